"""Contact forces that rigid bodies leave possible: their equations, what these leave free, and exact derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.analysis.derivatives import ConstraintForceDerivatives, constraint_force_derivatives
from rnc_pin.analysis.normal_forces import ContactLines, NormalForces, contacts_of
from rnc_pin.array_shapes import Bool, Float
from rnc_pin.errors import RncError
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import Rows
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.user_functions import gradient_with_error

_RANK = 1e-10  # part of the largest singular value below which one counts as zero
_ASSEMBLED = 1e-6  # the same at configurations that are assembled to a tolerance
_SAMPLES = 3  # configurations, beside the neutral one, that decide the rank of the equations
_FREE = 1e-8  # part of a unit force that is free, below which this is rounding


class SolvedForces(NamedTuple):
    """Solutions ``y + lift z`` of the equations of the contact forces; the contact forces are ``forces + free z``."""

    y: Float[Array, "N y"]
    forces: Float[Array, "N m k"]
    free: Float[Array, "N m k d"]
    lift: Float[Array, "N y d"]
    inverse: Float[Array, "N y e"]
    """Pseudo-inverses of W."""


class ContactForceSet:
    """Set of the contact forces of a model that rigid bodies leave possible.

    The unknowns y are the forces of all constraint rows on the robot, the upward forces of contacts whose height no row
    keeps, and the couples of axles. They satisfy ``W y = b``: the rows give the generalized force of the constraints,
    and the upward forces balance a planar base (``NormalForces``). The null space of W is what rigid bodies leave open,
    e.g. how two wheels on one axle share a lateral force, or how four wheels share the weight.

    Args:
        reduced: the model.
        along: False for the upward forces alone.

    Attributes:
        normal: normal forces of the model.
        contacts: contacts that grip or carry, (m,).
        names: their names, (m,).
        gripping: True for contacts with friction along the ground, (m,).
        size: number k of the components of a contact force: upward, and along the ground.
    """

    def __init__(self, reduced: ReducedModel, along: bool = True) -> None:
        self._reduced, self.normal = reduced, NormalForces(reduced)
        contacts = contacts_of(reduced) if along else [each._replace(along=()) for each in self.normal.contacts]
        self.contacts = [each for each in contacts if each.along or each in self.normal.contacts or not along]
        self.names = tuple(each.name for each in self.contacts)
        self.gripping = np.array([bool(each.along) for each in self.contacts], dtype=bool)
        self.size = 1 + max((len(each.along) for each in self.contacts), default=0)
        self._rows = reduced.all_constraints.size
        self._by_motion = ~self.normal.carried_by_row
        places = {each.point: number for number, each in enumerate(self.normal.contacts)}
        self._places = [places.get(each.point) for each in self.contacts]

    @cached_property
    def selection(self) -> Float[Array, "m k y"]:
        """Selection of the components of each contact among the unknowns y: upward, then along the ground."""
        axles = sum(contact.up is None for contact in self.normal.contacts)
        out = np.zeros((len(self.contacts), self.size, self._rows + int(self._by_motion.sum()) + axles))
        for number, (contact, place) in enumerate(zip(self.contacts, self._places, strict=True)):
            for component, row in enumerate(contact.along, 1):
                out[number, component, row] = 1.0
            if place is not None and self._by_motion[place]:
                out[number, 0, self._rows + int(self._by_motion[:place].sum())] = 1.0
            elif place is not None and contact.up is not None:
                out[number, 0, contact.up] = 1.0
        return out

    def _effects(self, rows: Array, lines: ContactLines | None) -> tuple[Array, Array | None]:
        """Matrices W (N, e, y) of the equations, and the combinations (N, e', 3) of the plane's balances in it."""
        of_rows = rows.mT
        if lines is None:
            return of_rows, None
        gives, couples = self.normal.plane_effects(lines)
        kept = self.balanced_part(gives, couples)
        left = np.zeros((len(rows), 3, self._rows))
        for number, contact in enumerate(self.normal.contacts):
            if not self._by_motion[number]:
                left[:, :, contact.up] = gives[:, :, number]
        right = np.concatenate([gives[:, :, self._by_motion], couples], axis=2)
        nothing = np.zeros((len(rows), of_rows.shape[1], right.shape[2]))
        below = kept @ np.concatenate([left, right], axis=2)
        return np.concatenate([np.concatenate([of_rows, nothing], axis=2), below], axis=1), kept

    def _lines(self, at: Array | StateEvaluation) -> ContactLines | None:
        """Lines of action at configurations (N, nq) or at one state; None if rows keep all heights."""
        return self.normal.lines(at) if self._by_motion.any() else None

    def equations(
        self, state: StateEvaluation, T: Float[Array, "N p"]
    ) -> tuple[Float[Array, "M e y"], Float[Array, "N e"]]:
        """Return W and b at states (N,), or at one state (M = 1), under inputs T."""
        batch = state.q if state.q.ndim > 1 else state.q[None]
        lines = self._lines(state if state.q.ndim == 1 else state.q)
        effects, kept = self._effects(state.all_rows.reshape(len(batch), *state.all_rows.shape[-2:]), lines)
        needed, v_dot = state.forced_motion(T)
        if lines is None or kept is None:
            return effects, needed
        q, v = (np.broadcast_to(each, (len(T), each.shape[-1])) for each in (state.q, state.v))
        balance = self.normal.plane_needs(lines, q, v, v_dot, T)
        return effects, np.concatenate([needed, np.matvec(kept, balance)], axis=1)

    def balanced_part(self, gives: Float[Array, "N 3 c"], couples: Float[Array, "N 3 u"]) -> Float[Array, "N e 3"]:
        """Combinations of the three balances that forces can satisfy: the sum exactly, moments by least squares."""
        effects = np.concatenate([gives[:, :, self._by_motion], couples], axis=2)
        sums, moments = effects[0, 0], effects[:, 1:]
        free = np.eye(len(sums)) - np.outer(sums, sums) / self._by_motion.sum()  # directions that keep the sum
        out = np.zeros((len(gives), 1 + len(sums), 3))
        out[:, 0, 0] = 1.0
        out[:, 1:, 1:] = (moments @ free).mT
        return out

    def free(self, q: Float[Array, "N nq"], rows: Float[Array, "N l nv"]) -> Float[Array, "N m k d"]:
        """Directions in which the contact forces are free: orthonormal, the last ones zero where fewer are free.

        Args:
            q: configurations.
            rows: all constraint rows there.
        """
        _, values, right = np.linalg.svd(self._effects(rows, self._lines(q))[0], full_matrices=False)
        return self._directions(right * self._counted(values)[:, :, None])[0]

    def solve(self, effects: Float[Array, "N e y"], needed: Float[Array, "N e"]) -> SolvedForces:
        """Return all solutions y of the equations ``W y = b``."""
        left, values, right = np.linalg.svd(effects, full_matrices=False)
        counted = self._counted(values)
        free, lift = self._directions(right * counted[:, :, None])
        inverse = (right.mT * (counted / np.where(counted, values, 1.0))[:, None]) @ left.mT
        y = np.matvec(inverse, needed)
        return SolvedForces(y, np.einsum("mky,ny->nmk", self.selection, y), free, lift, inverse)

    def _counted(self, values: Array) -> Array:
        """Mask of the singular values (N, s) of W that are not zero.

        Near configurations at which constraint rows are dependent, there are values of the size of the residual. No
        more count than where the robot is assembled.
        """
        return (values > _RANK * values[:, :1]) & (np.arange(values.shape[1]) < self._rank)

    @cached_property
    def _rank(self) -> int:
        """Rank of W at assembled configurations."""
        return max((int((values > _ASSEMBLED * values[0]).sum()) for values, _ in self._assembled), default=0)

    @cached_property
    def _freedom(self) -> int:
        """Number of free directions at assembled configurations."""
        selection = self.selection.reshape(-1, self.selection.shape[-1])
        found = 0
        for values, right in self._assembled:
            right = right[: len(values)][values > _ASSEMBLED * values[0]]
            left = selection - (selection @ right.T) @ right
            found = max(found, int((np.linalg.svd(left, compute_uv=False) > _ASSEMBLED).sum()))
        return found

    @cached_property
    def _assembled(self) -> list[tuple[Array, Array]]:
        """Singular values and right singular vectors of W at a few assembled configurations."""
        robot, generator, found = self._reduced.robot, np.random.default_rng(0), []
        for q in (robot.configuration(), *(robot.random_configuration(generator) for _ in range(_SAMPLES))):
            with suppress(RncError):
                state = self._reduced.at(self._reduced.assembled(q))
                effects, _ = self._effects(state.all_rows[None], self._lines(state.q[None]))
                found.append(np.linalg.svd(effects[0])[1:])
        return found

    def _directions(self, right: Array) -> tuple[Array, Array]:
        """Free directions of the contact forces, and those of the unknowns y, from the row space of W (N, s, y)."""
        selection = self.selection.reshape(-1, self.selection.shape[-1])
        left, values, lift = np.linalg.svd(selection - (selection @ right.mT) @ right, full_matrices=False)
        acts = values > _FREE
        count = min(int(acts.sum(axis=1).max(initial=0)), self._freedom)
        basis = (left * acts[:, None])[:, :, :count].reshape(len(right), *self.selection.shape[:2], count)
        return basis, (lift * (acts / np.where(acts, values, 1.0))[:, :, None])[:, :count].mT

    def known(self, contact_forces: Float[Array, "N l"], normal_forces: Float[Array, "N c"]) -> Float[Array, "N m k"]:
        """Contact forces from those of the rows on the robot, and from ``NormalForces``; 0 where nothing carries."""
        out = np.zeros((len(contact_forces), len(self.contacts), self.size))
        for number, (contact, place) in enumerate(zip(self.contacts, self._places, strict=True)):
            out[:, number, 1 : 1 + len(contact.along)] = contact_forces[:, list(contact.along)]
            if place is not None and self._by_motion[place]:
                out[:, number, 0] = normal_forces[:, place]
            elif place is not None:
                out[:, number, 0] = contact_forces[:, contact.up]
        return out


def linked_contacts(free: Float[Array, "N m k d"]) -> Bool[Array, "N m m"]:
    """Pairs of contacts that a common choice changes, from free directions; with itself, if a contact has a choice."""
    N, m, k, d = free.shape
    flat = free.reshape(N, m * k, d)
    return (np.abs(flat @ flat.mT) > _FREE**2).reshape(N, m, k, m, k).any(axis=(2, 4))


def dependent_groups(linked: Bool[Array, "m m"]) -> list[list[int]]:
    """Groups of contacts that choices link, from all linked pairs; contacts without a choice are in no group."""
    groups: list[list[int]] = []
    left = set(np.flatnonzero(linked.diagonal()).tolist())
    while left:
        group = [left.pop()]
        for each in group:  # which grows
            found = left & set(np.flatnonzero(linked[each]).tolist())
            group += found
            left -= found
        groups.append(sorted(group))
    return sorted(groups)


# ------------------------------------------------------------------ derivatives


class ContactForceGradients:
    """Derivatives of a function of the contact forces by the state and the inputs.

    The forces y satisfy ``W y = b``. A function whose derivative by y is ``W^T p`` changes by ``p (db - dW y)``, where
    the forces y stay the same: this is the derivative of the balance of forces. So the choice that rigid bodies leave
    has no effect, if y is the best one.

    Args:
        reduced: the model.
        forces: its contact forces.
    """

    def __init__(self, reduced: ReducedModel, forces: ContactForceSet) -> None:
        self._reduced, self._set, self._model = reduced, forces, reduced.robot.model
        self._kinematics, self._data = Kinematics(reduced.robot), reduced.robot.model.createData()
        self._motion = ~forces.normal.carried_by_row

    def at(
        self, state: StateEvaluation, T: Float[Array, "N p"], y: Float[Array, "N k y"], shares: Float[Array, "N k e"]
    ) -> tuple[Float[Array, "N k nv"], Float[Array, "N k r"], Float[Array, "N k p"]]:
        """Return the derivatives of k functions by q, v2 and T.

        Args:
            state: states (N,).
            T: inputs.
            y: forces, for each function.
            shares: derivatives p of each function by the right sides b.
        """
        reduced, rows, n = self._reduced, self._reduced.all_constraints.size, self._reduced.n
        out = tuple(np.zeros((*y.shape[:2], size)) for size in (n, reduced.r, reduced.p))
        for i in range(len(T)):
            one = reduced.at(state.q[i], state.v2[i])
            found = constraint_force_derivatives(reduced, one, T[i], y[i, :, :rows])
            balance = _PlaneBalance(self, one, T[i]) if self._motion.any() else None
            for k, each in enumerate(found):
                parts = [shares[i, k, :n] @ matrix for matrix in each.force]
                if balance is not None:
                    more = balance.gradient(each, y[i, k], shares[i, k, n:])
                    parts = [a + b for a, b in zip(parts, more, strict=True)]
                for whole, part in zip(out, parts, strict=True):
                    whole[i, k] = part
        return out[0], out[1], out[2]

    def points(self, at: PositionKinematics) -> Float[Array, "c 3 nv"]:
        """Derivatives of the points of the contacts."""
        return np.array([self._point(contact.point, at) for contact in self._set.normal.contacts])

    def directions(self, axles: Sequence[int], at: PositionKinematics) -> Float[Array, "u 3 nv"]:
        """Derivatives of the directions of the forces of some contacts."""
        out = np.zeros((len(axles), 3, self._reduced.n))
        for number, axle in enumerate(axles):
            block, row = self._row(self._set.normal.contacts[axle].point)
            found = block.direction_gradients(at)
            out[number] = self._by_differences(block, row, 1, at.q) if found is None else found[row]
        return out

    def _point(self, index: int, at: PositionKinematics) -> Array:
        block, row = self._row(index)
        found = block.point_gradient(at)
        return self._by_differences(block, row, 0, at.q) if found is None else found

    def _row(self, index: int) -> tuple[Rows, int]:
        """Block of one of all constraint rows, and its row there."""
        places = self._reduced.all_constraints.places
        place = next(each for each in places if each.where.start <= index < each.where.stop)
        row = index - place.where.start
        return place.block, row if place.rows is None else int(np.arange(len(place.block.names))[place.rows][row])

    def _by_differences(self, block: Rows, row: int, which: int, q: Array) -> Array:
        """The same for rows of a user, and for surfaces without a closed form."""

        def line(p: Array) -> Array:
            found = block.lines_of_action(self._kinematics.position(p))
            assert found is not None
            return np.asarray(found[which][row])

        return gradient_with_error(self._model, line, q)[0]


class _PlaneBalance:
    """Balance of a planar base at one state, upwards and about the axes along the ground, with its derivatives."""

    def __init__(self, owner: ContactForceGradients, state: StateEvaluation, T: Array) -> None:
        forces, model, data, reduced = owner._set, owner._model, owner._data, owner._reduced
        normal, q, v = forces.normal, np.asarray(state.q), np.asarray(state.v)
        w = state.acceleration(T)
        self._motion, self._contacts = owner._motion, normal.contacts
        lines = normal.lines(q[None])
        self.gives, self.couples = (each[0] for each in normal.plane_effects(lines))
        self.kept = forces.balanced_part(self.gives[None], self.couples[None])[0]
        self.needs = normal.plane_needs(lines, q[None], v[None], w[None], T[None])[0]
        points, across = lines
        lowest = int(points[0, :, 2].argmin())
        self._ground = float(points[0, lowest, 2])
        at = owner._kinematics.position(q)
        self.points_q = owner.points(at)
        self.ground_q = self.points_q[lowest, 2]
        self.axles = [column for column, contact in enumerate(normal.contacts) if contact.up is None]
        self.across_q = owner.directions(self.axles, at)
        directions = across[0, self.axles]
        heading = np.array([np.zeros(len(directions)), directions[:, 1], -directions[:, 0]])
        size = np.linalg.norm(heading)
        self.spread = float(np.linalg.norm(self.couples) / size) if size else 1.0

        # Force and moment about the origin that the contacts have to give, by q, v, w and T.
        _, rate_q, rate_v, rate_w = pin.computeCentroidalDynamicsDerivatives(model, data, q, v, w)
        center, mass = np.array(data.com[0]), float(data.mass[0])
        center_q = np.array(pin.jacobianCenterOfMass(model, data, q))
        force = np.array(data.dhg.linear) - mass * np.array(model.gravity.linear)
        self.q, self.v, self.w = (_about_origin(np.array(each), center) for each in (rate_q, rate_v, rate_w))
        self.q[3:] += np.cross(center_q, force[:, None], axis=0)
        self.T = np.zeros((6, reduced.p))
        self.total = np.concatenate([force, np.array(data.dhg.angular) + np.cross(center, force)])
        for column, frame, row in reduced.actuation.frames:
            place, J = at.placement(frame), at.jacobian(frame)
            unit = place.rotation[:, row % 3]
            wrench = np.concatenate([unit, np.cross(place.translation, unit)] if row < 3 else [np.zeros(3), unit])
            self.T[:, column] -= wrench
            self.total = self.total - T[column] * wrench
            turned = np.cross(J[3:], unit[:, None], axis=0) * T[column]
            if row < 3:
                moved = np.cross(J[:3], unit[:, None], axis=0) * T[column]
                self.q[:3] -= turned
                self.q[3:] -= np.cross(place.translation[:, None], turned, axis=0) + moved
            else:
                self.q[3:] -= turned

    def gradient(self, each: ConstraintForceDerivatives, y: Array, shares: Array) -> tuple[Array, Array, Array]:
        """Derivatives by q, v2, T of ``shares kept (needs - gives f - couples u)`` at forces y that stay the same."""
        count = int(self._motion.sum())
        upward = np.zeros(len(self._contacts))
        upward[self._motion] = y[len(y) - count - len(self.axles) : len(y) - len(self.axles)]
        for number, contact in enumerate(self._contacts):
            if not self._motion[number]:
                upward[number] = y[contact.up]
        couples = y[len(y) - len(self.axles) :]
        k = shares @ self.kept
        rest = self.needs - self.gives @ upward - self.couples @ couples
        z = self._ground
        row = np.array([-k[2] * z, k[1] * z, k[0], k[1], k[2], 0.0])
        by_q, by_v, by_w = row @ self.q, row @ self.v, row @ self.w
        by_q = by_q + (k[1] * self.total[1] - k[2] * self.total[0]) * self.ground_q
        # Effects of the forces move with their points, and so do the combinations that are kept.
        effects = np.column_stack([self.gives[:, self._motion], self.couples])
        free = np.eye(effects.shape[1]) - np.outer(effects[0], effects[0]) / count
        levers = free @ shares[1:]
        moments = -np.outer(upward, k[1:])
        moments[self._motion] += np.outer(levers[:count], rest[1:])
        by_q = by_q + np.einsum("c,cj->j", moments[:, 0], self.points_q[:, 1]) - moments[:, 1] @ self.points_q[:, 0]
        if self.axles:
            moments = self.spread * (np.outer(levers[count:], rest[1:]) - np.outer(couples, k[1:]))
            by_q = by_q + moments[:, 0] @ self.across_q[:, 1] - moments[:, 1] @ self.across_q[:, 0]
        return (
            by_q + by_v @ each.v[0] + by_w @ each.w[0],
            by_v @ each.v[1] + by_w @ each.w[1],
            row @ self.T + by_w @ each.w[2],
        )


def _about_origin(rates: Array, center: Array) -> Array:
    """Derivatives of a wrench about the origin, from those (6, n) about the centre of mass."""
    out = rates.copy()
    out[3:] += np.cross(center[:, None], rates[:3], axis=0)
    return out
