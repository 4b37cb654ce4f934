"""Friction demand of wheels along a motion, and the time scale at which they do not slip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.analysis import Grip, LiftOff
from rnc_pin.control import KinematicController, RedundancyController
from rnc_pin.errors import InfeasibleError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.planning import Slowed, TaskReference
from rnc_pin.simulation.rollout import kinematic_rollout

_SLOWEST = 64.0
_CLOSE = 1e-3
_TRIES = 6
_OUTER_GAIN = 2.0  # [1/s]


@dataclass(frozen=True)
class GripNeeded:
    """Friction demand of a motion.

    Attributes:
        used: largest friction use of a contact: demanded force over available friction. Above 1 the contact slips.
        contact: name of that contact.
        time: time of the largest use [s].
        slower: smallest time scale (duration factor) at which no contact slips. It is 1 if no contact slips now, and
            infinite if one slips even at rest.
        lift_off: first contact that lifts off the ground; None if none does.
    """

    used: float
    contact: str
    time: float
    slower: float
    lift_off: LiftOff | None = None

    def complaints(self) -> list[str]:
        """Reasons why the ground cannot support the motion, as text; empty if there are none."""
        lifted = [] if self.lift_off is None else [str(self.lift_off)]
        if self.used <= 1.0 + _CLOSE:
            return lifted
        slower = f"slow it down {self.slower:.3g} times" if np.isfinite(self.slower) else "it slips at any speed"
        return [
            f"the reference needs {self.used:.3g} times the grip that '{self.contact}' has, at t = {self.time:.2f} s; "
            f"{slower}",
            *lifted,
        ]


def grip_along(reduced: ReducedModel, grip: Grip, times: np.ndarray, path: np.ndarray) -> GripNeeded:
    """Friction demand of a sampled motion, such as the result of ``kinematic_rollout`` or ``preflight``.

    Velocities and accelerations are central differences. A time scale s divides velocities by s and accelerations by
    s^2. It divides all forces by s^2, except those of gravity.

    Args:
        reduced: reduced model.
        grip: friction and loads.
        times: evenly spaced times (N,), at least five [s].
        path: configurations (N, nq).

    Raises:
        ConstraintError: the actuators cannot produce these accelerations.
    """
    inner, v2, v2_dot = rates_along(reduced, times, path)

    def used(slower: float) -> np.ndarray:
        return grip.used_by(inner, v2 / slower, v2_dot / slower**2)

    now = used(1.0)
    when, which = np.unravel_index(int(np.argmax(now)), now.shape)
    largest = float(now[when, which])
    slower = 1.0 if largest <= 1.0 + _CLOSE else _least(lambda s: float(used(s).max()), np.sqrt(largest))
    lifted = grip.lift_off(times[1:-1], inner, v2, v2_dot)
    return GripNeeded(largest, grip.names[int(which)], float(times[1 + int(when)]), slower, lifted)


def rates_along(
    reduced: ReducedModel, times: np.ndarray, path: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inner configurations (N - 2, nq) of a path, reduced velocities and accelerations (N - 2, r) by differences."""
    model, dt = reduced.robot.model, float(times[1] - times[0])
    v = np.array([pin.difference(model, before, after) for before, after in zip(path, path[2:], strict=False)])
    inner = path[1:-1]
    v2 = reduced.at(inner, v=v / (2 * dt)).v2
    return inner, v2, np.gradient(v2, dt, axis=0)


def _least(used: Callable[[float], float], guess: float) -> float:
    """Smallest time scale s with ``used(s) <= 1``. The guess is exact if only inertial forces act."""
    if not guess <= _SLOWEST:
        guess = _SLOWEST
    low, high = 1.0, guess
    if abs(used(guess) - 1.0) < 1e-9:
        return float(guess)
    while used(high) > 1.0:
        if high >= _SLOWEST:
            return np.inf
        low, high = high, min(2 * high, _SLOWEST)
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
    slower, slowed = 1.0, reference
    for _ in range(_TRIES):
        target = (
            RedundancyController(task, slowed.primary, slowed.vertical, k3=_OUTER_GAIN, k21=_OUTER_GAIN)
            if controller is None
            else controller(slowed)
        )
        needed = grip_along(reduced, grip, *kinematic_rollout(reduced, target, q0, slowed.duration, dt * slower))
        if needed.used <= 1.0 + _CLOSE:
            return slowed
        slower *= needed.slower
        if not np.isfinite(slower):
            break
        slowed = TaskReference(Slowed(reference.primary, slower), Slowed(reference.vertical, slower))
    raise InfeasibleError("; ".join(needed.complaints()))
