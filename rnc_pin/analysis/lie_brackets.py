"""Iterated Lie brackets of the columns of R at a configuration, by jets instead of nested differences.

Follow the fields Y_1, Y_2, ... of span(R) in turn, each for a time t, and pull a field W back from the end point:

    Z(t) = Ad(exp t Y_1) Ad(exp t Y_2) ... W = sum over a, b, ... of t^(a + b + ...) / (a! b! ...) ad_Y1^a ad_Y2^b ... W

So the Taylor coefficients of Z at t = 0 are brackets of each depth with W. W runs through the brackets of two columns
of R, which are exact. Gauss-Legendre collocation of order 2 c integrates the flow and its derivative, with exact
derivatives of R. No coefficient up to that order has an integration error. A Chebyshev fit over a time of order one
gives the coefficients. It loses about one digit per level; nested differences lose two or more.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import ceil, factorial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy
from numpy.polynomial import chebyshev, legendre

from rnc_pin.errors import ConstraintError
from rnc_pin.model.coordinates import ConfigurationManifold, PlacementChart
from rnc_pin.model.reduced_model import ReducedModel

Bracket = Callable[[np.ndarray, np.ndarray], np.ndarray]


def frame_bracket(model: pin.Model) -> Bracket:
    """Return the bracket of tangent vectors (..., nv) as left-invariant fields of SE(2), SO(3) and SE(3) joints.

    Args:
        model: model of the robot.
    """
    parts: list[tuple[slice, str]] = []
    for joint in list(model.joints)[1:]:
        kind = joint.shortname()
        if kind in ("JointModelPlanar", "JointModelFreeFlyer", "JointModelSpherical"):
            parts.append((slice(joint.idx_v, joint.idx_v + joint.nv), kind))
        # Other joints have constant velocity fields in their coordinates, whose brackets are zero.
        elif joint.nv > 1 and joint.nq != joint.nv:
            raise ConstraintError(f"no Lie bracket is known for a joint of type {kind}")

    def bracket(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        result = np.zeros_like(x)
        for where, kind in parts:
            a, b, out = x[..., where], y[..., where], result[..., where]
            if kind == "JointModelPlanar":
                out[..., 0] = b[..., 2] * a[..., 1] - a[..., 2] * b[..., 1]
                out[..., 1] = a[..., 2] * b[..., 0] - b[..., 2] * a[..., 0]
            elif kind == "JointModelSpherical":
                out[...] = np.cross(a, b)
            else:
                out[..., :3] = np.cross(a[..., 3:], b[..., :3]) + np.cross(a[..., :3], b[..., 3:])
                out[..., 3:] = np.cross(a[..., 3:], b[..., 3:])
        return result

    return bracket


PIECES = 3
"""Number of fields that a flow follows in turn. With three fields, their brackets with brackets of generators span a
free Lie algebra up to degree 8 and beyond (``tests/analysis/test_lie_brackets.py``). Two fields do not."""
FLOW_TIMES = (0.5, 0.2, 0.05, 0.0125)  # flow times, tried in turn while the error is large


_Generators = Callable[[np.ndarray], np.ndarray]


class Jets(NamedTuple):
    """Taylor coefficients, from two fits of different degree."""

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
        self._moved = ConfigurationManifold(self._model).integrate
        self._bracket = frame_bracket(self._model)
        R = reduced.at(q).R
        # Orthonormal at q: brackets of long and short columns would have sizes of their own.
        self._scaling = np.linalg.inv(np.linalg.qr(R)[1])
        self.generators: np.ndarray = R @ self._scaling

    def pairs(self) -> np.ndarray:
        """Return the exact brackets (nv, pairs) of two generators at q."""
        return self._of_pairs(*self._fields(self.q[None]))[0]

    def draw(self, order: int, time: float, generator: np.random.Generator) -> Jets:
        """Return the Taylor coefficients of brackets pulled back along a random flow, each in units of its size.

        Args:
            order: of the highest coefficient.
            time: the flow is sampled from ``-time`` to ``time``; the generators have unit length at q.
            generator: random generator for the fields.
        """
        silent = 1e-12  # functions that never exceed this value are rounding errors

        def values(times: np.ndarray) -> np.ndarray:
            found = self._pulled_back(times, order, generator)
            return found / np.maximum(np.abs(found).max(axis=(0, 1)), silent)

        spare = 8  # degrees of the fit above the order, which take up the terms that the fit leaves out
        return _coefficients(values, order, time, spare)

    def follow(self, order: int, time: float, fields: np.ndarray) -> Jets:
        """Return the Taylor coefficients of the coordinates of a ``PlacementChart`` at q along flows.

        Args:
            order: of the highest coefficient.
            time: duration of each piece of a flow.
            fields: combinations of generators that each flow follows in turn, (flows, pieces, r).
        """
        chart, count = PlacementChart(self._model, self.q), len(fields)

        def values(times: np.ndarray) -> np.ndarray:
            q, each = np.repeat(self.q[None], len(times) * count, axis=0), np.repeat(times, count)
            # Flows one after the other, each from where the last one ended.
            for piece in range(fields.shape[1]):
                direction = np.tile(fields[:, piece], (len(times), 1))
                q = self._moved(q, self._steps(q, each, direction, order, self._normal_generators)[2])
            return np.moveaxis(chart.coordinates(q).reshape(len(times), count, -1), 1, 2)

        # Coefficients are results here, and need more digits than the dimensions of ``draw``.
        spare = 12
        return _coefficients(values, order, time, spare)

    def _pulled_back(self, times: np.ndarray, order: int, generator: np.random.Generator) -> np.ndarray:
        """Brackets of generators at the end of each piece of a flow, pulled back to q, (times, nv, functions)."""
        n, found = self.reduced.n, []
        q = np.repeat(self.q[None], len(times), axis=0)
        back = np.tile(np.eye(n), (len(times), 1, 1))
        for _ in range(PIECES):
            direction = generator.normal(size=self.reduced.r)
            # All pieces together move over the same length for any number of generators, so the flow times fit all
            # robots.
            direction *= np.sqrt(self.reduced.r) / (PIECES * np.linalg.norm(direction))
            q, step = self._flow(q, times, direction, order)
            # The inverse derivative of the flow so far carries fields at its end back to q.
            back = back @ np.linalg.inv(step)
            found.append(back @ self._of_pairs(*self._fields(q)))
        return np.concatenate(found, axis=-1)

    def _steps(
        self, start: np.ndarray, times: np.ndarray, direction: np.ndarray, order: int, generators: _Generators
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stages of the flows of combinations (k, r) of generators from k configurations.

        Returns their configurations (k c, ...), the combination of each (k c, r), and the tangent vectors (k, nv) from
        the starts to the ends.
        """
        k, n = len(start), self.reduced.n
        weights, ends = _gauss_legendre(order // 2 + 1)
        c = len(ends)
        dt, along = times[:, None, None], np.repeat(direction, c, axis=0)
        slopes = np.zeros((k, c, n))
        for _ in range(order + 2):  # each sweep makes one more coefficient exact
            moved = dt * (weights @ slopes)
            points = self._moved(np.repeat(start, c, axis=0), moved.reshape(k * c, n))
            velocities = np.einsum("pnr,pr->pn", generators(points), along).reshape(k, c, n)
            slopes = self._in_chart(moved, velocities, order)
        return points, along, dt[:, 0] * np.einsum("j,pjk->pk", ends, slopes)

    def _flow(
        self, start: np.ndarray, times: np.ndarray, direction: np.ndarray, order: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """End points (k, ...) of the flow of a combination of generators from k configurations, and its derivatives."""
        k, n = len(start), self.reduced.n
        weights, ends = _gauss_legendre(order // 2 + 1)
        c = len(ends)
        same = np.broadcast_to(direction, (k, len(direction)))
        points, along, step = self._steps(start, times, same, order, self._generators)
        fields, gradient = self._fields(points)
        v = np.einsum("pnr,pr->pn", fields, along).reshape(k * c, 1, n)
        carried = np.moveaxis(self._bracket(np.broadcast_to(v, (k * c, n, n)), np.eye(n) + 0 * v), 1, 2)
        # In moving frames the derivative of a field has the bracket of the joints' groups as well.
        rates = (np.einsum("pnrd,r->pnd", gradient, direction) - carried).reshape(k, c, n, n)
        # Collocation of the linear equation for the derivative of the flow.
        system = np.eye(c * n) - np.einsum("ij,p,pikl->pikjl", weights, times, rates).reshape(k, c * n, c * n)
        stages = np.linalg.solve(system, rates.reshape(k, c * n, n)).reshape(k, c, n, n)
        turned = np.eye(n) + times[:, None, None] * np.einsum("i,pikl->pkl", ends, stages)
        return self._moved(start, step), turned

    def _in_chart(self, xi: np.ndarray, v: np.ndarray, order: int) -> np.ndarray:
        """Rate of ``xi`` in ``q = start (+) xi`` at a velocity v, by the series of the inverse differential."""
        total, term = v.copy(), v
        for j, number in enumerate(scipy.special.bernoulli(order + 1)[1:], start=1):
            term = self._bracket(xi, term)
            # The series ends for commuting motions, such as of revolute joints.
            if number and not term.any():
                break
            total += (-1) ** j * number / factorial(j) * term
        return total

    def _generators(self, points: np.ndarray) -> np.ndarray:
        """Generators (k, nv, r)."""
        return self.reduced.at(points).R @ self._scaling

    def _normal_generators(self, points: np.ndarray) -> np.ndarray:
        """Generators (k, nv, r) whose components along those at q are constant: they need no good outputs."""
        fields = self._generators(points)
        # Outputs may turn singular along a flow, and the distribution does not: components along q's generators remain.
        return fields @ np.linalg.inv(self.generators.T @ fields)

    def _fields(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Generators (k, nv, r) and their derivatives (k, nv, r, nv); the last index is the direction."""
        k, n = len(points), self.reduced.n
        states = self.reduced.at(np.repeat(points, n, axis=0), v=np.tile(np.eye(n), (k, 1)))
        gradient = np.moveaxis((states.R_dot @ self._scaling).reshape(k, n, n, -1), 1, -1)
        return states.R[::n] @ self._scaling, gradient

    def _of_pairs(self, fields: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Brackets (k, nv, pairs) of two generators."""
        i, j = np.triu_indices(self.reduced.r, 1)
        along = np.einsum("knrd,kds->knrs", gradient, fields)  # of column r along column s
        first, second = (np.moveaxis(fields[..., each], -1, -2) for each in (i, j))
        return along[..., j, i] - along[..., i, j] + np.moveaxis(self._bracket(first, second), -1, -2)


def _coefficients(values: Callable[[np.ndarray], np.ndarray], order: int, time: float, spare: int) -> Jets:
    """Taylor coefficients of functions (times, ...) of the time, scaled by its powers, by fits of both signs of it."""
    degree = order + spare
    # More nodes than coefficients: the fit averages rounding errors.
    count = ceil(1.25 * (degree + 1))
    nodes = chebyshev.chebpts1(count)
    fitted = values(time * nodes)
    # Fits of two degrees from the same values: their difference shows what the truncation costs.
    return Jets(*(_fit(nodes, fitted, each)[: order + 1] for each in (degree, degree - 2)))


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
    series = chebyshev.chebfit(nodes, values.reshape(len(nodes), -1), degree)
    powers = np.zeros((degree + 1, degree + 1))
    for k in range(degree + 1):
        powers[: k + 1, k] = chebyshev.cheb2poly(np.eye(degree + 1)[k, : k + 1])
    return (powers @ series).reshape(degree + 1, *values.shape[1:])
