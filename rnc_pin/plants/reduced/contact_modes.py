"""Models of a system with each set of contacts that are closed without slip, and the sets that only push."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import scipy

from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import nonnegative
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants.reduced.reduced_plant import ReducedPlant
from rnc_pin.plants.reduced.unilateral_contact import BoundContact

_FORCE = 1e-9  # force that counts as zero, relative to the sum of all, plus 1 N
_MOTION = 1e-8  # acceleration of a gap that counts as zero, relative to those of the robot, plus 1
_SMALL = 1e-9

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
        """Names of contacts in a message."""
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
        return nonnegative(forces, scipy.linalg.null_space(state.all_rows.T, rcond=_SMALL)[up])

    def least_force(self, closed: Closed, plant: ReducedPlant) -> float:
        """Least normal force of the closed contacts [N], with a margin for rounding."""
        forces = self.forces(closed, plant)
        return float(forces.min(initial=np.inf) + _FORCE * (1.0 + np.abs(forces).sum()))

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
        at, limit = state.motion, _MOTION * (1.0 + float(np.abs(v_dot).max()))
        return all(self._contacts[number].gap_acceleration(at, v_dot) >= -limit for number in others)
