"""Kinematic roll-out, a motion that follows a velocity target exactly without dynamics, and what it tells before a run.

The model along the roll-out gives the distance to singular configurations, the friction demand and lift-off, and the
gains of a tracker that are scaled to the inertia.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin import control
from rnc_pin.analysis import Grip, LiftOff, NormalForces, first_lift_off
from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Command
from rnc_pin.control.gain_design import AWAY_FROM_SINGULAR, gravity_loads
from rnc_pin.errors import ConstraintError, DivergenceError, InputError, SimulationError, SingularityError, few
from rnc_pin.math.linear_algebra import weakest_rows
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.configuration_evaluation import ConfigurationEvaluation
from rnc_pin.model.input_validation import is_number, numbers_of, vector
from rnc_pin.model.integrators import LieRungeKutta4
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.task import Task
from rnc_pin.printing import printed
from rnc_pin.references.reference import TaskReference
from rnc_pin.simulation.sampled_run import run_error

_LARGEST_TIME_SCALE = 64.0
_CLOSE = 1e-3
_FEWEST = 5  # smallest number of configurations for accelerations by differences
_DESIGN, _STEP = control.GainDesign(), 0.05  # [s], of the roll-out


@printed()
class Rollout(NamedTuple):
    """Sampled motion of a kinematic roll-out."""

    time: np.ndarray
    """(N,) [s]"""
    q: np.ndarray
    """(N, nq)"""


def kinematic_rollout(
    reduced: ReducedModel, target: control.KinematicController, q0: np.ndarray, duration: float, dt: float = 0.02
) -> Rollout:
    """Integrate the kinematics under ``v2 = v2d``, without dynamics. Return times (N,) and configurations (N, nq).

    Args:
        reduced: reduced model.
        target: kinematic controller.
        q0: initial configuration (nq,).
        duration: duration [s].
        dt: step [s]; it can be large, because there are no dynamics.

    Raises:
        SingularityError, DivergenceError: the reference reaches a singular configuration, or its rates grow without
            bound near one. The error has the time, and the roll-out so far in ``error.trajectory``.
        SimulationError: the target raises an error, which becomes the cause; ``error.trajectory`` as above.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> swing = rnc.planning.MinimumJerk(np.zeros(3), [0.5, 0.0, 0.0], duration=1.0)
        >>> target = rnc.control.ReducingOutputController(reduced, swing)
        >>> times, path = rnc.kinematic_rollout(reduced, target, robot.configuration(), duration=1.0)
        >>> path[-1, :2].round(2)  # the platform reacts to the arm
        array([-0.47,  0.5 ])
    """
    if not (is_number(duration) and is_number(dt) and duration >= 0 and dt > 0):
        raise InputError(f"duration {duration!r} and dt {dt!r} have to be positive numbers")
    integrator, r = LieRungeKutta4(reduced.robot), reduced.r
    q, y, v2, t = numbers_of(q0, "q0"), np.zeros(r), np.zeros(r), 0.0
    state = target.initial_state(reduced.at(q, v2, t=t).measure(y))
    times, path = [0.0], [q]

    def velocity(here: StateEvaluation, integrals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        desired = vector(target.step(t, here.measure(integrals), state)[0].v2, r, "v2")
        return here.velocity(desired), desired

    def rate(p: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        v, desired = velocity(reduced.at(p, v2, t=float(x[r])), x[:r])
        return v, np.append(desired, 1.0)

    try:
        for sample in range(1, round(duration / dt) + 1):
            # Targets use v2 only for their rates, so the last known v2 is sufficient.
            here = reduced.at(q, v2, t=t)
            command, next_state = target.step(t, here.measure(y), state)
            if isinstance(command, Command):
                raise InputError("it gives forces, not velocities: expected a kinematic controller")
            v2 = vector(command.v2, r, "v2")
            # The first stage of the step is at this very state: it is not evaluated twice.
            v, desired = velocity(StateEvaluation(here, v2=v2), y)
            # The time is a state too: each stage asks the target at its own time.
            q, x = integrator.step(rate, q, np.append(y, t), dt, (v, np.append(desired, 1.0)))
            state, t, y = next_state, sample * dt, x[:r]
            # Each step leaves closed loops and heights by its error, and such errors add up.
            q = reduced.assembly.project(q, t=t)
            times.append(t)
            path.append(q)
    except Exception as error:
        failure = run_error(error, "the target", t)
        failure.trajectory = Rollout(np.array(times), np.stack(path))
        raise failure  # noqa: B904 (run_error sets the cause)
    return Rollout(np.array(times), np.stack(path))


@printed()
@dataclass(frozen=True)
class Margin:
    """Smallest singular value along a reference.

    Attributes:
        value: smallest singular value of the stack E with unit rows, or of A4.
        time: time of the minimum [s].
        q: configuration (nq,) of the minimum.
        rows: names of the rows that are almost dependent there: constraints and outputs of E, or vertical outputs.
    """

    value: float
    time: float
    q: np.ndarray
    rows: tuple[str, ...] = ()


class RolloutEvaluation:
    """Model along a sampled motion, such as a ``Rollout``. Each quantity is computed once, on first use.

    Velocities and accelerations are central differences. They exist at the inner samples, all but the first and last.

    Args:
        reduced: reduced model.
        times: evenly spaced times (N,) [s]; velocities need at least five.
        path: configurations (N, nq).

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> times = np.linspace(0.0, 1.0, 11)
        >>> path = np.array([robot.configuration({"root_joint": [0.5 * t**2, 0.0, 0.0]}) for t in times])
        >>> evaluation = rnc.simulation.RolloutEvaluation(reduced, times, path)
        >>> evaluation.states.v2[-1].round(6), evaluation.v2_dot[4].round(6)  # speed t at 0.9 s, acceleration 1 m/s^2
        (array([0.9, 0. ]), array([1., 0.]))
        >>> evaluation.inputs[4].round(6)  # the force is the mass of the sleigh
        array([2., 0.])
    """

    def __init__(self, reduced: ReducedModel, times: np.ndarray, path: np.ndarray) -> None:
        self._reduced, self._times, self._path = reduced, times, path

    @cached_property
    def configurations(self) -> ConfigurationEvaluation:
        """Model at all samples (N,)."""
        return self._reduced.at(self._path, t=self._times)

    @property
    def inner_times(self) -> Float[Array, " N-2"]:
        """Times of the inner samples [s]."""
        return self._times[1:-1]

    @cached_property
    def states(self) -> StateEvaluation:
        """Model at the inner samples (N - 2,), with velocities that satisfy the constraints."""
        model, path = self._reduced.robot.model, self._path
        change = np.array([pin.difference(model, before, after) for before, after in zip(path, path[2:], strict=False)])
        # Differences of samples violate the rows by their error; v2 alone keeps the admissible part of them.
        by_differences = self._reduced.at(path[1:-1], v=change / (2 * self._dt), t=self.inner_times)
        return StateEvaluation(by_differences, v2=by_differences.v2)

    @cached_property
    def v2_dot(self) -> Float[Array, "N-2 r"]:
        """Reduced accelerations at the inner samples."""
        return np.gradient(self.states.v2, self._dt, axis=0)

    @cached_property
    def inputs(self) -> Float[Array, "N-2 p"]:
        """Actuator inputs at the inner samples.

        Raises:
            ConstraintError: the actuators cannot produce these accelerations.
        """
        return self.states.allocate(self.states.inverse_dynamics(self.v2_dot))

    @property
    def _dt(self) -> float:
        return float(self._times[1] - self._times[0])

    def slowed(self, time_scale: float) -> tuple[StateEvaluation, Float[Array, "N-2 p"]]:
        """Return states and inputs of the inner samples for a motion that takes ``time_scale`` times as long.

        Args:
            time_scale: duration over that of the roll-out.

        Raises:
            ConstraintError: the actuators cannot produce these accelerations.
        """
        # On the same path velocities fall with the time scale, accelerations with its square, and gravity stays.
        states = StateEvaluation(self.states, v2=self.states.v2 / time_scale)
        return states, states.allocate(states.inverse_dynamics(self.v2_dot / time_scale**2))

    def stack_margin(self) -> Margin:
        """Return the smallest singular value of ``E = [A; J2]`` with scaled rows."""
        at = self.configurations
        return self._margin(np.asarray(at.smallest_singular_value), at.dependent_rows)

    def A4_margin(self, task: Task) -> Margin:
        """Return the smallest singular value of a task's A4.

        Args:
            task: task with as many redundant outputs as vertical ones.
        """
        # All samples in one array: one call of the decomposition for the whole way.
        A4 = self.configurations.A_star[:, task.vertical][:, :, task.redundant]
        smallest = np.linalg.svd(A4, compute_uv=False)[:, -1]
        return self._margin(smallest, lambda index: weakest_rows(A4[index], task.vertical_names))

    def lift_off(self, normal: NormalForces) -> LiftOff | None:
        """Return the first contact that lifts off the ground; None if none does.

        Args:
            normal: normal forces of the model.

        Raises:
            ConstraintError: the actuators cannot produce these accelerations.
        """
        # Before the inputs, which need actuators that can produce the motion.
        if not normal.contacts:
            return None
        return first_lift_off(self.inner_times, normal.at(self.states, self.inputs), normal.names)

    def _margin(self, values: np.ndarray, rows: Callable[[int], tuple[str, ...]]) -> Margin:
        index = int(np.argmin(values))
        return Margin(float(values[index]), float(self._times[index]), self._path[index], rows(index))


# ---------------------------------------------------------------------- before a run


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
        # Gravity may need more than the grip at rest: then no time scale helps.
        slower = f"slow it down {self.time_scale:.3g} times"
        remedy = slower if np.isfinite(self.time_scale) else "it slips at any speed"
        need = f"the reference needs {self.used:.3g} times the grip that '{self.contact}' has, at t = {self.time:.2f} s"
        return [f"{need}; {remedy}", *lifted]


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
    # The worst contact at the worst time: one that slips moves the robot off its way.
    now = grip.used_at(rollout.states, rollout.inputs)
    when, which = np.unravel_index(int(np.argmax(now)), now.shape)
    used, time, time_scale = float(now[when, which]), float(rollout.inner_times[when]), 1.0
    if used > 1.0 + _CLOSE:
        # Inertial forces fall with the square of the time scale: where gravity has no part, its root is exact.
        time_scale = _least_time_scale(lambda s: float(grip.used_at(*rollout.slowed(s)).max()), np.sqrt(used))
    return FrictionDemand(used, grip.names[int(which)], time, time_scale, rollout.lift_off(grip.normal))


def _least_time_scale(used: Callable[[float], float], guess: float) -> float:
    """Smallest time scale s with ``used(s) <= 1``. The guess is exact if only inertial forces act."""
    high = min(guess, _LARGEST_TIME_SCALE)
    rounding = 1e-9
    if abs(used(high) - 1.0) < rounding:
        return float(high)
    # Slower motions need less friction, down to what gravity needs at rest.
    while used(high) > 1.0:
        if high >= _LARGEST_TIME_SCALE:
            return np.inf
        high = min(2 * high, _LARGEST_TIME_SCALE)
    return float(scipy.optimize.brentq(lambda s: used(s) - 1.0, 1.0, high, rtol=rounding))


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
        """Reasons against the reference, as text; empty if all margins are above the threshold.

        Args:
            threshold: singular value below which a configuration counts as close to a singular one.
        """
        close = [
            f"the reference comes close to a singular configuration: smallest singular value of {what} is "
            f"{margin.value:.2g} at t = {margin.time:.2f} s ({few(margin.rows, 4)}); {AWAY_FROM_SINGULAR}"
            for margin, what in ((self.stack, "E = [A; J2]"), (self.A4, "A4"))
            if margin is not None and margin.value < threshold
        ]
        # A run that diverges later did so because of the configuration that it was close to.
        if self.singular is not None and not (close and isinstance(self.singular, DivergenceError)):
            return [f"the reference reaches a singular configuration: {self.singular}"]
        return close + (_complaint(self.lift_off) if self.grip is None else self.grip.complaints())


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
    follower = control.RedundancyController(task, reference.primary, reference.vertical)
    return margins_along(reduced, follower, q0, duration, dt, task, grip)


def margins_along(
    reduced: ReducedModel,
    controller: control.KinematicController,
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
    singular: SimulationError | None = None
    try:
        rollout = kinematic_rollout(reduced, controller, q0, duration, dt)
    except (SingularityError, DivergenceError) as error:
        if not isinstance(error.trajectory, Rollout):
            raise
        # The margins of the motion up to there show how it came about.
        rollout, singular = error.trajectory, error
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


# ---------------------------------------------------------------------- gains


def tuned_tracker(
    reduced: ReducedModel,
    kinematic: control.KinematicController,
    q0: np.ndarray,
    duration: float,
    dt: float = 0.002,
    *,
    along: control.KinematicController | None = None,
    design: control.GainDesign = _DESIGN,
    gravity_compensation: bool | None = None,
) -> control.VelocityTracker:
    """Construct the adaptive velocity tracker of a kinematic controller, for ``simulate``.

    A kinematic roll-out, without dynamics, gives the configurations of the motion. The gains are scaled to the inertia
    at these configurations. The tracker itself does not use the model.

    Args:
        reduced: reduced model.
        kinematic: kinematic controller that gives the desired velocities.
        q0: initial configuration (nq,).
        duration: duration of the roll-out [s]; use that of the references.
        dt: sampling period [s], the same as for ``simulate``.
        along: kinematic controller for the roll-out instead of ``kinematic``, if that one is adaptive.
        design: choice of the gains; scaled to the inertia by default.
        gravity_compensation: True starts the tracker with the force that holds the system at rest at q0, as the
            actuators would report it. This is the default where gravity loads the outputs.

    Raises:
        InfeasibleError: no gains fit both the inertia and the sampling.
        SingularityError: the references reach a singular configuration; the error has the time.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> swing = rnc.planning.MinimumJerk(np.zeros(3), [0.5, 0.0, 0.0], duration=1.0)
        >>> target = rnc.control.ReducingOutputController(reduced, swing)
        >>> tracker = rnc.tuned_tracker(reduced, target, robot.configuration(), duration=1.0)
        >>> run = rnc.simulate(reduced, tracker, robot.configuration(), duration=1.2)
        >>> bool(abs(run.x2[-1, 0] - 0.5) < 0.01)
        True
    """
    times, region = kinematic_rollout(reduced, along or kinematic, q0, duration, _STEP)
    # The range of the inertia along the way decides, so that the steps of the roll-out may be long.
    gains = control.design_velocity_gains(reduced, region, dt, design, times=times)
    if gravity_compensation is None:
        gravity_compensation = gravity_loads(reduced, q0)
    rest = np.zeros(reduced.r)
    force = reduced.inverse_dynamics(q0, rest, rest) if gravity_compensation else None
    return control.VelocityTracker(kinematic, gains, force)
