"""Simulation: a controller and a plant in closed loop, sample by sample; and motion without a sampled controller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter, thread_time
from typing import cast

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin import errors
from rnc_pin.control.controller import Command, Controller, findings_of, limited_accelerations, missed_goals
from rnc_pin.control.loop import ControlLoop, LoopOptions, LoopState
from rnc_pin.control.loop.loop_state import LateTicks, with_late_tick
from rnc_pin.errors import DivergenceError, InputError, RncError, SingularityError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import is_number, numbers_of
from rnc_pin.model.integrators import AdaptiveIntegrator
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import Plant, ReducedPlant
from rnc_pin.plants.constrained_dynamics import ConstrainedDynamics, integrated_outputs
from rnc_pin.plants.plant import IntegrationErrors, PlantReport, ReportingPlant, takes_velocities
from rnc_pin.simulation import run_info
from rnc_pin.simulation.derived_quantities import derive, versions
from rnc_pin.simulation.run_data import Grounds, Record, Trajectory
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.simulation.simulation_options import (
    DEFAULT_OPTIONS,
    LiftOffMonitor,
    RunArguments,
    Sample,
    SimulationOptions,
    StopMonitor,
    assembled_start,
    check_arguments,
    sample_count,
)

Feedback = Callable[[float, Array, Array], Array]

_ROUNDING = 1e-6  # of a time, in sampling periods
_AT_FAULT = 0.01  # sum of the estimated errors, relative to the velocities, from which the integrator diverges


class SampledRun:
    """Run whose samples somebody else calls: a loop over a duration, or one that follows a clock.

    Args:
        arguments: arguments of the run.

    Attributes:
        controller: the controller.
        plant: the plant.
        loop: control loop of the controller.
        record: recorder of the run.
        stop: monitor of the stop conditions.
        samples: number of samples so far.

    Raises:
        RncError: as ``simulate``.
    """

    def __init__(self, arguments: RunArguments) -> None:
        check_arguments(arguments)
        reduced, controller, q0, dt, _, v2_0, plant, options = arguments
        self.controller = controller
        origin = run_info.provenance_of(options.meta)
        # What could not be found is an error before the run, and loses no results.
        self._info, self._observer = run_info.RunInfo(dt=dt, versions=versions(), provenance=origin), options.observer
        self.plant = plant = ReducedPlant(reduced) if plant is None else plant
        self._reporting, self._reported = plant if isinstance(plant, ReportingPlant) else None, PlantReport()
        # A plant of the same model hands over its evaluation of the state: nothing is computed twice.
        self._exact = plant if isinstance(plant, ReducedPlant) and plant.reduced is reduced else None
        self._measured = np.zeros(0), np.zeros(0)  # of the last reading; velocities are empty if measurements are exact
        # By default the plant alone clips inputs, and reports what it applies; ``options.loop`` may say otherwise.
        loop_options: LoopOptions = {"fallback": "hold", "limits": False, "max_speed": options.stop.speed}
        kind: type[ControlLoop] = ControlLoop
        self._servos = takes_velocities(plant)
        if self._servos:
            from rnc_pin.control.loop import VelocityInputLoop  # a run under forces starts without it

            kind, loop_options["fallback"] = VelocityInputLoop, "zero"
        elif self._exact is not None:
            # Measurements of the own model are exact: an error is the controller's, and no disturbance that passes.
            loop_options["fallback"] = "raise"
        # The options of the caller last: they replace the defaults of the plant.
        loop_options.update(options.loop)
        self.loop = kind(reduced, controller, dt, **loop_options)
        self.stop, self._dt, self.samples = StopMonitor(options.stop, reduced.robot), dt, 0
        self._zeros = zeros = np.zeros(reduced.r)
        self._fallbacks: list[int] = []  # numbers of the samples with a fallback command
        self._fallback_reason = ""
        self._late: LateTicks | None = None
        self._reduced, self._accelerations = reduced, limited_accelerations(controller)
        # Rounding of holonomic rows in q0 would become a constraint force at the first sample.
        first = reduced.at(assembled_start(reduced, numbers_of(q0, "q0")), zeros if v2_0 is None else v2_0, t=0.0)
        plant.reset(first.q, first.v)
        self._senses = self._report().actual is not None
        self._lift_off = LiftOffMonitor(self._reported.reduced, reduced) if options.stop.lift_off else None
        state = options.controller_state
        if state is None:
            # From the state that the plant has after its reset: it may have projected q0 and v.
            state = controller.initial_state(self._read_state(0.0).measure(zeros))
        # Time begins at zero here, so that references do not depend on when the first measurement comes.
        self.loop.resume(LoopState(begin=0.0, controller=state))
        self.record = Record(reduced, integrated_outputs(reduced), self._reported)

    @property
    def time(self) -> float:
        """Time of the next sample [s]."""
        return self.samples * self._dt

    def sample(self, progress: Progress) -> Sample:
        """Measure, compute and apply the inputs, and record the sample.

        Args:
            progress: receives the time and the component at work, for error messages.
        """
        loop, exact = self.loop, self._exact
        progress.time = t = self.time
        state = self._read_state(t)
        # Before the controller, which never sees a diverged state.
        try:
            self.stop.check(t, state)
        except DivergenceError as error:
            raise _blamed(error, self._report().errors, state.v) from None
        wall, begin = perf_counter(), thread_time()
        try:
            T = loop.step(t, *self._measured) if exact is None else loop.compute_input(t, exact.state, exact.integrals)
        except Exception:
            # The message names who was at work: the controller, the model, or the allocation of the command.
            progress.active_component = loop.active_component
            raise
        if perf_counter() - wall > self._dt:  # thread time, without other work of the computer, is never longer
            self._late = with_late_tick(self._late, t, thread_time() - begin, self._dt)
        # Inputs that the plant clipped: the record and the next step of the controller have what acts.
        T = self._apply(T)
        if loop.state.fault is not None:
            self._fallback_reason = self._fallback_reason or loop.state.fault
            self._fallbacks.append(self.samples)
        if self._lift_off is not None:
            self._lift_off.check(t, state, T, self._reported.external)
        # A loop that has only given safe commands has no integrals yet: they are zero at the start.
        integrals = loop.state.integrals if loop.state.integrals is not None else self._zeros
        measurement, command = _last_decision(loop, state)
        # Outputs are recorded of the true state. Integrals of quasi-velocities are the loop's, of measured velocities.
        outputs = (measurement.x1, measurement.x2) if measurement.q is state.q else None
        self.record.add(t, state, integrals, command, T, self._reported, outputs, self._measured[1])
        self.samples += 1
        found = Sample(t, measurement, command, T, loop.state.controller)
        if self._observer is not None:
            progress.active_component = "the observer"
            self._observer(found)
            progress.active_component = MODEL
        return found

    def _report(self) -> PlantReport:
        """Report of the plant now."""
        if self._reporting is not None:
            self._reported = self._reporting.report()
        return self._reported

    def _read_state(self, t: float) -> StateEvaluation:
        """Read the sensors at time t [s] and return the true state: at the start of a run, then once per sample.

        Raises:
            DivergenceError: the state is not finite.
        """
        if self._exact is not None:
            return self._exact.state
        self._measured = self.plant.read()
        q, v = (self._senses and self._report().actual) or self._measured
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise DivergenceError("plant state is not finite")
        return self._reduced.at(q, v=v, t=t)

    def _apply(self, T: Array) -> Array:
        """Apply inputs to the plant, report the applied ones to the loop, and return them; of servos their efforts."""
        (self.plant.apply if self._exact is None else self._exact.hold)(T)
        report = self._report()
        # Servos tell efforts, and the loop has nothing to learn of limits of forces.
        if self._servos:
            return np.full(len(T), np.nan) if report.effort is None else report.effort
        applied = T if report.applied is None else report.applied
        self.loop.report_applied_input(applied)
        return applied

    def advance(self) -> None:
        """Advance the plant to the next sample."""
        self.plant.advance(self._dt)

    def run_to(self, samples: int, progress: Progress) -> str | None:
        """Take samples, and advance between them, until there are so many; return ``failure``.

        Args:
            samples: number of samples at the end.
            progress: as for ``sample``.
        """
        for sample in range(self.samples, samples):
            self.sample(progress)
            # No motion after the last sample: nothing would record it.
            if sample + 1 < samples:
                self.advance()
        return self.failure

    @property
    def failure(self) -> str | None:
        """Reason why the loop only gives safe commands; None if it works."""
        state = self.loop.state
        return f"the loop gave the safe command until the end: {state.fault}" if state.failed else None

    def finish(self, outcome: run_info.Outcome, message: str | None = None) -> Trajectory:
        """Return the trajectory so far.

        Args:
            outcome: outcome of the run.
            message: reason of an early end, if any.
        """
        # A second report: the plant has moved since the last sample, perhaps through an event of its contacts.
        report, own, late = self._report(), self.loop.state.controller, self._late
        info = replace(
            self._info,
            outcome=outcome,
            message=message,
            phases=_phases(report, self._dt),
            fallback=self._fallback_use(),
            findings=findings_of(self.controller, own, self.samples),
            integration=_integration(report),
            late=late._replace(ticks=self.samples) if late is not None and late.late else None,
        )
        run = derive(self.record, info)
        # Asked now: the controller may be used again before somebody asks for the verdict.
        ended = outcome is run_info.Outcome.COMPLETED
        missed = missed_goals(self.controller, float(run.time[-1]), run.q[-1], run.v2[-1]) if ended else ()
        return replace(run, grounds=Grounds(self._reduced, self._accelerations, tuple(missed)))

    def _fallback_use(self) -> run_info.FallbackUse | None:
        """Use of fallback commands so far."""
        if not self._fallbacks:
            return None
        samples = np.array(self._fallbacks)
        lengths = [len(each) for each in np.split(samples, np.flatnonzero(np.diff(samples) > 1) + 1)]
        # A sample that ended with an error is not counted as taken.
        last = lengths.pop() if samples[-1] >= self.samples - 1 else 0
        # A last stretch that outlasts the timeout, or all stretches before it, is no passing disturbance.
        lasts = last * self._dt > self.loop.timeout or last > max(lengths, default=0)
        first = float(samples[0] * self._dt)
        return run_info.FallbackUse(len(samples), first, self._fallback_reason, lasts or self.loop.state.failed)


def _phases(report: PlantReport, dt: float) -> tuple[run_info.PhaseInfo, ...]:
    """Intervals between the contact events of a plant for a sampling period; empty if contacts do not switch."""
    events = report.contact_events
    ends = [*(event.cause for event in events[1:]), None]
    found = []
    for event, end in zip(events, ends[: len(events)], strict=True):
        # The first sample after the event: the one before was still taken in the old phase.
        name, first = " + ".join(event.closed) or "flight", int(np.ceil(event.time / dt - _ROUNDING))
        found.append(run_info.PhaseInfo(name, first, event.time, dict(event.impulses), event.energy_loss, end))
    return tuple(found)


def _integration(report: PlantReport) -> run_info.IntegrationAccuracy | None:
    """Estimated errors of the integration since the start; None if the plant does not estimate them."""
    if (errors := report.errors) is None:
        return None
    # Plain numbers: a report may hold those of NumPy, which JSON refuses.
    rate, total, most = float(errors.rate), float(errors.total), int(errors.most)
    return run_info.IntegrationAccuracy(report.tolerance, rate, total, most, max(int(errors.enough), most))


def _blamed(error: DivergenceError, errors: IntegrationErrors | None, v: Array) -> DivergenceError:
    """Return an error of a motion at velocity v (nv,) that says whether the integrator diverges, and not the robot."""
    # Small errors of the integration cannot have made such velocities: then the robot itself diverges.
    if errors is None or errors.enough <= errors.most or errors.total <= _AT_FAULT * np.abs(v).max(initial=0.0):
        return error
    what = f"the integrator, not the robot: {error.what}; substeps {errors.most} is too small, set {errors.enough}"
    return DivergenceError(what, time=error.time)


def _last_decision(loop: ControlLoop, state: StateEvaluation) -> tuple[Measurement, Command]:
    """Measurement and command of the loop's last step. For a safe command, the goals are those of the step before."""
    if loop.last is None:
        return state.measure(loop.state.integrals), Command(T=loop.state.T)
    if loop.state.fault is not None:
        return loop.last.measurement, loop.last.command._replace(F=None, T=loop.state.T)
    return loop.last.measurement, loop.last.command


