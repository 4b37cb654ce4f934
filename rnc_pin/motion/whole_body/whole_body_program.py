"""Common part of the whole-body programs, tasks, limits, description and report; the program at velocity level.

``VelocityQP`` solves one quadratic program per sample in the reduced velocities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import partial
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import (
    DescribedMixin,
    Description,
    LimitedAcceleration,
    MissedGoal,
    State,
    VelocityTarget,
    elapsed_time,
    nested,
)
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.io.json import Json, to_json
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import NotNegative, check_positive_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.whole_body.limit_stack import LimitStack
from rnc_pin.motion.whole_body.limits.control_limit import AccelerationLimit, ControlLimit, ControlSample
from rnc_pin.motion.whole_body.task_hierarchy import MotionMetric, TaskStack, solve_within
from rnc_pin.motion.whole_body.tasks import ControlTask, DampingTask, PostureTask
from rnc_pin.verdict import GOAL_TOLERANCE, MOSTLY, Finding, FindingKind, Severity


class LimitReport(NamedTuple):
    """Effect of the limits at a sample."""

    active: tuple[str, ...]
    """Limits that change the motion."""
    exceeded: Mapping[str, float]
    """Limits that gave way, with the amounts, because they excluded each other."""
    worst: Mapping[str, float]
    """The same since the start, with the largest amounts."""


class SampleCount(NamedTuple):
    """Samples of a run to which the same happened."""

    samples: int = 0
    first: float | None = None
    """Time of the first one [s]."""
    reason: str = ""
    """Reason at that time."""

    def and_one(self, t: float, reason: str) -> SampleCount:
        """Count one more sample; none without a reason."""
        if not reason:
            return self
        # Later reasons mostly follow from the first one.
        first = (t, reason) if self.first is None else (self.first, self.reason)
        return SampleCount(self.samples + 1, *first)

    def findings(
        self, kind: FindingKind, where: str, what: str, samples: int, fails: float = np.inf
    ) -> tuple[Finding, ...]:
        """Return the finding of these samples; none without any.

        Args:
            kind, where: kind of the finding, and the part of the program.
            what: what happened in these samples.
            samples: number of samples of the run.
            fails: share of the run above which it fails.
        """
        if not self.samples:
            return ()
        share = self.samples / max(samples, 1)
        first = f"first at t = {self.first or 0.0:.3f} s: {self.reason}"
        message = f"{what} in {self.samples} of {samples} samples, {first}"
        severity = Severity.FAILS if share > fails else Severity.DEGRADES
        return (Finding(kind, where, share, "", self.first, severity, message),)


@runtime_checkable
class ProgramRecord(Protocol):
    """Record that the states of all programs have."""

    multipliers: Float[Array, "levels k"]
    excess: Float[Array, " k"]
    worst_excess: Float[Array, " k"]
    unsolved: SampleCount


class WholeBodyProgram(DescribedMixin):
    """Tasks as least squares and limits as inequalities, for one model.

    Args:
        reduced: the model.
        tasks, limits: the tasks and limits.
        resting: as of ``TaskStack``.
    """

    def __init__(
        self, reduced: ReducedModel, tasks: Sequence[ControlTask], limits: Sequence[ControlLimit], resting: int = 0
    ) -> None:
        self.tasks, self.limits = tuple(tasks), tuple(limits)
        self._reduced = reduced
        self._metric, self._limits = MotionMetric(reduced), LimitStack(self.limits, reduced)
        self._tasks = TaskStack(self.tasks, reduced, resting, self._metric)
        # The record of a run compares outputs with the goals of the tasks that have them.
        self._followed = [
            (place, [names.index(name) for name in own], [bound.followed.names.index(name) for name in own], bound)
            for bound in self._tasks.bound
            for place, names in enumerate((reduced.vertical.names, reduced.reducing.names))
            if bound.followed is not None and (own := [name for name in bound.followed.names if name in names])
        ]
        first = min((task.priority for task in tasks), default=0)
        alone = all(isinstance(task, PostureTask | DampingTask) for task in tasks)
        pairs = list(zip(tasks, self._tasks.bound, strict=True))
        postures = [bound for task, bound in pairs if isinstance(task, PostureTask) and task.priority == first]
        # Postures are preferences, unless there is nothing else.
        self._goals = postures if alone else [bound for _, bound in pairs if bound.followed is not None]
        self.limit_names: tuple[str, ...] = self._limits.names
        """Names of the limits' rows, in the order of ``excess`` of the state."""

    @property
    def limited_accelerations(self) -> tuple[LimitedAcceleration, ...]:
        """Accelerations that the limits bound, for the verdict of a run."""
        limits = [each for each in self.limits if isinstance(each, AccelerationLimit)]
        return tuple(entry for limit in limits for entry in limit.entries(self._reduced))

    def describe(self) -> Description:
        """Return the settings of tasks and limits, and those of the program."""
        tasks, limits = ([_describe_item(each) for each in some] for some in (self.tasks, self.limits))
        return {**super().describe(), "tasks": tasks, "limits": limits}

    def _configuration(self, measurement: Measurement) -> Float[Array, " nq"]:
        if measurement.q is None:
            raise InputError("a whole-body controller reads the configuration: the measurement has no q")
        return measurement.q

    def _check_velocity(self, v2: Array) -> None:
        if np.shape(v2) != (self._reduced.r,):
            raise InputError(
                f"a whole-body controller takes one state: v2 has shape {np.shape(v2)}, expected ({self._reduced.r},)"
            )

    def _desired(self, t: float) -> tuple[Array | None, Array | None]:
        """Goals of x1 and x2 at a time, NaN for outputs without a task; None if no task has an output."""
        if not self._followed:
            return None, None
        # A zero would look like a goal in the record: outputs without a task have none.
        found = np.full(self._reduced.vertical.size, np.nan), np.full(self._reduced.r, np.nan)
        for place, where, own, bound in self._followed:
            found[place][where] = bound.reference.at(t).position[own]
        return found

    def findings(self, state: State, samples: int) -> tuple[Finding, ...]:
        """Return findings about the steps so far: programs that were not solved, limits that excluded each other.

        Args:
            state: state of the program, or of a controller around it.
            samples: number of steps.
        """
        own = next(each for each in nested(state) if isinstance(each, ProgramRecord))
        what = "the program was not solved"
        found = own.unsolved.findings(FindingKind.UNSOLVED, "program", what, samples, MOSTLY)
        # The largest amount since the start: a limit that gave way for one sample was exceeded.
        for name, amount in self.report(own).worst.items():
            message = f"limit {name} gave way by up to {amount:.3g}, because limits excluded each other"
            found += (Finding(FindingKind.LIMIT_GAVE_WAY, name, amount, "", None, Severity.DEGRADES, message),)
        return found

    def goal_errors(self, t: float, q: Float[Array, " nq"], v: Float[Array, " nv"]) -> dict[str, float]:
        """Return the distances from the goals of the tasks by name; of several goals of one name, the largest.

        Args:
            t, q, v: time [s], configuration and velocity.
        """
        errors: dict[str, float] = {}
        for each in self._goals:
            for name, error in each.errors(t, self._reduced.at(q).position, v).items():
                # Two tasks may follow the same output: its name then stands for both.
                errors[name] = max(error, errors.get(name, 0.0))
        return errors

    def missed_goals(self, t: float, q: Float[Array, " nq"], v2: Float[Array, " r"]) -> tuple[MissedGoal, ...]:
        """Return the goals that a run misses which ends in this state, for its verdict.

        Args:
            t, q, v2: time [s], configuration and reduced velocity.
        """
        return MissedGoal.of_errors(self.goal_errors(t, q, self._reduced.at(q, v2, t=t).v), GOAL_TOLERANCE)

    def report(self, state: State) -> LimitReport:
        """Return the limits that are active, and those that gave way."""
        names = self.limit_names
        # A limit changes the motion where it pushes at any level.
        active = tuple(names[place] for place in np.flatnonzero(np.any(state.multipliers, axis=0)))
        exceeded = [
            {name: float(value) for name, value in zip(names, values, strict=True) if value}
            for values in (state.excess, state.worst_excess)
        ]
        return LimitReport(active, *exceeded)


def program_of(controller: object) -> WholeBodyProgram | None:
    """Whole-body program that a controller is or contains as its ``target``; None without one."""
    return next((each for each in nested(controller) if isinstance(each, WholeBodyProgram)), None)


def _describe_item(description: ControlTask | ControlLimit) -> Json:
    """Settings of a task or a limit for the record."""
    settings = {each.name: _setting(getattr(description, each.name)) for each in fields(description)}
    return {"type": type(description).__name__, **settings}


def _setting(value: object) -> Json:
    """Numbers, text and mappings as they are, other objects by name."""
    # Parts of a setting, such as obstacles, are known to the reader by their names.
    if isinstance(value, list | tuple) and any(is_dataclass(item) for item in value):
        return [str(getattr(item, "name", repr(item))) for item in value]
    if is_dataclass(value):
        return repr(value)
    try:
        return to_json(value, "setting")
    except InputError:
        return type(value).__name__


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
            return VelocityTarget(v2, np.zeros_like(v2), x1, x2), state._replace(time=t)
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
