"""Shapes of revolution that a joint turns about their own axis, such as wheels: the turn does not move them."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float, Int

_WOBBLE = 2e-6  # [m]; axes in robot files have few digits: 1.5708 for a right angle moves the rim of a wheel by 1e-6 m
_OF_REVOLUTION = (coal.Cylinder, coal.Capsule, coal.Cone)  # about the z axes of their frames
_REVOLUTE = "JointModelR"  # bounded and unbounded, along an axis of the frame or not


class SpinningShapes:
    """Shapes of revolution whose joint turns about their axis, and the poses that they have without this turn.

    Args:
        model: model of the robot.
        axes: axes of its joints, by ``axes_of_rotation``.
        shapes: convex shapes; only those with a carrier are looked at.
        carriers: joint that carries each of the first shapes.
        rotations, origins: poses of the shapes in their joints, (s, 3, 3) and (s, 3) [m].
        radii: radii of the spheres around the shapes [m].

    Attributes:
        shapes: indices (n,) of the shapes that spin.
        wobble: largest distance (s,) of a point of each shape from that of an exact shape of revolution [m].
    """

    def __init__(
        self,
        model: pin.Model,
        axes: Float[Array, "njoints 3"],
        shapes: Sequence[coal.CollisionGeometry],
        carriers: Int[Array, " k"],
        rotations: Float[Array, "s 3 3"],
        origins: Float[Array, "s 3"],
        radii: Float[Array, " s"],
    ) -> None:
        self.wobble = np.zeros(len(shapes))
        found = []
        for k, joint in enumerate(carriers.tolist()):
            axis = axes[joint]
            if (
                np.isnan(axis).any()
                or model.joints[joint].nv != 1
                or not isinstance(shapes[k], (coal.Sphere, *_OF_REVOLUTION))
            ):
                continue
            tilt = (
                0.0 if isinstance(shapes[k], coal.Sphere) else float(np.linalg.norm(np.cross(axis, rotations[k, :, 2])))
            )
            wobble = float(np.linalg.norm(np.cross(axis, origins[k]))) + tilt * float(radii[k])
            if wobble < _WOBBLE:
                found.append(k)
                self.wobble[k] = wobble
        self.shapes = np.array(found, dtype=int)
        joints = carriers[self.shapes]
        self._parents = np.array([model.parents[joint] for joint in joints.tolist()], dtype=int)
        placed = [model.jointPlacements[joint].rotation for joint in joints.tolist()]
        self._rotations = np.array(placed).reshape(-1, 3, 3) @ rotations[self.shapes]

    def without_spin(
        self, rotations: Float[Array, "n s 3 3"], joints: Float[Array, "n j 3 3"]
    ) -> Float[Array, "n s 3 3"]:
        """Rotations of all shapes, with those of spinning ones as if their joints stood at zero.

        Args:
            rotations: rotations of all shapes in the world.
            joints: rotations of all joints in the world.
        """
        if not len(self.shapes):
            return rotations
        still = rotations.copy()
        still[:, self.shapes] = joints[:, self._parents] @ self._rotations
        return still


def axes_of_rotation(model: pin.Model) -> Float[Array, "njoints 3"]:
    """Axis of each joint that turns about one axis, in its frame; NaN for other joints."""
    axes, q = np.full((model.njoints, 3), np.nan), pin.neutral(model)
    for k, joint in enumerate(list(model.joints)[1:], start=1):
        if joint.shortname().startswith(_REVOLUTE) and joint.nv == 1:
            data = joint.createData()
            joint.calc(data, q)
            axes[k] = np.ravel(data.S)[3:]
        elif joint.shortname() == "JointModelPlanar":
            axes[k] = [0.0, 0.0, 1.0]
    return axes
