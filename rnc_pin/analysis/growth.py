"""Complete nonholonomy: span(R) under Lie brackets, its growth vector and its involutive closure.

A bracket is linear in each of the fields in it. So the brackets of all generators with a field span what its
brackets with random combinations of them span, and a draw that brings nothing new says (with probability one)
that no generator does: the cost of a level grows with the directions found, not with r.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy.linalg

from rnc_pin.errors import ConstraintError
from rnc_pin.model.reduced_model import ReducedModel

_STEP = 0.01
_OTHER = 0.7  # of that step: what is found has to be there with both
_AGREE = 0.2  # relative difference between the two; noise points anywhere, and cut-off terms shrink with the step
# Eighth-order central difference. Rates of R are exact, so only brackets of brackets need it.
_HALF_STENCIL = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
_STENCIL = tuple((sign * k, sign * weight) for k, weight in _HALF_STENCIL for sign in (1, -1))
_TOLERANCE = 1e-5  # of unit vectors; nested differences lose two digits a level
_DEEPEST = 8
_EMPTY_DRAWS = 2  # in a row, before a field's brackets count as exhausted

_BLOCK = 256  # configurations at a time: stencils of stencils are many

Field = Callable[[np.ndarray, float], np.ndarray]
"""Vectors (k, nv) at configurations (k, nq), by differences of a step."""


class Growth(NamedTuple):
    """The filtration of a distribution at a configuration."""

    vector: tuple[int, ...]
    """Dimensions of span(R), with its brackets, with theirs, ... until they grow no more."""
    closure: np.ndarray
    """Orthonormal basis (nv, dimension) of the last of them: where motion can lead."""


def growth_vector(reduced: ReducedModel, q: np.ndarray) -> tuple[int, ...]:
    """Dimensions of span(R), with its brackets, with theirs, ... until they grow no more.

    Args:
        reduced: the model.
        q: a configuration (nq,) at which the dimensions are the generic ones.
    """
    return grow(reduced, q).vector


def grow(reduced: ReducedModel, q: np.ndarray) -> Growth:
    """The filtration of span(R) at q, and its involutive closure.

    Vector fields are written in the tangent space at q, in which the moving frames of planar, spherical
    and free-flying joints have a bracket of their own. Brackets of the columns of R are exact; deeper
    ones take an eighth-order difference of those.

    Where constraints are affine, ``v = R v2 + b``, brackets with the given motion b are left out: what span(R) reaches
    can be reached, and b may reach more.

    Args:
        reduced: the model.
        q: a configuration (nq,) at which the dimensions are the generic ones.

    Raises:
        ConstraintError: a joint whose tangent space has no known bracket.
        SingularityError: q is singular.
    """
    brackets = _Brackets(reduced, q)
    generator = np.random.default_rng(0)
    basis = scipy.linalg.orth(brackets.generators)
    dimensions = [basis.shape[1]]
    basis, fields = _first_brackets(brackets, basis)
    while fields:
        dimensions.append(basis.shape[1])
        if len(dimensions) == _DEEPEST:
            break
        deeper: list[Field] = []
        for field in fields:
            empty = 0
            while basis.shape[1] < reduced.n and empty < _EMPTY_DRAWS:
                candidate = brackets.of(generator.normal(size=reduced.r), field)
                direction = _found_twice(basis, candidate, q)
                if direction is None:
                    empty += 1
                else:
                    empty = 0
                    basis = np.column_stack([basis, direction])
                    deeper.append(candidate)
        fields = deeper
    return Growth(tuple(dimensions), basis)


class _Brackets:
    """Lie brackets with the generators: the columns of R, in a constant combination orthonormal at q."""

    def __init__(self, reduced: ReducedModel, q: np.ndarray) -> None:
        self.reduced, self.q = reduced, q
        self.model = reduced.robot.model
        self.algebra = frame_bracket(self.model)
        R = reduced.at(q).R
        self.scaling = np.linalg.inv(np.linalg.qr(R)[1])
        self.generators = R @ self.scaling

    def of_pair(self, first: np.ndarray, second: np.ndarray) -> Field:
        """The bracket of two combinations of generators, exact."""
        columns = self.scaling @ np.column_stack([first, second])

        def value(points: np.ndarray, step: float) -> np.ndarray:
            here = self.reduced.at(points)
            x, y = np.moveaxis(here.R @ columns, -1, 0)
            along_x, along_y = (here.moving(each).R_dot for each in (x, y))
            return along_x @ columns[:, 1] - along_y @ columns[:, 0] + self.algebra(x, y)

        return _in_blocks(value)

    def of(self, combination: np.ndarray, field: Field) -> Field:
        """The bracket of a combination of generators with any field."""
        column = self.scaling @ combination

        def value(points: np.ndarray, step: float) -> np.ndarray:
            y = field(points, step)
            here = self.reduced.at(points)
            x, along_y = here.R @ column, here.moving(y).R_dot
            return _derivative(self.model, field, points, x, step) - along_y @ column + self.algebra(x, y)

        return _in_blocks(value)


def _in_blocks(field: Field) -> Field:
    def value(points: np.ndarray, step: float) -> np.ndarray:
        starts = range(0, len(points), _BLOCK)
        return np.concatenate([field(points[start : start + _BLOCK], step) for start in starts])

    return value


def _first_brackets(brackets: _Brackets, basis: np.ndarray) -> tuple[np.ndarray, list[Field]]:
    """Every bracket of two generators at once, and those that lead out of span(R)."""
    reduced, r = brackets.reduced, brackets.reduced.r
    X = brackets.generators
    along = reduced.basis_rate(brackets.q, X.T)[1] @ brackets.scaling  # (r, nv, r): of column j along column i
    first, second = np.triu_indices(r, 1)
    moving = np.array([brackets.algebra(X[:, i], X[:, j]) for i, j in zip(first, second, strict=True)])
    vectors = along[first, :, second] - along[second, :, first] + moving.reshape(len(first), reduced.n)
    lengths = np.linalg.norm(vectors, axis=1)
    # A coupling may be weak, and a pair's bracket small beside another's: each is judged on its own.
    long = lengths > _TOLERANCE
    if not long.any():
        return basis, []
    units = vectors[long] / lengths[long, None]
    for _ in range(2):  # twice is enough
        units = units - (units @ basis) @ basis.T
    Q, triangle, order = scipy.linalg.qr(units.T, mode="economic", pivoting=True)
    count = int((np.abs(np.diag(triangle)) > _TOLERANCE).sum())
    chosen = np.flatnonzero(long)[order[:count]]
    identity = np.eye(r)
    fields = [brackets.of_pair(identity[first[k]], identity[second[k]]) for k in chosen]
    return np.column_stack([basis, Q[:, :count]]), fields


def _derivative(model: pin.Model, field: Field, points: np.ndarray, x: np.ndarray, step: float) -> np.ndarray:
    """Rates (k, nv) of a field at configurations (k, nq) that move along x (k, nv)."""
    length = np.linalg.norm(x, axis=1, keepdims=True)
    along = x * (step / np.maximum(length, 1e-300))
    moved = [pin.integrate(model, q, k * dq) for k, _ in _STENCIL for q, dq in zip(points, along, strict=True)]
    around = field(np.stack(moved), step).reshape(len(_STENCIL), *x.shape)
    total = np.tensordot([weight for _, weight in _STENCIL], around, axes=1)
    return np.asarray(total * (length / step))


def _found_twice(basis: np.ndarray, field: Field, q: np.ndarray) -> np.ndarray | None:
    """The unit vector by which a field leads out of a basis at q (nq,), if differences of two steps say so."""
    first = _rest(basis, *field(q[None], _STEP))
    size = float(np.linalg.norm(first))
    if size < _TOLERANCE:
        return None
    second = _rest(basis, *field(q[None], _OTHER * _STEP))
    return first / size if np.linalg.norm(first - second) < _AGREE * size else None


def _rest(basis: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """What of a vector, scaled to one, leads out of a basis (n, k)."""
    rest: np.ndarray = vector / max(float(np.linalg.norm(vector)), _TOLERANCE)
    for _ in range(2):  # twice is enough
        rest = rest - basis @ (basis.T @ rest)
    return rest


def frame_bracket(model: pin.Model) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Bracket of tangent vectors (..., nv) as left-invariant fields: that of SE(2), SO(3) and SE(3) joints."""
    parts: list[tuple[slice, str]] = []
    for joint in list(model.joints)[1:]:
        kind = joint.shortname()
        if kind in ("JointModelPlanar", "JointModelFreeFlyer", "JointModelSpherical"):
            parts.append((slice(joint.idx_v, joint.idx_v + joint.nv), kind))
        elif joint.nv > 1 and joint.nq != joint.nv:
            raise ConstraintError(f"no growth vector for a robot with a joint of type {kind}")

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
