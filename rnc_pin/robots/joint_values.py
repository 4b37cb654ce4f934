"""Place of joints in q and v, and conversion between joint values by name (angles, displacements) and entries of q."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, nearest

JointValue = float | Sequence[float] | np.ndarray

NO_LIMIT = 1e10
"""Value above which a number of a robot file means that there is no limit; Pinocchio writes the largest float."""


def joint_index(model: pin.Model, name: str) -> int:
    """Index of a joint. An unknown name raises ModelError with the nearest name."""
    valid = list(model.names)[1:]
    if name not in valid:
        raise ModelError(f"no joint '{name}' in robot '{model.name}'{nearest(str(name), valid)}")
    return model.getJointId(name)


def configuration(model: pin.Model, values: Mapping[str, JointValue]) -> np.ndarray:
    """Neutral configuration (nq,) with the given joint values.

    Raises:
        ModelError: unknown joint, or values of a wrong number or type.
    """
    q = pin.neutral(model)
    if not isinstance(values, Mapping):
        example = next(iter(model.names[1:]), "joint")
        raise ModelError(f"joint values have to be a mapping such as {{'{example}': 0.0}}, found {values!r}")
    for name, value in values.items():
        joint = model.joints[joint_index(model, name)]
        try:
            entry = np.atleast_1d(np.asarray(value, dtype=float))
        except (TypeError, ValueError):
            raise ModelError(f"joint '{name}' takes numbers, found {value!r}") from None
        if not np.isfinite(entry).all():
            raise ModelError(f"joint '{name}' takes finite numbers, found {value!r}")
        q[joint.idx_q : joint.idx_q + joint.nq] = _joint_coordinates(name, joint, entry)
    return q


def values_of(model: pin.Model, q: np.ndarray) -> dict[str, float | list[float]]:
    """Joint name to value(s) [rad or m] at q (nq,), the inverse of ``configuration``."""
    values: dict[str, float | list[float]] = {}
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        entry = q[joint.idx_q : joint.idx_q + joint.nq]
        if _goes_round(joint):
            values[name] = float(np.arctan2(entry[1], entry[0]))
        elif joint.shortname() == "JointModelPlanar":
            values[name] = [float(entry[0]), float(entry[1]), float(np.arctan2(entry[3], entry[2]))]
        else:
            values[name] = float(entry[0]) if joint.nq == 1 else entry.tolist()
    return values


def _goes_round(joint: pin.JointModel) -> bool:
    """True if a joint is continuous with configuration (cos, sin). Its class depends on the axis."""
    return bool(joint.nq == 2 and joint.nv == 1)


def _joint_coordinates(name: str, joint: pin.JointModel, entry: np.ndarray) -> np.ndarray:
    kind = joint.shortname()
    if _goes_round(joint) and entry.size == 1:
        return np.array([np.cos(entry[0]), np.sin(entry[0])])
    if kind == "JointModelPlanar" and entry.size == 3:
        return np.array([entry[0], entry[1], np.cos(entry[2]), np.sin(entry[2])])
    if kind in ("JointModelFreeFlyer", "JointModelSpherical") and entry.size == joint.nq:
        length = np.linalg.norm(entry[-4:])
        if length < 1e-9:
            raise ModelError(f"joint '{name}': the quaternion (x, y, z, w) has zero length")
        return np.r_[entry[:-4], entry[-4:] / length]
    if entry.size == joint.nq == joint.nv:
        return entry
    expected = {
        "JointModelPlanar": "3 (x, y, yaw)",
        "JointModelFreeFlyer": "7 (x, y, z, quaternion x, y, z, w)",
        "JointModelSpherical": "4 (quaternion x, y, z, w)",
    }
    count = expected.get(kind, str(joint.nv))
    raise ModelError(f"joint '{name}' takes {count} value{'s' * (count != '1')}, found {entry.size}")


class SingleJoint(NamedTuple):
    """Joint with one degree of freedom, as plain numbers: joint models of Pinocchio cannot be pickled or copied."""

    idx_q: int
    """Index of its first value in q."""
    idx_v: int
    """Index in v."""
    continuous: bool
    """True if q holds the cosine and the sine of its angle."""
    unit: str
    """Unit of its velocity: "rad/s" or "m/s"."""

    @classmethod
    def of(cls, joint: pin.JointModel) -> SingleJoint:
        """Return the place of a joint, which has one degree of freedom."""
        unit = "rad/s" if joint.shortname().startswith("JointModelR") else "m/s"
        return cls(joint.idx_q, joint.idx_v, joint.nq == 2, unit)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Position (...,) [rad or m] at q (..., nq)."""
        if self.continuous:
            return np.asarray(np.arctan2(q[..., self.idx_q + 1], q[..., self.idx_q]))
        return np.asarray(q[..., self.idx_q])
