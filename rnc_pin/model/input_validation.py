"""Validation of input arrays and of parameters: shape, finite numbers, normalization, and bounds by annotated types.

Type checkers read the annotated types of parameters, and scenario files are validated against them.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from math import isfinite
from numbers import Real
from sys import float_info
from typing import Annotated, Literal, TypeAlias, TypeGuard, get_args, get_type_hints

import numpy as np
import pinocchio as pin
from annotated_types import Ge, Gt, Len

from rnc_pin.errors import ConfigurationError, InputError, few, printable, short_text
from rnc_pin.math.linear_algebra import Component
from rnc_pin.robots.robot import Robot

_FLOAT = np.dtype(float)
ArrayInput: TypeAlias = object
"""Argument of any type. Values that are no real numbers are refused."""


def admit_configurations(q: ArrayInput, robot: Robot) -> np.ndarray:
    """Copy of configurations (..., nq) of finite numbers, unit complex numbers and unit quaternions.

    Later changes of the caller's array have no effect.

    Args:
        q: configurations (..., nq).
        robot: the robot that has the configurations.
    """
    if robot.model.nq != robot.nq:
        robot.check_unchanged()
    q = vector(q, robot.nq, "q").copy()
    states = (q,) if q.ndim == 1 else q.reshape(-1, robot.nq)
    # Only pairs (cos, sin) and quaternions have more entries than their velocities.
    if robot.nq != robot.nv and not all(pin.isNormalized(robot.model, each, 1e-6) for each in states):
        raise InputError("q holds a (cos, sin) pair or a quaternion that is not of unit length")
    return q


def admit_configuration(q: ArrayInput, robot: Robot, name: str = "q") -> np.ndarray:
    """Copy of one configuration (nq,), as ``admit_configurations``.

    Args:
        q: the configuration (nq,).
        robot: the robot that has the configuration.
        name: the input in messages.
    """
    found = admit_configurations(q, robot)
    if found.ndim > 1:
        raise InputError(f"{name} has shape {found.shape}, expected one configuration ({robot.nq},)")
    return found


def vector(array: ArrayInput, size: int, name: str, entries: Sequence[str] = ()) -> np.ndarray:
    """Convert an input to a float array (..., size) of finite numbers; an error about its size names the entries.

    Args:
        array: the input.
        size: length of the last axis.
        name: the input in messages.
        entries: names of its entries.
    """
    if type(array) is not np.ndarray or array.dtype is not _FLOAT:
        array = admit_numbers(array, name)
    one = array.shape == (size,)
    if not one and (array.ndim == 0 or array.shape[-1] != size):
        of = f" for {few(entries, 6)}" if entries else ""
        raise InputError(f"{name} has shape {array.shape}, expected (..., {size}){of}")
    # For few numbers the sum is faster than array functions.
    if not (one and isfinite(sum(array.tolist()))):
        check_finite(name, array)
    return array


def own_vector(array: ArrayInput, size: int, name: str) -> np.ndarray:
    """Convert an input of one state to a new float array (size,) of finite numbers; the caller may change its own.

    Args:
        array: the input.
        size: its length.
        name: the input in messages.
    """
    found = vector(array, size, name)
    if found.ndim > 1:
        raise InputError(f"{name} has shape {found.shape}, expected ({size},)")
    return found.copy()


def admit_times(t: ArrayInput, batch: tuple[int, ...]) -> Component:
    """Convert a time, or times of states (...), to a finite number or an array of them.

    Args:
        t: the input [s].
        batch: leading axes of the states.

    Raises:
        InputError: t is not finite, or has another shape than the states.
    """
    times = numbers_of(t, "t")
    if times.shape not in ((), batch):
        raise InputError(f"t has shape {times.shape}, expected one number or {batch}")
    if not np.isfinite(times).all():
        raise InputError("t holds values that are not finite")
    return times if times.ndim else float(times)


def numbers_of(array: ArrayInput, name: str) -> np.ndarray:
    """Convert an input to a new float array of any shape.

    Args:
        array: the input.
        name: the input in messages.

    Raises:
        InputError: the input does not consist of numbers.
    """
    return np.array(admit_numbers(array, name))


def admit_numbers(array: ArrayInput, name: str) -> np.ndarray:
    """Convert an input to a float array of any shape, which may be the input.

    Args:
        array: the input.
        name: the input in messages.

    Raises:
        InputError: the input does not consist of real numbers; text, truth values, objects and masked arrays do not.
    """
    try:
        found = np.asarray(array)
    except (TypeError, ValueError):
        found = np.zeros((), dtype=object)
    masked = any(each.__name__ == "MaskedArray" for each in type(array).__mro__)  # an import of numpy.ma takes long
    # Truth values and text would convert to numbers without an error; a mask would be lost.
    if found.dtype.kind not in "fiu" or masked:
        raise InputError(f"{name} is not an array of numbers: {printable(repr(array), 60)}")
    return found.astype(float, copy=False)


def numbers_or_nan(values: object) -> np.ndarray:
    """Return a copy of values as floats; NaN if they are no numbers, which the check of the values then refuses too.

    Args:
        values: the input; None among them is NaN.
    """
    try:
        return np.array(values, dtype=float)
    except (TypeError, ValueError):
        return np.array(np.nan)


def check_finite(name: str, array: np.ndarray) -> None:
    """Raise ``InputError`` if an array contains NaN or infinite values.

    Args:
        name: the array in messages.
        array: (..., size).
    """
    finite = np.isfinite(array).all(axis=-1)
    if not finite.all():
        first = np.unravel_index(int(np.argmin(finite)), finite.shape) if finite.ndim else ()
        values = np.array2string(array[first], precision=4, separator=", ", max_line_width=10**6, threshold=10**6)
        where = f" at state {', '.join(str(int(i)) for i in first)}" if finite.ndim else ""
        raise InputError(f"{name} holds values that are not finite{where}: {values}")


def admit_states(
    q: np.ndarray, v: ArrayInput, size: int, name: str, entries: Sequence[str] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Configurations, and a copy of velocities as ``vector`` admits them, with the same leading axes.

    Args:
        q: admitted configurations (..., nq).
        v: velocities (..., size).
        size: length of their last axis.
        name: the velocities in messages.
        entries: names of their entries.
    """
    # A copy: later changes of the caller's array must not change the evaluation.
    v = vector(v, size, name, entries).copy()
    if q.shape[:-1] == v.shape[:-1]:
        return q, v
    try:
        batch = np.broadcast_shapes(v.shape[:-1], q.shape[:-1])
    except ValueError:
        raise InputError(f"q of shape {q.shape} and {name} of shape {v.shape} do not broadcast") from None
    # The kernel walks through memory, which broadcast arrays do not have.
    wide = (np.ascontiguousarray(np.broadcast_to(each, (*batch, each.shape[-1]))) for each in (q, v))
    return next(wide), next(wide)


