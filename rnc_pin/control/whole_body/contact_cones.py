"""Conditions of the ground on the contact forces of a model, as rows of a program in the inputs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.analysis.contact_forces import ContactForceSet
from rnc_pin.array_shapes import Float
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation

_SIDES = 8  # of the pyramid inside a friction cone
_RANK = 1e-10


class ContactBounds(NamedTuple):
    """Conditions ``rows [T; z] <= upper`` of the ground on inputs T and on undetermined contact forces z."""

    rows: Float[Array, "k x"]
    upper: Float[Array, " k"]
    unknowns: int
    """Number of undetermined contact forces z."""


class ContactCones:
    """Conditions of the ground on the contact forces of a model: normal forces push, friction stays in its cone.

    With the constraint forces ``A^T lambda`` of the dynamics, and the balance of a planar base upwards and about the
    axes along the ground, the forces y of all contacts satisfy ``W y = y0 + Y T``. Rigid bodies leave some of them
    undetermined, e.g. for two wheels on one axle. So the program has these undetermined parts as unknowns beside the
    inputs.

    The cone is a pyramid of eight sides inside the true cone. Contacts are those of ``NormalForces``: wheels, balls,
    blades, casters.

    Args:
        reduced: the model.
        friction: coefficient of friction of the ground; None if only the normal forces matter.

    Attributes:
        names: name of each condition, (k,).
    """

    def __init__(self, reduced: ReducedModel, friction: float | None) -> None:
        self._reduced, self._friction = reduced, friction or 0.0
        self._forces = ContactForceSet(reduced)
        self._normal = self._forces.normal
        self._carrying = [self._forces.contacts.index(each) for each in self._normal.contacts]
        self._gripping = [
            (place, len(contact.along))
            for place, contact in enumerate(self._forces.contacts)
            if friction is not None and place in self._carrying and contact.along
        ]
        names = [f"{name} normal force" for name in self._normal.names]
        for place, along in self._gripping:
            names += [f"{self._forces.names[place]} friction"] * (2 if along == 1 else _SIDES)
        self.names = tuple(names)

    def at(self, state: StateEvaluation) -> ContactBounds:
        """Return the conditions at one state."""
        p = self._reduced.p
        if not self.names:
            return ContactBounds(np.zeros((0, p)), np.zeros(0), 0)
        effects, needed = self._forces.equations(state, np.vstack([np.zeros(p), np.eye(p)]))
        left, values, right = np.linalg.svd(effects[0])
        rank = int((values > _RANK * values[0]).sum())
        inverse = right[:rank].T @ (left[:, :rank] / values[:rank]).T
        # All contact forces: constant part, gain of T, gain of z.
        unknowns = np.column_stack([inverse @ needed[0], inverse @ (needed[1:] - needed[0]).T, right[rank:].T])
        forces = self._forces.selection @ unknowns
        rows = [-forces[self._carrying, 0]]
        for place, along in self._gripping:
            sides = 2 if along == 1 else _SIDES
            angles = 2 * np.pi * np.arange(sides) / sides
            across = np.cos(angles)[:, None] * forces[place, 1]
            if along > 1:
                across = across + np.sin(angles)[:, None] * forces[place, 2]
            inside = self._friction * (1.0 if sides == 2 else np.cos(np.pi / sides))
            rows.append(across - inside * forces[place, 0])
        whole = np.vstack(rows)
        return ContactBounds(whole[:, 1:], -whole[:, 0], unknowns.shape[1] - 1 - p)
