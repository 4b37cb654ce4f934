"""Plant whose contacts with the ground open and close by themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from rnc_pin.errors import ConfigurationError, SimulationError
from rnc_pin.model.impact import Impact
from rnc_pin.model.integrators.runge_kutta import DEFAULT_TOLERANCE
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.reduced.contact_modes import NONE, Closed, ContactModes, consistent, force_margin
from rnc_pin.plants.reduced.reduced_plant import EventStep, ReducedPlant
from rnc_pin.plants.reduced.step_control import IntegrationErrors
from rnc_pin.plants.reduced.unilateral_contact import UnilateralContact, bound_contacts, check_depth, radius_of_gyration

# Relative to the size of the robot, its radius of gyration:
_TOUCHES = 1e-8  # gap of a contact that lands together with another one
_ROUNDING = 1e-11  # gap that rounding explains
_HALVINGS = 40
_EVENTS = 100  # largest number of events in one step


@dataclass(frozen=True)
class ContactEvent:
    """Contacts that opened or closed.

    Attributes:
        time: time [s].
        cause: description, such as "landing of ball"; "start" for the first one.
        closed: names of the closed contacts from then on.
        impulses: impulse of each row that took part in an impact [N s or N m s]; empty without an impact.
        energy_loss: kinetic energy that the impact removed [J].
    """

    time: float
    cause: str
    closed: tuple[str, ...]
    impulses: Mapping[str, float] = field(default_factory=dict)
    energy_loss: float = 0.0


class _Signals:
    """Gaps (c,) and their rates of all contacts, and normal forces of the closed ones, at the state of a plant."""

    def __init__(self, modes: ContactModes, closed: Closed, plant: ReducedPlant) -> None:
        state = plant.state
        at = modes.position(state.q)
        self.gaps = np.array([each.gap(at) for each in modes.contacts])
        self.rates = np.array([each.gap_rate(at, state.v) for each in modes.contacts])
        self.forces = np.zeros(0)
        if closed:
            self.forces = modes.forces(closed, plant)


class ContactPlant:
    """Plant whose contacts with the ground open and close by themselves.

    Each set of closed contacts has a model, which a ``ReducedPlant`` integrates. The plant finds the time of the next
    event within a step, to rounding:

    * A contact lands when its gap becomes zero. The impact is that of ``rnc.impact``, with the coefficient of the
      contact for its height row and zero for the rows that prevent slip. If the contact does not rebound, it closes.
    * A contact lifts off when its normal force becomes zero. It can land again.

    Contacts that close or open together are the largest set in which contacts only push and the others separate. If an
    impact has no such set, no contact that touches slips (``ContactImpacts.sticking``).

    Args:
        system: system without the contacts, with the actuators.
        contacts: the contacts.
        joint_damping, actuator_limits, joint_friction, substeps, tolerance: as for ``ReducedPlant``.

    Attributes:
        tolerance: allowed error of the integration per second.
        closed: indices of the closed contacts.
        contact_events: events since the start.

    Raises:
        ConfigurationError: no contacts, contacts of the same name, or a contact without a gap.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot)
        >>> plant = rnc.ContactPlant(system, [rnc.UnilateralContact(rnc.RollingBall("ball", 0.2), restitution=0.5)])
        >>> plant.reset(robot.configuration({"root_joint": [0, 0, 0.5, 0, 0, 0, 1]}), np.zeros(6))
        >>> plant.advance(0.5)
        >>> [(event.cause, round(event.time, 3)) for event in plant.contact_events]
        [('start', 0.0), ('landing of ball', 0.247), ('landing of ball', 0.495)]
    """

    def __init__(
        self,
        system: NonholonomicSystem,
        contacts: Sequence[UnilateralContact],
        joint_damping: bool = False,
        actuator_limits: bool = False,
        joint_friction: bool = False,
        substeps: int | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> None:
        bound = bound_contacts("ContactPlant", system, contacts)
        for each in bound:
            if each.has_friction:
                raise ConfigurationError(
                    f"contact '{each.name}': a ContactPlant has no limit of friction and no moments of friction; use a "
                    "FrictionPlant"
                )
        plant_of = partial(  # a lambda could not be pickled
            ReducedPlant,
            joint_damping=joint_damping,
            actuator_limits=actuator_limits,
            joint_friction=joint_friction,
            substeps=substeps,
            tolerance=tolerance,
        )
        self.tolerance = tolerance
        self._modes = ContactModes(system, bound, plant_of)
        self.closed, self._clinging = NONE, NONE
        self._plant = self._modes.plant(self.closed)
        self.contact_events: tuple[ContactEvent, ...] = ()
        self._time, self._past_work, self._size = 0.0, 0.0, 0.0

    # ------------------------------------------------------------------ state

    @property
    def reduced(self) -> ReducedModel:
        """Model with the contacts that are closed."""
        return self._plant.reduced

    @property
    def applied(self) -> np.ndarray:
        """Applied inputs (p,), within the actuator limits."""
        return self._plant.applied

    @property
    def external(self) -> np.ndarray | None:
        """Generalized forces (nv,) of damping and friction; None without them."""
        return self._plant.external

    @property
    def errors(self) -> IntegrationErrors:
        """Estimated errors of the integration since the start."""
        return self._plant.errors

    @property
    def work(self) -> float:
        """Work since the start, minus the energy that damping, friction and impacts removed [J]."""
        return self._past_work + self._plant.work

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart at time zero, at configuration q (nq,) and velocity v (nv,).

        Contacts that touch the ground, or are a little below it, are closed; if they approach it, with an impact.

        Raises:
            InputError: a contact is below the ground.
        """
        self._time, self._past_work, self.contact_events = 0.0, 0.0, ()
        self.closed, self._clinging = NONE, NONE
        self._plant = self._modes.plant(self.closed)
        self._plant.reset(np.array(q, dtype=float), np.array(v, dtype=float))
        self._size = radius_of_gyration(self._plant.reduced.robot.model, self._plant.read()[0])
        start = _Signals(self._modes, self.closed, self._plant)
        check_depth(self._modes.contacts, start.gaps, self._size)
        touching = frozenset(np.flatnonzero((start.gaps <= _ROUNDING * self._size) & (start.rates <= 0.0)).tolist())
        if touching:
            self._land("start", touching)
        else:
            self._record("start")

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,)."""
        return self._plant.read()

    def apply(self, T: np.ndarray) -> None:
        """Hold the inputs T (p,), clipped to the actuator limits. A jump of the inputs can open contacts."""
        self._plant.apply(T)
        self._open_where_pulled()

    # ------------------------------------------------------------------ motion

    def advance(self, dt: float) -> None:
        """Advance by a time dt [s], through all events on the way.

        Raises:
            DivergenceError: velocities or accelerations are not finite.
            SimulationError: contacts open and close without end, or no set of them is consistent.
        """
        end = self._time + dt
        for _ in range(_EVENTS):
            left = end - self._time
            before = _Signals(self._modes, self.closed, self._plant)
            step = EventStep(self._plant, left)
            event = self._first_event(step, before)
            if event is None:
                step.move_to(left)
                self._time = end
                return
            elapsed, number = event
            step.move_to(elapsed)
            self._time = min(self._time + elapsed, end)
            self._happen(number)
        raise SimulationError(
            f"contacts open and close {_EVENTS} times within {dt:g} s at t = {self._time:.4f} s: "
            "increase the rest_speed of the contacts"
        )

    def _happen(self, number: int) -> None:
        """Open or close a contact at the present state."""
        name = self._modes.contacts[number].name
        if number in self._clinging and self._gap_rate(number) > 0.0:  # it leaves the ground for good
            mode = self.closed, self._clinging - {number}
            self._take(mode, self._started(mode, *self._plant.read(), self._plant.applied))
            return
        if number in self.closed:
            self._use(self.closed - {number}, self.closed)
            self._record(f"lift-off of {name}")
            return
        now = _Signals(self._modes, frozenset(), self._plant)
        with_it = np.flatnonzero((now.gaps <= _TOUCHES * self._size) & (now.rates < 0.0)).tolist()
        self._land(f"landing of {name}", self.closed | {number, *with_it})

    def _land(self, cause: str, touching: Closed) -> None:
        """Apply an impact of the touching contacts."""
        q, v = self._plant.read()
        candidates, jump = self._modes.after_impact(touching, q, v, self._time)
        T = self._plant.applied
        self._past_work += self._plant.work - jump.loss
        self.closed, self._clinging = NONE, NONE
        self._plant = self._started((NONE, NONE), q, jump.v, T)
        self._use(candidates, candidates)
        self._record(cause, jump if jump.changes_velocity else None)

    def _open_where_pulled(self) -> None:
        """Open contacts whose normal force is negative, as after a jump of the inputs."""
        before = self.closed
        if before and not self._modes.holds(before, frozenset(), self._plant):
            self._use(before, before)
            self._record(f"lift-off of {self._modes.names(before - self.closed)}")

    def _use(self, candidates: Closed, touching: Closed) -> None:
        """Close those of the candidates that push while the others that touch separate."""
        started = {(self.closed, self._clinging): self._plant}

        def holds(closed: Closed, clinging: Closed = NONE) -> bool:
            mode = closed, clinging
            if mode not in started:
                started[mode] = self._started(mode, *self._plant.read(), self._plant.applied)
            return self._modes.holds(closed, touching - closed, started[mode])

        found, clinging = consistent(candidates, holds), NONE
        if found is None:
            found = consistent(candidates, lambda closed: holds(closed, touching - closed))
            if found is None:
                raise SimulationError(
                    f"contacts {self._modes.names(touching)} at t = {self._time:.4f} s: no set of them only pushes "
                    "while the others separate without slip"
                )
            clinging = touching - found
        self._take((found, clinging), started[found, clinging])

    def _take(self, mode: tuple[Closed, Closed], plant: ReducedPlant) -> None:
        """Continue with the plant of a mode."""
        if plant is not self._plant:
            self._past_work += self._plant.work
            (self.closed, self._clinging), self._plant = mode, plant

    def _started(self, mode: tuple[Closed, Closed], q: np.ndarray, v: np.ndarray, T: np.ndarray) -> ReducedPlant:
        """Plant of closed and clinging contacts, at a state and under inputs T."""
        plant, errors = self._modes.plant(*mode), self._plant.errors
        plant.reset(q, v, self._time)
        plant.apply(T)
        plant.keep_errors(errors)
        return plant

    def _record(self, cause: str, jump: Impact | None = None) -> None:
        closed = tuple(self._modes.contacts[number].name for number in sorted(self.closed))
        impulses = {} if jump is None else {name: each for name, each in jump.impulses.items() if each}
        loss = 0.0 if jump is None else jump.loss
        self.contact_events += (ContactEvent(self._time, cause, closed, impulses, loss),)

    # ------------------------------------------------------------------ events

    def _first_event(self, step: EventStep, before: _Signals) -> tuple[float, int] | None:
        """Time after the start of a step [s] and contact of the first event within it; None without any."""
        after = _Signals(self._modes, self.closed, self._plant)
        found: list[tuple[float, int]] = []
        margin = force_margin(after.forces)
        for column, number in enumerate(sorted(self.closed)):
            if after.forces[column] < -margin:
                found.append((self._zero_of_force(step, before, column), number))
        for number in range(len(self._modes.contacts)):
            if number not in self.closed:
                time = self._landing_time(step, before, after, number)
                found += [] if time is None else [(time, number)]
        for number in self._clinging:
            if after.rates[number] > self._modes.contacts[number].contact.rest_speed:
                found.append((step.crossing(partial(self._excess_rate, number)), number))
        return min(found, default=None)

    def _excess_rate(self, number: int) -> float:
        return self._gap_rate(number) - self._modes.contacts[number].contact.rest_speed

    def _gap_rate(self, number: int) -> float:
        state = self._plant.state
        return self._modes.contacts[number].gap_rate(self._modes.position(state.q), state.v)

    def _zero_of_force(self, step: EventStep, before: _Signals, column: int) -> float:
        if before.forces[column] <= 0.0:
            return 0.0
        return step.crossing(lambda: float(_Signals(self._modes, self.closed, self._plant).forces[column]))

    def _landing_time(self, step: EventStep, before: _Signals, after: _Signals, number: int) -> float | None:
        """Time at which the gap of a contact becomes zero; None if it stays open."""
        contact, rounding = self._modes.contacts[number], _ROUNDING * self._size

        def gap() -> float:
            return contact.gap(self._modes.position(self._plant.state.q))

        end, departs = step.dt, before.gaps[number] <= rounding
        if after.gaps[number] >= (-rounding if departs else 0.0):
            # It may touch the ground in between, such as the corner of a body that turns.
            if not before.rates[number] < 0.0 < after.rates[number]:
                return None
            end = step.crossing(partial(self._gap_rate, number))
            step.move_to(end)
            if gap() >= -rounding:
                return None
        if not departs:
            return step.crossing(gap, 0.0, end)
        for halving in range(1, _HALVINGS):
            start = end * 0.5**halving
            step.move_to(start)
            if gap() > 0.0:
                return step.crossing(gap, start, end)
        return 0.0
