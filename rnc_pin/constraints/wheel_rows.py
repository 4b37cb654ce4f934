"""Rows of a wheel that rolls on a plane, upright or leaning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.math.components import Component, Entry, cross, dot, packed_vector
from rnc_pin.model.frame_rows import FLAT, DirectionRows
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, wrench_rows
from rnc_pin.model.kinematics import Placement, PositionKinematics
from rnc_pin.model.rows import Friction, GroundContact, Phrases, check_defined
from rnc_pin.robots.robot import Robot


def wheel_level(axle: Sequence[Entry], normal: Sequence[Entry]) -> Entry:
    """Sine of the angle between the axle of a wheel and the normal of its plane."""
    across = cross(axle, normal)
    return dot(across, across) ** 0.5


def wheel_wrenches(axle: Sequence[Entry], normal: Sequence[Entry], radius: Entry) -> list[list[Entry]]:
    """Rolling, lateral and vertical rows (3, 6) of a wheel on a plane.

    The axle is a, the normal n, ``z = a . n`` and s the length of ``a x n``. The wheel heads along ``h = a x n / s``,
    and ``c = n x h`` is sideways. The contact point is at ``arm = radius (z c - s n)`` from the centre. With the
    centre's velocity v and the angular velocity w, the material point there has the velocity ``v + w x arm``. Its
    components are

        rolling   h . v - radius a . w
        lateral   c . v + radius s h . w
        vertical  n . v + radius z h . w.
    """
    across, s, z = cross(axle, normal), wheel_level(axle, normal), dot(axle, normal)
    heading = [each / s for each in across]
    rolling = [*heading, *(-radius * each for each in axle)]
    lateral = [*cross(normal, heading), *(radius * each for each in across)]
    return [rolling, lateral, [*normal, *(radius * z * each for each in heading)]]


class WheelDisk(NamedTuple):
    """Wheel without a tyre."""

    frame: str
    """Name of a frame at its centre."""
    radius: float
    """Radius [m]."""
    axle: np.ndarray
    """Axle in the frame's own axes (3,)."""
    parts: tuple[str, ...]
    """Words of the rows, (k,)."""
    combination: np.ndarray | None
    """Rows as combinations (k, 3) of the rolling, lateral and vertical rows; None for identity."""


class RollingRows(DirectionRows):
    """Rows of a wheel that is bound to a robot: ``wheel_wrenches``. A roller or a wheel that skids combines them.

    Attributes:
        wheel: name of the frame.
        radius: radius [m]. The rows are affine in it. An estimator sets it on its own copy.
        axle: axle in the frame's own axes (3,).
    """

    on_ground = True
    undefined = "a wheel lies flat on the ground"

    def __init__(self, disk: WheelDisk, friction: Friction, plane: GroundPlane, robot: Robot) -> None:
        self.names = tuple(f"{part}({disk.frame})" for part in disk.parts)
        self.units = ("m/s",) * len(disk.parts)
        self.holonomic = tuple(part == "vertical" for part in disk.parts)
        self.wheel, self.frame = disk.frame, robot.frame_id(disk.frame)
        self.radius, self.axle, self.directions = disk.radius, disk.axle, disk.axle[:, None]
        self.combination, self._friction = disk.combination, friction
        self.ground = None if plane.is_default else plane
        self._point, self._up = np.asarray(plane.point), plane.axes[2]
        self._normal = self._up.tolist()
        self.twist, self.affine = plane.twist, plane.moves

    def regularity(self, *directions: Sequence[Entry]) -> Entry:
        return wheel_level(directions[0], self._normal)

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return wheel_wrenches(directions[0], self._normal, self.radius)

    def wrenches_at(self, q: np.ndarray, rotation: np.ndarray) -> list[list[float]]:
        """Wrenches (k, 6) as numbers of Python.

        Args:
            q: one configuration (nq,), for messages.
            rotation: rotation of the frame there (3, 3).

        Raises:
            SingularityError: the wheel lies flat.
        """
        (axle,) = self.world_directions(rotation)
        check_defined(self.undefined, q, cast("float", wheel_level(axle, self._normal)), FLAT, self.names)
        found = cast("list[list[float]]", wheel_wrenches(axle, self._normal, self.radius))
        if self.combination is None:
            return found
        combined: list[list[float]] = self.combination.dot(found).tolist()
        return combined

    def _contact(self, at: PositionKinematics) -> np.ndarray:
        """Contact points (..., 3) in the world, where the wrenches are defined."""
        place, normal = at.placement(self.frame), self._normal
        (axle,) = self.world_directions(place.rotation)
        s, z = cast("Component", wheel_level(axle, normal)), dot(axle, normal)
        # z c - s n, with c = (a - z n) / s
        arm = [self.radius * (z * (a - z * n) / s - s * n) for a, n in zip(axle, normal, strict=True)]
        return place.translation + packed_vector(arm, s)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        self.check_defined(at)
        height = (self._contact(at) - self._point) @ self._up
        return np.asarray(height)[..., None] * self.holonomic

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        directions = self.wrenches(at)[..., :3]  # which checks that the wheel does not lie flat
        return np.broadcast_to(self._contact(at)[..., None, :], directions.shape), directions

    def arm_gradient(self, place: Placement, turning: np.ndarray) -> np.ndarray:
        a, n = (place.rotation @ self.axle)[:, None], np.asarray(self._normal)[:, None]
        a_q = np.cross(turning, a, axis=0)
        z, z_q = float(a[:, 0] @ n[:, 0]), n[:, 0] @ a_q
        s = float(np.sqrt(1 - z * z))
        # arm = radius (z (a - z n) / s - s n), with s^2 = 1 - z^2
        along, along_q = (a - z * n) / s, (a_q - n * z_q) / s + (a - z * n) * (z * z_q / s**3)
        return np.asarray(self.radius * (along * z_q + z * along_q + n * (z * z_q / s)))

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self.wheel, self.radius, self.axle, friction=self._friction),)

    def phrases(self) -> Phrases:
        prevents = "slip at" if self._friction == "all" else "roll without turning"
        return Phrases("rolling wheel", prevents=prevents, where=self.wheel)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        combination = np.eye(3) if self.combination is None else self.combination
        numbers = [[*self.axle, self.radius, *self._normal, *weights] for weights in combination]
        return wrench_rows(Form.WHEEL, attached(model, self.frame), numbers, self.twist)
