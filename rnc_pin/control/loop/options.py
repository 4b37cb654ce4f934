"""Checks of the options of a control loop, of its controller, and of the commands of the controller."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Literal, TypedDict, TypeVar

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.control.controller import Command, Controller, State, VelocityTarget
from rnc_pin.errors import ConfigurationError, DivergenceError, InputError
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

ControllerOrFactory = Controller | Callable[[Measurement], Controller]
"""Controller, or a function from the first measurement to one."""

_REMEDY = "put a controller of forces over it, such as rnc.control.VelocityTracker(it) or ComputedTorque(reduced, it)"
_T = TypeVar("_T")


class LoopOptions(TypedDict, total=False):
    """Keyword options of ``ControlLoop``; see there."""

    velocity: Literal["measured", "filtered", "observer"]
    cutoff: float | None
    limits: bool | Float[Array, " p"]
    fallback: Literal["hold", "brake", "zero", "raise"]
    timeout: float | None
    max_speed: float
    min_singular_value: float
    brake: float


def admit_model(reduced: object) -> ReducedModel:
    """Return the argument if it is a reduced model.

    Raises:
        ConfigurationError: it is not one.
    """
    if isinstance(reduced, ReducedModel):
        return reduced
    hint = ": call reduce() of it" if hasattr(reduced, "reduce") else ""
    raise ConfigurationError(f"expected a ReducedModel, found {type_name(reduced)}{hint}")


def admit_controller(controller: _T, of_measurement: bool = False) -> _T:
    """Return the argument if it is a controller.

    With ``of_measurement`` it may also be a function from the first measurement to a controller.

    Raises:
        ConfigurationError: it is neither.
    """
    if isinstance(controller, type):
        raise ConfigurationError(f"the controller is the class {controller.__name__}: pass an instance of it")
    if isinstance(controller, Controller) or (of_measurement and callable(controller)):
        return controller
    raise ConfigurationError(
        "expected a controller with initial_state and step, such as those of rnc.control, "
        f"found {type_name(controller)}"
    )


def admit_limits(reduced: ReducedModel, limits: bool | Array) -> Array | None:
    """Input limits (p,); None without limits.

    Raises:
        ConfigurationError: not a boolean and not p non-negative numbers.
    """
    if isinstance(limits, bool):
        return reduced.actuation.limits if limits and np.isfinite(reduced.actuation.limits).any() else None
    try:
        given = np.asarray(limits, dtype=float)
    except (TypeError, ValueError):
        given = np.full(1, np.nan)
    if given.shape != (reduced.p,) or not (given >= 0).all():
        raise ConfigurationError(f"limits of a loop have to be {reduced.p} non-negative numbers")
    return given


def check_number(option: str, value: object, zero: bool = False) -> None:
    """Raise an error unless the value is a positive number. Infinity is valid, except for dt.

    Raises:
        ConfigurationError: names the option.
    """
    number = value if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool) else -1
    if (number > 0 or (zero and number == 0)) and not (option == "dt" and number == np.inf):
        return
    wanted = "a number that is not negative" if zero else "positive"
    raise ConfigurationError(f"{option} of a loop has to be {wanted}, found {value!r}")


def check_choice(option: str, value: object, valid: tuple[str, ...]) -> None:
    """Raise an error unless the value is valid.

    Raises:
        ConfigurationError: names the option and the valid values.
    """
    if value not in valid:
        raise ConfigurationError(f"{option} of a loop: expected one of {', '.join(valid)}, found {value!r}")


def unpack_step(answer: tuple[Command, State]) -> tuple[Command, State]:
    """Return the command and the new state from the answer of a controller's step.

    Raises:
        InputError: the answer is not a pair.
    """
    try:
        command, state = answer
    except (TypeError, ValueError):
        raise InputError(_no_command(answer)) from None
    return command, state


def input_of(reduced: ReducedModel, state: StateEvaluation, command: Command) -> Array:
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


def _no_command(answer: object) -> str:
    """Error message for an answer that is not a command."""
    if isinstance(answer, VelocityTarget):
        return f"the controller decides velocities, not forces: {_REMEDY}"
    return f"step of a controller has to return a Command and its state, found {type_name(answer)}"


def type_name(thing: object) -> str:
    """Name of the type of an object, for error messages."""
    return "None" if thing is None else f"a {type(thing).__name__}"
