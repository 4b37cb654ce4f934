"""Exact derivatives of contact forces along the dynamics of a reduced model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.analysis.contact_force_set import ContactForceSet
from rnc_pin.analysis.derivatives import ConstraintForceDerivatives, constraint_force_derivatives
from rnc_pin.array_shapes import Float
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import Rows
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.model.user_functions import gradient_with_error


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
        sizes = (n, reduced.r, reduced.p)
        out = tuple(np.zeros((*y.shape[:2], size)) for size in sizes)
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
