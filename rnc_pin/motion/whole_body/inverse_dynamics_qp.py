"""Whole-body controller at acceleration level: one quadratic program per sample in the actuator inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin import _kernel
from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import Command, State, elapsed_time, nested
from rnc_pin.math.linear_algebra import as_slice, clipped
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import Positive, check_positive_settings
from rnc_pin.model.integrators import DEFAULT_TOLERANCE, ReducedMotion
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import NO_EFFECT, StateEvaluation
from rnc_pin.motion.whole_body.braking_motion import BrakedSample, Braking, BrakingState
from rnc_pin.motion.whole_body.limit_stack import ContactBounds, ContactCones, ProgramBounds
from rnc_pin.motion.whole_body.limits.control_limit import (
    ControlLimit,
    ControlSample,
    LimitRows,
    known_state,
    turning_velocities,
)
from rnc_pin.motion.whole_body.task_hierarchy import MotionBasis, SampledDamping, TaskLevels, solve_within
from rnc_pin.motion.whole_body.tasks import ControlTask
from rnc_pin.motion.whole_body.whole_body_program import SampleCount, WholeBodyProgram
from rnc_pin.verdict import SHORTFALL, Finding, FindingKind, Severity

_CORRECTIONS = 4  # of the velocity at the end of a sample, each smaller by a factor of order dt
_BEYOND = 1e-9  # excess over a limit of motion that is rounding
_SLIGHT = 1e-4  # [rad/s, m/s] excess that tasks hardly feel if another program does not remove it
_DEPENDENT = 1e-4  # singular value of limits that act, relative to the largest, of which none is corrected
_MOST_STEPS = 64  # Runge-Kutta steps in a sample


class InverseDynamicsState(NamedTuple):
    """State of ``InverseDynamicsQP`` from one sample to the next."""

    time: float | None
    """Time of the last sample [s]."""
    multipliers: Float[Array, "levels k"]
    """Multipliers of the limits at each level of tasks; the next program starts from them."""
    excess: Float[Array, " k"]
    """Amount by which each limit gave way at the last sample; zero if it did not."""
    worst_excess: Float[Array, " k"]
    """Largest such amount since the start."""
    exceeded: Float[Array, " k"]
    """Amount by which the last sample leads beyond each limit itself; zero without ``braking_time``."""
    worst_exceeded: Float[Array, " k"]
    """Largest such amount since the start."""
    braking: BrakingState = BrakingState()
    """Verified braking motion, samples that brake, and samples without a verified braking motion."""
    unsolved: SampleCount = SampleCount()
    """Samples whose program was not solved: they keep limits alone (``task_hierarchy.solve_within``), or come to rest
    (``otherwise`` there). ``Braking.decide`` may replace either by the kept braking motion."""
    shifts: Float[Array, "2 k"] | None = None
    """As of ``InputSolution``. With them, the first program of the next sample is nearly right."""


class _SampleProgram(NamedTuple):
    """Limits of a sample and the effect of its inputs T, in unknowns y beside the contact forces.

    v2 at the end is ``still + motion y``, and ``T = resting + inputs y``. The columns of ``motion`` are orthonormal by
    ``MotionMetric``: the cost of an unknown is that of a motion.
    """

    sample: ControlSample
    rows: LimitRows
    contacts: ContactBounds
    basis: MotionBasis
    motion: Float[Array, "r p"]
    still: Float[Array, " r"]
    inputs: Float[Array, "p p"]
    resting: Float[Array, " p"]

    def velocity(self, unknowns: Array) -> Array:
        """v2 (r,) at the end."""
        return np.asarray(self.still + self.motion.dot(unknowns[: len(self.resting)]))

    def efforts(self, unknowns: Array) -> Array:
        """Inputs T (p,)."""
        return np.asarray(self.resting + self.inputs.dot(unknowns[: len(self.resting)]))


def _unknowns(state: StateEvaluation, dt: float, basis: MotionBasis) -> tuple[Array, Array]:
    """Velocities (r, p) and inputs (p, p) of unit unknowns: orthonormal columns, or zero for those that move nothing.

    Args:
        state: state at the start of a sample.
        dt: its duration [s].
        basis: unknowns of the metric.
    """
    effects, _ = state.input_accelerations
    r, p = effects.shape
    if p == r:  # the unknowns can be the velocities themselves
        inputs = state.accelerating_inputs
        if not inputs.size or inputs[0, 0] < np.inf:
            return basis.to_v2, inputs.dot(basis.to_v2) / dt
    left, values, right = np.linalg.svd(basis.of_v2 @ (dt * effects))
    rank = int((values > NO_EFFECT * values.max(initial=0.0)).sum())
    motion, inputs = np.zeros((r, p)), right.T.copy()
    motion[:, :rank] = basis.to_v2 @ left[:, :rank]
    inputs[:, :rank] /= values[:rank]
    return motion, inputs


class InputSolution(NamedTuple):
    """Solution of one program."""

    T: Float[Array, " p"]
    v2: Float[Array, " r"]
    """Velocity that the model predicts for the end of the sample."""
    multipliers: Float[Array, "levels k"]
    excess: Float[Array, " k"]
    end: StateEvaluation | None = None
    """State at the end of the sample by the dynamics; None if no limit of motion needs it."""
    unsolved: str = ""
    """Reason why the tasks are not solved."""
    shifts: Float[Array, "2 k"] | None = None
    """Changes of the lower and upper bounds that the dynamics within the sample ask for; None if unknown."""


def _onto_bounds(multipliers: Array, bounds: ProgramBounds, away: Array, error: float) -> Array:
    """Least change of the unknowns that brings limits to their bounds which are nearer than the error.

    The error is small after a correction of the whole program. Tasks lose no more than that, and another program costs
    ten times as much.

    Args:
        multipliers: multipliers of all limits (levels, total) of the solution within the bounds.
        bounds: bounds of motion, of efforts and of the ground; the last two are kept where they act.
        away: changes of the first rows, limits of motion, that reach their nearer bound.
        error: largest excess over a limit of motion.
    """
    acting, missing = np.array(multipliers[:, bounds.places].any(axis=0)), np.zeros(len(bounds.places))
    acting[: len(away)] = np.abs(away) <= error
    missing[: len(away)] = away
    change, *_ = np.linalg.lstsq(bounds.rows[acting], missing[acting], rcond=_DEPENDENT)
    return change


class InverseDynamicsQP(WholeBodyProgram):
    """Model-based controller within limits: tasks as least squares, limits as inequalities, in the inputs T.

    The dynamics ``H v2dot + V v2 + G = R^T B T`` give the velocity at the end of a sample as an affine function of T.
    So the program has no equality constraint, rolling and momentum hold exactly, and robots with fewer actuators than
    motions need nothing special. Tasks and limits are those of ``VelocityQP``. The velocity error of a task decays at
    the rate ``velocity_gain``. Motion that no task determines comes to rest at the same rate.

    Two kinds of limits concern forces. Inputs stay within the effort limits of the actuators. On the ground, normal
    forces push, and with ``friction`` every contact stays in its friction cone. If limits exclude each other, soft
    limits give way first, in the order of ``VelocityQP``, then hard ones, then the ground's. Effort limits never do.
    ``report`` tells which limits gave way.

    Tasks use the acceleration at the start of the sample. Limits of motion hold for the velocity at its end: if the
    integrated dynamics exceed them, the program is solved again with the difference.

    Before a sample is executed, a braking motion from its end is rolled out on the model. If a limit would give way,
    the braking motion that was verified one sample before takes the place of the program. ``state.braking`` counts
    these samples. Models with fewer actuators than reduced velocities, or with constraints that move them, have none.

    Unlike the adaptive trackers, it reads the model. Reads from the measurement: ``q, v2``.

    Args:
        reduced: the model.
        tasks: tasks from ``control.tasks``.
        limits: limits from ``control.limits``.
        dt: sampling interval [s].
        velocity_gain: rate at which velocity errors of tasks decay [1/s]; the rest of the motion comes to rest at the
            same rate.
        friction: coefficient of friction of the ground, for the friction cone of each contact; None if only normal
            forces have a limit.
        braking_time: longest braking motion that is verified [s]; None for no verification.

    Raises:
        ModelError, ConfigurationError: a task or a limit does not fit the model.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reach = rnc.control.tasks.OutputTask(rnc.FramePosition("tip", "xy"), rnc.planning.Hold([1.0, 1.0]))
        >>> controller = rnc.control.InverseDynamicsQP(system.reduce(), [reach], dt=0.01)
        >>> start = system.reduce().at(robot.configuration({"joint_2": 1.0}), np.zeros(3)).measure()
        >>> command, state = controller.step(0.0, start, controller.initial_state(start))
        >>> command.T.shape
        (3,)
    """

    described = ("dt", "velocity_gain", "friction", "braking_time")

    def __init__(
        self,
        reduced: ReducedModel,
        tasks: Sequence[ControlTask],
        limits: Sequence[ControlLimit] = (),
        *,
        dt: float,
        velocity_gain: Positive = 20.0,
        friction: Positive | None = None,
        braking_time: Positive | None = 2.0,
    ) -> None:
        check_positive_settings(dt=dt, velocity_gain=velocity_gain, friction=friction, braking_time=braking_time)
        self.dt, self.velocity_gain, self.friction, self.braking_time = dt, velocity_gain, friction, braking_time
        self._decay = float(np.exp(-velocity_gain * dt))
        super().__init__(reduced, tasks, limits, resting=reduced.r)
        self._contacts, self._motion = ContactCones(reduced, friction), ReducedMotion(reduced.robot)
        efforts = reduced.actuation.limits
        limited = np.flatnonzero(np.isfinite(efforts))
        self._limited, self._efforts = as_slice(limited), efforts[limited]
        self.limit_names = (
            *self._limits.names,
            *(f"{reduced.actuation.names[i]} effort" for i in limited),
            *self._contacts.names,
        )
        stops = np.cumsum([len(self._limits.names), len(limited), len(self._contacts.names)])
        rests = reduced.p >= reduced.r and not reduced.affine  # others cannot be brought to rest in general
        self._braking: Braking | None = None
        if rests and braking_time is not None and self._limits.names:
            self._braking = Braking(reduced, self._limits, self._contacts, self.limit_names, dt, braking_time)
        self._forces = [np.arange(stops[0], stops[1]), np.arange(stops[1], stops[2])]
        self._places = np.arange(stops[2])

    def initial_state(self, measurement: Measurement) -> InverseDynamicsState:
        """Return the state before the first sample."""
        k = len(self.limit_names)
        self._check_velocity(measurement.v2)
        return InverseDynamicsState(None, np.zeros((len(self._tasks.ends), k)), *np.zeros((4, k)))

    def step(
        self, t: float, measurement: Measurement, state: InverseDynamicsState
    ) -> tuple[Command, InverseDynamicsState]:
        """Compute one sample.

        Raises:
            InputError: time runs backwards, or the measurement has no configuration.
            SingularityError: the reducing outputs do not parametrise the motion at the configuration.
        """
        elapsed_time(t, state.time)
        q, v2 = self._configuration(measurement), measurement.v2
        program = self._program(t, q, v2)
        found = self._solved(t, program, state.multipliers, state.shifts)
        exceeded, worst_exceeded, braking = state.exceeded, state.worst_exceeded, state.braking
        if self._braking is not None:
            start = program.sample.start
            # The last sample has computed what its end exceeds, which is this start.
            before = self._braking.exceeded(start, t) if state.time is None else exceeded
            planned = self._reached(program, found)

            def under(T: Array) -> BrakedSample:
                return self._reached(program, found._replace(T=T, end=None))

            chosen, braking = self._braking.decide(
                start, t, before, planned, under, program.rows, program.contacts, braking
            )
            exceeded, worst_exceeded = chosen.exceeded, np.maximum(worst_exceeded, chosen.exceeded)
            if chosen is not planned:
                excess = np.where(exceeded > _BEYOND, exceeded, 0.0)
                found = found._replace(T=chosen.T, v2=chosen.v2, excess=excess, shifts=None)
        x1, x2 = self._desired(t)
        # A verdict reads the last state alone, so it has the largest amounts.
        worst = np.maximum(state.worst_excess, found.excess)
        command = Command(T=found.T, v2_desired=found.v2, x1_desired=x1, x2_desired=x2)
        amounts = found.excess, worst, exceeded, worst_exceeded
        unsolved = state.unsolved.and_one(t, found.unsolved)
        return command, InverseDynamicsState(t, found.multipliers, *amounts, braking, unsolved, found.shifts)

    def solve(self, t: float, q: Array, v2: Array, multipliers: Array | None = None) -> InputSolution:
        """Solve the program of one sample.

        Args:
            t: time of its start [s].
            q: configuration at the start (nq,).
            v2: reduced velocities at the start (r,).
            multipliers: multipliers of the last program, (levels, k), to start from.
        """
        return self._solved(t, self._program(t, q, v2), multipliers, None)

    def braking_problem(self, t: float, q: Array, v2: Array) -> str | None:
        """Return what the braking motion from a state does not keep; None if all limits hold until rest.

        It is None too if nothing is verified: without ``braking_time`` or limits of motion, and for models that cannot
        be brought to rest.

        Args:
            t: time [s].
            q: configuration (nq,).
            v2: reduced velocities (r,).
        """
        if self._braking is None:
            return None
        start = self._reduced.at(q, v2, t=t)
        before = self._braking.exceeded(start, t)
        return self._braking.motion(start, t, before, self._contacts.at(start)).problem

    def findings(self, state: State, samples: int) -> tuple[Finding, ...]:
        """Return findings about the steps so far: unsolved programs, braking motions, limits that gave way.

        Args:
            state: state of the program, or of a controller around it.
            samples: number of steps.
        """
        own = next(each for each in nested(state) if isinstance(each, InverseDynamicsState))
        braked, unverified = own.braking.braked, own.braking.unverified
        # The reason names what the program would have exceeded.
        braked = braked._replace(reason=f"{braked.reason} otherwise")
        what = "a verified braking motion took the place of the program"
        found = braked.findings(FindingKind.BRAKING, "program", what, samples)
        what = "no braking motion could be verified"
        found += unverified.findings(FindingKind.BRAKING, "verification", what, samples)
        # Limits of motion that the run exceeds by the model since its start, with the largest amounts.
        for name, amount in zip(self._limits.names, own.worst_exceeded.tolist(), strict=False):
            if amount > SHORTFALL:
                message = f"limit {name} of the program was exceeded by {amount:.3g}"
                found += (Finding(FindingKind.LIMIT_GAVE_WAY, name, amount, "", None, Severity.FAILS, message),)
        return *super().findings(own, samples), *found

    def _program(self, t: float, q: Array, v2: Array) -> _SampleProgram:
        """Limits of one sample and the effect of its inputs, for tasks and braking motions."""
        sample = ControlSample(self._reduced, t, q, v2, self.dt)
        state = sample.start
        basis = self._metric.basis(sample.end.R)
        motion, inputs = _unknowns(state, self.dt, basis)
        free = state.v2 + self.dt * state.input_accelerations[1]
        # Inputs that reach every velocity also cancel what moves without them: no part of it remains.
        moved = basis.of_v2.dot(motion).T.dot(basis.of_v2.dot(free))
        still = free - motion.dot(moved)
        limits = self._limits.rows(sample), self._contacts.at(state)
        return _SampleProgram(sample, *limits, basis, motion, still, inputs, -inputs.dot(moved))

    def _solved(
        self, t: float, program: _SampleProgram, multipliers: Array | None, shifts: Array | None
    ) -> InputSolution:
        """Solve the levels within the limits, which hold for the velocity that the dynamics give at the end.

        Args:
            t: time of the start of the sample [s].
            program: limits of the sample and the effect of its inputs.
            multipliers, shifts: those of the last sample, if they are known.
        """
        levels, sampled, bounds = self._posed(t, program)
        sample, rows = program.sample, program.rows
        state, motions = sample.start, len(rows.lower)

        def rest() -> Array:  # by computed torque, which carries the load
            lowest = slice(-self._reduced.r, None)
            return np.asarray(levels.rate[lowest].dot(levels.jacobian[lowest]))

        always = self._limits, rest, 0.0
        first = bounds if shifts is None else bounds.shifted(shifts)
        found = best = solve_within(levels, first, *always, multipliers, self._forces, sampled)
        least, best_end, steps, shifts = np.inf, None, 0, None
        T, v2 = program.efforts(found.unknowns), program.velocity(found.unknowns)
        # Mostly the motion is far from all limits: then nothing need be integrated, unless a braking motion follows.
        far = not (found.unsolved or self._braking) and self._reduced.evaluator.far_within(
            (state, sample.end), v2, T, sample.time, self.dt, (rows.jacobian, rows.lower, rows.upper)
        )
        for attempt in range(0 if far or found.unsolved or not motions else _CORRECTIONS + 1):
            end, steps = self._end(state, program.efforts(found.unknowns), steps)  # what one needs, the next ones do
            reached, throughout = rows.jacobian @ end.v, self._limits.throughout[rows.places]
            turning = np.where(throughout, rows.jacobian @ self._turning_velocities(state, end), reached)
            beyond = np.maximum(np.maximum(reached, turning) - rows.upper, rows.lower - np.minimum(reached, turning))
            beyond -= (excess := found.excess[rows.places])
            if not beyond.max() < least:
                break  # near singular coordinates, corrections need not converge
            best, best_end, least = found, end, float(beyond.max())
            # A change of the velocity at the end changes that in the middle by half of it.
            above, below = (np.where(throughout, 2.0 * turning - each, reached) for each in (rows.upper, rows.lower))
            highest, lowest = np.maximum(reached, above), np.minimum(reached, below)
            expected = rows.jacobian @ (sample.end.R @ program.velocity(found.unknowns) + sample.end.b)
            shifts = np.zeros((2, len(self.limit_names)))
            shifts[:, rows.places] = expected - lowest, expected - highest
            if least <= _BEYOND:
                break
            if attempt or least <= _SLIGHT:
                over, under = highest - rows.upper - excess, rows.lower - lowest - excess
                change = _onto_bounds(found.multipliers, bounds, np.where(over > under, -over, under), 2.0 * least)
                found = found._replace(unknowns=found.unknowns + change)
                continue
            similar = self._forces, sampled._replace(near=found.damping)
            found = solve_within(levels, bounds.shifted(shifts), *always, found.multipliers, *similar)
            if found.unsolved:
                break
        if not far:
            T, v2 = program.efforts(best.unknowns), program.velocity(best.unknowns)
        T = clipped(T, self._reduced.actuation.limits)  # the solver's rounding is no effort
        # Limits that exclude each other may come and go.
        shifts = None if shifts is None or best.excess.any() else shifts
        return InputSolution(T, v2, best.multipliers, best.excess, best_end, best.unsolved, shifts)

    def _end(self, state: StateEvaluation, T: Array, steps: int = 0) -> tuple[StateEvaluation, int]:
        """State at the end of the sample under constant inputs, and its Runge-Kutta steps: as many as it needs if 0."""
        if not steps:
            (_, coarse), (q, v2) = (self._integrated(state, T, steps) for steps in (1, 2))
            error = np.abs(v2 - coarse).max(initial=0.0) / 15.0  # of order four: twice the steps leave a sixteenth
            steps = int(min(_MOST_STEPS, np.ceil(2.0 * (error / (DEFAULT_TOLERANCE * self.dt)) ** 0.25)))
            if steps <= 2:
                return known_state(self._reduced, q, v2), 2
        return known_state(self._reduced, *self._integrated(state, T, steps)), steps

    def _integrated(self, state: StateEvaluation, T: Array, steps: int) -> tuple[Array, Array]:
        """Configuration and reduced velocity after a sample of a number of Runge-Kutta steps."""
        reduced, h = self._reduced, self.dt / steps
        start = np.concatenate([state.v2, np.zeros(reduced.vertical.size + 1)])
        q, y, _ = self._motion.steps(reduced.evaluator, np.array(state.q), start, np.ascontiguousarray(T), h, steps)
        return q, y[: reduced.r]

    def _turning_velocities(self, start: StateEvaluation, end: StateEvaluation) -> Float[Array, " nv"]:
        """Velocities at which the joints turn from a state to another one, a sample later."""
        return turning_velocities(start.v, end.v, pin.difference(self._reduced.robot.model, start.q, end.q) / self.dt)

    # ------------------------------------------------------------------ braking

    def _reached(self, program: _SampleProgram, found: InputSolution) -> BrakedSample:
        """End of a sample under the inputs of a solution, and the limits that it exceeds."""
        end = found.end or self._end(program.sample.start, found.T)[0]
        turning = self._turning_velocities(program.sample.start, end)
        motion = self._limits.exceeded(end, program.sample.time, program.rows, turning)
        # Forces of the ground follow from the inputs, not from the state at the end. No input exceeds its limit.
        exceeded = np.concatenate([motion, np.zeros(len(self._efforts)), found.excess[self._forces[1]]])
        return BrakedSample(found.T, end.q, end.v2, exceeded)

    def _posed(self, t: float, program: _SampleProgram) -> tuple[TaskLevels, SampledDamping, ProgramBounds]:
        """Tasks and limits on the unknowns. The last level brings the rest of the motion to rest.

        Limits of motion come first, then those of efforts, then those of the ground.
        """
        sample, limits, contacts, motion = program.sample, program.rows, program.contacts, program.motion
        start, end, of_v2, tasks, decay = sample.start, sample.end, program.basis.of_v2, self._tasks, self._decay
        now = ControlSample(self._reduced, t, start.q, start.v2, 0.0, start)
        J, rate = tasks.rows(sample, now)
        inputs, resting, efforts = program.inputs[self._limited], program.resting[self._limited], self._efforts
        offset, wanted = end.R.dot(program.still), decay * start.v2 - program.still
        if self._reduced.affine:
            offset = offset + end.b
        (r, p), k, motions, ground = motion.shape, len(tasks.roots), len(limits.lower), len(contacts.upper)
        width, forces = contacts.rows.shape[1], motions + len(efforts)
        rows, rates, levers = np.zeros((k + r, width)), np.empty(k + r), np.zeros(len(tasks.ends))
        bounds, (lower, upper) = np.zeros((forces + ground, width)), (sides := np.empty((2, forces + ground)))
        table = tasks.roots, tasks.squares, tasks.curvature, decay, end.E_inverse, offset, start.v, of_v2, wanted
        given = motion, limits.jacobian, limits.lower, limits.upper, inputs, resting, efforts
        # All products in one call: one by one, each costs more than its arithmetic.
        if not _kernel.library.program(J, rate, *table, *given, rows, rates, levers, bounds, sides):
            moving, away = end.R.dot(motion), limits.jacobian.dot(offset)
            ahead = J[1].dot(start.v) - rate[1]  # errors of rates decay as those of velocities without a task
            rows[:k, :p] = tasks.roots[:, None] * J[0].dot(moving)
            rates[:k] = tasks.roots * (rate[0] - J[0].dot(offset) + decay * ahead)
            rows[k:, :p], rates[k:], levers = of_v2.dot(motion), of_v2.dot(wanted), tasks.levers(J[0])
            bounds[:motions, :p], bounds[motions:forces, :p] = limits.jacobian.dot(moving), inputs
            lower[:motions], upper[:motions] = limits.lower - away, limits.upper - away
            lower[motions:forces], upper[motions:forces] = -efforts - resting, efforts - resting
        if ground:
            bounds[forces:, :p] = contacts.rows[:, :p].dot(program.inputs)
            bounds[forces:, p:] = contacts.rows[:, p:]
            lower[forces:], upper[forces:] = -np.inf, contacts.upper - contacts.rows[:, :p].dot(program.resting)
        complete = len(bounds) == len(self._places)  # no limit of motion is idle
        places = self._places if complete else np.concatenate([limits.places, *self._forces])
        found = ProgramBounds(bounds, lower, upper, places, len(self._places))
        return TaskLevels(rows, rates, tasks.ends), SampledDamping(sample.dt, levers, tasks.curved), found
