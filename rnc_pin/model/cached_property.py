"""Values that are computed once: properties, whose arrays become read-only, and values of a model."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Generic, TypeVar, overload
from weakref import WeakKeyDictionary

import numpy as np

_Value = TypeVar("_Value")
_Model = TypeVar("_Model")


class cached_property(Generic[_Value]):
    """Property that is computed once, without the lock of ``functools.cached_property`` on Python 3.11.

    Arrays become read-only: writing to one raises an error and cannot change the owner.
    """

    def __init__(self, compute: Callable[..., _Value]) -> None:
        self._compute, self._name = compute, compute.__name__
        self.__doc__ = compute.__doc__

    @overload
    def __get__(self, owner: None, kind: type) -> cached_property[_Value]: ...

    @overload
    def __get__(self, owner: object, kind: type) -> _Value: ...

    def __get__(self, owner: object | None, kind: type) -> cached_property[_Value] | _Value:
        if owner is None:
            return self
        value = self._compute(owner)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        setattr(owner, self._name, value)
        return value


def once_per_model(function: Callable[[_Model], _Value]) -> Callable[[_Model], _Value]:
    """Return a function that keeps its value as long as the model exists. The value has to be immutable.

    Args:
        function: function of the structure of a model, such as its contacts, not of its parameters.
    """
    known: WeakKeyDictionary[_Model, _Value] = WeakKeyDictionary()

    @wraps(function)
    def value(reduced: _Model) -> _Value:
        if reduced not in known:
            known[reduced] = function(reduced)
        return known[reduced]

    return value
