"""Friction demand of wheels along a motion, and the time scale at which they do not slip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from rnc_pin.analysis import Grip, LiftOff
from rnc_pin.control import KinematicController
from rnc_pin.errors import InfeasibleError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.planning import Slowed, TaskReference
from rnc_pin.printing import printed
from rnc_pin.simulation.rollout import RolloutEvaluation, class_1_controller, kinematic_rollout

_LARGEST_TIME_SCALE = 64.0
_CLOSE = 1e-3
_TRIES = 6
_Attempt = TypeVar("_Attempt")


@printed()
@dataclass(frozen=True)
class FrictionDemand:
    """Friction demand of a motion.

    Attributes:
        used: largest friction use of a contact: demanded force over available friction. Above 1 the contact slips.
        contact: name of that contact.
        time: time of the largest use [s].
        time_scale: smallest duration factor at which no contact slips. It is 1 if no contact slips now, and infinite if
            one slips even at rest.
        lift_off: first contact that lifts off the ground; None if none does.
    """

    used: float
    contact: str
    time: float
    time_scale: float
    lift_off: LiftOff | None = None

    def complaints(self) -> list[str]:
        """Reasons why the ground cannot support the motion, as text; empty if there are none."""
        lifted = [] if self.lift_off is None else [str(self.lift_off)]
        if self.used <= 1.0 + _CLOSE:
            return lifted
        remedy = (
            f"slow it down {self.time_scale:.3g} times" if np.isfinite(self.time_scale) else "it slips at any speed"
        )
        return [
            f"the reference needs {self.used:.3g} times the grip that '{self.contact}' has, at t = {self.time:.2f} s; "
            f"{remedy}",
            *lifted,
        ]


def grip_along(reduced: ReducedModel, grip: Grip, times: np.ndarray, path: np.ndarray) -> FrictionDemand:
    """Friction demand of a sampled motion, such as the result of ``kinematic_rollout`` or ``preflight``.

    Args:
        reduced: reduced model.
        grip: friction and loads.
        times: evenly spaced times (N,), at least five [s].
        path: configurations (N, nq).

    Raises:
        ConstraintError: the actuators cannot produce these accelerations.
    """
    return friction_demand(RolloutEvaluation(reduced, times, path), grip)


def friction_demand(rollout: RolloutEvaluation, grip: Grip) -> FrictionDemand:
    """Friction demand along a roll-out.

    A time scale s divides velocities by s and accelerations by s^2. It divides all forces by s^2, except those of
    gravity.

    Args:
        rollout: the roll-out.
        grip: friction and loads.

    Raises:
        ConstraintError: the actuators cannot produce these accelerations.
    """
    now = grip.used_at(rollout.states, rollout.inputs)
    when, which = np.unravel_index(int(np.argmax(now)), now.shape)
    used = float(now[when, which])
    time_scale = 1.0
    if used > 1.0 + _CLOSE:
        time_scale = _least_time_scale(lambda s: float(grip.used_at(*rollout.slowed(s)).max()), np.sqrt(used))
    return FrictionDemand(
        used, grip.names[int(which)], float(rollout.inner_times[when]), time_scale, rollout.lift_off(grip.normal)
    )


def _least_time_scale(used: Callable[[float], float], guess: float) -> float:
    """Smallest time scale s with ``used(s) <= 1``. The guess is exact if only inertial forces act."""
    guess = guess if guess <= _LARGEST_TIME_SCALE else _LARGEST_TIME_SCALE
    low, high = 1.0, guess
    if abs(used(guess) - 1.0) < 1e-9:
        return float(guess)
    while used(high) > 1.0:
        if high >= _LARGEST_TIME_SCALE:
            return np.inf
        low, high = high, min(2 * high, _LARGEST_TIME_SCALE)
    while high - low > _CLOSE * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if used(middle) > 1.0 else (low, middle)
    return float(high)


def within_grip(
    reduced: ReducedModel,
    task: Task,
    reference: TaskReference,
    q0: np.ndarray,
    grip: Grip,
    dt: float = 0.02,
    controller: Callable[[TaskReference], KinematicController] | None = None,
) -> TaskReference:
    """Slow down a reference by one time scale until no contact slips along its roll-out.

    Args:
        reduced: reduced model.
        task: task of the outputs.
        reference: desired x21 and x1, of finite duration.
        q0: initial configuration (nq,).
        grip: friction and loads.
        dt: step of the roll-out [s].
        controller: function from the reference to the kinematic controller that follows it; class 1 by default.

    Returns:
        The slowed reference; the given one if no contact slips.

    Raises:
        InfeasibleError: no time scale is enough. The response to an initial error does not slow down.
    """
    follow = controller or partial(class_1_controller, task)

    def attempt(time_scale: float) -> tuple[TaskReference, FrictionDemand]:
        slowed = reference
        if time_scale != 1.0:
            slowed = TaskReference(Slowed(reference.primary, time_scale), Slowed(reference.vertical, time_scale))
        rollout = kinematic_rollout(reduced, follow(slowed), q0, slowed.duration, dt * time_scale)
        return slowed, grip_along(reduced, grip, *rollout)

    (slowed, demand), _ = iterate_time_scale(attempt, lambda result: result[1].time_scale)
    if demand.time_scale > 1.0:
        raise InfeasibleError("; ".join(demand.complaints()))
    return slowed


def iterate_time_scale(
    attempt: Callable[[float], _Attempt], further: Callable[[_Attempt], float]
) -> tuple[_Attempt, float]:
    """Slow a motion down until no contact slips.

    One factor may not suffice, because the feedback of an initial error does not slow down.

    Args:
        attempt: the motion at a time scale.
        further: time scale that an attempt still needs; 1 if no contact slips.

    Returns:
        The last attempt, and the product of all time scales.
    """
    time_scale = 1.0
    for _ in range(_TRIES):
        motion = attempt(time_scale)
        factor = further(motion)
        if factor == 1.0 or not np.isfinite(factor):
            break
        time_scale *= factor
    return motion, time_scale
