"""Frame with a constant placement on another frame."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kernel_rows import AttachedFrame, attached
from rnc_pin.model.kinematics import Placement, PositionKinematics
from rnc_pin.model.parameter_types import Vector
from rnc_pin.robots.robot import Robot

_UNIT = np.eye(3)


def point_name(frame: str, point: np.ndarray) -> str:
    """Name of a point (3,) in a frame's axes: that of the frame, with the coordinates unless it is the origin."""
    return f"{frame}[{' '.join(f'{each:g}' for each in point)}]" if point.any() else frame


class OffsetFrame:
    """Frame with a constant offset and rotation relative to a parent frame.

    Args:
        robot: the robot that has the frame.
        frame: name of the parent frame.
        at: origin of the offset frame in the parent's axes (3,) [m].
        rotation: rotation of the offset frame relative to the parent (3, 3); identity by default.

    Attributes:
        name: name of the parent frame, with the point if this is not its origin.
        index: index of the parent frame in the model.
        joint: index of the joint that supports the frame.
        offset: constant placement on the parent frame.

    Raises:
        ModelError: unknown frame.
        ConfigurationError: a point that is not three finite numbers.
    """

    def __init__(self, robot: Robot, frame: str, at: Vector, rotation: np.ndarray = _UNIT) -> None:
        point = triple(at, f"point on frame '{frame}'")
        self.index = robot.frame_id(frame)
        self.joint = robot.model.frames[self.index].parentJoint
        self.name = point_name(frame, point)
        self._point, self._rotation = point, rotation
        self.offset = pin.SE3(rotation, point)

    def placement(self, at: PositionKinematics) -> Placement:
        """Placement of the offset frame in the world."""
        place = at.placement(self.index)
        return Placement(place.rotation @ self._rotation, place.translation + apply(place.rotation, self._point))

    def attached(self, model: pin.Model) -> AttachedFrame:
        """Joint and constant placement of the offset frame."""
        return attached(model, self.index, pin.SE3(self._rotation, self._point))


def triple(values: Vector, what: str) -> np.ndarray:
    """Convert a value to three finite numbers (3,); the error message names it by ``what``."""
    found = np.asarray(values, dtype=float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ConfigurationError(f"{what}: expected three finite numbers, found {values}")
    return found
