"""Whole-body controller at velocity level: one quadratic program per sample in the reduced velocities."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import VelocityTarget, elapsed_time
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import NotNegative, check_positive_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.whole_body.limits.control_limit import ControlLimit, ControlSample
from rnc_pin.motion.whole_body.task_hierarchy import solve_within
from rnc_pin.motion.whole_body.tasks import ControlTask
from rnc_pin.motion.whole_body.whole_body_program import SampleCount, WholeBodyProgram


class ProgramState(NamedTuple):
    """State of ``VelocityQP`` from one sample to the next."""

    time: float | None
    """Time of the last sample [s]."""
    interval: float
    """Duration for which the last sample planned [s]; zero if none was known."""
    v2: Float[Array, " r"]
    """Velocity commanded at the last sample."""
    v2_dot: Float[Array, " r"]
    """Its rate until the end of that sample."""
    multipliers: Float[Array, "levels k"]
    """Multipliers of the limits at each level of tasks; the next program starts from them."""
    excess: Float[Array, " k"]
    """Amount by which each limit gave way at the last sample; zero if it did not."""
    worst_excess: Float[Array, " k"]
    """Largest such amount since the start."""
    unsolved: SampleCount = SampleCount()
    """Samples whose program was not solved: they keep limits alone, or come to rest."""


class ProgramSolution(NamedTuple):
    """Solution of one program."""

    v2: Float[Array, " r"]
    """Velocity at the end of the sample."""
    multipliers: Float[Array, "levels k"]
    excess: Float[Array, " k"]
    unsolved: str = ""
    """Reason why the tasks are not solved."""


class VelocityQP(WholeBodyProgram):
    """Kinematic controller within limits: tasks as least squares, limits as inequalities, in ``v = R v2 + b``.

    The program has only the r reduced velocities as unknowns. So rolling, closed loops and momentum hold exactly. At
    each sample it decides the velocity at the sample's end, at the predicted configuration there. Until then the
    commanded velocity changes linearly: ``v2_dot`` is exactly its rate, and the next sample starts where this one ends.
    A sample that takes longer than planned holds the velocity of its planned end. A robot that holds a command over
    the sample, as under ``VelocityLoop``, gets the mean of both ends (``v2_held``): it moves as far, within the limits.

    If limits exclude each other, they give way in this order: soft limits of the largest ``priority`` first, then those
    of smaller ``priority``, each group by the least sum of squares. Hard limits (positions and velocities of joints)
    never give way to others: zero velocity satisfies them. ``report`` tells which limits gave way.

    Reads from the measurement: ``q``, and ``v2`` at the start.

    Args:
        reduced: the model.
        tasks: tasks from ``control.tasks``.
        limits: limits from ``control.limits``.
        dt: sampling interval [s]; by default the last interval predicts the next one, and the first sample keeps the
            measured velocity.
        damping: cost of the motion beside the tasks at every level, as the root of a weight: of rates of joints, and of
            speeds over the robot's length. It bounds the velocity near singular configurations; zero follows the tasks
            exactly.

    Raises:
        ModelError, ConfigurationError: a task or a limit does not fit the model.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> reach = rnc.control.tasks.OutputTask(rnc.FramePosition("tip", "xy"), rnc.planning.Hold([1.0, 1.0]))
        >>> slow = rnc.control.limits.JointVelocityLimit(joints=["joint_1", "joint_2"], limit=0.05)
        >>> controller = rnc.control.VelocityQP(reduced, [reach], [slow], dt=0.01)
        >>> start = reduced.at(robot.configuration({"joint_2": 1.0}), np.zeros(reduced.r)).measure()
        >>> target, state = controller.step(0.0, start, controller.initial_state(start))
        >>> controller.report(state).active
        ('joint_2 velocity',)
    """

    described = ("dt", "damping")

    def __init__(
        self,
        reduced: ReducedModel,
        tasks: Sequence[ControlTask],
        limits: Sequence[ControlLimit] = (),
        *,
        dt: float | None = None,
        damping: NotNegative = 0.0,
    ) -> None:
        check_positive_settings(dt=dt)
        if not 0 <= damping < np.inf:
            raise ConfigurationError(f"damping of a whole-body controller cannot be negative, found {damping}")
        self.dt, self.damping = dt, damping
        super().__init__(reduced, tasks, limits)

    def initial_state(self, measurement: Measurement) -> ProgramState:
        """Return the state before the first sample: the measured reduced velocity."""
        r, k = self._reduced.r, len(self.limit_names)
        v2 = np.zeros(r) if measurement.v2 is None else np.array(measurement.v2, dtype=float)
        self._check_velocity(v2)
        return ProgramState(None, 0.0, v2, np.zeros(r), np.zeros((len(self._tasks.ends), k)), *np.zeros((2, k)))

    def step(self, t: float, measurement: Measurement, state: ProgramState) -> tuple[VelocityTarget, ProgramState]:
        """Compute one sample.

        Raises:
            InputError: time runs backwards, or the measurement has no configuration.
            SingularityError: the reducing outputs do not parametrise the motion at the configuration.
        """
        q = self._configuration(measurement)
        elapsed = elapsed_time(t, state.time)
        # Commands continue from commands: the lag of a motor would otherwise slow each of them down.
        # A late sample finds the velocity of the planned end, which the robot has held since.
        v2 = state.v2 + min(elapsed, state.interval) * state.v2_dot
        dt = self.dt or elapsed or state.interval
        x1, x2 = self._desired(t)
        if not dt:  # the first sample: no interval is known
            still = state._replace(time=t)
            return VelocityTarget(v2, np.zeros_like(v2), x1, x2), still
        sample = ControlSample(self._reduced, t, q, v2, dt)
        solution = self.solve(sample, state.multipliers)
        v2_dot = (solution.v2 - v2) / dt
        # The state has the largest amounts, because a verdict reads the last state alone.
        worst = np.maximum(state.worst_excess, solution.excess)
        unsolved = state.unsolved.and_one(t, solution.unsolved)
        next_state = ProgramState(t, dt, v2, v2_dot, solution.multipliers, solution.excess, worst, unsolved)
        return VelocityTarget(v2, v2_dot, x1, x2, v2_held=v2 + 0.5 * dt * v2_dot), next_state

    def solve(self, sample: ControlSample, multipliers: Array | None = None) -> ProgramSolution:
        """Solve the program of one sample.

        Args:
            sample: the sample.
            multipliers: multipliers of the last program, (levels, k), to start from.
        """
        (levels, sampled), bounds = self._tasks.at(sample), self._limits.bounds(sample)
        # In unknowns of the metric, damping does not depend on the choice of the reducing outputs.
        to_v2 = self._metric.basis(sample.end.R).to_v2
        levels = levels._replace(jacobian=levels.jacobian.dot(to_v2))
        bounds = bounds._replace(rows=bounds.rows.dot(to_v2))
        rest = partial(np.zeros, self._reduced.r)  # hard limits allow it
        solved = solve_within(levels, bounds, self._limits, rest, self.damping, multipliers, sampled=sampled)
        return ProgramSolution(to_v2.dot(solved.unknowns), solved.multipliers, solved.excess, solved.unsolved)
