"""Actuator inputs of a controller's command."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from rnc_pin.control.controller import Command, State, VelocityTarget
from rnc_pin.errors import DivergenceError, InputError
from rnc_pin.loop.options import type_name
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

_REMEDY = "put a controller of forces over it, such as rnc.control.VelocityTracker(it) or ComputedTorque(reduced, it)"


def unpack_step(answer: Any) -> tuple[Command, State]:
    """Return the command and the new state from the answer of a controller's step.

    Raises:
        InputError: the answer is not a pair.
    """
    try:
        command, state = answer
    except (TypeError, ValueError):
        raise InputError(_no_command(answer)) from None
    return command, state


def input_of(reduced: ReducedModel, state: StateEvaluation, command: Command) -> np.ndarray:
    """Actuator inputs (p,) of a command.

    Raises:
        InputError: not a command; neither F nor T, or both; or a wrong shape.
        DivergenceError: the inputs are not finite.
        ConstraintError: the actuators cannot produce its F.
    """
    try:
        F, T = command.F, command.T
    except AttributeError:
        raise InputError(_no_command(command)) from None
    if (F is None) == (T is None):
        raise InputError(f"a command has to give either F or T, found {'neither' if F is None else 'both'}")
    if T is None:
        return state.allocate(F)
    T = np.asarray(T, dtype=float)
    if T.shape != (reduced.p,):
        raise InputError(f"the T of a command has shape {T.shape}, expected ({reduced.p},)")
    if not (isfinite(sum(T.tolist())) or np.isfinite(T).all()):  # the sum of finite inputs may be too large
        raise DivergenceError("the inputs T of a command are not finite")
    return T


def _no_command(answer: Any) -> str:
    """Error message for an answer that is not a command."""
    if isinstance(answer, VelocityTarget):
        return f"the controller decides velocities, not forces: {_REMEDY}"
    return f"step of a controller has to return a Command and its state, found {type_name(answer)}"
