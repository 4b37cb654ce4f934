"""Ball that rolls without slip on a plane or on a curved surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.constraints.body_shapes import Sphere
from rnc_pin.constraints.curved_grounds import CurvedGround
from rnc_pin.constraints.ground_plane import GroundPlane, on_carrier
from rnc_pin.constraints.rolling_body import RollingBody
from rnc_pin.errors import ConstraintError
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.mechanisms import GroundContact, Phrases
from rnc_pin.model.parameter_types import Positive
from rnc_pin.model.rows import Rows
from rnc_pin.model.wrench_rows import ConstantWrenchRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class RollingBall:
    """Ball whose contact point has the velocity of the ground: two rolling rows and a vertical row.

    The contact point is ``radius`` below the centre at any attitude. The rows are the velocity of the material point
    there along the world's x, y and z, or along the axes of the ground. The vertical row is holonomic: the centre stays
    at height ``radius``. For a planar base on level ground, it is zero and is dropped.

    Args:
        frame: a frame at the centre of the ball that turns with it.
        radius: radius of the ball [m].
        ground: a plane, or curved ground as of a ``RollingBody``; None for z = 0 at rest.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the radius is not positive, or a ground of another kind.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", radius=0.3)])
        >>> reduced = system.reduce([rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"])
        >>> q = robot.configuration({"root_joint": [0, 0, 0.3, 0, 0, 0, 1]})
        >>> reduced.at(q, [0.0, 2.0, 0.0]).v[[0, 4]].round(3)  # as it turns about y it goes along x
        array([0.6, 2. ])
    """

    frame: str
    radius: Positive
    ground: GroundPlane | CurvedGround | None = None

    def bind(self, robot: Robot) -> Rows:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ConstraintError(f"radius of ball '{self.frame}' has to be positive, found {self.radius}")
        if self.ground is None or isinstance(self.ground, GroundPlane):
            return on_carrier(
                _RollingBallRows(self, self.ground or GroundPlane(), robot), self.frame, self.ground, robot
            )
        return RollingBody(self.frame, Sphere(self.radius), ground=self.ground).bind(robot)


class _RollingBallRows(ConstantWrenchRows):
    """Velocity of the material at a constant arm from the centre, along the axes of the plane."""

    holonomic = (False, False, True)
    on_ground = True
    units = ("m/s",) * 3

    def __init__(self, kind: RollingBall, plane: GroundPlane, robot: Robot) -> None:
        self.names = tuple(f"{part}({kind.frame})" for part in ("rolling_x", "rolling_y", "vertical"))
        self._ball, self.frame = kind, robot.frame_id(kind.frame)
        self.ground = None if plane.is_default else plane
        self.twist, self.affine = plane.twist, plane.moves
        self._plane, self._axes, self._arm = plane, plane.axes, -kind.radius * plane.axes[2]
        self.matrix = np.hstack([self._axes, np.cross(self._arm, self._axes)])

    def residual(self, at: PositionKinematics) -> np.ndarray:
        height = (self._contact(at) - self._plane.point) @ self._axes[2]
        return np.asarray(height)[..., None] * [0.0, 0.0, 1.0]

    def _contact(self, at: PositionKinematics) -> np.ndarray:
        """Contact point (..., 3) in the world."""
        return np.asarray(at.placement(self.frame).translation + self._arm)

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = self._contact(at)[..., None, :]
        shape = (*contact.shape[:-2], 3, 3)
        return np.broadcast_to(contact, shape), np.broadcast_to(self._axes, shape)

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self._ball.frame, self._ball.radius),)

    def phrases(self) -> Phrases:
        return Phrases("rolling ball", prevents="slip at", where=self._ball.frame)
