"""Exponential map of the configuration manifold and its inverse, and coordinates about a center."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float, Int

FEW = 8
"""Configurations below which calls of Pinocchio, 2 us each, cost less than the closed forms, 25 us together."""


class ConfigurationManifold:
    """Exponential map and its inverse, as Pinocchio defines them, for stacks of configurations.

    Real numbers, angles on a circle and planar bases have closed forms here. Few configurations, and robots with other
    joints, such as balls and free bases, take a call of Pinocchio for each configuration.

    Args:
        model: Pinocchio's model.

    Example:
        >>> robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
        >>> from rnc_pin.model.configuration_manifold import ConfigurationManifold
        >>> manifold = ConfigurationManifold(robot.model)
        >>> start = np.tile(robot.configuration(), (2, 1))
        >>> step = np.array([[0.1, 0.0, 0.0, 0.0, 0.0], [0.1, 0.0, np.pi, 0.0, 0.0]])
        >>> manifold.integrate(start, step)[:, :2].round(4)
        array([[0.1   , 0.    ],
               [0.    , 0.0637]])
    """

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self.nv = model.nv
        joints = list(model.joints)[1:]
        flat = [joint for joint in joints if joint.nq == joint.nv]
        circles = [joint for joint in joints if joint.shortname().startswith("JointModelRUB")]
        planar = [joint for joint in joints if joint.shortname() == "JointModelPlanar"]
        self._closed = len(flat) + len(circles) + len(planar) == len(joints)
        self._flat = (
            _columns(joint.idx_q + k for joint in flat for k in range(joint.nq)),
            _columns(joint.idx_v + k for joint in flat for k in range(joint.nv)),
        )
        self._planar = _columns(joint.idx_q for joint in planar), _columns(joint.idx_v for joint in planar)
        self._turned = (  # the cosine, which the sine follows
            _columns([*(joint.idx_q for joint in circles), *(self._planar[0] + 2)]),
            _columns([*(joint.idx_v for joint in circles), *(self._planar[1] + 2)]),
        )

    def integrate(self, q: Float[Array, "n nq"], step: Float[Array, "n nv"]) -> Float[Array, "n nq"]:
        """Configurations displaced by tangent vectors."""
        if not self._closed or len(q) < FEW:
            return np.array([pin.integrate(self._model, a, b) for a, b in zip(q, step, strict=True)]).reshape(q.shape)
        found = np.empty(q.shape)
        at, to = self._flat
        found[:, at] = q[:, at] + step[:, to]
        if not len(self._turned[0]):
            return found
        at, to = self._turned
        found[:, at], found[:, at + 1] = _rotated(q[:, at], q[:, at + 1], np.cos(step[:, to]), np.sin(step[:, to]))
        at, to = self._planar
        half, x, y = 0.5 * step[:, to + 2], step[:, to], step[:, to + 1]
        size = np.sinc(half / np.pi)  # of the chord, relative to the arc
        shift = _rotated(x, y, size * np.cos(half), size * np.sin(half))
        for k, moved in enumerate(_rotated(*shift, q[:, at + 2], q[:, at + 3])):
            found[:, at + k] = q[:, at + k] + moved
        return found

    def difference(self, start: Float[Array, "n nq"], end: Float[Array, "n nq"]) -> Float[Array, "n nv"]:
        """Tangent vectors at ``start`` that lead to ``end``."""
        if not self._closed or len(start) < FEW:
            found = [pin.difference(self._model, a, b) for a, b in zip(start, end, strict=True)]
            return np.array(found).reshape(len(start), self.nv)
        step = np.empty((len(start), self.nv))
        at, to = self._flat
        step[:, to] = end[:, at] - start[:, at]
        if not len(self._turned[0]):
            return step
        at, to = self._turned
        cosine, sine = _rotated(end[:, at], end[:, at + 1], start[:, at], -start[:, at + 1])
        step[:, to] = np.arctan2(sine, cosine)
        at, to = self._planar
        x, y = (end[:, at + k] - start[:, at + k] for k in range(2))
        half = 0.5 * step[:, to + 2]
        size = np.sinc(half / np.pi)
        chord = _rotated(x, y, start[:, at + 2], -start[:, at + 3])
        step[:, to], step[:, to + 1] = _rotated(*chord, np.cos(half) / size, -np.sin(half) / size)
        return step

    def interpolate(
        self, start: Float[Array, "*n nq"], end: Float[Array, "*n nq"], parts: Float[Array, " n"]
    ) -> Float[Array, "n nq"]:
        """Configurations on the geodesics between two configurations, at fractions of them."""
        step = parts[:, None] * self.difference(np.atleast_2d(start), np.atleast_2d(end))
        return self.integrate(np.broadcast_to(start, (len(parts), start.shape[-1])), step)


def _columns(numbers: Iterable[int]) -> Int[Array, " k"]:
    return np.array([*numbers], dtype=int)


def _rotated(x: Array, y: Array, cosine: Array, sine: Array) -> tuple[Array, Array]:
    """Vectors in the plane, rotated."""
    return x * cosine - y * sine, x * sine + y * cosine


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
        >>> from rnc_pin.model.configuration_manifold import PlacementChart
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
