"""Exponential map of the configuration manifold and its inverse, for stacks of configurations."""

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
