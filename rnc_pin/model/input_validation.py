"""Validation of input arrays: shape, finite numbers and normalization."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from rnc_pin.errors import InputError, few, printable
from rnc_pin.math.components import Component
from rnc_pin.robots.robot import Robot

ArrayInput: TypeAlias = object
"""Argument of any type. Values that NumPy does not convert to a float array are refused."""


class ConfigurationValidator:
    """Validation of a robot's configurations: shape, finite numbers, unit complex numbers and unit quaternions.

    Args:
        robot: the robot that has the configurations.
    """

    def __init__(self, robot: Robot) -> None:
        self._model, self._nq, self._shape = robot.model, robot.nq, (robot.nq,)
        self._on_spheres = any(joint.nq != joint.nv for joint in list(robot.model.joints)[1:])

    def validate(self, q: ArrayInput) -> np.ndarray:
        """Validated copy of q (..., nq), so that later changes of the caller's array have no effect."""
        try:
            q = np.array(q, float)  # by position: a keyword costs as much as the call
        except (TypeError, ValueError):
            raise _not_numbers("q", q) from None
        if q.shape == self._shape:  # one state, on the hot path
            if not isfinite(sum(q.tolist())):
                check_finite("q", q)
            if self._on_spheres and not pin.isNormalized(self._model, q, 1e-6):
                raise _NOT_OF_UNIT_LENGTH
            return q
        if q.ndim == 0 or q.shape[-1] != self._nq:
            raise InputError(f"q has shape {q.shape}, expected (..., {self._nq})")
        check_finite("q", q)
        if self._on_spheres and not all(pin.isNormalized(self._model, q_i, 1e-6) for q_i in q.reshape(-1, self._nq)):
            raise _NOT_OF_UNIT_LENGTH
        return q


_NOT_OF_UNIT_LENGTH = InputError("q holds a (cos, sin) pair or a quaternion that is not of unit length")


def vector(array: ArrayInput, size: int, name: str, entries: Sequence[str] = ()) -> np.ndarray:
    """Convert an input to a float array (..., size) of finite numbers; an error about its size names the entries."""
    try:
        array = np.asarray(array, float)
    except (TypeError, ValueError):
        raise _not_numbers(name, array) from None
    if array.shape == (size,):
        if not isfinite(sum(array.tolist())):  # for few numbers this is faster than array functions
            check_finite(name, array)
        return array
    if array.ndim == 0 or array.shape[-1] != size:
        of = f" for {few(entries, 6)}" if entries else ""
        raise InputError(f"{name} has shape {array.shape}, expected (..., {size}){of}")
    check_finite(name, array)
    return array


def own_vector(array: ArrayInput, size: int, name: str) -> np.ndarray:
    """Convert an input of one state to a new float array (size,) of finite numbers; the caller may change its own."""
    found = vector(array, size, name)
    if found.ndim > 1:
        raise InputError(f"{name} has shape {found.shape}, expected ({size},)")
    return found.copy()


def admit_times(t: ArrayInput, batch: tuple[int, ...]) -> Component:
    """Convert a time, or times of states (...), to a finite number or an array of them.

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

    Raises:
        InputError: the input does not consist of numbers.
    """
    try:
        return np.array(array, float)
    except (TypeError, ValueError):
        raise _not_numbers(name, array) from None


def _not_numbers(name: str, array: ArrayInput) -> InputError:
    return InputError(f"{name} is not an array of numbers: {printable(repr(array), 60)}")


def check_finite(name: str, array: np.ndarray) -> None:
    """Raise ``InputError`` if an array contains NaN or infinite values."""
    finite = np.isfinite(array).all(axis=-1)
    if not finite.all():
        first = np.unravel_index(int(np.argmin(finite)), finite.shape) if finite.ndim else ()
        values = np.array2string(array[first], precision=4, separator=", ", max_line_width=10**6, threshold=10**6)
        where = f" at state {', '.join(str(int(i)) for i in first)}" if finite.ndim else ""
        raise InputError(f"{name} holds values that are not finite{where}: {values}")


def broadcast_states(q: np.ndarray, beside: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Broadcast configurations and velocities to the same leading axes."""
    if q.shape[:-1] == beside.shape[:-1]:
        return q, beside
    try:
        batch = np.broadcast_shapes(beside.shape[:-1], q.shape[:-1])
    except ValueError:
        raise InputError(f"q of shape {q.shape} and {name} of shape {beside.shape} do not broadcast") from None
    wide = (np.ascontiguousarray(np.broadcast_to(each, (*batch, each.shape[-1]))) for each in (q, beside))
    return next(wide), next(wide)
