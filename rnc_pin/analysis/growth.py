"""Complete nonholonomy: the growth vector of span(R) under Lie brackets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError
from rnc_pin.reduction import ReducedModel

_STEP = 0.01
# Eighth-order central difference. Rates of R are exact, so only brackets of brackets need it.
_STENCIL = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
_TOLERANCE = 1e-5  # of unit vectors; nested differences lose two digits a level
_DEEPEST = 8

Field = Callable[[np.ndarray], np.ndarray]


def growth_vector(reduced: ReducedModel, q: np.ndarray) -> tuple[int, ...]:
    """Dimensions of span(R), with its brackets, with theirs, ... until they grow no more.

    Vector fields are written in the tangent space at q, in which the moving frames of planar, spherical
    and free-flying joints have a bracket of their own. Brackets of the columns of R are exact; deeper
    ones take an eighth-order difference of those.

    Args:
        reduced: the model.
        q: a configuration (nq,) at which the dimensions are the generic ones.
    """
    model = reduced.robot.model
    algebra = _frame_bracket(model)

    def column(i: int) -> Field:
        return lambda p: reduced.basis_rate(p, np.zeros(reduced.n))[0][:, i]

    def bracket(i: int, other: Field, exact: int | None) -> Field:
        def value(p: np.ndarray) -> np.ndarray:
            y = other(p)
            R, R_along_y = reduced.basis_rate(p, y)
            x = R[:, i]
            along_x = reduced.basis_rate(p, x)[1][:, exact] if exact is not None else _derivative(model, other, p, x)
            return along_x - R_along_y[:, i] + algebra(x, y)

        return value

    generators = [column(i) for i in range(reduced.r)]
    basis = _extend(np.zeros((reduced.n, 0)), [each(q) for each in generators])[0]
    dimensions = [basis.shape[1]]
    fields = [(bracket(i, generators[j], j)) for i in range(reduced.r) for j in range(i + 1, reduced.r)]
    while dimensions[-1] < reduced.n and fields and len(dimensions) < _DEEPEST:
        basis, new = _extend(basis, [each(q) for each in fields])
        if not new:
            break
        dimensions.append(basis.shape[1])
        fresh = [fields[k] for k in new]
        fields = [bracket(i, each, None) for i in range(reduced.r) for each in fresh]
    return tuple(dimensions)


def _derivative(model: pin.Model, field: Field, q: np.ndarray, x: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(x)
    if length == 0:
        return np.zeros_like(x)
    direction, total = x / length, np.zeros_like(x)
    for k, weight in _STENCIL:
        ahead, behind = (field(pin.integrate(model, q, sign * k * _STEP * direction)) for sign in (1, -1))
        total += weight * (ahead - behind)
    return total * (length / _STEP)


def _extend(basis: np.ndarray, vectors: list[np.ndarray]) -> tuple[np.ndarray, list[int]]:
    """An orthonormal basis (n, k) grown by vectors, and which of them were new."""
    new = []
    for index, vector in enumerate(vectors):
        length = np.linalg.norm(vector)
        if basis.shape[1] == basis.shape[0] or length < _TOLERANCE:
            continue
        rest = vector / length
        for _ in range(2):  # twice is enough
            rest = rest - basis @ (basis.T @ rest)
        if np.linalg.norm(rest) > _TOLERANCE:
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
            new.append(index)
    return basis, new


def _frame_bracket(model: pin.Model) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
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
