"""Caster, ball transfer unit or skid without joints: it only supports the robot's weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.model.frame_velocity import FrameVelocityRows
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.mechanisms import GroundContact, Phrases
from rnc_pin.model.parameter_types import NotNegative
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

_UP = 2


@dataclass(frozen=True)
class Caster:
    """Frictionless ball on the ground z = 0: it supports the robot and moves freely in the plane.

    It models a caster whose swivel and wheel are not joints of the model, a ball transfer unit, or a skid.
    The only row, vertical, is holonomic: the frame's origin stays at height ``radius``. For a planar base, the row is
    zero and is dropped.

    Args:
        frame: a frame at the centre of the ball.
        radius: radius of the ball [m]; 0 for a point contact.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the radius is negative.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="free")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, [*wheels, rnc.Caster("nose", radius=0.1)])
        >>> print(system.r, system.assembled(robot.configuration())[2].round(3))  # it stands, and drives as on a plane
        2 0.1
    """

    frame: str
    radius: NotNegative

    def bind(self, robot: Robot) -> Rows:
        if not (np.isfinite(self.radius) and self.radius >= 0):
            raise ConstraintError(f"radius of caster '{self.frame}' has to be zero or positive, found {self.radius}")
        return _CasterRow(self, robot)


class _CasterRow(FrameVelocityRows):
    holonomic = (True,)
    on_ground = True

    def __init__(self, kind: Caster, robot: Robot) -> None:
        super().__init__(robot, kind.frame, (_UP,))
        self.names = (f"vertical({kind.frame})",)
        self._caster, self._radius = kind, kind.radius

    def residual(self, at: PositionKinematics) -> np.ndarray:
        return at.placement(self._frame).translation[..., _UP:] - self._radius

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        up = np.array([[0.0, 0.0, 1.0]])
        contact = at.placement(self._frame).translation[..., None, :] - self._radius * up
        return contact, np.broadcast_to(up, contact.shape)

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self._caster.frame, self._radius, friction="none"),)

    def phrases(self) -> Phrases:
        return Phrases()
