"""Run of a sampled controller and a plant, one sample at a time."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter, thread_time

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Command, VelocityGiving, findings_of, limited_accelerations, missed_goals
from rnc_pin.control.loop import ControlLoop, LoopOptions, LoopState, VelocityInputLoop
from rnc_pin.control.loop.loop_state import LateTicks, with_late_tick
from rnc_pin.control.loop.options import admit_controller, admit_model, type_name
from rnc_pin.errors import ConfigurationError, DivergenceError, InputError
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.input_validation import numbers_of
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.plants import Plant, ReducedPlant
from rnc_pin.plants.constrained_dynamics import integrated_outputs
from rnc_pin.plants.plant import PlantReport, ReportingPlant, takes_velocities
from rnc_pin.plants.step_control import IntegrationErrors
from rnc_pin.simulation import run_info
from rnc_pin.simulation.derived_quantities import derive, versions
from rnc_pin.simulation.record import Record
from rnc_pin.simulation.run_data import Grounds
from rnc_pin.simulation.simulation_options import RunArguments, Sample, SimulationOptions
from rnc_pin.simulation.stop import MODEL, LiftOffMonitor, Progress, StopMonitor
from rnc_pin.simulation.trajectory import Trajectory

_EMPTY = np.zeros(0)
_ROUNDING = 1e-6  # of a time, in sampling periods
_ASSEMBLED = 1e-4  # largest residual of holonomic rows that counts as rounding of an initial configuration
_AT_FAULT = 0.01  # sum of the estimated errors, relative to the velocities, from which the integrator diverges


class PlantAdapter:
    """Adapter of a plant: its state in the outputs of a model.

    Args:
        plant: the plant.
        reduced: reduced model of the controller.

    Attributes:
        reported: last report of the plant.
    """

    def __init__(self, plant: Plant, reduced: ReducedModel) -> None:
        self.plant, self._reduced = plant, reduced
        self._exact = plant if isinstance(plant, ReducedPlant) and plant.reduced is reduced else None
        self._servos = takes_velocities(plant)
        self.measured: tuple[Array, Array] = (_EMPTY, _EMPTY)  # velocities are empty if measurements are exact
        self._reporting, self._senses = plant if isinstance(plant, ReportingPlant) else None, False
        self.reported = PlantReport()

    @property
    def loop_options(self) -> LoopOptions:
        """Default options of the control loop on this plant, which clips inputs itself and reports what it applies."""
        if self._exact is not None:
            return {"fallback": "raise", "limits": False}
        return {"fallback": "zero" if self._servos else "hold", "limits": False}

    def reset(self, start: StateEvaluation) -> None:
        """Restart the plant at a state."""
        self.plant.reset(start.q, start.v)
        self._senses = self.report().actual is not None

    def report(self) -> PlantReport:
        """Report of the plant now."""
        if self._reporting is not None:
            self.reported = self._reporting.report()
        return self.reported

    def read_state(self, t: float) -> StateEvaluation:
        """Read the sensors at time t [s] and return the true state. Call it once per sample.

        Raises:
            DivergenceError: the state is not finite.
        """
        if self._exact is not None:
            return self._exact.state
        self.measured = self.plant.read()
        q, v = (self._senses and self.report().actual) or self.measured
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise DivergenceError("plant state is not finite")
        return self._reduced.at(q, v=v, t=t)

    def compute_input(self, loop: ControlLoop, t: float) -> Array:
        """Return the inputs (p,) of a loop for the last measurement."""
        if self._exact is not None:
            return loop.compute_input(t, self._exact.state, self._exact.integrals)
        return loop.step(t, *self.measured)

    def apply(self, loop: ControlLoop, T: Array) -> Array:
        """Apply inputs to the plant, report the applied ones to the loop, and return them; of servos their efforts."""
        (self.plant.apply if self._exact is None else self._exact.hold)(T)
        report = self.report()
        if self._servos:
            return np.full(len(T), np.nan) if report.effort is None else report.effort
        applied = T if report.applied is None else report.applied
        loop.report_applied_input(applied)
        return applied


class SampledRun:
    """Run whose samples somebody else calls: a loop over a duration, or one that follows a clock.

    Args:
        arguments: arguments of the run.

    Attributes:
        controller: the controller.
        loop: control loop of the controller.
        record: recorder of the run.
        stop: monitor of the stop conditions.
        samples: number of samples so far.

    Raises:
        RncError: as ``simulate``.
    """

    def __init__(self, arguments: RunArguments) -> None:
        check_arguments(arguments)
        reduced, controller, q0, dt, samples, v2_0, plant, options = arguments
        self.controller = controller
        origin = run_info.provenance_of(options.meta)
        # What could not be found is an error before the run, and loses no results.
        self._info, self._observer = run_info.RunInfo(dt=dt, versions=versions(), provenance=origin), options.observer
        self._adapter = adapter = PlantAdapter(ReducedPlant(reduced) if plant is None else plant, reduced)
        loop_options: LoopOptions = {**adapter.loop_options, "max_speed": options.stop.speed, **options.loop}
        kind = VelocityInputLoop if takes_velocities(plant) else ControlLoop
        self.loop: ControlLoop = kind(reduced, controller, dt, **loop_options)
        self.stop, self._dt, self.samples = StopMonitor(options.stop, reduced.robot), dt, 0
        self._zeros = zeros = np.zeros(reduced.r)
        self._fallbacks: list[int] = []  # numbers of the samples with a fallback command
        self._fallback_reason = ""
        self._late: LateTicks | None = None
        self._reduced, self._accelerations = reduced, limited_accelerations(controller)
        first = reduced.at(assembled_start(reduced, numbers_of(q0, "q0")), zeros if v2_0 is None else v2_0, t=0.0)
        adapter.reset(first)
        self._lift_off = LiftOffMonitor(adapter.reported.reduced, reduced) if options.stop.lift_off else None
        state = options.controller_state
        if state is None:
            state = controller.initial_state(adapter.read_state(0.0).measure(zeros))
        self.loop.resume(LoopState(begin=0.0, controller=state))
        self.record = Record(reduced, samples, integrated_outputs(reduced), adapter.reported)

    @property
    def plant(self) -> Plant:
        """Plant of the run."""
        return self._adapter.plant

    @property
    def time(self) -> float:
        """Time of the next sample [s]."""
        return self.samples * self._dt

    def sample(self, progress: Progress) -> Sample:
        """Measure, compute and apply the inputs, and record the sample.

        Args:
            progress: receives the time and the component at work, for error messages.
        """
        adapter, loop = self._adapter, self.loop
        progress.time = t = self.time
        state = adapter.read_state(t)
        try:
            self.stop.check(t, state)
        except DivergenceError as error:
            raise _blamed(error, adapter.report().errors, state.v) from None
        wall, begin = perf_counter(), thread_time()
        try:
            T = adapter.compute_input(loop, t)
        except Exception:
            progress.active_component = loop.active_component
            raise
        if perf_counter() - wall > self._dt:  # thread time, without other work of the computer, is never longer
            spent = thread_time() - begin
            self._late = with_late_tick(self._late, t, spent, self._dt)
        T = adapter.apply(loop, T)
        if loop.state.fault is not None:
            self._fallback_reason = self._fallback_reason or loop.state.fault
            self._fallbacks.append(self.samples)
        if self._lift_off is not None:
            self._lift_off.check(t, state, T, adapter.reported.external)
        integrals = loop.state.integrals if loop.state.integrals is not None else self._zeros
        measurement, command = self._add(t, state, T, integrals)
        self.samples += 1
        found = Sample(t, measurement, command, T, loop.state.controller)
        if self._observer is not None:
            progress.active_component = "the observer"
            self._observer(found)
            progress.active_component = MODEL
        return found

    def _add(self, t: float, state: StateEvaluation, T: Array, integrals: Array) -> tuple[Measurement, Command]:
        """Record a state with the last measurement and command of the loop, and return these."""
        adapter = self._adapter
        measurement, command = _last_decision(self.loop, state)
        outputs = (measurement.x1, measurement.x2) if measurement.q is state.q else None  # not of a sensor's state
        self.record.add(t, state, integrals, command, T, adapter.reported, outputs, adapter.measured[1])
        return measurement, command

    def advance(self) -> None:
        """Advance the plant to the next sample."""
        self._adapter.plant.advance(self._dt)

    def run_to(self, samples: int, progress: Progress) -> str | None:
        """Take samples, and advance between them, until there are so many; return ``failure``.

        Args:
            samples: number of samples at the end.
            progress: as for ``sample``.
        """
        for sample in range(self.samples, samples):
            self.sample(progress)
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
        report, own, late = self._adapter.report(), self.loop.state.controller, self._late
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
        missed = missed_goals(self.controller, run.q[-1], run.v2[-1]) if len(run.time) else ()
        return replace(run, grounds=Grounds(self._reduced, self._accelerations, tuple(missed)))

    def _fallback_use(self) -> run_info.FallbackUse | None:
        """Use of fallback commands so far."""
        if not self._fallbacks:
            return None
        samples = np.array(self._fallbacks)
        lengths = [len(each) for each in np.split(samples, np.flatnonzero(np.diff(samples) > 1) + 1)]
        # A sample that ended with an error is not counted as taken.
        last = lengths.pop() if samples[-1] >= self.samples - 1 else 0
        lasts = last * self._dt > self.loop.timeout or last > max(lengths, default=0)
        first = float(samples[0] * self._dt)
        return run_info.FallbackUse(len(samples), first, self._fallback_reason, lasts or self.loop.state.failed)


def _phases(report: PlantReport, dt: float) -> tuple[run_info.PhaseInfo, ...]:
    """Intervals between the contact events of a plant for a sampling period; empty if contacts do not switch."""
    events = report.contact_events
    ends = [*(event.cause for event in events[1:]), None]
    return tuple(
        run_info.PhaseInfo(
            " + ".join(event.closed) or "flight",
            int(np.ceil(event.time / dt - _ROUNDING)),
            event.time,
            dict(event.impulses),
            event.energy_loss,
            end,
        )
        for event, end in zip(events, ends[: len(events)], strict=True)
    )


def _integration(report: PlantReport) -> run_info.IntegrationAccuracy | None:
    """Estimated errors of the integration since the start; None if the plant does not estimate them."""
    if (errors := report.errors) is None:
        return None
    rate, total, most = float(errors.rate), float(errors.total), int(errors.most)
    return run_info.IntegrationAccuracy(report.tolerance, rate, total, most, max(int(errors.enough), most))


def _blamed(error: DivergenceError, errors: IntegrationErrors | None, v: Array) -> DivergenceError:
    """Return an error of a motion at velocity v (nv,) that says whether the integrator diverges, and not the robot."""
    if errors is None or errors.enough <= errors.most or errors.total <= _AT_FAULT * np.abs(v).max(initial=0.0):
        return error
    what = f"the integrator, not the robot: {error.what}; substeps {errors.most} is too small, set {errors.enough}"
    return DivergenceError(what, time=error.time)


def check_arguments(arguments: RunArguments) -> None:
    """Raise an error if an argument of a run has the wrong type, or if plant and controller do not fit together."""
    reduced, controller, *_, plant, options = arguments
    admit_model(reduced)
    admit_controller(controller)
    if plant is not None and (isinstance(plant, type) or not isinstance(plant, Plant)):
        raise ConfigurationError(f"plant: expected methods reset, read, apply, advance, found {type_name(plant)}")
    takes, gives = takes_velocities(plant), isinstance(controller, VelocityGiving) and controller.gives_velocities
    if takes and not gives:
        raise ConfigurationError(
            "the plant takes velocities: put rnc.control.ActuatorVelocityController(reduced, ...) over a kinematic "
            f"controller, found {type_name(controller)}"
        )
    if gives and not takes:
        raise ConfigurationError(
            "the controller gives velocities: expected a plant with velocity servos, such as "
            f"rnc.plants.VelocityPlant(reduced), found {type_name(plant)}"
        )
    if not isinstance(options, SimulationOptions):
        raise ConfigurationError(f"options: expected SimulationOptions, found {type_name(options)}")


def assembled_start(reduced: ReducedModel, q0: Array) -> Array:
    """Initial configuration without rounding errors of the holonomic rows.

    Raises:
        InputError: the residual of a holonomic row is larger than rounding.
    """
    if not reduced.assembly.size:
        return q0
    if np.abs(reduced.assembly.residual(q0)).max() > _ASSEMBLED:
        name, residual = reduced.assembly.worst(q0)
        raise InputError(
            f"the initial configuration violates {name} by {residual:.3g} [m or rad]; "
            "reduced.assembled(q0) or system.assembled(q0) returns the nearest one that satisfies it"
            f"{reduced.assembly.remedy(name)}"
        )
    return reduced.assembled(q0)


def _last_decision(loop: ControlLoop, state: StateEvaluation) -> tuple[Measurement, Command]:
    """Measurement and command of the loop's last step. For a safe command, the goals are those of the step before."""
    if loop.last is None:
        return state.measure(loop.state.integrals), Command(T=loop.state.T)
    if loop.state.fault is not None:
        return loop.last.measurement, loop.last.command._replace(F=None, T=loop.state.T)
    return loop.last.measurement, loop.last.command
