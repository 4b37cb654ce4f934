"""Plant whose contacts with the ground open and close by themselves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from rnc_pin.errors import ConfigurationError, ConstraintError, InputError, SimulationError
from rnc_pin.lab.contacts import contact_impulses
from rnc_pin.lab.contacts.contact_impulses import UnilateralContact
from rnc_pin.lab.contacts.sliding_plant import SlidingPlant, SlidingStep
from rnc_pin.math.convex_programs import nonnegative
from rnc_pin.math.linear_algebra import null_space
from rnc_pin.model.input_validation import numbers_of, own_vector
from rnc_pin.model.integrators import DEFAULT_TOLERANCE
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.friction import DryFriction
from rnc_pin.plants.plant import ContactEvent, IntegrationErrors, PlantReport
from rnc_pin.plants.reduced_plant import ReducedPlant

Closed = frozenset[int]
"""Indices of the closed contacts."""
NONE: Closed = frozenset()


class ContactPlant:
    """Plant whose contacts with the ground open and close by themselves.

    The plant finds the time of the next event within a step:

    * A contact lands when its gap becomes zero. The impact has two phases: compression until no contact approaches,
      and a rebound, which returns at most the share ``restitution^2`` of the work of the compression.
    * A contact lifts off when its normal force becomes zero. It can land again.

    Contacts have a coefficient of friction, or none of them has a limit of friction:

    * Without a limit, closed contacts do not slip. Each set of closed contacts has a model, which a ``ReducedPlant``
      integrates. Contacts that close or open together are the largest set in which contacts only push and the others
      separate. Where there is none, as in Painleve's paradox, the run ends with an error that has the time.
    * With coefficients, contacts stick and slide (``SlidingPlant``), and a ``ReducedPlant`` integrates flight.

    Args:
        system: system without the contacts, with the actuators.
        contacts: the contacts.
        joint_damping, actuator_limits, joint_friction, substeps, tolerance: as for ``ReducedPlant``.

    Attributes:
        tolerance: allowed error of the integration per second.
        contact_events: events since the start.

    Raises:
        ConfigurationError: no contacts, contacts of the same name, a contact without a gap, coefficients of friction of
            some contacts only, or with coefficients moving or momentum constraints in the system.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot)
        >>> plant = rnc.ContactPlant(system, [rnc.UnilateralContact(rnc.RollingBall("ball", 0.2), friction=0.3)])
        >>> plant.reset(robot.configuration({"root_joint": [0, 0, 0.21, 0, 0, 0, 1]}), np.array([1.0, 0, 0, 0, 0, 0]))
        >>> plant.advance(0.2)
        >>> [(event.cause, round(event.time, 3)) for event in plant.contact_events[:3]]
        [('start', 0.0), ('landing of ball', 0.045), ('slip of ball', 0.045)]
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
        self._system, self._contacts = system, contact_impulses.bound_contacts(system, contacts)
        self.tolerance = tolerance
        self._options = joint_damping, actuator_limits, joint_friction, substeps, tolerance
        self._plants: dict[Closed, ReducedPlant] = {}
        """Plant with each set of closed contacts, made at its first use."""
        # Made at once: errors of the system itself come before errors of contacts.
        self._flight = self._plant_with(NONE)
        self._rows = contact_impulses.ContactRows(self._contacts, DryFriction(self._flight.reduced, joint_friction))
        self._sliding: SlidingPlant | None = None
        self._force_units: dict[str, str] = {}  # of ``contact_forces``
        if any(each.contact.friction is not None for each in self._contacts):
            reduced = self._flight.reduced
            conserved = any(block.conserved is not None for block, *_ in reduced.constraints.places)
            if reduced.affine or reduced.rheonomic or conserved:
                raise ConfigurationError(
                    "ContactPlant: with coefficients of friction, constraints of the system that move, depend on time "
                    "or conserve a momentum are not supported"
                )
            self._sliding = SlidingPlant(self._flight, self._contacts, self._rows)
            self._force_units = {name: "N" for each in self._contacts for name in each.names}
        self._closed = NONE
        self._plant: ReducedPlant | SlidingPlant = self._flight
        self.contact_events: tuple[ContactEvent, ...] = ()
        self._time, self._past_work, self._size = 0.0, 0.0, 0.0

    # ------------------------------------------------------------------ state

    @property
    def closed(self) -> Closed:
        """Indices of the closed contacts."""
        return self._plant.touching if isinstance(self._plant, SlidingPlant) else self._closed

    @property
    def reduced(self) -> ReducedModel:
        """Model with the closed contacts; with coefficients of friction without them."""
        return self._plant.reduced

    @property
    def errors(self) -> IntegrationErrors:
        """Estimated errors of the integration since the start."""
        return self._plant.errors

    @property
    def work(self) -> float:
        """Work since the start, minus the energy that damping, friction and impacts removed [J]."""
        return self._past_work + self._plant.work

    @property
    def normal_forces(self) -> dict[str, float]:
        """With coefficients of friction, mean normal force of each contact in the last step [N], by name.

        NaN before the first step of a contact. Empty without coefficients: then ``reduced`` has the forces.
        """
        if self._sliding is None:
            return {}
        found = self._plant.normal_forces if isinstance(self._plant, SlidingPlant) else {}
        return {each.name: found.get(number, 0.0) for number, each in enumerate(self._contacts)}

    @property
    def contact_forces(self) -> dict[str, float]:
        """With coefficients of friction, mean forces of the rows of all contacts on the robot in the last step.

        Rows of open contacts have no force. After contacts changed, forces of the others are NaN until the next step.
        """
        found = self._plant.contact_forces if isinstance(self._plant, SlidingPlant) else {}
        return dict.fromkeys(self._force_units, 0.0) | found

    def report(self) -> PlantReport:
        """Return inputs, work, model, forces, contacts and errors.

        External forces come from damping and friction; with coefficients of friction also from contacts, as means of
        the last step while contacts touch.
        """
        return self._plant.report()._replace(
            work=self.work, tolerance=self.tolerance, errors=self.errors, normal_forces=self.normal_forces,
            contact_forces=self.contact_forces, contact_force_units=self._force_units,
            contact_events=self.contact_events,
        )  # fmt: skip

    @property
    def sliding(self) -> tuple[str, ...]:
        """Names of the contacts that slide."""
        numbers = self._plant.sliding if isinstance(self._plant, SlidingPlant) else ()
        return tuple(self._contacts[number].name for number in sorted(numbers))

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart at time zero, at configuration q (nq,) and velocity v (nv,).

        Contacts that touch the ground, or are a little below it, are closed; if they approach it, with an impact.

        Args:
            q: configuration (nq,).
            v: velocity (nv,); an impact at the start removes what contacts forbid.

        Raises:
            InputError: a contact is below the ground.
        """
        self._time, self._past_work, self.contact_events = 0.0, 0.0, ()
        self._closed, self._plant = NONE, self._flight
        self._flight.reset(numbers_of(q, "q"), numbers_of(v, "v"))
        self._size = contact_impulses.radius_of_gyration(self.reduced.robot.model, self.read()[0])
        if self._sliding is not None:
            self._sliding.restart(self._size)
        inside = 2e-4  # depth over the radius of gyration that the digits of an initial configuration explain
        for each, gap in zip(self._contacts, self._gaps(self._flight.state), strict=True):
            if gap < -inside * self._size:
                raise InputError(f"contact '{each.name}' starts {-gap:.3g} m below the ground")
        self._land("start")

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,)."""
        return self._plant.read()

    def apply(self, T: np.ndarray) -> None:
        """Hold the inputs T (p,), clipped to the actuator limits. A jump of the inputs can open contacts.

        Args:
            T: inputs (p,) [N or N m].
        """
        self._plant.apply(own_vector(T, self.reduced.p, "T"))
        before = self._closed
        if before and self._least_force() < 0.0:
            self._settle(before, before)
            self._record("lift-off", before - self._closed)

    # ------------------------------------------------------------------ motion

    def advance(self, dt: float) -> None:
        """Advance by a time dt [s], through all events on the way.

        Args:
            dt: the time [s].

        Raises:
            DivergenceError: velocities or accelerations are not finite.
            SimulationError: contacts open and close without end, or no set of them is consistent.
        """
        end, events = self._time + dt, 0
        most = 100  # located events in one step
        rest = 1e-12  # of a sample that rounding explains
        while end - self._time > rest * dt:
            left = end - self._time
            plant = self._plant
            # While contacts slide, the plant chooses its step; else one step goes to the end of the sample.
            step = plant.step(left, dt) if isinstance(plant, SlidingPlant) else ReducedStep(plant, left)
            open_contacts = [number for number in range(len(self._contacts)) if number not in self.closed]
            watched = [self._watched_gap(self._contacts[number]) for number in open_contacts]
            if self._closed:
                watched.append(Watched(self._least_force))
            found = first_event(step, watched)
            elapsed = step.dt if found is None else found[0]
            step.move_to(elapsed)
            # Exactly the end: sums of steps miss it by rounding.
            self._time = end if elapsed == left else min(self._time + elapsed, end)
            if isinstance(step, SlidingStep):
                self._note(step.take())
            if found is None:
                continue
            events += 1
            if events > most:
                raise SimulationError(
                    f"contacts open and close {most} times within {dt:g} s at t = {self._time:.4f} s: "
                    "increase the rest_speed of the contacts"
                )
            if found[1] < len(open_contacts):
                self._land("landing", open_contacts[found[1]])
            else:
                self._lift_off()
        if isinstance(self._plant, SlidingPlant):
            self._plant.end_sample()

    def _watched_gap(self, contact: contact_impulses.BoundContact) -> Watched:
        def rate() -> float:
            state = self._plant.state
            return float(contact.jacobian(state.position) @ state.v)

        rounding = 1e-11  # gap over the radius of gyration that rounding explains
        return Watched(lambda: contact.gap(self._plant.state.position), rate=rate, rounding=rounding * self._size)

    def _lift_off(self) -> None:
        """Open the contact whose normal force has become zero."""
        # One at a time: without the first, others may push again.
        lost = sorted(self._closed)[int(np.argmin(self._forces()))]
        self._settle(self._closed - {lost}, self._closed)
        self._record("lift-off", [lost])

    def _note(self, changes: list[tuple[str, Closed]]) -> None:
        """Record what contacts with friction begin to do; in flight, another plant goes on."""
        for cause, numbers in changes:
            self._record(cause, numbers)
        if isinstance(self._plant, SlidingPlant) and not self._plant.touching:
            self._go_on(self._flight, *self._plant.read())

    def _settle(self, candidates: Closed, touching: Closed) -> None:
        """Close the candidates that push without slip while all others that touch separate."""
        before, closed_before = self._plant, self._closed
        work, (q, v) = before.work, before.read()
        # The largest first: fewer contacts are a solution only where more are none.
        for closed in contact_impulses.subsets(candidates):
            plant = before
            if closed != closed_before:
                plant = self._plant_with(closed)
                self._start(plant, q, v)
            self._closed, self._plant = closed, plant
            if self._holds(touching - closed):
                self._past_work += work if plant is not before else 0.0
                return
        raise SimulationError(f"contacts {self._names(touching)} at t = {self._time:.4f} s: {contact_impulses.NO_SET}")

    def _start(self, plant: ReducedPlant | SlidingPlant, q: np.ndarray, v: np.ndarray) -> None:
        """Start another plant at a state, under the present inputs."""
        if isinstance(self._plant, SlidingPlant):
            self._plant.end_sample()
        # One run has one estimate of its errors, whichever plant integrates.
        T, errors = self._plant.applied, self._plant.errors
        plant.reset(q, v, self._time)
        plant.apply(T)
        plant.keep_errors(errors)

    def _go_on(self, plant: ReducedPlant | SlidingPlant, q: np.ndarray, v: np.ndarray) -> None:
        """Go on with a plant from a state."""
        self._past_work += self._plant.work
        self._start(plant, q, v)
        self._closed, self._plant = NONE, plant

    # ------------------------------------------------------------------ impacts

    def _gaps(self, state: StateEvaluation) -> np.ndarray:
        return np.array([each.gap(state.position) for each in self._contacts])

    def _land(self, cause: str, number: int | None = None) -> None:
        """Apply the impact of the contacts that touch, and close the contacts that stay."""
        q, v = self._plant.read()
        # Constraints that depend on time are those of this instant.
        state = self._flight.reduced.frozen(self._time).at(q, v=v)
        touches = 1e-8  # gap over the radius of gyration of a contact that touches
        near = frozenset(np.flatnonzero(self._gaps(state) <= touches * self._size).tolist())
        numbers = frozenset[int]() if number is None else frozenset([number])
        # The contact that was located counts, also if rounding leaves it a gap.
        touching = self.closed | near | numbers
        layout = self._rows.layout(touching, joints=False)
        rows, ground = self._rows.at(state, layout)
        try:
            impulses, after = contact_impulses.contact_impact(state, layout, rows, ground)
        except SimulationError as error:
            raise error.within(f"impact of {self._names(touching)} at t = {self._time:.4f} s") from None
        # M belongs to the robot without contacts: the energy before and after the impact.
        loss = float(0.5 * v @ state.M @ v - 0.5 * after @ state.M @ after)
        leaves_at = 1e-8  # velocity from which a contact leaves the ground, relative to the largest velocity, plus 1
        leaves = rows[layout.normals] @ after > leaves_at * (1.0 + float(np.abs(after).max()))
        stay = frozenset(each for each, gone in zip(sorted(touching), leaves, strict=True) if not gone)
        changes = self._touch(stay, q, after)
        self._past_work -= loss
        self._record(cause, numbers, dict(zip(layout.names, impulses.tolist(), strict=True)), loss)
        self._note(changes)

    def _touch(self, stay: Closed, q: np.ndarray, v: np.ndarray) -> list[tuple[str, Closed]]:
        """Go on from a state with the contacts that stay on the ground, and return the ones among them that slide."""
        sliding = self._sliding
        if sliding is None or not stay:
            self._go_on(self._flight, q, v)
            self._settle(stay, stay)
            return []
        if sliding is not self._plant:
            self._go_on(sliding, q, v)
        return sliding.touch(stay, v)

    def _record(
        self, cause: str, numbers: Collection[int] = (), impulses: Mapping[str, float] | None = None, loss: float = 0.0
    ) -> None:
        closed = tuple(self._contacts[number].name for number in sorted(self.closed))
        cause += f" of {self._names(numbers)}" if numbers else ""
        named = {name: each for name, each in (impulses or {}).items() if each}
        self.contact_events += (ContactEvent(self._time, cause, closed, named, loss),)

    # ------------------------------------------------------------------ sets of closed contacts

    def _plant_with(self, closed: Closed) -> ReducedPlant:
        if closed not in self._plants:
            kinds = [self._contacts[number].contact.constraint for number in sorted(closed)]
            try:
                # A set may hold the whole robot, as the four corners of a box do.
                reduced = self._system.with_constraints(kinds, may_stop=True).reduce()
            except ConstraintError as error:
                raise error.within(f"contacts {self._names(closed)} closed") from None
            self._plants[closed] = ReducedPlant(reduced, *self._options)
        return self._plants[closed]

    def _names(self, numbers: Iterable[int]) -> str:
        """Names of contacts in a message."""
        return ", ".join(self._contacts[number].name for number in sorted(numbers)) or "none"

    def _forces(self) -> np.ndarray:
        """Normal forces (c,) of the contacts that are closed without slip, in order [N].

        None is below zero if they can share the load so.
        """
        plant = self._plant
        assert isinstance(plant, ReducedPlant)
        rows, state = plant.reduced.all_constraints.names, plant.state
        up = [rows.index(self._contacts[number].names[0]) for number in sorted(self._closed)]
        forces = state.contact_forces(plant.applied, plant.external)[up]
        if not (forces < 0).any():
            return forces
        dependent = 1e-9  # singular value of the rows that counts as zero, relative to the largest
        # Dependent rows share a load in many ways, as four legs do: another share may push only.
        return nonnegative(forces, null_space(state.all_rows.T, dependent)[up])

    def _least_force(self) -> float:
        """Least normal force of the contacts that are closed without slip [N], with a margin for rounding."""
        forces = self._forces()
        zero = 1e-9  # force that counts as zero, relative to the sum of all, plus 1 N
        return float(forces.min(initial=np.inf) + zero * (1.0 + np.abs(forces).sum()))

    def _holds(self, others: Closed) -> bool:
        """True if the closed contacts only push, and others that touch do not come closer."""
        plant = self._plant
        assert isinstance(plant, ReducedPlant)
        if self._least_force() < 0.0:
            return False
        if not others:
            return True
        state = plant.state
        v_dot = state.acceleration(plant.applied, plant.external)
        zero = 1e-8  # acceleration of a gap that counts as zero, relative to the robot's accelerations, plus 1
        at, limit = state.motion, zero * (1.0 + float(np.abs(v_dot).max()))
        return all(self._contacts[number].gap_acceleration(at, v_dot) >= -limit for number in others)


