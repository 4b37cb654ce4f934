"""Contact forces that rigid bodies leave possible, and the friction that constraints need of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import scipy

from rnc_pin.analysis.normal_forces import ContactLines, NormalForces, contacts_of
from rnc_pin.array_shapes import Array, Bool, Float
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.math.convex_programs import least_shares
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.input_validation import Positive, check_positive_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.printing import ObjectSummary, SummaryMixin, counted, items

_ASSEMBLED = 1e-6  # part of the largest singular value below which one is an error of the assembly
_FREE = 1e-8  # part of a unit force that is free, below which this is rounding


class ContactForceSet:
    """Set of the contact forces of a model that rigid bodies leave possible.

    The unknowns y are the forces of all constraint rows on the robot, the upward forces of contacts whose height no row
    keeps, and the couples of axles. They satisfy ``W y = b``: the rows give the generalized force of the constraints,
    and the upward forces balance a planar base (``NormalForces``). The null space of W is what rigid bodies leave open,
    e.g. how two wheels on one axle share a lateral force, or how four wheels share the weight.

    Args:
        reduced: the model.

    Raises:
        ConfigurationError: a force on the robot leaves the normal forces unknown.

    Attributes:
        normal: normal forces of the model.
        contacts: contacts that grip or carry, (m,).
        names: their names, (m,).
        gripping: True for contacts with friction along the ground, (m,).
        size: number k of the components of a contact force: upward, and along the ground.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        self._reduced, self.normal = reduced, NormalForces(reduced)
        self.normal.require("forces of contacts")
        self.contacts = [each for each in contacts_of(reduced) if each.along or each in self.normal.contacts]
        self.names = tuple(each.name for each in self.contacts)
        self.gripping = np.array([bool(each.along) for each in self.contacts], dtype=bool)
        self.size = 1 + max((len(each.along) for each in self.contacts), default=0)
        self._rows = reduced.all_constraints.size
        # Loads without a row follow from the balance of the whole robot on the plane: they are unknowns of their own.
        self._by_motion = ~self.normal.carried_by_row

    @cached_property
    def selection(self) -> Float[Array, "m k y"]:
        """Selection of the components of each contact among the unknowns y: upward, then along the ground."""
        axles = sum(contact.up is None for contact in self.normal.contacts)
        out = np.zeros((len(self.contacts), self.size, self._rows + int(self._by_motion.sum()) + axles))
        places = {each.point: place for place, each in enumerate(self.normal.contacts)}
        for number, contact in enumerate(self.contacts):
            place = places.get(contact.point)
            for component, row in enumerate(contact.along, 1):
                out[number, component, row] = 1.0
            if place is not None and self._by_motion[place]:
                out[number, 0, self._rows + int(self._by_motion[:place].sum())] = 1.0
            elif place is not None and contact.up is not None:
                out[number, 0, contact.up] = 1.0
        return out

    def _effects(self, rows: Array, lines: ContactLines | None) -> tuple[Array, Array | None]:
        """Matrices W (N, e, y) of the equations, and the combinations (N, e', 3) of the plane's balances in it."""
        if lines is None:
            return rows.mT, None
        gives, couples = self.normal.plane_effects(lines)
        others = np.concatenate([gives[:, :, self._by_motion], couples], axis=2)
        # Two wheels without casters cannot balance a pitch moment: such a balance must not enter the equations. The sum
        # of the forces carries the weight exactly; only what is left may reduce the error of the moments.
        sums, moments = others[0, 0], others[:, 1:]
        free = np.eye(len(sums)) - np.outer(sums, sums) / self._by_motion.sum()  # directions that keep the sum
        kept = np.zeros((len(gives), 1 + len(sums), 3))
        kept[:, 0, 0] = 1.0
        kept[:, 1:, 1:] = (moments @ free).mT
        of_rows = np.zeros((len(rows), 3, rows.shape[1]))
        for number, contact in enumerate(self.normal.contacts):
            if not self._by_motion[number]:
                of_rows[:, :, contact.up] = gives[:, :, number]
        balances = np.concatenate([of_rows, others], axis=2)
        # The generalized force of the constraints has no part of the other unknowns.
        forces = np.pad(rows.mT, ((0, 0), (0, 0), (0, balances.shape[2] - rows.shape[1])))
        return np.concatenate([forces, kept @ balances], axis=1), kept

    def _lines(self, at: Array | StateEvaluation) -> ContactLines | None:
        """Lines of action at configurations (N, nq) or at one state; None if rows keep all heights."""
        return self.normal.lines(at) if self._by_motion.any() else None

    def equations(
        self, state: StateEvaluation, rows: Float[Array, "*batch l nv"], T: Float[Array, "N p"]
    ) -> tuple[Float[Array, "M e y"], Float[Array, "N e"]]:
        """Return W and b at states (N,), or at one state (M = 1), under inputs T.

        Args:
            state: states (N,), or one state for all inputs.
            rows: all constraint rows there; none (l = nv = 0) for upward forces alone, if no row gives one.
            T: inputs of the actuators [N or N m].
        """
        lines = self._lines(state)
        effects, kept = self._effects(rows if rows.ndim == 3 else rows[None], lines)
        # What constraints have to give for this motion is unique, even if the forces of single contacts are not.
        needed, v_dot = state.forced_motion(T) if rows.size else (np.zeros((len(T), 0)), state.acceleration(T))
        if lines is None or kept is None:
            return effects, needed
        balance = self.normal.plane_needs(lines, np.atleast_2d(state.q), np.atleast_2d(state.v), v_dot, T)
        return effects, np.concatenate([needed, np.matvec(kept, balance)], axis=1)

    def free(self, q: Float[Array, "N nq"], rows: Float[Array, "N l nv"]) -> Float[Array, "N m k d"]:
        """Directions in which the contact forces are free: orthonormal, the last ones zero where fewer are free.

        Args:
            q: configurations.
            rows: all constraint rows there.
        """
        _, values, right = np.linalg.svd(self._effects(rows, self._lines(q))[0], full_matrices=False)
        least = 1e-10  # part of the largest singular value below which one counts as zero
        # Near configurations at which constraint rows are dependent, there are values of the size of the residual. No
        # more count than where the robot is assembled.
        rank, freedom = self._assembled
        counted = (values > least * values[:, :1]) & (np.arange(values.shape[1]) < rank)
        # Scaled to zero in place of left out, so that all samples stay in one array.
        left, sizes, _ = np.linalg.svd(self._left_open(right * counted[:, :, None]), full_matrices=False)
        acts = sizes > _FREE
        count = min(int(acts.sum(axis=1).max(initial=0)), freedom)
        return (left * acts[:, None])[:, :, :count].reshape(len(q), *self.selection.shape[:2], count)

    def _left_open(self, right: Array) -> Array:
        """Part (..., m k, y) of the selection that the equations leave open, from the row space (..., s, y) of W."""
        selection = self.selection.reshape(-1, self.selection.shape[-1])
        return np.asarray(selection - (selection @ right.mT) @ right)

    @cached_property
    def _assembled(self) -> tuple[int, int]:
        """Rank of W, and number of free directions, at a few assembled configurations."""
        robot, generator, rank, freedom = self._reduced.robot, np.random.default_rng(0), 0, 0
        samples = 3  # beside the neutral configuration: they decide the rank of the equations
        for q in (robot.configuration(), *(robot.random_configuration(generator) for _ in range(samples))):
            # Some random configurations cannot be assembled, or are singular: the others decide.
            with suppress(RncError):
                state = self._reduced.at(self._reduced.assembled(q))
                effects, _ = self._effects(state.all_rows[None], self._lines(state.q[None]))
                _, values, right = np.linalg.svd(effects[0], full_matrices=False)
                row_space = right[values > _ASSEMBLED * values[0]]
                left = np.linalg.svd(self._left_open(row_space), compute_uv=False)
                rank, freedom = max(rank, len(row_space)), max(freedom, int((left > _ASSEMBLED).sum()))
        return rank, freedom

    def known(self, contact_forces: Float[Array, "N l"], normal_forces: Float[Array, "N c"]) -> Float[Array, "N m k"]:
        """Contact forces from the forces of the rows on the robot, and from ``NormalForces``; 0 where nothing carries.

        Args:
            contact_forces: forces of all constraint rows on the robot [N or N m].
            normal_forces: normal forces of the contacts of ``normal`` [N].
        """
        forces = np.concatenate([contact_forces, normal_forces[:, self._by_motion]], axis=1)
        # The last unknowns, couples of axles, are a component of no contact.
        return np.einsum("mky,ny->nmk", self.selection[:, :, : forces.shape[1]], forces)


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
        # A contact takes part in a choice if some free direction changes one of its components.
        chosen = np.abs(free).max(axis=(2, 3), initial=0.0)[:, self._set.gripping] > 0
        return chosen.reshape(*state.q.shape[:-1], len(self.names))

    def _shares(self, q: Array, rows: Array, contact_forces: Array, normal_forces: Array) -> Array:
        """Shares (..., w) of states (...,)."""
        batch = q.shape[:-1]
        arrays, count = (q, rows, contact_forces, normal_forces), int(np.prod(batch))
        q, rows, contact_forces, normal_forces = (each.reshape(count, *each.shape[len(batch) :]) for each in arrays)
        forces, free = self._set.known(contact_forces, normal_forces), self._set.free(q, rows)
        even = np.linalg.norm(forces[:, self._set.gripping, 1:], axis=2)
        allowed = np.zeros_like(even)  # a contact that does not carry has no load
        for column, contact in enumerate(self._contacts):
            if contact in self.normal.contacts:
                load = normal_forces[:, self.normal.contacts.index(contact)]
                allowed[:, column] = self.friction * np.maximum(load, 0.0)
        small = 1e-9  # [N]: a force without a load that is rounding slips on no ground
        # A contact that needs a force and carries nothing uses infinite friction; one that needs none uses zero.
        shares = np.divide(even, allowed, out=np.where(even > small, np.inf, 0.0), where=allowed > 0)
        place = np.cumsum(self._set.gripping) - 1
        # Contacts whose forces do not depend on each other are separate programs, which are smaller and equal for many
        # samples.
        for samples, group in _alike(free):
            grips = self._set.gripping[group]
            if not grips.any():
                continue
            some = np.ix_(samples, group)
            least = least_shares(forces[some], free[some], np.where(grips, self.friction, 0.0))
            where = np.ix_(samples, place[group][grips])
            shares[where] = np.where(np.isnan(least[:, grips]), shares[where], least[:, grips])
        return shares.reshape(*batch, len(self.names))


def _alike(free: Float[Array, "N m k d"]) -> Iterator[tuple[list[int], list[int]]]:
    """Samples in which the forces of a group of contacts depend on each other, and the group.

    Contacts without a choice are in no group.
    """
    N, m, k, d = free.shape
    flat = free.reshape(N, m * k, d)
    # Pairs of contacts that a common choice changes; of a contact with itself, if it has a choice.
    pairs = (np.abs(flat @ flat.mT) > _FREE**2).reshape(N, m, k, m, k).any(axis=(2, 4))
    # Samples with the same pattern of dependence are solved in one stack.
    patterns, which = np.unique(pairs, axis=0, return_inverse=True)
    for number, linked in enumerate(patterns):
        samples = np.flatnonzero(which.reshape(-1) == number).tolist()
        chosen = np.flatnonzero(linked.diagonal())
        _, group = scipy.sparse.csgraph.connected_components(linked[np.ix_(chosen, chosen)])
        for each in dict.fromkeys(group.tolist()):
            yield samples, chosen[group == each].tolist()