# ---------------------------------------------------------------------- end of a run


_OUTCOMES = {SingularityError: Outcome.SINGULAR, DivergenceError: Outcome.DIVERGED, errors.LimitError: Outcome.LIMIT}
_LONGEST = 300  # largest number of characters from the message of a foreign error

MODEL = "the model"


@dataclass
class Progress:
    """Progress of a run, for its error messages."""

    time: float = 0.0
    """[s]"""
    active_component: str = MODEL


def complete_run(
    advance: Callable[[Progress], str | None], finish: Callable[[Outcome, str | None], Trajectory]
) -> Trajectory:
    """Run to the end and return the trajectory; Ctrl-C ends the run early.

    A ``SingularityError`` on a ``ReducedPlant`` of the controller's own model ends the run: its outcome is
    ``SINGULAR``, and its verdict has the finding ``singular``. On another plant the loop gives its safe command to the
    end, unless its ``fallback`` is "raise": the outcome is ``FAILED``, with the findings ``ended_early`` and
    ``fallback``, and no error is raised. Scenarios, sweeps, drives and batches keep ``error.trajectory`` as a result.

    It writes no file: the result folder of a scenario is written by ``applications/scenario/execution.write``.

    Args:
        advance: the whole run; returns the reason if it failed without an error.
        finish: function from the outcome and its reason to the trajectory so far.

    Raises:
        RncError: ``advance`` raised an error. ``error.trajectory`` has the trajectory so far.
    """
    progress, outcome, reason = Progress(), Outcome.COMPLETED, None
    # Ctrl-C reaches ``advance`` alone: ``finish`` has to keep what was simulated until then.
    with uninterrupted():
        try:
            with interruptible():
                reason = advance(progress)
        except KeyboardInterrupt:
            outcome = Outcome.INTERRUPTED
        except Exception as error:
            failure = run_error(error, progress.active_component, progress.time)
            outcome = next((each for kind, each in _OUTCOMES.items() if isinstance(failure, kind)), Outcome.FAILED)
            failure.trajectory = finish(outcome, str(failure))
            raise failure  # noqa: B904 (run_error sets the cause)
        return finish(outcome if reason is None else Outcome.FAILED, reason)


