"""How a frame is turned in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FrameOrientation:
    """Attitude of a frame: its rate is the angular velocity in world axes, its error lives on SO(3).

    The value is the rotation vector [rad], not longer than a half turn; in a trajectory it goes on without jumps. The
    error of a reference Rd is ``log(Rd R^T)`` in world axes: the shortest way round, never unwinding. References are in
    rotation vectors, too; controllers turn their derivatives into angular velocities.

    Args:
        frame: name of the frame.
    """

    frame: str

    def bind(self, robot: Robot) -> OutputRows:
        return _OrientationRows(self, robot)


class _OrientationRows(OutputRows):
    rotation = True

    def __init__(self, kind: FrameOrientation, robot: Robot) -> None:
        self.names = tuple(f"{kind.frame}_orientation_{axis}" for axis in "xyz")
        self.units = ("rad/s",) * 3
        self.angular = (False,) * 3
        self._frame = robot.frame_id(kind.frame)

    def value(self, state: Kinematics) -> np.ndarray:
        return np.asarray(pin.log3(state.placement(self._frame).rotation))

    def jacobian(self, state: Kinematics) -> np.ndarray:
        return state.jacobian(self._frame)[3:]

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        return state.jacobian_dot(self._frame)[3:]

    def drift(self, state: Kinematics) -> np.ndarray:
        return np.asarray(state.acceleration(self._frame).angular)

    def drift_gradient(self, state: Kinematics) -> np.ndarray:
        return state.frame_gradients(self._frame).angular_acceleration
