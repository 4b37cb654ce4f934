"""Constraint rows at complex configurations: analytic functions, whose Taylor coefficients keep their digits."""

from __future__ import annotations

from math import factorial

import numpy as np
import pinocchio as pin

from rnc_pin.model.kernel_rows import Form, KernelRow
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel

_FORMS = (Form.CONSTANT, Form.OWN, Form.WORLD)
_TERMS = 20  # of the series of sine and cosine
_STRAIGHT = 1e-8  # tangent below which an arc equals its chord to all digits


def has_complex_rows(reduced: ReducedModel) -> bool:
    """True if all constraint rows have values at complex configurations: knife edges, balls, locked joints, casters."""
    if not Kinematics(reduced.robot).axes_are_constant:
        return False
    blocks = (place.block.kernel_rows(reduced.robot.model) for place in reduced.all_constraints.places)
    return all(rows is not None and all(row.form in _FORMS and len(row.frames) < 2 for row in rows) for rows in blocks)


class ComplexRows:
    """Independent constraint rows of a model, and fields that satisfy them, near a configuration.

    Such rows are analytic functions of the joint motions. Their Taylor coefficients follow from values on a circle of
    complex times, where no digit is lost. Differences and fits on the real line lose one or two with each order.

    A configuration is an array (joints, 3, 4): rotation and translation of each joint's body in the parent body. In a
    complex one, rotations satisfy ``R R^T = 1`` still.

    Args:
        reduced: a model for which ``has_complex_rows`` is true.
        q: a regular configuration (nq,).
        basis: orthonormal basis of the kernel of the rows at q, (nv, r).

    Attributes:
        start: q as an array (joints, 3, 4).
    """

    def __init__(self, reduced: ReducedModel, q: np.ndarray, basis: np.ndarray) -> None:
        model, state = reduced.robot.model, reduced.at(q)
        data = model.createData()
        pin.forwardKinematics(model, data, q)
        self._model, self.n, self.m = model, reduced.n, reduced.m
        self.start: np.ndarray = np.array([data.liMi[j].homogeneous[:3] for j in range(1, model.njoints)])
        self._slices, self._axes = [], []
        for joint in list(model.joints)[1:]:
            calculated = joint.createData()
            joint.calc(calculated, q)
            self._slices.append(slice(joint.idx_v, joint.idx_v + joint.nv))
            self._axes.append(np.asarray(calculated.S, dtype=float).reshape(6, joint.nv))
        rows: list[KernelRow] = []
        for place in reduced.all_constraints.places:
            found = place.block.kernel_rows(model)
            assert found is not None
            rows += found
        self._rows, self._constant = [(k, rows[k]) for k in state.kept_rows.tolist()], state.all_rows
        self.basis = basis

    def moved(self, configurations: np.ndarray, tangents: np.ndarray) -> np.ndarray:
        """Configurations (k, joints, 3, 4) after motions (k, nv) along the joints."""
        found = np.empty_like(configurations, dtype=np.result_type(configurations, tangents))
        for j, (where, S) in enumerate(zip(self._slices, self._axes, strict=True)):
            step = _exponential(tangents[:, where] @ S.T)
            rotation = configurations[:, j, :, :3]
            found[:, j, :, :3] = rotation @ step[:, :, :3]
            found[:, j, :, 3] = (rotation @ step[:, :, 3:])[..., 0] + configurations[:, j, :, 3]
        return found

    def coordinates(self, configurations: np.ndarray) -> np.ndarray:
        """Coordinates (k, nv) of a ``PlacementChart`` at the start."""
        found = np.empty((len(configurations), self.n), dtype=configurations.dtype)
        for j, (where, S) in enumerate(zip(self._slices, self._axes, strict=True)):
            back = self.start[j, :, :3].T
            shift = (configurations[:, j, :, 3] - self.start[j, :, 3]) @ back.T
            turn = _rotation_vector(back @ configurations[:, j, :, :3])
            found[:, where] = np.concatenate([shift, turn], axis=1) @ np.linalg.pinv(S).T
        return found

    def generators(self, configurations: np.ndarray) -> np.ndarray:
        """Fields (k, nv, r) in the kernel, ``basis`` at the start."""
        return self._inverse(self._matrix(configurations, gradients=False)[0])[:, :, self.m :]

    def _inverse(self, A: np.ndarray) -> np.ndarray:
        return np.linalg.inv(np.concatenate([A, np.broadcast_to(self.basis.T, (len(A), *self.basis.T.shape))], axis=1))

    def fields(self, configurations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``generators`` (k, nv, r), and their derivatives (k, nv, r, nv) by direction."""
        A, A_gradient = self._matrix(configurations)
        inverse = self._inverse(A)
        R = inverse[:, :, self.m :]
        k, m, n = A.shape
        along = (R.mT[:, None] @ A_gradient).reshape(k, m, -1)
        return R, -(inverse[:, :, :m] @ along).reshape(k, n, -1, n)

    def _matrix(self, configurations: np.ndarray, gradients: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Independent rows (k, m, nv), and their derivatives (k, m, nv, nv), zero if they are not needed."""
        rotations, origins, columns = self._placed(configurations)
        A = np.zeros((len(configurations), self.m, self.n), dtype=configurations.dtype)
        gradient = np.zeros((*A.shape, self.n if gradients else 0), dtype=A.dtype)
        for number, (index, row) in enumerate(self._rows):
            if row.form == Form.CONSTANT:
                A[:, number] = self._constant[index]
                continue
            joint, placement = row.frames[0]
            rotation = rotations[joint] @ placement.rotation
            origin = origins[joint] + rotations[joint] @ placement.translation
            J = self._own(columns, joint, rotation, origin)
            weights = np.broadcast_to(np.asarray(row.numbers[:6], dtype=float), (len(J), 6))
            if row.form == Form.WORLD:
                weights = (weights.reshape(-1, 2, 3) @ rotation).reshape(-1, 6)
            A[:, number] = (weights[:, None] @ J)[:, 0]
            if gradients:
                gradient[:, number] = self._gradient(J, joint, weights, row.form == Form.WORLD)
        return A, gradient

    def _placed(self, configurations: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
        """Rotations (k, 3, 3) and origins (k, 3) of joints, and unit twists (k, 6, nv) in the world, at its origin."""
        count = len(configurations)
        rotations: list[np.ndarray] = [np.broadcast_to(np.eye(3), (count, 3, 3))]
        origins: list[np.ndarray] = [np.zeros((count, 3))]
        columns = np.zeros((count, 6, self.n), dtype=configurations.dtype)
        for j, (where, S) in enumerate(zip(self._slices, self._axes, strict=True)):
            parent = self._model.parents[j + 1]
            rotations.append(rotations[parent] @ configurations[:, j, :, :3])
            shift = (rotations[parent] @ configurations[:, j, :, 3:])[..., 0]
            origins.append(origins[parent] + shift)
            linear, angular = rotations[-1] @ S[:3], rotations[-1] @ S[3:]
            columns[:, :3, where] = linear + np.cross(origins[-1][:, :, None], angular, axis=1)
            columns[:, 3:, where] = angular
        return rotations, origins, columns

    def _path(self, joint: int) -> list[int]:
        """Joints that move a joint, from the base on, counted from zero."""
        return [j - 1 for j in self._model.supports[joint] if j > 0]

    def _own(self, columns: np.ndarray, joint: int, rotation: np.ndarray, origin: np.ndarray) -> np.ndarray:
        """Jacobian (k, 6, nv) of a frame in its own axes."""
        J = np.zeros_like(columns)
        moving = np.concatenate([np.arange(self.n)[self._slices[j]] for j in self._path(joint)])
        angular = columns[:, 3:, moving]
        linear = columns[:, :3, moving] + np.cross(angular, origin[:, :, None], axis=1)
        J[:, :3, moving], J[:, 3:, moving] = rotation.mT @ linear, rotation.mT @ angular
        return J

    def _gradient(self, J: np.ndarray, joint: int, weights: np.ndarray, world: bool) -> np.ndarray:
        """Derivatives (k, nv, nv) of a row ``weights . J``; in world axes the weights turn against the frame.

        Joints between a joint and the frame move its column: ``-ad(J_i) J_j``.
        """
        path, k = self._path(joint), len(J)
        found = np.zeros((k, self.n, self.n), dtype=J.dtype)
        # weights . ad(a) b, as the product of b and the dual bracket of the weights with a.
        force, torque = weights[:, :3, None], weights[:, 3:, None]
        v, w = J[:, :3], J[:, 3:]
        dual = np.concatenate(
            [np.cross(force, w, axis=1), np.cross(force, v, axis=1) + np.cross(torque, w, axis=1)], axis=1
        )
        for place, outer in enumerate(path):
            for inner in path[place + 1 :]:
                products = J[:, :, self._slices[outer]].mT @ dual[:, :, self._slices[inner]]
                found[:, self._slices[outer], self._slices[inner]] = -products
        if world:
            turned = np.concatenate([np.cross(force, w, axis=1), np.cross(torque, w, axis=1)], axis=1)
            found += J.mT @ turned
        return found


def _exponential(twists: np.ndarray) -> np.ndarray:
    """Placements (k, 3, 4) of complex twists (k, 6), linear part first, with angles up to a full turn."""
    v, w = twists[:, :3], twists[:, 3:]
    squared = (w * w).sum(axis=-1)[:, None, None]
    K = np.zeros((len(w), 3, 3), dtype=twists.dtype)
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -w[:, 2], w[:, 1], -w[:, 0]
    K -= K.mT
    K2 = K @ K
    # sin(x) / x, (1 - cos(x)) / x^2 and (x - sin(x)) / x^3 are entire functions of x^2.
    a, b, c = (_horner(squared, first) for first in (1, 2, 3))
    rotation = np.eye(3) + a * K + b * K2
    shift = (np.eye(3) + b * K + c * K2) @ v[:, :, None]
    return np.concatenate([rotation, shift], axis=-1)


def _rotation_vector(R: np.ndarray) -> np.ndarray:
    """Rotation vectors (k, 3) of complex rotations (k, 3, 3) by less than half a turn."""
    cosine = (np.trace(R, axis1=1, axis2=2) - 1) / 2
    sines = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    half = np.sqrt((1 - cosine + 0j) / (1 + cosine))  # tangent of half the angle; either sign gives the same vector
    small = np.abs(half) < _STRAIGHT
    stretch = np.where(small, 1.0, np.arctan(np.where(small, 1.0, half)) / np.where(small, 1.0, half))
    return 2 * (stretch / (1 + cosine))[:, None] * sines


def _horner(squared: np.ndarray, first: int) -> np.ndarray:
    """Sum over j of ``(-squared)^j / (2 j + first)!``."""
    total = np.zeros_like(squared)
    for j in range(_TERMS, -1, -1):
        total = 1.0 / factorial(2 * j + first) - squared * total
    return total