def run_error(error: Exception, component: str, t: float) -> RncError:
    """Return an error of a run as an RncError, which can carry the run so far.

    Args:
        error: error that was caught.
        component: name of the component that raised it.
        t: time [s].

    Returns:
        The error itself if it is an RncError, else a SimulationError with the error as its cause.
    """
    if isinstance(error, RncError):
        # A model knows the configuration where it failed; when that was, only the run knows.
        if isinstance(error, SingularityError | DivergenceError) and error.time is None:
            error.time = t
        return error
    # One line, however many the error of a user's controller has.
    message = " ".join(str(error).split())
    message = f": {message[:_LONGEST]}" if message else ""
    failure = errors.SimulationError(f"{component} raised {type(error).__name__} at t = {t:.3f} s{message}")
    failure.__cause__ = error
    return failure


# ---------------------------------------------------------------------- runs


def simulate(
    reduced: ReducedModel,
    controller: Controller,
    q0: Array,
    duration: float,
    dt: float = 0.002,
    *,
    v2_0: Array | None = None,
    plant: Plant | None = None,
    options: SimulationOptions = DEFAULT_OPTIONS,
) -> Trajectory:
    """Simulate a controller in closed loop with the reduced model, or with another plant.

    The controller gets a measurement every ``dt``, and a zero-order hold keeps its inputs in between. A fourth-order
    Lie-group integrator runs in charts of the constraints, which are regular if the constraints have constant rank.
    So only the outputs of the controller can be singular. At every sample a projection removes the drift of holonomic
    rows, such as wheel height and loop closure. The correction has zero momentum along the admissible velocities.

    With a row for each run in q0 or v2_0, the result is a list of runs. An error ends only its run, whose trajectory
    has its outcome and message. On a ``ReducedPlant`` of the model, runs under trackers are computed together, and
    differ from runs alone by rounding; other runs are computed one after the other.

    Args:
        reduced: reduced model.
        controller: controller with the protocol of ``rnc_pin.control``.
        q0: initial configuration (nq,), or many (B, nq).
        duration: duration [s], rounded to a multiple of ``dt``.
        dt: sampling period [s].
        v2_0: initial reduced velocity (r,), or many (B, r); zero by default.
        plant: what moves: a ``ReducedPlant`` with damping, friction or actuator limits, a model that differs from the
            nominal one, velocity servos (for an ``ActuatorVelocityController``), sensors with faults, another
            simulator, or hardware. ``ReducedPlant(reduced)`` by default.
        options: stop conditions, control loop, observer and origin of the run.

    Returns:
        The run, or a list of runs. Ctrl-C ends it early, with outcome "interrupted"; repeated Ctrl-C has the same
        effect.

    Raises:
        RncError: the run ends early, with the run so far in ``error.trajectory``: a SingularityError, DivergenceError
            or LimitError; a ConstraintError if the actuators cannot produce the command; or a SimulationError, whose
            cause is an error that the controller or the observer raised.
        InputError: wrong shapes; the duration or period is not positive; or the initial configuration violates the
            holonomic rows (``ReducedModel.assembled`` returns one that satisfies them).
        ConfigurationError: an argument has the wrong type, or ``meta`` has a value of the wrong type under a known key.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce([rnc.JointPosition(f"joint_{k}") for k in (1, 2, 3)])
        >>> swing = rnc.planning.MinimumJerk(np.zeros(3), [0.5, 0.0, 0.0], duration=1.0)
        >>> target = rnc.control.ReducingOutputController(reduced, swing)
        >>> controller = rnc.control.ComputedTorque(reduced, target)
        >>> run = rnc.simulate(reduced, controller, robot.configuration(), duration=1.0, dt=0.01)
        >>> run
        Trajectory: succeeded, 1 s in 101 samples
        >>> round(run.x2[-1, 0].item(), 2)
        0.5
    """
    samples = sample_count(duration, dt)
    arguments = RunArguments(reduced, controller, q0, dt, samples, v2_0, plant, options)
    if np.ndim(q0) > 1 or (v2_0 is not None and np.ndim(v2_0) > 1):
        from rnc_pin.simulation.batch import simulate_batch  # a run alone starts without it

        return cast(Trajectory, simulate_batch(arguments))  # for type checkers, which cannot tell one row from many
    run = SampledRun(arguments)
    return complete_run(lambda progress: run.run_to(samples, progress), run.finish)