class ReducedStep:
    """Step of a ``ReducedPlant``.

    Args:
        plant: plant at the start of the step. It advances to the end.
        dt: duration of the step [s].

    Raises:
        DivergenceError: as ``ReducedPlant.advance``.
    """

    def __init__(self, plant: ReducedPlant, dt: float) -> None:
        self._plant, self.dt, self._start = plant, dt, plant.checkpoint()
        # The whole step first: most steps have no event.
        plant.advance(dt)
        self._end = plant.checkpoint()
        self._steps = self._end.errors.used  # one number, so that the state depends continuously on the time

    def move_to(self, elapsed: float) -> None:
        """Move the plant to a time after the start of the step [s].

        Args:
            elapsed: the time [s], up to ``dt``.
        """
        self._plant.rollback(self._end if elapsed == self.dt else self._start)
        if 0.0 < elapsed < self.dt:
            self._plant.advance_part(elapsed, self._steps)


EventStep = ReducedStep | SlidingStep
"""Step of a plant under constant inputs, to whose instants the plant can move."""


class Watched(NamedTuple):
    """Value of the present state of a plant that falls through zero at an event.

    Attributes:
        value: function of the value.
        rate: function of its rate, for a value that may rise again within the step, such as a gap.
        rounding: absolute value that counts as zero where a step with a ``rate`` starts.
    """

    value: Callable[[], float]
    rate: Callable[[], float] | None = None
    rounding: float = 0.0


