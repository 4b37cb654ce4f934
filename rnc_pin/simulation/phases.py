"""Simulation of a run whose constraints appear and vanish, phase by phase."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, TypeAlias, cast

import numpy as np

from rnc_pin.control import ZeroInput
from rnc_pin.control.controller import Controller, describe
from rnc_pin.control.loop.options import type_name
from rnc_pin.errors import ConfigurationError, ConstraintError, RncError, SimulationError
from rnc_pin.model.impact import Impact, Restitution, impact
from rnc_pin.model.parameter_types import Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants import ReducedPlant
from rnc_pin.plants.reduced.events import ReducedStep, Watched, first_event
from rnc_pin.simulation.phase_events import BoundEvent, Event, LiftOffMonitor, PushingForces
from rnc_pin.simulation.phase_record import PhasePart, joined
from rnc_pin.simulation.run_info import Outcome, PhaseInfo
from rnc_pin.simulation.sampled_run import SampledRun
from rnc_pin.simulation.simulate import sample_count
from rnc_pin.simulation.simulation_options import DEFAULT_OPTIONS, RunArguments, SimulationOptions
from rnc_pin.simulation.stop import Progress, complete_run
from rnc_pin.simulation.trajectory import Trajectory

_REBOUND = 1e-6  # velocity against a row that counts as a rebound, relative to the speed
OnLiftOff = Literal["ignore", "stop", "release"]


@dataclass(frozen=True)
class Phase:
    """Part of a run under one set of constraints.

    The time of constraints that depend on it starts at zero with the phase, as that of its controller.

    Args:
        reduced: model with the constraints of the phase; all phases have the same robot.
        duration: duration [s], rounded to a multiple of the sampling period; with ``until`` the longest one.
        controller: controller of the phase; its time starts at zero with the phase. None for no inputs.
        until: event that ends the phase. The run fails if the event does not occur.
        restitution: coefficient of Newton for the impact at the start of the phase, see ``rnc.impact``.
        impact: system whose constraints act at the start of the phase; by default those of ``reduced``. Name contacts
            that rebound only here, not in ``reduced``.
        on_lift_off: action if a contact would pull. "ignore" keeps it, "stop" ends the run with an error, "release"
            starts the next phase, which must not have the contact.
        pushing: constraint rows that only push, in addition to contacts with the ground: 1 along the row's velocity,
            -1 against it.
        plant: plant of ``reduced``; ``ReducedPlant(reduced)`` by default.
        name: name for messages and records.

    Raises:
        ConfigurationError: an argument has the wrong type.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> phase = rnc.Phase(reduced, duration=1.0, name="on ice")
        >>> phase.on_lift_off
        'ignore'
    """

    reduced: ReducedModel
    duration: Positive
    controller: Controller | None = None
    until: Event | None = None
    restitution: Restitution = 0.0
    impact: NonholonomicSystem | ReducedModel | None = None
    on_lift_off: OnLiftOff = "ignore"
    pushing: Mapping[str, int] = field(default_factory=dict)
    plant: ReducedPlant | None = None
    name: str = ""

    def __post_init__(self) -> None:
        if self.plant is not None and not (isinstance(self.plant, ReducedPlant) and self.plant.reduced is self.reduced):
            raise ConfigurationError(
                f"phases: expected a ReducedPlant of the phase's model, found {type_name(self.plant)}; "
                "MuJoCo and other plants have contacts of their own: use them with simulate"
            )
        if self.until is not None and not isinstance(self.until, Event):
            raise ConfigurationError(
                f"until: expected an event such as OutputCrossing or ContactLoss, found {type_name(self.until)}"
            )
        if self.on_lift_off not in ("ignore", "stop", "release"):
            raise ConfigurationError(f"on_lift_off: expected ignore, stop or release, found {self.on_lift_off!r}")


PhaseStart: TypeAlias = Callable[[np.ndarray, np.ndarray, float], Phase]
"""Function from configuration (nq,), velocity (nv,) and time [s] before a phase to the phase."""


def simulate_phases(
    phases: Sequence[Phase | PhaseStart],
    q0: np.ndarray,
    dt: float = 0.002,
    *,
    v2_0: np.ndarray | None = None,
    options: SimulationOptions = DEFAULT_OPTIONS,
) -> Trajectory:
    """Simulate a run whose constraints appear and vanish.

    Each phase has constraints and a controller. At its start, ``rnc.impact`` gives the velocity: constraints that
    appear remove the velocity against them, and constraints that vanish change nothing. Events are located within the
    sampling period, and the next phase starts at that time. So the first sample of a phase has the time of the last
    sample of the phase before.

    The trajectory has the columns of all phases. A row, contact, actuator or reduced force has zeros in phases
    without it. Outputs have their values in all phases, and goals are NaN where there is none. ``trajectory.phase`` is
    the phase of each sample, and ``trajectory.info.phases`` has starts, impulses and lost energies. Impacts count as
    negative work, so ``energy - work`` is constant.

    Args:
        phases: phases, in order. A function ``(q, v, t) -> Phase`` makes its phase from the state before it, for
            example with a reference that starts there, or with rows that continue over time.
        q0: initial configuration (nq,).
        dt: sampling period [s].
        v2_0: initial reduced velocity (r,) of the first phase; zero by default.
        options: stop conditions, control loop, observer and origin of the run. ``controller_state`` is not supported.

    Raises:
        RncError: as ``simulate``. A ConstraintError or InputError if a phase cannot start, with its name.
        ConfigurationError: no phases, or phases of different robots.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> free = rnc.NonholonomicSystem(robot).reduce()
        >>> blade = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> slide = rnc.Phase(free, duration=0.5, name="slides")
        >>> grip = rnc.Phase(blade, duration=0.5, name="grips")
        >>> run = rnc.simulate_phases([slide, grip], robot.configuration(), dt=0.1, v2_0=[1.0, 0.3, 0.0])
        >>> run.phase.tolist(), run.info.phases[1].energy_loss > 0
        ([0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1], True)
    """
    if not phases:
        raise ConfigurationError("phases: expected at least one")
    if options.controller_state is not None:
        raise ConfigurationError("controller_state: the controllers of phases start with their own states")
    run = _PhasedRun(phases, np.array(q0, dtype=float), dt, v2_0, options)
    return complete_run(run.advance, run.finish)


class _PhasedRun:
    """Run through phases."""

    def __init__(
        self,
        phases: Sequence[Phase | PhaseStart],
        q0: np.ndarray,
        dt: float,
        v2_0: np.ndarray | None,
        options: SimulationOptions,
    ) -> None:
        self._phases, self._dt, self._options = phases, dt, options
        self._q, self._v2_0 = q0, v2_0
        self._v: np.ndarray | None = None
        self._time, self._work, self._samples = 0.0, 0.0, 0
        self._parts: list[PhasePart] = []
        self._run: SampledRun | None = None
        self._info: PhaseInfo | None = None
        self._reduced: ReducedModel | None = None
        self._released: tuple[str, ...] = ()
        self._failure: str | None = None
        # Errors of the first phase are those of its caller, before the run begins.
        self._first = self._phase(0)
        self._start(0, self._first)

    def advance(self, progress: Progress) -> str | None:
        for number in range(len(self._phases)):
            phase, name = self._first, self._name(number, None if number else self._first)
            progress.time = self._time
            try:
                if number:
                    phase = self._phase(number)
                    name = self._name(number, phase)
                    self._start(number, phase)
                self._go(phase, progress)
            except RncError as error:
                raise error.within(f"phase '{name}', from t = {self._time:.3f} s") from error.__cause__
            if self._failure is not None:
                return f"phase '{name}': {self._failure}"
        return None

    def finish(self, outcome: Outcome, message: str | None) -> Trajectory:
        """Return the trajectory so far."""
        self._close(outcome, message)
        return joined(self._parts, self._dt, outcome, message)

    # ------------------------------------------------------------------ start of a phase

    def _name(self, number: int, phase: Phase | None) -> str:
        return phase.name if phase is not None and phase.name else f"{number + 1}"

    def _phase(self, number: int) -> Phase:
        entry = self._phases[number]
        if not isinstance(entry, Phase):
            entry = entry(self._q.copy(), np.zeros(0) if self._v is None else self._v.copy(), self._time)
        if not isinstance(entry, Phase):
            raise ConfigurationError(f"phases[{number}]: expected a Phase, found {type_name(entry)}")
        if entry.on_lift_off == "release" and number + 1 == len(self._phases):
            raise ConfigurationError(f"phases[{number}]: on_lift_off 'release' requires a next phase")
        if self._parts:
            _check_same_robot(self._parts[0].reduced, entry.reduced, number)
        return entry

    def _start(self, number: int, phase: Phase) -> None:
        """Apply the impact at the start of a phase, and construct its run."""
        jump = None
        if self._v is not None:
            jump = self._impact(phase, self._v)
            self._work -= jump.loss
        capacity = sample_count(phase.duration, self._dt)
        v2 = self._v2_0 if jump is None else phase.reduced.at(self._q, v=jump.v, t=0.0).v2
        name, controller = self._name(number, phase), phase.controller or ZeroInput(phase.reduced)
        plant = phase.plant or ReducedPlant(phase.reduced)
        arguments = RunArguments(phase.reduced, controller, self._q, self._dt, capacity, v2, plant, self._options)
        self._run, self._reduced = SampledRun(arguments, start=self._time), phase.reduced
        self._info = PhaseInfo(name, self._samples, self._time, controller=describe(controller))
        if jump is not None and jump.changes_velocity:
            self._info = replace(self._info, impulses=dict(jump.impulses), energy_loss=jump.loss)

    def _impact(self, phase: Phase, v: np.ndarray) -> Impact:
        names = phase.reduced.all_constraints.names
        for name in self._released:
            if name in names:
                raise ConfigurationError(f"contact row '{name}' was released, but the next phase has it again")
        acting = phase.reduced if phase.impact is None else phase.impact
        reduced = acting.reduce() if isinstance(acting, NonholonomicSystem) else acting
        jump = impact(reduced.frozen(0.0), self._q, v, phase.restitution)
        residual = phase.reduced.at(self._q, v=jump.v, t=0.0).residual
        row = int(np.argmax(np.abs(residual))) if len(residual) else 0
        if len(residual) and abs(residual[row]) > _REBOUND * max(float(np.linalg.norm(jump.v)), 1e-9):
            raise ConstraintError(
                f"'{phase.reduced.constraints.names[row]}' moves at {residual[row]:.3g} after the impact, but the "
                "phase keeps this row: name a contact that rebounds in 'impact', not in the constraints of the phase"
            )
        if phase.on_lift_off != "ignore":
            for name, (constraint, sign) in PushingForces(phase.reduced, phase.pushing).constraint_rows.items():
                impulse = sign * jump.impulses.get(constraint, 0.0)
                if impulse < -_REBOUND * jump.largest_impulse:
                    raise ConstraintError(
                        f"the impact pulls at '{name}' with {-impulse:.3g} N s: a contact that only pushes cannot "
                        "appear while its bodies separate"
                    )
        return jump

    # ------------------------------------------------------------------ motion

    def _go(self, phase: Phase, progress: Progress) -> None:
        """Run a phase to its event, or to its end."""
        assert self._run is not None
        run, plant = self._run, cast(ReducedPlant, self._run.plant)
        events = _events(phase)
        count = sample_count(phase.duration, self._dt)
        monitor = None
        if phase.on_lift_off == "stop":
            monitor = LiftOffMonitor(PushingForces(phase.reduced, phase.pushing))
        watched = [Watched(partial(_value, event, plant), event.direction) for event in events]
        values: list[float | None] = [np.inf if event.from_start else None for event in events]
        for sample in range(count):
            run.sample(progress)
            if monitor is not None:
                monitor.check(self._time + sample * self._dt, plant.state, plant.applied, plant.external)
            for event, each, before in zip(events, watched, values, strict=True):  # under new inputs
                if before is not None and each.crosses(before, each.value()):
                    self._end(phase, event, sample * self._dt)
                    return
            if sample + 1 == count:
                break
            step = ReducedStep(plant, self._dt)
            found = first_event(step, watched)
            if found is not None:
                elapsed, number = found
                step.move_to(elapsed)
                run.record_between(elapsed, plant.integrals, plant.applied)
                self._end(phase, events[number], sample * self._dt + elapsed)
                return
            step.move_to(self._dt)
            values = [each.value() for each in watched]
        if phase.until is not None:
            raise SimulationError(f"'{events[0].name}' did not occur within {phase.duration:g} s")
        self._end(phase, None, (count - 1) * self._dt)

    def _end(self, phase: Phase, event: BoundEvent | None, elapsed: float) -> None:
        """Keep the state at the end of a phase, from which the next one starts."""
        assert self._run is not None
        assert self._info is not None
        plant = cast(ReducedPlant, self._run.plant)
        self._released, self._failure = (), self._run.failure
        if event is not None:
            self._info = replace(self._info, end=event.name)
            if event.name == "lift-off":
                forces = PushingForces(phase.reduced, phase.pushing)
                values = forces.at(plant.state, plant.applied, plant.external)
                lost = forces.names[int(np.argmin(values))]
                self._released = (forces.constraint_rows[lost][0],) if lost in forces.constraint_rows else ()
                self._info = replace(self._info, end=f"lift-off of {lost}")
        self._q, self._v = plant.read()
        work = plant.work
        self._close(Outcome.COMPLETED, None)
        self._time, self._work = self._time + elapsed, self._work + work

    def _close(self, outcome: Outcome, message: str | None) -> None:
        """Add the run of the present phase to the parts."""
        if self._run is None:
            return
        assert self._info is not None
        assert self._reduced is not None
        trajectory = self._run.finish(outcome, message)
        self._parts.append(PhasePart(self._reduced, trajectory, self._info, self._work))
        self._samples += len(trajectory.time)
        self._run = None


def _value(event: BoundEvent, plant: ReducedPlant) -> float:
    return event.value(plant.state, plant.applied, plant.external)


def _events(phase: Phase) -> list[BoundEvent]:
    events = [] if phase.until is None else [phase.until.bind_event(phase.reduced)]
    if phase.on_lift_off == "release":
        events.append(LiftOffMonitor(PushingForces(phase.reduced, phase.pushing)).event())
    return events


def _check_same_robot(first: ReducedModel, other: ReducedModel, number: int) -> None:
    one, two = first.robot, other.robot
    if (one.nq, one.nv, tuple(one.joint_names)) != (two.nq, two.nv, tuple(two.joint_names)):
        raise ConfigurationError(f"phases[{number}]: its robot '{two.name}' has other joints than '{one.name}'")