# ------------------------------------------------------------------ parameters

Axis = Literal["x", "y", "z"]
"""Axis of a frame."""
Axes = Literal["x", "y", "z", "xy", "yx", "xz", "zx", "yz", "zy", "xyz", "xzy", "yxz", "yzx", "zxy", "zyx"]
"""Several axes, each at most once."""
Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Vector = Annotated[Sequence[float], Len(3, 3)]
"""Components along x, y and z."""
Numbers = Annotated[Sequence[float], Len(1)]
"""One or more numbers."""


_BOUNDS = {
    "gt": ("above", operator.gt), "ge": ("at least", operator.ge), "lt": ("below", operator.lt),
    "le": ("at most", operator.le),
}  # fmt: skip


def is_number(value: object) -> TypeGuard[float]:
    """True for a finite number. Text is none, even if it is the text of a number, and True is none.

    Args:
        value: any object.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    return bool(-float_info.max <= value <= float_info.max)  # Python's integers have no bound


def is_count(value: object, least: int = 0) -> TypeGuard[int]:
    """True for an integer of at least ``least``.

    Args:
        value: any object.
        least: smallest valid integer.
    """
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(value >= least)


def check_settings(settings: object) -> None:
    """Raise an error unless the attributes of an object are finite and within the bounds of their annotated types.

    None is valid where the type has it. Attributes whose type is an integer with bounds have to be integers.

    Args:
        settings: object with annotated attributes.

    Raises:
        ConfigurationError: one is not.
    """
    for name, hint in get_type_hints(type(settings), include_extras=True).items():
        value, annotated = getattr(settings, name), [hint, *get_args(hint)]
        # Bounds stand in the annotations, as ``Annotated[float, Gt(0)]``.
        marks = [mark for each in annotated for mark in getattr(each, "__metadata__", ())]
        # In a union with None the integer stands below the annotation: ``Annotated[int, Gt(0)] | None``.
        whole = int in (getattr(each, "__origin__", each) for each in annotated)
        bounds = [(*_BOUNDS[kind], getattr(mark, kind)) for mark in marks for kind in _BOUNDS if hasattr(mark, kind)]
        unset = value is None and type(None) in annotated
        valid = unset or not bounds or (is_number(value) and (not whole or is_count(value)))
        if not (valid and all(unset or holds(value, bound) for _, holds, bound in bounds)):
            words = " and ".join(f"{word} {bound}" for word, _, bound in bounds)
            what = "an integer, " if whole else ""
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
    # A single object is the usual mistake: then the message shows it, and none of its parts.
    entries = list(values) if isinstance(values, Iterable) and not isinstance(values, str) else [None]
    if not all(isinstance(each, kind) for each in entries):
        wrong = next(each for each in entries if not isinstance(each, kind)) if len(entries) > 1 else values
        raise ConfigurationError(f"{name}: expected a list of {kind.__name__} objects, found {short_text(wrong)}")
