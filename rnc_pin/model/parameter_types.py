"""Annotated types of parameters; type checkers read them, and scenario files are validated against them."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from numbers import Real
from sys import float_info
from typing import Annotated, Literal, TypeGuard, get_args, get_type_hints

import numpy as np
from annotated_types import Ge, Gt, Len

from rnc_pin.errors import ConfigurationError, short_text

Axis = Literal["x", "y", "z"]
"""Axis of a frame."""
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Vector = Annotated[Sequence[float], Len(3, 3)]
"""Components along x, y and z."""
Numbers = Annotated[Sequence[float], Len(1)]
"""One or more numbers."""


_BOUNDS = {"gt": ("above", operator.gt), "ge": ("at least", operator.ge), "lt": ("below", operator.lt)}


def is_number(value: object) -> TypeGuard[float]:
    """True for a finite number. Text is none, even if it is the text of a number, and True is none."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    return bool(-float_info.max <= value <= float_info.max)  # Python's integers have no bound


def is_count(value: object, least: int = 0) -> TypeGuard[int]:
    """True for an integer of at least ``least``."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(value >= least)


def check_settings(settings: object) -> None:
    """Raise an error unless the attributes of an object are finite and within the bounds of their annotated types.

    None is valid. Attributes whose type is an integer with bounds have to be integers.

    Raises:
        ConfigurationError: one is not.
    """
    for name, hint in get_type_hints(type(settings), include_extras=True).items():
        value, annotated = getattr(settings, name), [hint, *get_args(hint)]
        marks = [mark for each in annotated for mark in getattr(each, "__metadata__", ())]
        bounds = [(*_BOUNDS[kind], getattr(mark, kind)) for mark in marks for kind in _BOUNDS if hasattr(mark, kind)]
        valid = value is None or not bounds or (is_number(value) and (int not in annotated or is_count(value)))
        if not (valid and all(value is None or holds(value, bound) for _, holds, bound in bounds)):
            words = " and ".join(f"{word} {bound}" for word, _, bound in bounds)
            what = "an integer, " if int in annotated else ""
            raise ConfigurationError(f"{name} of {type(settings).__name__} has to be {what}{words}, found {value!r}")


def check_positive_settings(**numbers: float | None) -> None:
    """Raise an error unless numbers, by name of their parameter, are positive and finite. None is valid.

    Raises:
        ConfigurationError: one is not.
    """
    for name, value in numbers.items():
        if value is not None and not (is_number(value) and value > 0):
            found = f"{value:g}" if isinstance(value, Real) else repr(value)
            raise ConfigurationError(f"{name}: expected a positive number, found {found}")


def check_instances(name: str, values: object, kind: type) -> None:
    """Raise an error unless an argument is a list or another sequence of objects of a class.

    Args:
        name: of the argument.
        values: the argument.
        kind: class of its entries.

    Raises:
        ConfigurationError: it is none, such as a single object.
    """
    entries = list(values) if isinstance(values, Iterable) and not isinstance(values, str) else [None]
    if not all(isinstance(each, kind) for each in entries):
        wrong = next(each for each in entries if not isinstance(each, kind)) if len(entries) > 1 else values
        raise ConfigurationError(f"{name}: expected a list of {kind.__name__} objects, found {short_text(wrong)}")
