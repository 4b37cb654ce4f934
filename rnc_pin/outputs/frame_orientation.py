"""Orientation of a frame in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.model.frame_velocity import FrameVelocityRows
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FrameOrientation:
    """Orientation of a frame: its rate is the angular velocity in world axes, its error is on SO(3).

    The value is the rotation vector [rad], with a length of at most pi; in a trajectory it continues without jumps. The
    error of a reference Rd is ``log(Rd R^T)`` in world axes, the shortest rotation, so unwinding does not occur.
    References are rotation vectors, too; controllers convert their derivatives to angular velocities.

    Args:
        frame: name of the frame.

    Example:
        >>> robot = rnc.Robot.from_urdf("floating_arm.urdf", base="free", gravity=(0, 0, 0))
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], ["shoulder", "elbow"])
        >>> reduced = system.reduce(vertical=[rnc.FrameOrientation("hand")])
        >>> reduced.vertical.names
        ('hand_orientation_x', 'hand_orientation_y', 'hand_orientation_z')
    """

    frame: str

    def bind(self, robot: Robot) -> OutputRows:
        return _OrientationRows(self, robot)


class _OrientationRows(FrameVelocityRows, OutputRows):
    rotation = True

    def __init__(self, kind: FrameOrientation, robot: Robot) -> None:
        super().__init__(robot, kind.frame, (3, 4, 5))
        self.names = tuple(f"{kind.frame}_orientation_{axis}" for axis in "xyz")
        self.angular = (False,) * 3

    def value(self, at: PositionKinematics) -> np.ndarray:
        rotation = at.placement(self._frame).rotation
        if rotation.ndim == 2:  # one state, on the hot path
            return np.asarray(pin.log3(rotation))
        vectors = np.empty(rotation.shape[:-1])
        for i in np.ndindex(vectors.shape[:-1]):
            vectors[i] = pin.log3(rotation[i])
        return vectors
