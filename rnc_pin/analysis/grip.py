"""Friction that wheels and blades need to enforce the constraints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy import ndarray as Array

from rnc_pin.analysis.contact_forces import ContactForceSet, dependent_groups, linked_contacts
from rnc_pin.array_shapes import Bool, Float
from rnc_pin.errors import ConfigurationError
from rnc_pin.math.convex_programs import least_shares
from rnc_pin.model.input_validation import Positive, check_positive_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.printing import ObjectSummary, SummaryMixin, counted, items


class Grip(SummaryMixin):
    """Friction that constraints need: the norm of their force along the ground over ``friction`` times the load.

    A contact is any constraint against slip along the ground: ``NoSideSlip``, wheels, balls. Its load is its upward
    force, accelerations included. Rigid bodies determine neither how the wheels of one axle share a lateral force, nor
    how four wheels share the weight. ``used`` takes the forces with the least largest share: if it is above 1, every
    choice slips. ``is_choice`` tells which contacts have one. ``InverseDynamicsQP`` has the same choice.

    If no choice pushes at all contacts, ``used`` has the forces of least norm, and a normal force below zero gives no
    grip. Casters do not grip but may lift off: ``first_lift_off`` checks the forces of ``normal``.

    Args:
        reduced: the model.
        friction: coefficient of friction of the ground.

    Attributes:
        names: frame names of the contacts that grip, (w,).
        normal: normal forces of all contacts.

    Raises:
        ConfigurationError: friction is not positive, no contact grips, or a force leaves their loads unknown.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators).reduce(
        ...     [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> grip = rnc.Grip(reduced, friction=0.5)
        >>> grip.names, grip.used(robot.configuration(), [1.0, 2.0], np.zeros(2)).round(2)
        (('sleigh',), array([0.3]))
    """

    def __init__(self, reduced: ReducedModel, friction: Positive) -> None:
        check_positive_settings(friction=friction)
        self._reduced, self.friction, self._set = reduced, friction, ContactForceSet(reduced)
        self.normal = self._set.normal
        self._contacts = [each for each in self._set.contacts if each.along]
        self.names = tuple(each.name for each in self._contacts)
        if not self.names:
            raise ConfigurationError("no contact of this system grips the ground by friction")

    def _summary(self) -> ObjectSummary:
        title = f"Grip of {counted(len(self.names), 'contact')} with friction {self.friction:.4g}"
        return ObjectSummary(title, [("contacts", items(self.names))])

    def _loads(self, normal: Array) -> Array:
        loads = np.zeros((*normal.shape[:-1], len(self.names)))
        for column, contact in enumerate(self._contacts):
            if contact in self.normal.contacts:
                loads[..., column] = np.maximum(normal[..., self.normal.contacts.index(contact)], 0.0)
        return loads

    def used(self, q: Array, v2: Array, T: Array) -> Float[Array, "*batch w"]:
        """Return the share of the available friction that each contact uses; a contact above 1 slips.

        Args:
            q: configurations (..., nq).
            v2: reduced velocities (..., r).
            T: inputs of the actuators (..., p).
        """
        return self.used_at(self._reduced.at(q, v2), np.asarray(T, dtype=float))

    def used_at(self, state: StateEvaluation, T: Array) -> Float[Array, "*batch w"]:
        """Return the shares of ``used`` at states that are already evaluated.

        Args:
            state: states (...,) of the model.
            T: inputs of the actuators (..., p).
        """
        contact_forces, normal_forces = state.contact_forces(T), self.normal.at(state, T)
        return self._shares(state.q, state.all_rows, contact_forces, normal_forces)

    def used_by_forces(
        self, q: Float[Array, "N nq"], contact_forces: Float[Array, "N m"], normal_forces: Float[Array, "N c"]
    ) -> Float[Array, "N w"]:
        """Return the shares of ``used`` for known forces, such as in a run; NaN where one is not known.

        Args:
            q: configurations.
            contact_forces: forces of all constraint rows [N or N m].
            normal_forces: normal forces of the contacts of ``normal`` [N].
        """
        used = np.full((len(q), len(self.names)), np.nan)
        known = np.isfinite(contact_forces).all(axis=1) & np.isfinite(normal_forces).all(axis=1)
        if known.any():
            rows = self._reduced.at(q[known]).all_rows
            used[known] = self._shares(q[known], rows, contact_forces[known], normal_forces[known])
        return used

    def is_choice(self, q: Array) -> Bool[Array, "*batch w"]:
        """Return which contacts have forces that rigid bodies do not determine: their shares are a choice.

        Args:
            q: configurations (..., nq).
        """
        state = self._reduced.at(q)
        rows = state.all_rows.reshape(-1, *state.all_rows.shape[-2:])
        free = self._set.free(state.q.reshape(-1, state.q.shape[-1]), rows)
        chosen = np.abs(free).max(axis=(2, 3), initial=0.0)[:, self._set.gripping] > 0
        return chosen.reshape(*state.q.shape[:-1], len(self.names))

    def _shares(self, q: Array, rows: Array, contact_forces: Array, normal_forces: Array) -> Array:
        """Shares (..., w) of states (...,)."""
        sizes = [np.linalg.norm(contact_forces[..., list(each.along)], axis=-1) for each in self._contacts]
        even, allowed = np.stack(sizes, axis=-1), self.friction * self._loads(normal_forces)
        small = 1e-9  # [N]: a force without a load that is rounding slips on no ground
        shares = np.divide(even, allowed, out=np.where(even > small, np.inf, 0.0), where=allowed > 0)
        batch = shares.shape[:-1]
        arrays = (q, rows, contact_forces, normal_forces, shares)
        ends = (each.shape[len(each.shape) - order :] for each, order in zip(arrays, (1, 2, 1, 1, 1), strict=True))
        many = (np.broadcast_to(each, (*batch, *end)) for each, end in zip(arrays, ends, strict=True))
        count = int(np.prod(batch))
        q, rows, contact_forces, normal_forces, shares = (a.reshape(count, *a.shape[len(batch) :]) for a in many)
        free = self._set.free(q, rows)
        forces, shares = self._set.known(contact_forces, normal_forces), shares.copy()
        column = np.cumsum(self._set.gripping) - 1
        # Contacts whose forces do not depend on each other are separate programs, which are smaller and equal for many
        # samples.
        for samples, group in _alike(free):
            grips = self._set.gripping[group]
            if not grips.any():
                continue
            some = np.ix_(samples, group)
            least = least_shares(forces[some], free[some], np.where(grips, self.friction, 0.0))
            where = np.ix_(samples, column[group][grips])
            shares[where] = np.where(np.isnan(least[:, grips]), shares[where], least[:, grips])
        return shares.reshape(*batch, len(self.names))


def _alike(free: Array) -> Iterator[tuple[list[int], list[int]]]:
    """Samples in which the forces of a group of contacts depend on each other, and the group."""
    # Samples with the same pattern of dependence are solved in one stack.
    patterns, which = np.unique(linked_contacts(free), axis=0, return_inverse=True)
    for number, linked in enumerate(patterns):
        samples = np.flatnonzero(which.reshape(-1) == number).tolist()
        for group in dependent_groups(linked):
            yield samples, group
