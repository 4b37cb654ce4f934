"""Checks of a loop's state before the loop resumes from it. The state may come from an untrusted file."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from rnc_pin.errors import InputError
from rnc_pin.loop.loop_state import LoopState
from rnc_pin.loop.velocity import VelocityEstimate
from rnc_pin.model.input_validation import ConfigurationValidator
from rnc_pin.model.reduced_model import ReducedModel

_LARGEST = 1e15
"""Largest valid absolute value of a time, velocity or input."""


def check_state(state: LoopState, reduced: ReducedModel) -> None:
    """Check the types, shapes and values of a loop's state. ``check_memory`` checks the controller's state.

    Args:
        state: state of a loop.
        reduced: model of the loop.

    Raises:
        InputError: names the field and the expected value.
    """
    if not isinstance(state, LoopState):
        raise InputError(f"expected a LoopState, found {type(state).__name__}")
    for name in ("begin", "time", "invalid_since"):
        value = getattr(state, name)
        if value is not None and (isinstance(value, bool) or not _is_number(value)):
            raise InputError(f"{name} is not a finite number: {_shown(value)}")
    nq, nv = reduced.robot.nq, reduced.n
    fields = [("v2", state.v2, reduced.r), ("integrals", state.integrals, reduced.r)]
    fields += [("T", state.T, reduced.p), ("input_deficit", state.input_deficit, reduced.p), ("q", state.q, nq)]
    if state.motion is not None:
        if not isinstance(state.motion, VelocityEstimate):
            raise InputError(f"motion is not a VelocityEstimate: {_shown(state.motion)}")
        fields += [("motion.q", state.motion.q, nq), ("motion.v", state.motion.v, nv)]
        fields += [("motion.other", state.motion.other, nv)]
    for name, value, size in fields:
        optional = not name.startswith("motion.")
        if value is not None or not optional:
            _check_vector(name, value, size)
    validator = ConfigurationValidator(reduced.robot)
    for q in (state.q, None if state.motion is None else state.motion.q):
        if q is not None:
            validator.validate(q)
    if state.fault is not None and not isinstance(state.fault, str):
        raise InputError(f"fault is not text: {_shown(state.fault)}")
    if not isinstance(state.failed, bool):
        raise InputError(f"failed is not a boolean: {_shown(state.failed)}")


def _check_vector(name: str, value: Any, size: int) -> None:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise InputError(f"{name} is not an array of numbers: {_shown(value)}")
    if value.shape != (size,):
        raise InputError(f"{name} has shape {value.shape}, expected ({size},)")
    wrong = np.flatnonzero(~(np.abs(value) <= _LARGEST))
    if len(wrong):
        raise InputError(f"{name}[{wrong[0]}] is {value[wrong[0]]:g}, expected at most {_LARGEST:g}")


def check_memory(found: Any, initial: Any, after: Any, where: str = "controller") -> None:
    """Check the stored state of a controller against two valid states.

    Args:
        found: stored state.
        initial: initial state of the controller.
        after: state after one step from ``found``. If its shape differs from that of ``initial``, it is a history: the
            first axis may have any length.
        where: name of the field, for error messages.

    Raises:
        InputError: the type or shape differs, or a number is not finite.
    """
    models = [each for each in (initial, after) if each is not None]
    if found is None or (not models and not isinstance(found, tuple | dict | np.ndarray | float | int | str)):
        return
    if isinstance(found, dict):
        _check_kind(found, models, where)
        for key, value in found.items():
            check_memory(value, _item(initial, key), _item(after, key), f"{where}.{key}")
    elif isinstance(found, tuple):
        _check_kind(found, models, where)
        for place, (name, value) in enumerate(zip(getattr(found, "_fields", range(len(found))), found, strict=True)):
            check_memory(value, _item(initial, place), _item(after, place), f"{where}.{name}")
    elif isinstance(found, str):
        if models and not any(isinstance(each, str) for each in models):
            raise InputError(f"{where} is text: {_shown(found)}")
    else:
        _check_numbers(found, initial, after, where)


def _check_kind(found: Any, models: list[Any], where: str) -> None:
    if models and not any(type(each) is type(found) for each in models):
        raise InputError(f"{where} is a {type(found).__name__}, expected a {type(models[0]).__name__}")


def _item(model: Any, key: Any) -> Any:
    """Return ``model[key]``; None if there is no such item."""
    if isinstance(model, dict):
        return model.get(key)
    return model[key] if isinstance(model, tuple) and key < len(model) else None


def _check_numbers(found: Any, initial: Any, after: Any, where: str) -> None:
    given = [each for each in (initial, after) if each is not None]
    models = [each for each in given if not isinstance(each, str | tuple | dict)]
    if given and not models:
        raise InputError(f"{where} is a number or an array, expected a {type(given[0]).__name__}")
    # An initial state may use NaN for unknown values.
    unknown = any(each is initial and np.isnan(each).any() for each in models)
    if not unknown and not _is_number(found):
        raise InputError(f"{where} is not finite")
    shapes = [np.shape(each) for each in models]
    if not shapes or np.shape(found) in shapes:
        return
    varies = len({*shapes}) > 1
    if not varies or np.ndim(found) != len(shapes[-1]) or np.shape(found)[1:] != shapes[-1][1:]:
        raise InputError(f"{where} has shape {np.shape(found)}, expected {shapes[0]}")


def _is_number(value: Any) -> bool:
    """True if the value is a finite number or an array of them."""
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.kind in "fiub" and bool(np.isfinite(value).all())
    try:
        return isinstance(value, float | int) and isfinite(value)
    except OverflowError:
        return False


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else f"{text[:57]}..."
