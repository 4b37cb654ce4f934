"""Values that are computed once: properties, whose arrays become read-only, and values of a model."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from operator import attrgetter
from typing import Generic, TypeVar, overload
from weakref import WeakKeyDictionary

import numpy as np

_Owner = TypeVar("_Owner")
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


def filled_at_q(formula: Callable[[_Owner], _Value]) -> cached_property[_Value]:
    """Quantity of an evaluation: the array of its name in ``arrays_at_q``, or the formula where that has none.

    Args:
        formula: formula of the quantity.
    """
    return _filled("arrays_at_q", formula)


def filled_at_v(formula: Callable[[_Owner], _Value]) -> cached_property[_Value]:
    """The same with the array in ``arrays_at_v``.

    Args:
        formula: formula of the quantity.
    """
    return _filled("arrays_at_v", formula)


def _filled(where: str, formula: Callable[[_Owner], _Value]) -> cached_property[_Value]:
    arrays_of, name = attrgetter(where), formula.__name__

    @wraps(formula)
    def value(owner: _Owner) -> _Value:
        # None without a compiled kernel, or if it declined a state: then formulas give all quantities.
        arrays = arrays_of(owner)
        filled: _Value | None = None if arrays is None else getattr(arrays, name)
        return formula(owner) if filled is None else filled

    return cached_property(value)


def once_per_model(function: Callable[[_Model], _Value]) -> Callable[[_Model], _Value]:
    """Return a function that keeps its value as long as the model exists.

    Args:
        function: function of the structure of a model, such as its contacts, not of its parameters, or of a robot's
            kinematics.
    """
    known: WeakKeyDictionary[_Model, _Value] = WeakKeyDictionary()

    @wraps(function)
    def value(reduced: _Model) -> _Value:
        if reduced not in known:
            known[reduced] = function(reduced)
        return known[reduced]

    return value
