"""Coordinates of configurations about a center: translation and rotation of a base, and positions of joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.model.configuration_manifold import ConfigurationManifold


class PlacementChart:
    """Coordinates (nv,) of configurations about a center.

    A planar or free base has its translation in the axes that it has at the center, and its angle or rotation vector.
    Unlike in the logarithm of SE(2) and SE(3), the translation does not depend on the rotation. The coordinates of
    other joints are those of ``pinocchio.difference``.

    Args:
        model: Pinocchio's model.
        center: configuration (nq,) with zero coordinates.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> from rnc_pin.model.placement_chart import PlacementChart
        >>> chart = PlacementChart(robot.model, np.array([1.0, 0.0, 0.0, 1.0]))  # at x = 1 m, yaw 90 degrees
        >>> chart.coordinates(np.array([[1.0, 0.5, -1.0, 0.0]])).round(4)
        array([[0.5   , 0.    , 1.5708]])
    """

    def __init__(self, model: pin.Model, center: Float[Array, " nq"]) -> None:
        self._model, self._center = model, np.array(center, dtype=float)
        self._manifold = ConfigurationManifold(model)
        self._real = all(joint.nv == 1 or joint.nq == joint.nv or _is(joint, "Planar") for joint in model.joints[1:])
        joints = list(model.joints)[1:]
        self._planar = [(joint.idx_q, joint.idx_v) for joint in joints if _is(joint, "Planar")]
        self._free = [(joint.idx_q, joint.idx_v) for joint in joints if _is(joint, "FreeFlyer")]

    def coordinates(self, q: Float[Array, "n nq"]) -> Float[Array, "n nv"]:
        """Coordinates of configurations."""
        center = self._center
        found = self._manifold.difference(np.broadcast_to(center, q.shape), q)
        for at, to in self._planar:
            (c, s), shift = center[at + 2 : at + 4], q[:, at : at + 2] - center[at : at + 2]
            found[:, to : to + 2] = shift @ np.array([[c, -s], [s, c]])
        for at, to in self._free:
            found[:, to : to + 3] = (q[:, at : at + 3] - center[at : at + 3]) @ _rotation(center[at + 3 : at + 7])
        return found

    def jacobian(self, q: Float[Array, "n nq"]) -> Float[Array, "n nv nv"]:
        """Derivatives of the coordinates along tangent vectors at the configurations."""
        n, nv = len(q), self._manifold.nv
        if self._real:
            found = np.tile(np.eye(nv), (n, 1, 1))
        else:
            found = np.array([pin.dDifference(self._model, self._center, each)[1] for each in q]).reshape(n, nv, nv)
        for at, to in self._planar:
            c, s = self._center[at + 2 : at + 4]
            cosine, sine = q[:, at + 2] * c + q[:, at + 3] * s, q[:, at + 3] * c - q[:, at + 2] * s
            found[:, to : to + 2, to : to + 3] = 0.0
            found[:, to, to], found[:, to, to + 1] = cosine, -sine
            found[:, to + 1, to], found[:, to + 1, to + 1] = sine, cosine
        for at, to in self._free:
            back = _rotation(self._center[at + 3 : at + 7]).T
            found[:, to : to + 3, to : to + 6] = 0.0
            found[:, to : to + 3, to : to + 3] = [back @ _rotation(each[at + 3 : at + 7]) for each in q]
        return found


def _is(joint: pin.JointModel, kind: str) -> bool:
    return bool(joint.shortname() == f"JointModel{kind}")


def _rotation(quaternion: Array) -> Array:
    """Rotation matrix of a quaternion (x, y, z, w)."""
    return np.array(pin.Quaternion(quaternion).toRotationMatrix())
