"""Run of a sampled controller and a plant, one sample at a time."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter, thread_time

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.controller import Command, VelocityGiving, findings_of, limited_accelerations, missed_goals
from rnc_pin.control.loop import ControlLoop, LoopOptions, LoopState, VelocityInputLoop
from rnc_pin.control.loop.loop_state import with_late_tick
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
from rnc_pin.simulation.judgement import judged_by
from rnc_pin.simulation.record import Record
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
        """Default options of the control loop on this plant."""
        if self._exact is None:
            return {"fallback": "zero" if self._servos else "hold", "limits": False}
        return {"fallback": "raise", "limits": self._exact.actuator_limits}

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

    def phases(self, dt: float) -> tuple[run_info.PhaseInfo, ...]:
        """Intervals between the contact events of the plant for a sampling period; empty if contacts do not switch."""
        events = self.report().contact_events
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

    @property
    def sensed(self) -> tuple[Array, ...]:
        """Measured velocities, use of the friction limits, and forces of the plant; empty if it states none of them."""
        if self._exact is not None:
            return ()
        found = self.reported
        kinds = found.friction_used, found.slip_speed, found.normal_forces, found.contact_forces
        return self.measured[1], *(np.array([*each.values()]) for each in kinds)


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
        self._provenance, self._observer = run_info.provenance_of(options.meta), options.observer
        self._adapter = adapter = PlantAdapter(ReducedPlant(reduced) if plant is None else plant, reduced)
        loop_options: LoopOptions = {**adapter.loop_options, "max_speed": options.stop.speed, **options.loop}
        kind = VelocityInputLoop if takes_velocities(plant) else ControlLoop
        self.loop: ControlLoop = kind(reduced, controller, dt, **loop_options)
        self.stop, self._dt, self.samples = StopMonitor(options.stop, reduced.robot), dt, 0
        self._zeros = zeros = np.zeros(reduced.r)
        self._stretch, self._longest = 0, 0  # samples with a fallback command: now, and the most of those that ended
        self._reduced, self._accelerations = reduced, limited_accelerations(controller)
        first = reduced.at(assembled_start(reduced, numbers_of(q0, "q0")), zeros if v2_0 is None else v2_0, t=0.0)
        adapter.reset(first)
        self._lift_off = LiftOffMonitor(adapter.reported.reduced, reduced) if options.stop.lift_off else None
        state = options.controller_state
        if state is None:
            state = controller.initial_state(adapter.read_state(0.0).measure(zeros))
        self.loop.resume(LoopState(begin=0.0, controller=state))
        found = adapter.reported
        self.record = Record(reduced, samples, integrated_outputs(reduced), tuple(found.friction_used))
        normal = dict.fromkeys(found.normal_forces, "N")
        self.record.own_force_units = {"normal_forces": normal, "contact_forces": dict(found.contact_force_units)}

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
            self.record.late = with_late_tick(self.record.late, t, spent, self._dt)
        T = adapter.apply(loop, T)
        self._count_fallback(t, loop.state.fault)
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

    def _count_fallback(self, t: float, reason: str | None) -> None:
        """Record that the command of this sample is a fallback; the reason is None if it is not."""
        if reason is None:
            if self._stretch:
                self._longest, self._stretch = max(self._longest, self._stretch), 0
            return
        self._stretch += 1
        before = self.record.fallback
        first = run_info.FallbackUse(0, t, reason, False) if before is None else before
        self.record.fallback = replace(first, samples=first.samples + 1)

    def _add(self, t: float, state: StateEvaluation, T: Array, integrals: Array) -> tuple[Measurement, Command]:
        """Record a state with the last measurement and command of the loop, and return these."""
        adapter = self._adapter
        measurement, command = _last_decision(self.loop, state)
        report = adapter.reported
        self.record.moves(report.reduced, report.external)
        outputs = (measurement.x1, measurement.x2) if measurement.q is state.q else None  # not of a sensor's state
        self.record.add(t, state, integrals, command, T, report.work, outputs, adapter.sensed)
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

    def integration(self) -> run_info.IntegrationAccuracy | None:
        """Estimated errors of the integration since the start; None if the plant does not estimate them."""
        report = self._adapter.report()
        if (errors := report.errors) is None:
            return None
        rate, total, most = float(errors.rate), float(errors.total), int(errors.most)
        return run_info.IntegrationAccuracy(report.tolerance, rate, total, most, max(int(errors.enough), most))

    @property
    def failure(self) -> str | None:
        """Reason why the loop only gives safe commands; None if it works."""
        state = self.loop.state
        return f"the loop gave the safe command until the end: {state.fault}" if state.failed else None

    def finish(self, outcome: run_info.Outcome, message: str | None = None) -> Trajectory:
        """Return the trajectory so far."""
        self.record.phases = self._adapter.phases(self._dt)
        if self.record.fallback is not None:
            lasts = self._stretch * self._dt > self.loop.timeout or self._stretch > self._longest
            self.record.fallback = replace(self.record.fallback, at_the_end=lasts or self.loop.state.failed)
        if self.record.late is not None:
            self.record.late = self.record.late._replace(ticks=self.samples) if self.record.late.late else None
        self.record.integration = self.integration()
        self.record.findings = findings_of(self.controller, self.loop.state.controller, self.samples)
        run = self.record.finish(self._dt, self._provenance, outcome, message)
        missed = missed_goals(self.controller, run.q[-1], run.v2[-1]) if len(run.time) else ()
        return judged_by(run, self._reduced, self._accelerations, missed)


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
