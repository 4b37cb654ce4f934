"""Check of a reference before a run: distance to singular configurations, friction demand and lift-off."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from rnc_pin.analysis import Grip, LiftOff, NormalForces
from rnc_pin.control import KinematicController
from rnc_pin.control.typical_inertia import AWAY_FROM_SINGULAR
from rnc_pin.errors import ConstraintError, DivergenceError, SimulationError, SingularityError, few
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.printing import printed
from rnc_pin.references.reference import TaskReference
from rnc_pin.simulation.rollout import Margin, Rollout, RolloutEvaluation, class_1_controller, kinematic_rollout

_LARGEST_TIME_SCALE = 64.0
_CLOSE = 1e-3
_FEWEST = 5  # smallest number of configurations for accelerations by differences


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
        lifted = _complaint(self.lift_off)
        if self.used <= 1.0 + _CLOSE:
            return lifted
        slower = f"slow it down {self.time_scale:.3g} times"
        remedy = slower if np.isfinite(self.time_scale) else "it slips at any speed"
        return [
            f"the reference needs {self.used:.3g} times the grip that '{self.contact}' has, at t = {self.time:.2f} s; "
            f"{remedy}",
            *lifted,
        ]


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


@printed()
@dataclass(frozen=True)
class Margins:
    """Result of a preflight.

    Attributes:
        stack: margin of ``E = [A; J2]``; at zero, x2 does not parametrize the motion.
        A4: margin of A4; at zero, the redundant outputs cannot move the vertical ones. None without such a task.
        singular: error that ended the roll-out early, with its time; None if it did not.
        time: times (N,) of the roll-out [s].
        q: configurations (N, nq) of the roll-out.
        grip: friction demand of the wheels; None without ``grip``, or if the roll-out ended early.
        lift_off: first contact that lifts off the ground. None if none does, if the roll-out ended early, or if the
            actuators cannot produce the motion.
    """

    stack: Margin
    A4: Margin | None
    singular: SimulationError | None
    time: np.ndarray
    q: np.ndarray
    grip: FrictionDemand | None = None
    lift_off: LiftOff | None = None

    def complaints(self, threshold: float = 0.01) -> list[str]:
        """Reasons against the reference, as text; empty if all margins are above the threshold."""
        if self.singular is not None:
            return [f"the reference reaches a singular configuration: {self.singular}"]
        return [
            f"the reference comes close to a singular configuration: smallest singular value of {what} is "
            f"{margin.value:.2g} at t = {margin.time:.2f} s ({few(margin.rows, 4)}); {AWAY_FROM_SINGULAR}"
            for margin, what in ((self.stack, "E = [A; J2]"), (self.A4, "A4"))
            if margin is not None and margin.value < threshold
        ] + (_complaint(self.lift_off) if self.grip is None else self.grip.complaints())


def _complaint(lift_off: LiftOff | None) -> list[str]:
    return [] if lift_off is None else [str(lift_off)]


def preflight(
    reduced: ReducedModel,
    task: Task,
    reference: TaskReference,
    q0: np.ndarray,
    duration: float | None = None,
    dt: float = 0.02,
    grip: Grip | None = None,
) -> Margins:
    """Roll out a reference by kinematics, without dynamics, and return the singular value margins.

    Args:
        reduced: reduced model.
        task: task of the outputs.
        reference: desired x21 and x1.
        q0: initial configuration (nq,).
        duration: duration of the roll-out [s]; by default until the reference is at rest.
        dt: step of the roll-out [s].
        grip: friction of the ground, for the friction demand of the wheels.

    Raises:
        SingularityError: the initial configuration is singular.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> x2 = [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")]
        >>> reduced = system.reduce(reducing=x2, vertical=[rnc.JointPosition("platform")])
        >>> task = rnc.Task.of(reduced, primary=["tip_x", "tip_y"], redundant=["joint_1"])
        >>> q0 = robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
        >>> x1, (x, y, _) = reduced.at(q0).outputs()
        >>> outwards = rnc.planning.MinimumJerk([x, y], [1.3 * x, 1.3 * y], duration=4.0)  # the arm is almost straight
        >>> margins = rnc.preflight(reduced, task, rnc.planning.TaskReference(outwards, rnc.planning.Hold(x1)), q0)
        >>> round(margins.stack.value, 3), round(margins.stack.time, 1)  # smallest singular value, and its time
        (0.025, 4.0)
    """
    duration = reference.duration if duration is None else duration
    return margins_along(reduced, class_1_controller(task, reference), q0, duration, dt, task, grip)


def margins_along(
    reduced: ReducedModel,
    controller: KinematicController,
    q0: np.ndarray,
    duration: float,
    dt: float = 0.02,
    task: Task | None = None,
    grip: Grip | None = None,
) -> Margins:
    """Preflight of any kinematic controller.

    Args:
        reduced: reduced model.
        controller: controller whose velocities the roll-out follows exactly.
        q0: initial configuration (nq,).
        duration: duration of the roll-out [s].
        dt: step of the roll-out [s].
        task: task whose A4 is checked too; None if the controller does not invert A4.
        grip: friction of the ground, for the friction demand of the wheels.

    Raises:
        SingularityError: the initial configuration is singular.
    """
    rollout, singular = _rollout_until_singular(reduced, controller, q0, duration, dt)
    along, demand, lift_off = RolloutEvaluation(reduced, *rollout), None, None
    A4 = None if task is None else along.A4_margin(task)
    if singular is None and len(rollout.q) >= _FEWEST:
        if grip is not None:
            demand = friction_demand(along, grip)
            lift_off = demand.lift_off
        else:
            with suppress(ConstraintError):  # forces are unknown if the actuators cannot produce the motion
                lift_off = along.lift_off(NormalForces(reduced))
    return Margins(along.stack_margin(), A4, singular, rollout.time, rollout.q, demand, lift_off)


def _rollout_until_singular(
    reduced: ReducedModel, controller: KinematicController, q0: np.ndarray, duration: float, dt: float
) -> tuple[Rollout, SimulationError | None]:
    """Return the roll-out, and the error that ended it early, if any."""
    try:
        return kinematic_rollout(reduced, controller, q0, duration, dt), None
    except (SingularityError, DivergenceError) as error:
        if not isinstance(error.trajectory, Rollout):
            raise
        return error.trajectory, error