def free_motion(
    reduced: ReducedModel | ReducedPlant,
    q0: Array,
    v2_0: Array,
    duration: float,
    dt: float = 0.02,
    inputs: Array | Feedback | None = None,
    *,
    tolerance: float | tuple[float, float] = 1e-12,
    options: SimulationOptions = DEFAULT_OPTIONS,
) -> Trajectory:
    """Simulate a reduced system without input, under constant inputs, or under a continuous feedback.

    An adaptive eighth-order method integrates on the configuration manifold, in charts of the constraints only. Motions
    stay accurate over minutes, also through configurations at which the model's outputs are singular. After every step
    a projection removes the drift of holonomic rows, which is of the order of the tolerance. For a sampled controller
    with zero-order hold, use ``simulate``.

    Args:
        reduced: reduced model, or a plant of it, with effects that the model does not include:
            ``ReducedPlant(reduced, joint_damping=True)``. Its state does not change.
        q0: initial configuration (nq,).
        v2_0: initial reduced velocity (r,).
        duration: [s].
        dt: sampling period of the trajectory [s]; the tolerances determine the integration steps.
        inputs: actuator inputs (p,), or ``inputs(t, q, v2) -> (p,)``, continuous; none by default.
        tolerance: of a step, relative and absolute; two numbers if they differ.
        options: stop conditions, checked once per sample, and origin of the run. The others need ``simulate``.

    Raises:
        RncError: the motion ends early, with the run so far in ``error.trajectory``: a SingularityError or
            DivergenceError; or a SimulationError, whose cause is an error that the feedback raised.
        InputError: wrong shapes; times or tolerances are not positive; or the initial configuration violates the
            holonomic rows.
        ConfigurationError: an option needs ``simulate``, or ``meta`` has a value of the wrong type under a known key.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> run = rnc.free_motion(reduced, robot.configuration(), v2_0=[0.0, 1.0], duration=20.0, dt=0.5)
        >>> bool(abs(run.v2[-1, 1]) < 0.01), bool(run.v2[-1, 0] > 0)  # rotation becomes straight motion
        (True, True)
    """
    stop, origin = options.stop, run_info.provenance_of(options.meta)
    info = run_info.RunInfo(dt=dt, versions=versions(), provenance=origin)
    if options.loop or options.observer is not None or options.controller_state is not None:
        raise errors.ConfigurationError("free_motion has no controller: of the options, it takes stop and meta only")
    rtol, atol = (tolerance, tolerance) if isinstance(tolerance, int | float) else tolerance
    if not all(map(is_number, (dt, duration, rtol, atol))) or not (0 < dt <= duration and rtol > 0 and atol > 0):
        raise InputError(
            f"duration {duration!r}, dt {dt!r} and tolerance {tolerance} have to be positive, dt at most the duration"
        )
    plant = ReducedPlant(reduced) if isinstance(reduced, ReducedModel) else reduced
    if not isinstance(plant, ReducedPlant):
        raise InputError("free_motion requires a ReducedModel or a ReducedPlant; use simulate for another plant")
    if plant.joint_friction:
        raise InputError(
            "dry friction is not smooth: free_motion does not support it; use simulate with joint_friction=True"
        )
    # Equations of its own: charts follow the motion, and the state of the plant must not change.
    model, dynamics = plant.reduced, ConstrainedDynamics(plant.reduced, plant.joint_damping, plant.actuator_limits)
    stop_monitor = StopMonitor(stop, model.robot)
    # Of the plant's own model: there is no other one here.
    lift_off = LiftOffMonitor(model, model) if stop.lift_off else None
    feedback = inputs if callable(inputs) else None
    # Clipped once, and not at each stage of the integrator.
    given = np.zeros(model.p) if inputs is None or callable(inputs) else numbers_of(inputs, "inputs")
    constant = dynamics.saturate(given)

    def inputs_at(t: float, state: StateEvaluation) -> Array:
        if feedback is None:
            return constant
        return dynamics.saturate(numbers_of(feedback(t, state.q, state.v2), "inputs"))

    def local_rate(t: float, q: Array, x: Array) -> Array:
        try:
            if feedback is None:
                return dynamics.local_rate(q, x, constant)
            # A feedback asks for the state of its stage, which is a displacement u from q.
            at = pin.integrate(model.robot.model, q, x[: model.n])
            return dynamics.local_rate(q, x, inputs_at(t, dynamics.at(at, x[model.n :]).in_reduction(model.evaluator)))
        except (SingularityError, DivergenceError):  # NaN makes the integrator shorten a step that leaves the chart
            return np.full(len(x), np.nan)

    def settle(q: Array, y: Array) -> tuple[Array, Array]:
        q = dynamics.project(q, y)
        # Charts change between steps only: within one, all stages have to be in the same chart.
        return q, dynamics.recentre(q, y)[1]

    q = assembled_start(model, numbers_of(q0, "q0"))
    # A (cos, sin) pair or a quaternion that is rounded in a file would scale the body that it turns.
    start = model.at(pin.normalize(model.robot.model, q), v2_0, t=0.0)
    _ = start.flow(inputs_at(0.0, start))  # raise errors of shape or singularity before the integration
    y0 = dynamics.initial(start.q, start.v)
    # Even times that end at the duration exactly, also where it is no multiple of dt.
    times_of_samples = np.linspace(0.0, duration, round(duration / dt) + 1)
    record = Record(model, dynamics.integrated)
    integrator = AdaptiveIntegrator(model.robot, local_rate, rtol, atol, settle)

    def advance(progress: Progress) -> None:
        progress.active_component = "the feedback" if feedback else MODEL
        for times, q, y in integrator.run(times_of_samples, start.q, y0):
            v, integrals = dynamics.at(q, y).v, dynamics.integrals(y)
            # One by one: the first sample that meets a condition ends the run, and a feedback may have a memory.
            for t, q_t, v_t, integrals_t, work in zip(times.tolist(), q, v, integrals, y[:, -1], strict=True):
                progress.time = t
                state = model.at(q_t, v=v_t, t=t)
                stop_monitor.check(t, state)
                T, external = inputs_at(t, state), dynamics.damping_force(state)
                if lift_off is not None:
                    lift_off.check(t, state, T, external)
                report = PlantReport(work=work, reduced=model, external=external)
                record.add(t, state, integrals_t, Command(T=T), T, report)

    return complete_run(
        advance, lambda outcome, message: derive(record, replace(info, outcome=outcome, message=message))
    )
