"""Options of a control loop, and checks of them, of its controller, and of the commands of the controller."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite
from typing import Literal, TypedDict

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Command, Controller, State, VelocityTarget
from rnc_pin.errors import ConfigurationError, DivergenceError, InputError, check_known, place_of
from rnc_pin.model.input_validation import NotNegative, Positive, is_number, numbers_of, numbers_or_nan
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

_REMEDY = "put a controller of forces over it, such as rnc.control.VelocityTracker(it) or ComputedTorque(reduced, it)"


class GuardOptions(TypedDict, total=False):
    """Keyword options that ``ControlLoop`` and ``VelocityLoop`` share: fields of ``LoopSettings``."""

    cutoff: float | None
    timeout: float | None
    max_speed: float
    min_singular_value: float
    brake: float
    deadline: float | None


class LoopOptions(GuardOptions, total=False):
    """Keyword options of ``ControlLoop``: fields of ``LoopSettings``."""

    velocity: Literal["measured", "observer"]
    limits: bool | Float[Array, " p"]
    fallback: Literal["hold", "brake", "zero", "raise"]


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """Options of a control loop.

    Attributes:
        velocity: "measured"; or "observer": estimated from configurations by a fading-memory filter, without lag at
            constant acceleration.
        cutoff: cutoff frequency of the velocity estimate [rad/s]; 0.3 / dt by default.
        limits: True clips inputs to the effort limits of the actuators, False does not clip; or limits (p,). The safe
            command and held inputs are always clipped. With False their limits are those of the actuators. The default
            of ``simulate`` and of scenarios is False: the plant clips, a ``ReducedPlant`` with ``actuator_limits``.
        fallback: safe command: "hold" the last inputs, "brake" (``F = -brake diag(H) v2``, with the inertia of the
            model), "zero", or "raise" the error. The default of
            ``simulate`` and of scenarios is "raise" on the reduced model without faults.
        timeout: time for which the last inputs are held while measurements are invalid [s]; five steps by default.
        max_speed: largest valid speed, of v and of the difference of two configurations over time [rad/s, m/s].
        min_singular_value: limit for the smallest singular value of E. Below it the loop fails with a
            SingularityError instead of a step.
        brake: decay rate of the velocities under "brake" [1/s].
        deadline: time that a step may take [s]. ``state.late`` counts the steps that take longer by the wall clock.

    Raises:
        ConfigurationError: an option has an invalid value.
    """

    velocity: Literal["measured", "observer"] = "measured"
    cutoff: Positive | None = None
    limits: bool | Float[Array, " p"] = True
    fallback: Literal["hold", "brake", "zero", "raise"] = "hold"
    timeout: Positive | None = None
    max_speed: Positive = 100.0
    min_singular_value: NotNegative = 0.0
    brake: Positive = 5.0
    deadline: Positive | None = None

    @classmethod
    def of_options(cls, options: LoopOptions) -> LoopSettings:
        """Return the settings of named options.

        Raises:
            ConfigurationError: an option has an unknown name, or an invalid value.
        """
        names = [each.name for each in fields(cls)]
        # By hand: the error of the constructor has no nearest name.
        for name in options:
            place_of(name, names, "loop: no option")
        return cls(**options)

    def __post_init__(self) -> None:
        check_known(self.fallback, ("hold", "brake", "zero", "raise"), "fallback of a loop")
        check_known(self.velocity, ("measured", "observer"), "velocity of a loop")
        for name in ("max_speed", "cutoff", "timeout", "min_singular_value", "brake", "deadline"):
            value = getattr(self, name)
            if value is not None:
                check_number(name, value, zero=name not in ("max_speed", "cutoff", "deadline"))


def check_reduced_model(reduced: object) -> None:
    """Raise an error unless the argument is a reduced model.

    Raises:
        ConfigurationError: it is none.
    """
    if not isinstance(reduced, ReducedModel):
        hint = ": call reduce() of it" if hasattr(reduced, "reduce") else ""
        raise ConfigurationError(f"expected a ReducedModel, found {type_name(reduced)}{hint}")


def check_controller(controller: object) -> None:
    """Raise an error unless the argument is a controller.

    Raises:
        ConfigurationError: it is none.
    """
    # A class has both methods, so the protocol would take it: it gets a message of its own.
    if isinstance(controller, type):
        raise ConfigurationError(f"the controller is the class {controller.__name__}: pass an instance of it")
    if not isinstance(controller, Controller):
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
        # Infinite limits clip nothing: None saves a comparison in each step.
        return reduced.actuation.limits if limits and np.isfinite(reduced.actuation.limits).any() else None
    given = numbers_or_nan(limits)
    if given.shape != (reduced.p,) or not (given >= 0).all():
        raise ConfigurationError(f"limits of a loop have to be {reduced.p} non-negative numbers")
    return given


def check_number(option: str, value: object, zero: bool = False) -> None:
    """Raise an error unless the value is a positive number. Infinity is valid, except for dt.

    Raises:
        ConfigurationError: names the option.
    """
    # Infinity switches a limit off, but no loop has an endless period.
    endless = option != "dt" and isinstance(value, float | np.floating) and value == np.inf
    if endless or (is_number(value) and (value > 0 or (zero and value == 0))):
        return
    wanted = "a number that is not negative" if zero else "positive"
    raise ConfigurationError(f"{option} of a loop has to be {wanted}, found {value!r}")


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
        T = state.allocate(F)
        # The model allocates blocks of forces too; a loop has one state at a time.
        if T.ndim > 1:
            raise InputError(f"the F of a command has shape {np.asarray(F).shape}, expected ({reduced.r},)")
        return T
    T = numbers_of(T, "the T of a command")  # the controller may use its memory again
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
