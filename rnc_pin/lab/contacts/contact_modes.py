"""Models of a system with each set of closed contacts, and the events within a step that change the set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import scipy

from rnc_pin.errors import ConstraintError
from rnc_pin.lab.contacts.unilateral_contact import BoundContact
from rnc_pin.math.linear_algebra import nonnegative
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.reduced_plant import ReducedPlant

Closed = frozenset[int]
"""Indices of the closed contacts."""
NONE: Closed = frozenset()


class ContactModes:
    """Models of a system with each set of closed contacts, made at their first use.

    Args:
        system: system without the contacts.
        contacts: the contacts.
        plant_of: function from a model to its plant.
    """

    def __init__(
        self, system: NonholonomicSystem, contacts: list[BoundContact], plant_of: Callable[[ReducedModel], ReducedPlant]
    ) -> None:
        self._system, self._contacts, self._plant_of = system, contacts, plant_of
        self._plants: dict[Closed, ReducedPlant] = {}

    def plant(self, closed: Closed) -> ReducedPlant:
        """Plant with a set of closed contacts.

        Args:
            closed: indices of the closed contacts.

        Raises:
            ConstraintError: the constraints of the set cannot act together.
        """
        if closed not in self._plants:
            kinds = [self._contacts[number].contact.constraint for number in sorted(closed)]
            try:
                reduced = self._system.with_constraints(kinds, may_stop=True).reduce()
            except ConstraintError as error:
                raise error.within(f"contacts {self.names(closed)} closed") from None
            self._plants[closed] = self._plant_of(reduced)
        return self._plants[closed]

    def names(self, numbers: Iterable[int]) -> str:
        """Names of contacts in a message.

        Args:
            numbers: indices of the contacts.
        """
        return ", ".join(self._contacts[number].name for number in sorted(numbers)) or "none"

    def forces(self, closed: Closed, plant: ReducedPlant) -> np.ndarray:
        """Normal forces (c,) of the closed contacts in order [N]; none below zero if they can share the load so.

        Args:
            closed: contacts that are closed in the model of the plant.
            plant: the plant, with its inputs.
        """
        rows, state = plant.reduced.all_constraints.names, plant.state
        up = [rows.index(self._contacts[number].names[0]) for number in sorted(closed)]
        forces = state.contact_forces(plant.applied, plant.external)[up]
        if not (forces < 0).any():
            return forces
        dependent = 1e-9  # singular value of the rows that counts as zero, relative to the largest
        # Dependent rows share a load in many ways, as four legs do: another share may push only.
        return nonnegative(forces, scipy.linalg.null_space(state.all_rows.T, rcond=dependent)[up])

    def least_force(self, closed: Closed, plant: ReducedPlant) -> float:
        """Least normal force of the closed contacts [N], with a margin for rounding.

        Args:
            closed: contacts that are closed in the model of the plant.
            plant: the plant, with its inputs.
        """
        forces = self.forces(closed, plant)
        zero = 1e-9  # force that counts as zero, relative to the sum of all, plus 1 N
        return float(forces.min(initial=np.inf) + zero * (1.0 + np.abs(forces).sum()))

    def holds(self, closed: Closed, others: Closed, plant: ReducedPlant) -> bool:
        """True if contacts stay closed by pushing at the state of a plant, and the others do not come closer.

        Args:
            closed: contacts that are closed in the model of the plant.
            others: contacts without a gap that are open.
            plant: the plant, with its inputs.
        """
        if self.least_force(closed, plant) < 0.0:
            return False
        if not others:
            return True
        state = plant.state
        v_dot = state.acceleration(plant.applied, plant.external)
        zero = 1e-8  # acceleration of a gap that counts as zero, relative to the robot's accelerations, plus 1
        at, limit = state.motion, zero * (1.0 + float(np.abs(v_dot).max()))
        return all(self._contacts[number].gap_acceleration(at, v_dot) >= -limit for number in others)


class EventStep(Protocol):
    """Step of a plant under constant inputs, to whose instants the plant can move."""

    dt: float
    """Duration of the step [s]."""

    def move_to(self, elapsed: float) -> None:
        """Move the plant to a time after the start of the step [s].

        Args:
            elapsed: time after the start [s].
        """


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
    before = [each.value() for each in watched]
    rates = [0.0 if each.rate is None else each.rate() for each in watched]
    step.move_to(step.dt)
    # Values at both ends for all first: a move within the step is much more work.
    after = [each.value() for each in watched]
    found: list[tuple[float, int]] = []
    for index, each in enumerate(watched):
        if each.rate is not None:
            time = _fall(step, each, each.rate, before[index], rates[index])
            found += [] if time is None else [(time, index)]
        elif before[index] > 0 >= after[index]:
            found.append((_crossing(step, each.value, 0.0, step.dt), index))
    return min(found, default=None)


def _fall(step: EventStep, watched: Watched, rate: Callable[[], float], before: float, falls: float) -> float | None:
    """Time at which a value becomes negative; None if it does not."""
    value, rounding, end = watched.value, watched.rounding, step.dt
    leaves = before <= rounding  # it starts at zero
    step.move_to(end)
    if value() >= (-rounding if leaves else 0.0):
        # It may be negative in between, such as the gap of a corner of a body that turns.
        # Only a value that falls first and rises at the end has a minimum within: there its rate is zero.
        if not falls < 0.0 < rate():
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
