"""Whether wheels hold on along a motion, and how much slower it has to be for them to."""

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
    """What a motion needs of the ground.

    Attributes:
        used: largest share of the grip that a contact uses; more than 1 slips.
        contact: which.
        time: when [s].
        slower: factor by which the same motion would have to take longer for every contact to hold: 1 where it holds as
            it is, infinite where it does not even hold at rest.
        lift_off: the first contact of all that the motion would lift off the ground; None where all hold.
    """

    used: float
    contact: str
    time: float
    slower: float
    lift_off: LiftOff | None = None

    def complaints(self) -> list[str]:
        """What speaks against the motion, in words; nothing where the grip will do."""
        lifted = [] if self.lift_off is None else [str(self.lift_off)]
        if self.used <= 1.0 + _CLOSE:
            return lifted
        slower = (
            f"{self.slower:.3g} times slower it would do" if np.isfinite(self.slower) else "at no speed it would do"
        )
        return [
            f"the reference needs {self.used:.3g} times the grip that '{self.contact}' has, at t = {self.time:.2f} s; "
            f"{slower}",
            *lifted,
        ]


def grip_along(reduced: ReducedModel, grip: Grip, times: np.ndarray, path: np.ndarray) -> GripNeeded:
    """What a motion needs that is known by configurations, as ``kinematic_rollout`` or ``preflight`` gives it.

    Rates and accelerations are central differences. Slower by s, rates are smaller by s and accelerations by its
    square; so are the forces but for those of gravity.

    Args:
        reduced: the model.
        grip: friction and loads.
        times: evenly spaced (N,), at least five [s].
        path: configurations (N, nq).

    Raises:
        ConstraintError: no inputs give these accelerations.
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
    """Configurations (N - 2, nq) inside a path, with reduced velocities and accelerations (N - 2, r) by differences."""
    model, dt = reduced.robot.model, float(times[1] - times[0])
    v = np.array([pin.difference(model, before, after) for before, after in zip(path, path[2:], strict=False)])
    inner = path[1:-1]
    v2 = reduced.at(inner, v=v / (2 * dt)).v2
    return inner, v2, np.gradient(v2, dt, axis=0)


def _least(used: Callable[[float], float], guess: float) -> float:
    """The smallest factor with which no more than everything is used: the guess, where inertia alone is at work."""
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
    """A reference slowed down as a whole until every contact holds along its roll-out.

    Args:
        reduced: the model.
        task: its outputs.
        reference: desired x21 and x1; it ends at some time.
        q0: initial configuration (nq,).
        grip: friction and loads.
        dt: step of the roll-out [s].
        controller: what follows it; class 1 by default.

    Returns:
        The reference as it was where it holds.

    Raises:
        InfeasibleError: no slowing down is enough; what an initial error asks for does not slow down.
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
