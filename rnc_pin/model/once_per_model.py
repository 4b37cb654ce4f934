"""Properties of a reduced model that functions of other packages compute, once for each model."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TypeVar
from weakref import WeakKeyDictionary

from rnc_pin.model.reduced_model import ReducedModel

_Value = TypeVar("_Value")


def once_per_model(function: Callable[[ReducedModel], _Value]) -> Callable[[ReducedModel], _Value]:
    """Return a function that keeps its value as long as the model exists. The value has to be immutable.

    Args:
        function: function of the structure of a model, such as its contacts, not of its parameters.
    """
    known: WeakKeyDictionary[ReducedModel, _Value] = WeakKeyDictionary()

    @wraps(function)
    def value(reduced: ReducedModel) -> _Value:
        if reduced not in known:
            known[reduced] = function(reduced)
        return known[reduced]

    return value
