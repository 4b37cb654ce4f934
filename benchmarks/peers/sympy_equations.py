"""Equations of planar systems, derived by SymPy and compiled by ``lambdify`` with ``cse``.

Lagrange's equations are written in the velocities that suit each system best: the joints of the space robot, and
forward speed, yaw rate and joints of the mobile manipulator. Inputs act along these velocities.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import sympy as sp
from scipy.linalg.lapack import dposv

from benchmarks.peers.cases import Case
from benchmarks.peers.peer import Peer
from benchmarks.states import States

Equations = Callable[[list[float], list[float], list[float]], tuple[list[list[float]], list[float]]]


def peers(case: Case, states: States) -> list[Peer]:
    """Reduced inertia and forces of a state from one compiled function, solved by LAPACK."""
    if case.name not in BASES:
        return []
    equations, rates = reduced_equations(case)
    x = np.array([case.coordinates.of(q) for q in states.q])
    each = list(zip(x, states.v[:, rates], states.T, strict=True))

    def acceleration(x: np.ndarray, u: np.ndarray, T: np.ndarray) -> np.ndarray:
        H, right = equations(x.tolist(), u.tolist(), T.tolist())
        return dposv(np.array(H), np.array(right))[1]

    first = case.model.nv - 3  # entries of v that are velocities of the reduction, in both systems
    return [Peer("SymPy", acceleration, each, lambda: np.array([acceleration(*state)[-3:] for state in each]), first)]


def reduced_equations(case: Case) -> tuple[Equations, list[int]]:
    """Compiled ``(H, R^T (B T - bias))``, and the entries of v that are the reduced velocities."""
    x = sp.symbols(f"x:{case.model.nv}", real=True)
    M = inertia_matrix(case.model, x)
    v = sp.Matrix(sp.symbols(f"v:{len(x)}", real=True))
    momentum = M * v
    bias = momentum.jacobian(x) * v - sp.Matrix([(v.T * momentum)[0] / 2]).jacobian(x).T
    return BASES[case.name](x, v, M, bias)


class _Arrow(NamedTuple):
    """Planar vector with components along the axes of a heading."""

    heading: sp.Expr
    x: sp.Expr
    y: sp.Expr

    def dot(self, other: _Arrow) -> sp.Expr:
        """Product in terms of the angle between the headings, which keeps the matrix short."""
        turn = other.heading - self.heading
        along, across = self.x * other.x + self.y * other.y, self.y * other.x - self.x * other.y
        return along * sp.cos(turn) + across * sp.sin(turn)


def inertia_matrix(model: pin.Model, x: tuple[sp.Symbol, ...]) -> sp.Matrix:
    """Inertia of a robot of vertical hinges, perhaps on a planar base with coordinates (x, y, heading)."""
    zero, one = sp.Integer(0), sp.Integer(1)
    poses: list[tuple[sp.Expr, list[_Arrow]]] = [(zero, [])]
    M = sp.zeros(len(x), len(x))
    for index in range(1, model.njoints):
        joint, inertia, placement = model.joints[index], model.inertias[index], model.jointPlacements[index]
        heading, path = poses[model.parents[index]]
        path = [*path, _arrow(heading, placement.translation)]
        heading = heading + _number(np.arctan2(*placement.rotation[1::-1, 0])) + x[joint.idx_v + joint.nv - 1]
        poses.append((heading, path))
        centre = [*path, _arrow(heading, inertia.lever)]
        columns = [[_Arrow(each.heading, -each.y, each.x) for each in centre if each.heading.has(angle)] for angle in x]
        if model.joints[1].nv == 3:
            columns[:2] = [_Arrow(zero, one, zero)], [_Arrow(zero, zero, one)]
        turns = [heading.diff(angle) for angle in x]
        for i, j in np.ndindex(M.shape):
            linear = sum(a.dot(b) for a in columns[i] for b in columns[j])
            M[i, j] += _number(inertia.mass) * linear + _number(inertia.inertia[2, 2]) * turns[i] * turns[j]
    return M


def _arrow(heading: sp.Expr, vector: np.ndarray) -> _Arrow:
    return _Arrow(heading, _number(vector[0]), _number(vector[1]))


def _number(value: float) -> sp.Expr:
    return sp.nsimplify(float(value), rational=True)


def _zero_momentum(
    x: tuple[sp.Symbol, ...], v: sp.Matrix, M: sp.Matrix, bias: sp.Matrix
) -> tuple[Equations, list[int]]:
    """All accelerations of a free system, at the velocity without momentum of the first coordinate."""
    T = sp.symbols(f"T:{len(x) - 1}", real=True)
    first = -(M[0, 1:] * v[1:, :])[0] / M[0, 0]
    right = sp.Matrix([0, *T]) - bias.subs(v[0], first)
    return sp.lambdify([x, v[1:], T], (M.tolist(), list(right)), modules="math", cse=True), list(range(1, len(x)))


def _no_side_slip(x: tuple[sp.Symbol, ...], v: sp.Matrix, M: sp.Matrix, bias: sp.Matrix) -> tuple[Equations, list[int]]:
    """Forward speed, yaw rate and joints of a base without lateral velocity."""
    count = len(x) - 1
    R = sp.zeros(len(x), count)
    R[0, 0], R[1, 0], R[2:, 1:] = sp.cos(x[2]), sp.sin(x[2]), sp.eye(count - 1)
    u, T = sp.symbols(f"u:{count}", real=True), sp.symbols(f"T:{count}", real=True)
    velocity = R * sp.Matrix(u)
    moving = dict(zip(v, velocity, strict=True))
    right = sp.Matrix(T) - R.T * (M * (velocity.jacobian(x) * velocity) + bias.subs(moving, simultaneous=True))
    H = R.T * M * R
    return sp.lambdify([x, u, T], (H.tolist(), list(right)), modules="math", cse=True), [0, *range(2, len(x))]


BASES = {"space-robot": _zero_momentum, "mobile-manipulator": _no_side_slip}
