"""The heading of a frame in the world."""

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
class FrameYaw:
    """Angle in the world's x-y plane of a frame's own axis [rad], in (-pi, pi].

    Exact in three dimensions too, wherever the axis is not vertical.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z": the axle of a wheel that turns with its frame.
    """

    frame: str
    axis: str = "x"

    def bind(self, robot: Robot) -> OutputRows:
        return _YawRow(self, robot)


class _YawRow(SpinFormRow):
    def __init__(self, kind: FrameYaw, robot: Robot) -> None:
        self.names = (f"{kind.frame}_yaw" + ("" if kind.axis == "x" else f"_{kind.axis}"),)
        self.units = ("rad/s",)
        self.angular = (True,)
        self._frame, self._axis = robot.frame_id(kind.frame), axis_index(kind.axis)

    def value(self, state: Kinematics) -> np.ndarray:
        x, y, _ = state.placement(self._frame).rotation[:, self._axis]
        return np.array([np.arctan2(y, x)])

    def _form(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray, float]:
        """The heading, the covector c with ``yaw' = c . spin``, and the squared horizontal length."""
        heading = state.placement(self._frame).rotation[:, self._axis]
        x, y, z = heading
        square = float(x * x + y * y)
        if square < _VERTICAL**2:
            raise SingularityError(
                "a yaw is not defined for a vertical axis",
                q=state.q.copy(),
                condition=1 / max(square, 1e-300),
                rows=self.names,
            )
        return heading, np.array([-z * x / square, -z * y / square, 1.0]), square

    def jacobian(self, state: Kinematics) -> np.ndarray:
        _, form, _ = self._form(state)
        return (form @ state.jacobian(self._frame)[3:])[None]

    def _form_rate(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray]:
        heading, form, square = self._form(state)
        x, y, z = heading
        dx, dy, dz = pin.skew(state.velocity(self._frame).angular) @ heading
        square_dot = 2 * (x * dx + y * dy)
        rate = np.array([-dz * x - z * dx, -dz * y - z * dy, 0.0]) / square
        rate[:2] -= form[:2] * square_dot / square
        return form, rate

    def drift_gradient(self, state: Kinematics) -> np.ndarray:
        heading, motion = state.placement(self._frame).rotation[:, self._axis], state.frame_gradients(self._frame)
        spin, acceleration = state.velocity(self._frame).angular, state.acceleration(self._frame).angular
        heading_q = -pin.skew(heading) @ state.jacobian(self._frame)[3:]
        return complex_step(
            _yaw_drift, (heading, heading_q), (spin, motion.spin), (acceleration, motion.angular_acceleration)
        )


def _yaw_drift(heading: np.ndarray, spin: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Second derivative of ``atan2(y, x)`` of a heading that turns with ``spin``."""
    first = np.cross(spin, heading)
    second = np.cross(acceleration, heading) + np.cross(spin, first)
    x, y, _ = heading
    square, twice = x * x + y * y, 2 * (x * first[0] + y * first[1])
    area, area_rate = x * first[1] - y * first[0], x * second[1] - y * second[0]
    return np.array([area_rate / square - area * twice / square**2])
