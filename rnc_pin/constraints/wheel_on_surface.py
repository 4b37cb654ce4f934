"""Rows of a wheel that rolls without slip on a curved surface."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.body_shapes import Torus
from rnc_pin.constraints.curved_grounds import CurvedGround
from rnc_pin.constraints.surface_contact import SurfaceContact, SurfaceContactRows
from rnc_pin.constraints.wheel_rows import WheelDisk
from rnc_pin.math.linear_algebra import apply, vector_product
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import Phrases
from rnc_pin.robots.robot import Robot

_TO_HEADING = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # from the axes of a contact


class WheelOnSurfaceRows(SurfaceContactRows):
    """Rolling, lateral and vertical rows of a wheel, in the tangent plane of the surface at the contact point.

    The wheel is a torus without a tube. The first axis of the contact is the axle a, projected on the tangent plane,
    which points sideways. The second is opposite to the heading ``a x n``.

    Args:
        disk: the wheel.
        ground: the surface.
        robot: the robot.
    """

    def __init__(self, disk: WheelDisk, ground: CurvedGround, robot: Robot) -> None:
        turned = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), disk.axle).matrix()
        placement = pin.SE3(turned, np.zeros(3))
        super().__init__(disk.frame, Torus(disk.radius), placement, True, ground, robot)
        self._axle = disk.axle
        self._combination = _TO_HEADING if disk.combination is None else disk.combination @ _TO_HEADING
        self.names = tuple(f"{part}({disk.frame})" for part in disk.parts)
        self.units = ("m/s",) * len(disk.parts)
        self.holonomic = tuple(part == "vertical" for part in disk.parts)

    def _direction(self, rotation: np.ndarray, normal: np.ndarray) -> np.ndarray:
        return apply(rotation, self._axle)

    def _direction_rate(self, found: SurfaceContact, w: np.ndarray) -> np.ndarray:
        return vector_product(w, found.along)

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._combination @ super().jacobian(at)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._combination @ super().jacobian_dot(at)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return apply(self._combination, super().bias_acceleration(at))

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        return self._combination @ super().bias_acceleration_gradient(at)

    def rate(self, at: PositionKinematics) -> np.ndarray:
        return apply(self._combination, super().rate(at)) if self.affine else self._zeros(at)

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        return apply(self._combination, super().rate_dot(at)) if self.affine else self._zeros(at)

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact, axes = self._contact_axes(at)
        directions = self._combination @ axes
        return np.broadcast_to(contact[..., None, :], directions.shape), directions

    def phrases(self) -> Phrases:
        prevents = "slip at" if len(self.names) == 3 else "roll without turning"
        return Phrases("rolling wheel", prevents=prevents, where=self._body)
