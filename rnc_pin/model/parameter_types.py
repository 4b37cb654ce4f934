"""Annotated types of parameters; type checkers read them, and scenario files are validated against them."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from math import isfinite
from typing import Annotated, Literal, get_args, get_type_hints

from annotated_types import Ge, Gt, Len

from rnc_pin.errors import ConfigurationError

Axis = Literal["x", "y", "z"]
"""Axis of a frame."""
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Vector = Annotated[Sequence[float], Len(3, 3)]
"""Components along x, y and z."""
Numbers = Annotated[Sequence[float], Len(1)]
"""One or more numbers."""


_BOUNDS = {"gt": ("above", operator.gt), "ge": ("at least", operator.ge), "lt": ("below", operator.lt)}


def check_settings(settings: object) -> None:
    """Raise an error unless the attributes of an object are finite and within the bounds of their annotated types.

    None is valid.

    Raises:
        ConfigurationError: one is not.
    """
    for name, hint in get_type_hints(type(settings), include_extras=True).items():
        value, annotated = getattr(settings, name), [hint, *get_args(hint)]
        marks = [mark for each in annotated for mark in getattr(each, "__metadata__", ())]
        bounds = [(*_BOUNDS[kind], getattr(mark, kind)) for mark in marks for kind in _BOUNDS if hasattr(mark, kind)]
        valid = value is None or not bounds or isfinite(value)
        if not (valid and all(value is None or holds(value, bound) for _, holds, bound in bounds)):
            words = " and ".join(f"{word} {bound}" for word, _, bound in bounds)
            raise ConfigurationError(f"{name} of {type(settings).__name__} has to be {words}, found {value}")


def check_positive_settings(**numbers: float | None) -> None:
    """Raise an error unless numbers, by name of their parameter, are positive and finite. None is valid.

    Raises:
        ConfigurationError: one is not.
    """
    for name, value in numbers.items():
        if value is not None and not 0 < value < float("inf"):
            raise ConfigurationError(f"{name}: expected a positive number, found {value:g}")
