"""Contact forces as affine functions of the inputs, and the conditions that the ground sets: it pushes, and it grips.

With the constraint forces ``A^T lambda`` of the dynamics, and the balance of a planar base upwards and about the axes
along the ground, the forces y of all contacts satisfy ``W y = y0 + Y T``. Rigid bodies leave some of them undetermined,
e.g. for two wheels on one axle. So the program has these undetermined parts as unknowns beside the inputs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.analysis.normal_forces import NormalForces, contacts_of
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
        self._normal = NormalForces(reduced)
        places = {contact: column for column, contact in enumerate(self._normal.contacts)}
        self._gripping = [
            (list(contact.along), places[contact])
            for contact in contacts_of(reduced)
            if friction is not None and contact in places and contact.along
        ]
        names = [f"{name} normal force" for name in self._normal.names]
        for along, column in self._gripping:
            names += [f"{self._normal.names[column]} friction"] * (2 if len(along) == 1 else _SIDES)
        self.names = tuple(names)

    def at(self, state: StateEvaluation) -> ContactBounds:
        """Return the conditions at one state."""
        p = self._reduced.p
        if not self.names:
            return ContactBounds(np.zeros((0, p)), np.zeros(0), 0)
        effects, offset, gain = self._equations(state)
        left, values, right = np.linalg.svd(effects, full_matrices=True)
        rank = int((values > _RANK * values[0]).sum())
        inverse = right[:rank].T @ (left[:, :rank] / values[:rank]).T
        # All contact forces: constant part, gain of T, gain of z.
        forces = np.column_stack([inverse @ offset, inverse @ gain, right[rank:].T])
        normal, along = self._parts(forces)
        rows = [-normal]
        for columns, place in self._gripping:
            sides = 2 if len(columns) == 1 else _SIDES
            angles = 2 * np.pi * np.arange(sides) / sides
            across = np.cos(angles)[:, None] * along[columns[0]]
            if len(columns) > 1:
                across = across + np.sin(angles)[:, None] * along[columns[1]]
            inside = self._friction * (1.0 if sides == 2 else np.cos(np.pi / sides))
            rows.append(across - inside * normal[place])
        whole = np.vstack(rows)
        return ContactBounds(whole[:, 1:], -whole[:, 0], forces.shape[1] - 1 - p)

    def _equations(self, state: StateEvaluation) -> tuple[Array, Array, Array]:
        """Equations ``effects y = offset + gain T`` for multipliers, upward forces and couples, y = [lambda; f; u]."""
        p = self._reduced.p
        inputs = np.vstack([np.zeros(p), np.eye(p)])
        needed = state.constraint_forces(inputs)  # A^T lambda
        effects = state.all_rows.T
        balance = self._normal.plane_balance(state, inputs)
        if balance is not None:
            by_row = self._normal.carried_by_row
            carried = zip(self._normal.contacts, by_row, strict=True)
            ups = [contact.up for contact, carries in carried if carries and contact.up is not None]
            of_rows = np.zeros((3, effects.shape[1]))
            of_rows[:, ups] = -balance.gives[:, by_row]
            of_motion = np.hstack([balance.gives[:, ~by_row], balance.couples])
            kept = _balanced_part(of_motion, int((~by_row).sum()))
            padding = np.zeros((len(effects), of_motion.shape[1]))
            effects = np.block([[effects, padding], [kept @ of_rows, kept @ of_motion]])
            needed = np.hstack([needed, balance.needed @ kept.T])
        return effects, needed[0], (needed[1:] - needed[0]).T

    def _parts(self, forces: Array) -> tuple[Array, Array]:
        """Normal forces (c, ...) and multipliers (k, ...) among all contact forces."""
        by_row, k = self._normal.carried_by_row, self._reduced.all_constraints.size
        normal = np.empty((len(by_row), forces.shape[1]))
        for column, contact in enumerate(self._normal.contacts):
            if by_row[column]:
                normal[column] = -forces[contact.up]
        normal[~by_row] = forces[k : k + int((~by_row).sum())]
        return normal, forces[:k]


def _balanced_part(effects: Array, count: int) -> Array:
    """Combinations (k, 3) of the three balances that forces can satisfy: the sum exactly, moments by least squares.

    Args:
        effects: sum and two moments of unit forces and unit couples (3, n).
        count: number of forces; the others are couples.
    """
    sums, moments = effects[0], effects[1:]
    free = np.eye(len(sums)) - np.outer(sums, sums) / count  # directions that keep the sum
    return np.vstack([[1.0, 0.0, 0.0], np.column_stack([np.zeros(len(sums)), (moments @ free).T])])
