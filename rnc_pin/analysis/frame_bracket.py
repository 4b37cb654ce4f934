"""Lie bracket of tangent vectors, written in the axes of the joints."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError

Bracket = Callable[[np.ndarray, np.ndarray], np.ndarray]


def frame_bracket(model: pin.Model) -> Bracket:
    """Return the bracket of tangent vectors (..., nv) as left-invariant fields of SE(2), SO(3) and SE(3) joints."""
    parts: list[tuple[slice, str]] = []
    for joint in list(model.joints)[1:]:
        kind = joint.shortname()
        if kind in ("JointModelPlanar", "JointModelFreeFlyer", "JointModelSpherical"):
            parts.append((slice(joint.idx_v, joint.idx_v + joint.nv), kind))
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
