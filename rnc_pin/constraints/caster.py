"""Caster, ball transfer unit or skid without joints: it only supports the robot's weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.carried_ground import on_carrier
from rnc_pin.constraints.ground_plane import GroundPlane, plane_below
from rnc_pin.errors import ConstraintError
from rnc_pin.model.frame_velocity import FrameVelocityRows
from rnc_pin.model.kernel_rows import Form, KernelRow, attached
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import GroundContact, Phrases
from rnc_pin.model.parameter_types import NotNegative
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

_UP = 2


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
        plane = plane_below(self.ground, f"caster '{self.frame}'")
        rows = _CasterRow(self, robot) if plane is None else _CasterRowOnPlane(self, plane, robot)
        return on_carrier(rows, self.frame, self.ground, robot)


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


class _CasterRowOnPlane(_CasterRow):
    """The same along the normal of a plane."""

    def __init__(self, kind: Caster, plane: GroundPlane, robot: Robot) -> None:
        super().__init__(kind, robot)
        self.ground, self._point, self._normal = plane, np.asarray(plane.point), plane.axes[2]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return np.asarray((self._normal @ at.jacobian(self._frame)[..., :3, :])[..., None, :])

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return np.asarray((self._normal @ at.jacobian_dot(self._frame)[..., :3, :])[..., None, :])

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return np.asarray((at.acceleration(self._frame)[..., :3] @ self._normal)[..., None])

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        return np.asarray((self._normal @ at.frame_gradients(self._frame).acceleration)[None])

    def residual(self, at: PositionKinematics) -> np.ndarray:
        height = (at.placement(self._frame).translation - self._point) @ self._normal - self._radius
        return np.asarray(height[..., None])

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = at.placement(self._frame).translation[..., None, :] - self._radius * self._normal
        return contact, np.broadcast_to(self._normal, contact.shape)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return [KernelRow(Form.WORLD, (attached(model, self._frame),), (), [*self._normal.tolist(), 0.0, 0.0, 0.0])]
