"""A ball that rolls without slip on the plane z = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class RollingBall:
    """The lowest point of a ball is at rest on the ground: two rolling rows and the vertical one.

    The contact is ``radius`` below the centre whatever the ball's attitude. Rows are the velocity of the material
    point there along the world's x, y and z. The last is holonomic, the centre stays at height ``radius``; for a
    planar base it is zero and drops out.

    Args:
        frame: a frame at the centre of the ball that turns with it.
        radius: of the ball [m].

    Raises:
        ModelError: no such frame.
        ConstraintError: the radius is not positive.
    """

    frame: str
    radius: float

    def bind(self, robot: Robot) -> Rows:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ConstraintError(f"radius of ball '{self.frame}' has to be positive, found {self.radius}")
        return _RollingBallRows(self, robot)


class _RollingBallRows(Rows):
    holonomic = (False, False, True)
    on_ground = True

    def __init__(self, kind: RollingBall, robot: Robot) -> None:
        self.names = tuple(f"{part}({kind.frame})" for part in ("rolling_x", "rolling_y", "vertical"))
        self.units = ("m/s",) * 3
        self._frame = robot.frame_id(kind.frame)
        self._radius = kind.radius
        # Velocity of the contact = that of the centre + this matrix times the angular velocity.
        self._lever = pin.skew(np.array([0.0, 0.0, kind.radius]))

    def jacobian(self, state: Kinematics) -> np.ndarray:
        jacobian = state.jacobian(self._frame)
        return jacobian[:3] + self._lever @ jacobian[3:]

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        jacobian_dot = state.jacobian_dot(self._frame)
        return jacobian_dot[:3] + self._lever @ jacobian_dot[3:]

    def drift(self, state: Kinematics) -> np.ndarray:
        acceleration = state.acceleration(self._frame)
        return acceleration.linear + self._lever @ acceleration.angular

    def drift_gradient(self, state: Kinematics) -> np.ndarray:
        motion = state.frame_gradients(self._frame)
        return motion.acceleration + self._lever @ motion.angular_acceleration

    def residual(self, state: Kinematics) -> np.ndarray:
        return np.array([0.0, 0.0, state.placement(self._frame).translation[2] - self._radius])

    def lines_of_action(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = state.placement(self._frame).translation - np.array([0.0, 0.0, self._radius])
        return np.tile(contact, (3, 1)), np.eye(3)
