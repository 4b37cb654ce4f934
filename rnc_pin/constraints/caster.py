"""Caster, ball transfer unit or skid without joints: it only supports the robot's weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.constraints.ground_plane import GroundPlane, on_carrier, plane_below
from rnc_pin.errors import ConstraintError
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.mechanisms import GroundContact, Phrases
from rnc_pin.model.parameter_types import NotNegative
from rnc_pin.model.rows import Rows
from rnc_pin.model.wrench_rows import ConstantWrenchRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class Caster:
    """Frictionless ball on the ground: it supports the robot and moves freely in the plane.

    It models a caster whose swivel and wheel are not joints of the model, a ball transfer unit, or a skid.
    The only row, vertical, is holonomic: the frame's origin stays at height ``radius``. For a planar base, the row is
    zero and is dropped.

    Args:
        frame: a frame at the centre of the ball.
        radius: radius of the ball [m]; 0 for a point contact.
        ground: the plane; None for z = 0. Its motion has no effect.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the radius is negative, or the ground is no plane.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="free")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, [*wheels, rnc.Caster("nose", radius=0.1)])
        >>> print(system.r, system.assembled(robot.configuration())[2].round(3))  # it stands, and drives as on a plane
        2 0.1
    """

    frame: str
    radius: NotNegative
    ground: GroundPlane | None = None

    def bind(self, robot: Robot) -> Rows:
        if not (np.isfinite(self.radius) and self.radius >= 0):
            raise ConstraintError(f"radius of caster '{self.frame}' has to be zero or positive, found {self.radius}")
        plane = plane_below(self.ground, f"caster '{self.frame}'") or GroundPlane()
        return on_carrier(_CasterRow(self, plane, robot), self.frame, self.ground, robot)


class _CasterRow(ConstantWrenchRows):
    """Velocity of the centre along the normal of the plane."""

    holonomic = (True,)
    on_ground = True
    units = ("m/s",)

    def __init__(self, kind: Caster, plane: GroundPlane, robot: Robot) -> None:
        self.names, self.frame = (f"vertical({kind.frame})",), robot.frame_id(kind.frame)
        self.ground = None if plane.is_default else plane
        self._caster, self._point, self._normal = kind, np.asarray(plane.point), plane.axes[2]
        self.matrix = np.array([[*self._normal, 0.0, 0.0, 0.0]])

    def residual(self, at: PositionKinematics) -> np.ndarray:
        height = (at.placement(self.frame).translation - self._point) @ self._normal - self._caster.radius
        return np.asarray(height[..., None])

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = at.placement(self.frame).translation[..., None, :] - self._caster.radius * self._normal
        return contact, np.broadcast_to(self._normal, contact.shape)

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self._caster.frame, self._caster.radius, friction="none"),)

    def phrases(self) -> Phrases:
        return Phrases()
