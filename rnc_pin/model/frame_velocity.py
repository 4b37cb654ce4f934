"""Rows of a frame's velocity components, shared by knife edges, positions, speeds, angular velocities and forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, component_rows
from rnc_pin.model.kinematics import (
    OWN_AXES,
    WORLD_AXES,
    PositionKinematics,
    VelocityKinematics,
)
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

AXES = {"x": 0, "y": 1, "z": 2}


def axis_index(axis: str) -> int:
    """Index 0, 1 or 2 of the axis "x", "y" or "z"."""
    if axis not in AXES:
        raise ConfigurationError(f"axis '{axis}' is not known{nearest(str(axis), AXES)}")
    return AXES[axis]


class FrameVelocityRows(Rows):
    """Rows of a frame's Jacobian, in world axes or in the frame's own axes.

    Args:
        robot: the robot that has the frame.
        frame: name of the frame.
        rows: indices among the six rows (linear x, y, z, angular x, y, z).
        axes: axes of the components.
    """

    def __init__(self, robot: Robot, frame: str, rows: Sequence[int], axes: pin.ReferenceFrame = WORLD_AXES) -> None:
        self._frame, self._axes = robot.frame_id(frame), axes
        self.units = tuple("m/s" if row < 3 else "rad/s" for row in rows)
        chosen = list(rows)
        following = chosen == list(range(chosen[0], chosen[0] + len(chosen)))
        # A slice is a view, not a copy, on the hot path.
        self._rows: slice | list[int] = slice(chosen[0], chosen[-1] + 1) if following else chosen

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return at.jacobian(self._frame, self._axes, self._rows)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return at.jacobian_dot(self._frame, self._axes)[..., self._rows, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return at.acceleration(self._frame, self._axes, self._rows)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        if self._axes == OWN_AXES:
            return at.own_acceleration_gradient(self._frame)[self._rows]
        motion = at.frame_gradients(self._frame)
        return np.vstack([motion.acceleration, motion.angular_acceleration])[self._rows]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        form = Form.OWN if self._axes == OWN_AXES else Form.WORLD
        components = np.arange(6)[self._rows].tolist()
        return component_rows(form, attached(model, self._frame), components)
