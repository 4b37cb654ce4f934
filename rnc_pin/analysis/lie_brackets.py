"""Iterated Lie brackets of the columns of R at a configuration, by jets instead of nested differences.

Follow the fields Y_1, Y_2, ... of span(R) in turn, each for a time t, and pull a field W back from the end point:

    Z(t) = Ad(exp t Y_1) Ad(exp t Y_2) ... W = sum over a, b, ... of t^(a + b + ...) / (a! b! ...) ad_Y1^a ad_Y2^b ... W

So the Taylor coefficients of Z at t = 0 are brackets of each depth with W. W runs through the brackets of two columns
of R, which are exact. Gauss-Legendre collocation of order 2 c integrates the flow and its derivative, with exact
derivatives of R. No coefficient up to that order has an integration error. If the rows have complex values
(``ComplexRows``), Cauchy's formula on a circle of complex times then gives the coefficients to nearly all digits.
For other rows, a Chebyshev fit over a time of order one does, and loses about one digit per level; nested differences
lose two or more.
"""

from __future__ import annotations

from functools import cache
from math import ceil, factorial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy
from numpy.polynomial import chebyshev, legendre

from rnc_pin.analysis.frame_bracket import frame_bracket
from rnc_pin.model.kernel_rows import Form, KernelRow
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel

_FORMS = (Form.CONSTANT, Form.OWN, Form.WORLD)
_TERMS = 20  # of the series of sine and cosine
PIECES = 3
"""Number of fields that a flow follows in turn. With three fields, their brackets with brackets of generators span a
free Lie algebra up to degree 8 and beyond (``tests/analysis/test_lie_brackets.py``). Two fields do not."""
_SPARE = 8  # degrees of the fit above the requested order
_TIMES = (0.5, 0.2, 0.05, 0.0125)  # flow times, tried in turn while the error is large
_FITTED = 3  # largest order of fits on the real line, if there is another way
_PLACEMENTS = 4  # dimensions of an array of complex configurations
_SHORT = 1e-12  # functions that never exceed this value are rounding errors


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
        constant = np.zeros((reduced.all_constraints.size, self.n))
        for place in reduced.all_constraints.places:
            found = place.block.kernel_rows(model)
            assert found is not None
            rows += found
        for index, row in enumerate(rows):
            if row.form == Form.CONSTANT:
                constant[index] = state.all_rows[index] if row.constant is None else row.constant
        self._rows, self._constant = [(k, rows[k]) for k in state.kept_rows.tolist()], constant
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


def _horner(squared: np.ndarray, first: int) -> np.ndarray:
    """Sum over j of ``(-squared)^j / (2 j + first)!``."""
    total = np.zeros_like(squared)
    for j in range(_TERMS, -1, -1):
        total = 1.0 / factorial(2 * j + first) - squared * total
    return total


class Jets(NamedTuple):
    """Taylor coefficients, each scaled by the largest value of its function, from two fits of different degree."""

    coefficients: np.ndarray
    """(order + 1, nv, functions), each times its power of the time."""
    coarser: np.ndarray
    """Coefficients from a fit of two degrees less; the difference estimates the error."""