def first_event(step: EventStep, watched: Sequence[Watched]) -> tuple[float, int] | None:
    """Time after the start of a step [s] and index of the first event within it; None without any.

    Args:
        step: the step. The plant is somewhere within it afterwards.
        watched: values that fall through zero at events.
    """
    step.move_to(0.0)
    starts = [(each.value(), 0.0 if each.rate is None else each.rate()) for each in watched]
    times = [_fall(step, each, *start) for each, start in zip(watched, starts, strict=True)]
    return min(((time, index) for index, time in enumerate(times) if time is not None), default=None)


def _fall(step: EventStep, watched: Watched, before: float, rate_before: float) -> float | None:
    """Time at which a value becomes negative; None if it does not."""
    (value, rate, rounding), end = watched, step.dt
    step.move_to(end)
    if rate is None:
        return _crossing(step, value, 0.0, end) if before > 0.0 >= value() else None
    leaves = before <= rounding  # it starts at zero
    if value() >= (-rounding if leaves else 0.0):
        # It may be negative in between, such as the gap of a corner of a body that turns.
        # Only a value that falls first and rises at the end has a minimum within: there its rate is zero.
        if not rate_before < 0.0 < rate():
            return None
        end = _crossing(step, rate, 0.0, end)
        step.move_to(end)
        if value() >= -rounding:
            return None
    if not leaves:
        return _crossing(step, value, 0.0, end)
    halvings = 40  # below 2^-40 of the step, the value falls at its start
    for halving in range(1, halvings):
        start = end * 0.5**halving
        step.move_to(start)
        if value() > 0.0:
            return _crossing(step, value, start, end)
    return 0.0


def _crossing(step: EventStep, value: Callable[[], float], start: float, end: float) -> float:
    """Time after the start of a step at which a value crosses zero between two times [s]."""

    def at(elapsed: float) -> float:
        step.move_to(elapsed)
        return value()

    precision = 1e-12  # of the time of an event, relative to the end of its bracket
    return float(scipy.optimize.brentq(at, start, end, xtol=precision * end, rtol=1e-14))
