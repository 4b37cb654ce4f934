"""Cached properties whose arrays are read-only."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar, overload

import numpy as np

_Value = TypeVar("_Value")


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
