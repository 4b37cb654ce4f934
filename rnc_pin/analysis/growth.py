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
# Eighth-order central difference. Rates of R are exact, so only brackets of brackets need it.
_HALF_STENCIL = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
_STENCIL = tuple((sign * k, sign * weight) for k, weight in _HALF_STENCIL for sign in (1, -1))
_TOLERANCE = 1e-5  # of unit vectors; nested differences lose two digits a level
_DEEPEST = 8
_EMPTY_DRAWS = 2  # in a row, before a field's brackets count as exhausted

Field = Callable[[np.ndarray], np.ndarray]


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
                direction = _new_direction(basis, candidate(q))
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

        def value(p: np.ndarray) -> np.ndarray:
            here = self.reduced.at(p)
            x, y = (here.R @ columns).T
            along_x, along_y = (here.moving(each).R_dot for each in (x, y))
            return along_x @ columns[:, 1] - along_y @ columns[:, 0] + self.algebra(x, y)

        return value

    def of(self, combination: np.ndarray, field: Field) -> Field:
        """The bracket of a combination of generators with any field."""
        column = self.scaling @ combination

        def value(p: np.ndarray) -> np.ndarray:
            y = field(p)
            here = self.reduced.at(p)
            x, along_y = here.R @ column, here.moving(y).R_dot
            return _derivative(self.model, field, p, x) - along_y @ column + self.algebra(x, y)

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


def _derivative(model: pin.Model, field: Field, q: np.ndarray, x: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(x)
    if length == 0:
        return np.zeros_like(x)
    step, total = x * (_STEP / length), np.zeros_like(x)
    for k, weight in _STENCIL:
        total += weight * field(pin.integrate(model, q, k * step))
    return total * (length / _STEP)


def _new_direction(basis: np.ndarray, vector: np.ndarray) -> np.ndarray | None:
    """The unit vector by which a vector leads out of a basis (n, k), if it does."""
    length = np.linalg.norm(vector)
    if length < _TOLERANCE:
        return None
    rest: np.ndarray = vector / length
    for _ in range(2):  # twice is enough
        rest = rest - basis @ (basis.T @ rest)
    size = float(np.linalg.norm(rest))
    return rest / size if size > _TOLERANCE else None


def frame_bracket(model: pin.Model) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Bracket of two tangent vectors as left-invariant fields: that of SE(2), SO(3) and SE(3) joints."""
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
            a, b = x[where], y[where]
            if kind == "JointModelPlanar":
                result[where] = (b[2] * a[1] - a[2] * b[1], a[2] * b[0] - b[2] * a[0], 0.0)
            elif kind == "JointModelSpherical":
                result[where] = np.cross(a, b)
            else:
                result[where] = pin.Motion(a).cross(pin.Motion(b)).vector
        return result

    return bracket
