"""Coordinates in which a user would integrate a robot: angles in place of (cos, sin), quaternions as they are."""

from __future__ import annotations

import numpy as np
import pinocchio as pin


class PlainCoordinates:
    """Configuration of a robot on a fixed or planar base: every entry of v has a coordinate.

    Args:
        model: robot of hinges, slides and continuous joints, its base fixed or planar.
    """

    def __init__(self, model: pin.Model) -> None:
        joints = list(model.joints)[1:]
        self._nq = model.nq
        self.planar = joints[0].shortname() == "JointModelPlanar"
        angled = [joint for joint in joints if joint.nq > joint.nv]
        self._cosines = np.array([joint.idx_q + joint.nq - 2 for joint in angled], dtype=int)
        self._angles = np.array([joint.idx_v + joint.nv - 1 for joint in angled], dtype=int)
        others = np.setdiff1d(np.arange(model.nv), self._angles)
        of = {joint.idx_v + k: joint.idx_q + k for joint in joints for k in range(joint.nv)}
        self._others, self._there = others, np.array([of[entry] for entry in others])

    def of(self, q: np.ndarray) -> np.ndarray:
        """Coordinates (nv,) of a configuration."""
        x = np.empty(len(self._others) + len(self._angles))
        x[self._others] = q[self._there]
        x[self._angles] = np.arctan2(q[self._cosines + 1], q[self._cosines])
        return x

    def configuration(self, x: np.ndarray) -> np.ndarray:
        """Configuration (nq,) at coordinates."""
        if not len(self._angles):
            return x
        q = np.empty(self._nq)
        q[self._there] = x[self._others]
        angles = x[self._angles]
        q[self._cosines], q[self._cosines + 1] = np.cos(angles), np.sin(angles)
        return q

    def rate(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Rates of the coordinates."""
        if not self.planar:
            return v
        rate, c, s = v.copy(), q[2], q[3]
        rate[0], rate[1] = c * v[0] - s * v[1], s * v[0] + c * v[1]
        return rate


class QuaternionCoordinates:
    """Configuration of a robot on a free base, whose other joints have one coordinate each."""

    def of(self, q: np.ndarray) -> np.ndarray:
        """Coordinates (nq,) of a configuration."""
        return q

    def configuration(self, x: np.ndarray) -> np.ndarray:
        """Configuration (nq,) with a unit quaternion."""
        q = x.copy()
        q[3:7] /= np.sqrt(x[3:7].dot(x[3:7]))
        return q

    def rate(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Rates of the coordinates."""
        x, y, z, w = q[3:7].tolist()
        vx, vy, vz, a, b, c = v[:6].tolist()
        tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
        rate = np.empty(len(q))
        rate[:7] = (
            vx + w * tx + y * tz - z * ty,
            vy + w * ty + z * tx - x * tz,
            vz + w * tz + x * ty - y * tx,
            0.5 * (w * a + y * c - z * b),
            0.5 * (w * b + z * a - x * c),
            0.5 * (w * c + x * b - y * a),
            -0.5 * (x * a + y * b + z * c),
        )
        rate[7:] = v[6:]
        return rate
