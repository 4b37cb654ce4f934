"""How far a frame's own axis points up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import SingularityError
from rnc_pin.math.linear_algebra import complex_step
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.outputs.spin_form import SpinFormRow
from rnc_pin.robots.robot import Robot

_VERTICAL = 1e-6


@dataclass(frozen=True)
class FrameTilt:
    """Angle of a frame's own axis above the horizon [rad], in (-pi/2, pi/2): the lean of a wheel by its axle.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".

    Raises:
        SingularityError: while evaluated, the axis is vertical: a tilt has no rate there.
    """

    frame: str
    axis: str = "y"

    def bind(self, robot: Robot) -> OutputRows:
        return _TiltRow(self, robot)


class _TiltRow(SpinFormRow):
    def __init__(self, kind: FrameTilt, robot: Robot) -> None:
        self.names = (f"{kind.frame}_tilt_{kind.axis}",)
        self.units = ("rad/s",)
        self.angular = (False,)
        self._frame, self._axis = robot.frame_id(kind.frame), axis_index(kind.axis)

    def _direction(self, state: Kinematics) -> tuple[np.ndarray, float]:
        """The axis in the world, and the length of its horizontal part."""
        axis = state.placement(self._frame).rotation[:, self._axis]
        level = float(np.hypot(axis[0], axis[1]))
        if level < _VERTICAL:
            raise SingularityError(
                "the tilt of a vertical axis has no rate",
                q=state.q.copy(),
                condition=1 / max(level, 1e-300),
                rows=self.names,
            )
        return axis, level

    def value(self, state: Kinematics) -> np.ndarray:
        x, y, z = state.placement(self._frame).rotation[:, self._axis]
        return np.array([np.arctan2(z, np.hypot(x, y))])

    def jacobian(self, state: Kinematics) -> np.ndarray:
        (x, y, _), level = self._direction(state)
        # Spin about the horizontal line across the axis: rate = (spin x axis)_z / level.
        spin = state.jacobian(self._frame)[3:5]
        return ((y * spin[0] - x * spin[1]) / level)[None]

    def _form_rate(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray]:
        axis, level = self._direction(state)
        x, y, z = axis
        dx, dy, dz = pin.skew(state.velocity(self._frame).angular) @ axis
        form = np.array([y, -x, 0.0]) / level
        return form, np.array([dy, -dx, 0.0]) / level + form * (z * dz / level**2)

    def drift_gradient(self, state: Kinematics) -> np.ndarray:
        axis, motion = self._direction(state)[0], state.frame_gradients(self._frame)
        return complex_step(
            _tilt_drift,
            (axis, -pin.skew(axis) @ state.jacobian(self._frame)[3:]),
            (state.velocity(self._frame).angular, motion.spin),
            (state.acceleration(self._frame).angular, motion.angular_acceleration),
        )


def _tilt_drift(axis: np.ndarray, spin: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Second derivative of ``asin(z)`` of an axis that turns with ``spin``."""
    first = np.cross(spin, axis)
    second = np.cross(acceleration, axis) + np.cross(spin, first)
    level = np.sqrt(1 - axis[2] ** 2)
    return np.array([second[2] / level + axis[2] * first[2] ** 2 / level**3])