class BracketJets:
    """Jets of brackets at a configuration.

    Args:
        reduced: the model.
        q: a regular configuration (nq,).

    Attributes:
        generators: constant combinations of the columns of R, orthonormal at q, (nv, r).
    """

    def __init__(self, reduced: ReducedModel, q: np.ndarray) -> None:
        self.reduced, self.q = reduced, q
        self._model = reduced.robot.model
        self._bracket = frame_bracket(self._model)
        R = reduced.at(q).R
        self._scaling = np.linalg.inv(np.linalg.qr(R)[1])
        self.generators: np.ndarray = R @ self._scaling
        self._rows = ComplexRows(reduced, q, self.generators) if has_complex_rows(reduced) else None
        self._pairs = np.triu_indices(reduced.r, 1)

    def pairs(self) -> np.ndarray:
        """Return the exact brackets (nv, pairs) of two generators at q."""
        fields, gradient = self._fields(self.q[None])
        return self._of_pairs(fields, gradient)[0]

    def times(self, order: int) -> tuple[float, ...]:
        """Flow times that suit an order, longest first.

        Circles of complex times lose no digits, so they may be longer, and deep brackets are larger there.
        """
        return (1.0, *_TIMES) if self._on_circle(order) else _TIMES

    def _on_circle(self, order: int) -> bool:
        """True for deep brackets; a fit costs less, and is accurate enough for others."""
        return self._rows is not None and order > _FITTED

    def draw(self, order: int, time: float, generator: np.random.Generator) -> Jets:
        """Return the Taylor coefficients of brackets pulled back along a random flow.

        Args:
            order: of the highest coefficient.
            time: the flow is sampled from ``-time`` to ``time``; the generators have unit length at q.
            generator: random generator for the fields.
        """
        if self._on_circle(order):
            return self._from_circle(order, time, generator)
        degree = order + _SPARE
        count = ceil(1.25 * (degree + 1))
        nodes = np.cos((2 * np.arange(count) + 1) * np.pi / (2 * count))
        values = self._pulled_back(time * nodes, order, generator)
        values = values / np.maximum(np.abs(values).max(axis=(0, 1)), _SHORT)
        fine, coarse = (_fit(nodes, values, each)[: order + 1] for each in (degree, degree - 2))
        return Jets(fine, coarse)

    def _from_circle(self, order: int, time: float, generator: np.random.Generator) -> Jets:
        """Coefficients from values on the circle of complex times of radius ``time``, by Cauchy's formula."""
        count = 4 * ceil((order + _SPARE) / 2)
        times = time * np.exp(2j * np.pi * np.arange(count // 2 + 1) / count)  # the others are conjugate
        values = self._pulled_back(times, order, generator)
        values = values / np.maximum(np.abs(values).max(axis=(0, 1)), _SHORT)
        # Values conjugate for conjugate times have real coefficients.
        fine = np.fft.hfft(values, axis=0)[: order + 1] / count
        coarse = np.fft.hfft(values[::2], axis=0)[: order + 1] / (count // 2)
        return Jets(fine, coarse)

    def _pulled_back(self, times: np.ndarray, order: int, generator: np.random.Generator) -> np.ndarray:
        """Brackets of generators at the end of each piece of a flow, pulled back to q, (times, nv, functions)."""
        n, found = self.reduced.n, []
        start = self._rows.start if self._rows is not None and np.iscomplexobj(times) else self.q
        q = np.repeat(start[None], len(times), axis=0)
        back = np.tile(np.eye(n), (len(times), 1, 1))
        for _ in range(PIECES):
            direction = generator.normal(size=self.reduced.r)
            direction *= np.sqrt(self.reduced.r) / (PIECES * np.linalg.norm(direction))
            q, step = self._flow(q, times, direction, order)
            back = back @ np.linalg.inv(step)
            fields, gradient = self._fields(q)
            found.append(back @ self._of_pairs(fields, gradient))
        return np.concatenate(found, axis=-1)

    def _flow(
        self, start: np.ndarray, times: np.ndarray, direction: np.ndarray, order: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """End points (k, ...) of the flow of a combination of generators from k configurations, and its derivatives."""
        k, n = len(start), self.reduced.n
        weights, ends = _gauss_legendre(order // 2 + 1)
        c = len(ends)
        dt = times[:, None, None]
        slopes = np.zeros((k, c, n), dtype=times.dtype)
        for _ in range(order + 2):  # each sweep makes one more coefficient exact
            moved = dt * (weights @ slopes)
            points = self._moved(np.repeat(start, c, axis=0), moved.reshape(k * c, n))
            velocities = (self._generators(points) @ direction).reshape(k, c, n)
            slopes = self._in_chart(moved, velocities, order)
        fields, gradient = self._fields(points)
        v = (fields @ direction).reshape(k * c, 1, n)
        carried = np.moveaxis(self._bracket(np.broadcast_to(v, (k * c, n, n)), np.eye(n) + 0 * v), 1, 2)
        rates = (np.einsum("pnrd,r->pnd", gradient, direction) - carried).reshape(k, c, n, n)
        # Collocation of the linear equation for the derivative of the flow.
        system = np.eye(c * n) - np.einsum("ij,p,pikl->pikjl", weights, times, rates).reshape(k, c * n, c * n)
        stages = np.linalg.solve(system, rates.reshape(k, c * n, n)).reshape(k, c, n, n)
        step = np.eye(n) + dt * np.einsum("i,pikl->pkl", ends, stages)
        return self._moved(start, dt[:, 0] * np.einsum("j,pjk->pk", ends, slopes)), step

    def _moved(self, q: np.ndarray, tangents: np.ndarray) -> np.ndarray:
        if self._rows is not None and q.ndim == _PLACEMENTS:
            return self._rows.moved(q, tangents)
        return np.stack([pin.integrate(self._model, *each) for each in zip(q, tangents, strict=True)])

    def _in_chart(self, xi: np.ndarray, v: np.ndarray, order: int) -> np.ndarray:
        """Rate of ``xi`` in ``q = start (+) xi`` at a velocity v, by the series of the inverse differential."""
        total, term = v.copy(), v
        for j, number in enumerate(scipy.special.bernoulli(order + 1)[1:], start=1):
            term = self._bracket(xi, term)
            if number and not term.any():
                break
            total += (-1) ** j * number / factorial(j) * term
        return total

    def _generators(self, points: np.ndarray) -> np.ndarray:
        """Generators (k, nv, r)."""
        if self._rows is not None and points.ndim == _PLACEMENTS:
            return self._rows.generators(points)
        return self.reduced.at(points).R @ self._scaling

    def _fields(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Generators (k, nv, r) and their derivatives (k, nv, r, nv); the last index is the direction."""
        if self._rows is not None and points.ndim == _PLACEMENTS:
            return self._rows.fields(points)
        k, n = len(points), self.reduced.n
        states = self.reduced.at(np.repeat(points, n, axis=0), v=np.tile(np.eye(n), (k, 1)))
        gradient = np.moveaxis((states.R_dot @ self._scaling).reshape(k, n, n, -1), 1, -1)
        return states.R[::n] @ self._scaling, gradient

    def _of_pairs(self, fields: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Brackets (k, nv, pairs) of two generators."""
        i, j = self._pairs
        along = np.einsum("knrd,kds->knrs", gradient, fields)  # of column r along column s
        first, second = (np.moveaxis(fields[..., each], -1, -2) for each in (i, j))
        return along[..., j, i] - along[..., i, j] + np.moveaxis(self._bracket(first, second), -1, -2)


@cache
def _gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights (c, c) and (c,) of the collocation method of order 2 c on [0, 1]."""
    nodes, ends = legendre.leggauss(count)
    nodes = (nodes + 1) / 2
    powers = np.arange(1, count + 1)
    integrals = nodes[:, None] ** powers / powers
    return np.linalg.solve(np.vander(nodes, increasing=True).T, integrals.T).T, ends / 2


def _fit(nodes: np.ndarray, values: np.ndarray, degree: int) -> np.ndarray:
    """Coefficients (degree + 1, ...) of powers, from values (nodes, ...) at Chebyshev nodes of [-1, 1]."""
    basis = chebyshev.chebvander(nodes, degree)
    weights = np.full(degree + 1, 2.0 / len(nodes))
    weights[0] /= 2  # the columns are orthogonal
    series = weights[:, None] * (basis.T @ values.reshape(len(nodes), -1))
    powers = np.zeros((degree + 1, degree + 1))
    for k in range(degree + 1):
        powers[: k + 1, k] = chebyshev.cheb2poly(np.eye(degree + 1)[k, : k + 1])
    return (powers @ series).reshape(degree + 1, *values.shape[1:])
