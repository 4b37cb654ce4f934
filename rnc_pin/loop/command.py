"""The inputs that a controller's command comes to."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from rnc_pin.control.protocol import Command, State, VelocityTarget
from rnc_pin.errors import DivergenceError, InputError
from rnc_pin.loop.options import named
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

_OVER_IT = "put a controller of forces over it, such as rnc.control.VelocityTracker(it) or ComputedTorque(reduced, it)"


def read_answer(answer: Any) -> tuple[Command, State]:
    """A command and the controller's state, of what its step returned.

    Raises:
        InputError: it returned something else.
    """
    try:
        command, state = answer
    except (TypeError, ValueError):
        raise InputError(_no_command(answer)) from None
    return command, state


def inputs_of(reduced: ReducedModel, state: StateEvaluation, command: Command) -> np.ndarray:
    """Actuator inputs (p,) of a command.

    Raises:
        InputError: it is none, or gives neither F nor T, or both, or of another size.
        DivergenceError: inputs that are not finite.
        ConstraintError: the actuators cannot produce its F.
    """
    try:
        F, T = command.F, command.T
    except AttributeError:
        raise InputError(_no_command(command)) from None
    if (F is None) == (T is None):
        raise InputError("a command has to give either F or T")
    if T is None:
        return state.allocate(F)
    T = np.asarray(T, dtype=float)
    if T.shape != (reduced.p,):
        raise InputError(f"the T of a command has shape {T.shape}, expected ({reduced.p},)")
    if not isfinite(sum(T.tolist())):
        raise DivergenceError("the controller asks for inputs without bound")
    return T


def _no_command(answer: Any) -> str:
    """Words for what a controller gave instead of a command."""
    if isinstance(answer, VelocityTarget):
        return f"the controller decides velocities, not forces: {_OVER_IT}"
    return f"step of a controller has to return a Command and its state, found {named(answer)}"
