"""Displacements of joints along steps of constant rate, split into translations and rotations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ModelError

_SPHERICAL = ("JointModelSphericalZYX", "JointModelUniversal")
_REVOLUTE = ("JointModelR",)  # bounded and unbounded, along an axis of the frame or not
_PRISMATIC = ("JointModelP",)
_HELICAL = ("JointModelH",)


class _Part(NamedTuple):
    """Part of a joint: the norm of these velocity components times two factors is its rotation and its translation."""

    joint: int
    columns: slice
    angular: float
    linear: float


class JointSteps:
    """Rotations and translations of the joints of a model along steps.

    A joint moves the bodies that it carries by a translation of its frame and a rotation about the origin of this
    frame. Both are bounded by the components of the step: exactly for joints with constant axes, and by the sum over
    the elementary rotations for universal, ZYX, ellipsoid and composite joints.

    Args:
        model: model of the robot.
        q: configurations (N, nq) of the motion; they bound the offsets within composite joints.

    Raises:
        ModelError: the model has a joint of an unknown kind.
    """

    def __init__(self, model: pin.Model, q: Float[Array, "N nq"]) -> None:
        self._count = model.njoints
        self._parts = [
            part for index in range(1, model.njoints) for part in _parts(index, model.joints[index], 0.0, np.abs(q))
        ]

    def of(self, steps: Float[Array, "k nv"]) -> tuple[Float[Array, "k njoints"], Float[Array, "k njoints"]]:
        """Rotations [rad] and translations [m] of the joints along steps (k, nv); the universe has none."""
        angular, linear = (np.zeros((len(steps), self._count)) for _ in range(2))
        for joint, columns, turning, moving in self._parts:
            size = np.linalg.norm(steps[:, columns], axis=1)
            angular[:, joint] += turning * size
            linear[:, joint] += moving * size
        return angular, linear


def _parts(index: int, joint: pin.JointModel, lever: float, largest: Float[Array, "N nq"]) -> list[_Part]:
    """Parts of a joint whose origin is at most a lever [m] away from that of joint ``index``."""
    kind, start, size = joint.shortname(), joint.idx_v, joint.nv
    every = slice(start, start + size)
    each = [slice(k, k + 1) for k in range(start, start + size)]
    if kind == "JointModelFreeFlyer":
        return [_Part(index, slice(start, start + 3), 0.0, 1.0), _Part(index, slice(start + 3, start + 6), 1.0, lever)]
    if kind == "JointModelPlanar":
        return [_Part(index, slice(start, start + 2), 0.0, 1.0), _Part(index, each[2], 1.0, lever)]
    if kind == "JointModelTranslation" or kind.startswith(_PRISMATIC):
        return [_Part(index, every, 0.0, 1.0)]
    if kind in ("JointModelSpherical",):
        return [_Part(index, every, 1.0, lever)]
    if kind in _SPHERICAL or kind.startswith(_REVOLUTE):
        return [_Part(index, one, 1.0, lever) for one in each]
    if kind.startswith(_HELICAL):
        return [_Part(index, every, 1.0, lever + abs(float(_extracted(joint).pitch)))]
    if kind == "JointModelEllipsoid":
        inside = _extracted(joint)
        reach = max(inside.radius_x, inside.radius_y, inside.radius_z)
        return [_Part(index, one, 1.0, lever + reach) for one in each]
    if kind == "JointModelComposite":
        return _composite_parts(index, _extracted(joint), lever, largest)
    raise ModelError(f"joint {index} is a {kind}: its motion between two configurations is not known")


def _composite_parts(
    index: int, joint: pin.JointModelComposite, lever: float, largest: Float[Array, "N nq"]
) -> list[_Part]:
    """Parts of the joints in a composite joint; the origin of the last one is that of the whole joint."""
    found: list[_Part] = []
    for inner, placement in reversed(list(zip(joint.joints, joint.jointPlacements, strict=True))):
        found += _parts(index, inner, lever, largest)
        lever += float(np.linalg.norm(placement.translation)) + _reach(inner, largest)
    return found


def _reach(joint: pin.JointModel, largest: Float[Array, "N nq"]) -> float:
    """Largest translation of a joint in a motion [m]."""
    kind, size = joint.shortname(), {"JointModelFreeFlyer": 3, "JointModelPlanar": 2}.get(joint.shortname(), joint.nq)
    if kind == "JointModelEllipsoid":
        return float(max(getattr(_extracted(joint), f"radius_{axis}") for axis in "xyz"))
    if kind.startswith(("JointModelR", "JointModelSpherical", "JointModelUniversal")):
        return 0.0
    moved = float(np.linalg.norm(largest[:, joint.idx_q : joint.idx_q + size], axis=1).max(initial=0.0))
    return moved * abs(float(_extracted(joint).pitch)) if kind.startswith(_HELICAL) else moved


def _extracted(joint: pin.JointModel) -> pin.JointModel:
    """Joint of its own type; a joint in a list of joints is of the general type."""
    return joint.extract() if hasattr(joint, "extract") else joint
