"""Distance between two frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.math.components import Component, components, dot
from rnc_pin.math.linear_algebra import complex_step
from rnc_pin.model.kernel_rows import Form, KernelRow, Value, attached
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import OutputRows, check_defined
from rnc_pin.robots.robot import Robot

_TOGETHER = 1e-9


@dataclass(frozen=True)
class Distance:
    """Distance between the origins of two frames [m].

    Args:
        frame_a: name of one frame.
        frame_b: name of the other.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(vertical=[rnc.Distance("platform_body", "tip")])
        >>> x1, _ = reduced.at(robot.configuration()).outputs()  # the arm is straight
        >>> x1.round(3)
        array([3.])
    """

    frame_a: str
    frame_b: str

    def bind(self, robot: Robot) -> OutputRows:
        return _DistanceRow(self, robot)


class _DistanceRow(OutputRows):
    def __init__(self, kind: Distance, robot: Robot) -> None:
        self.names = (f"distance_{kind.frame_a}_{kind.frame_b}",)
        self.units = ("m/s",)
        self.angular = (False,)
        self._a, self._b = robot.frame_id(kind.frame_a), robot.frame_id(kind.frame_b)

    def _vector(self, at: PositionKinematics) -> np.ndarray:
        return at.placement(self._b).translation - at.placement(self._a).translation

    def value(self, at: PositionKinematics) -> np.ndarray:
        return np.linalg.norm(self._vector(at), axis=-1, keepdims=True)

    def _direction(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors (..., 3) from a to b, and the distances (..., 1)."""
        vector = self._vector(at)
        length = np.linalg.norm(vector, axis=-1, keepdims=True)
        check_defined("a distance has no rate where it is zero", at, length[..., 0], _TOGETHER, self.names)
        return vector / length, length

    def _relative(self, both: Callable[[int], np.ndarray]) -> np.ndarray:
        """Linear part of a quantity of frame b relative to frame a."""
        return both(self._b)[..., :3] - both(self._a)[..., :3]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        direction, _ = self._direction(at)
        return direction[..., None, :] @ (at.jacobian(self._b) - at.jacobian(self._a))[..., :3, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        direction, length = self._direction(at)
        velocity = self._relative(at.velocity)
        direction_rate = (velocity - direction * np.vecdot(direction, velocity)[..., None]) / length
        J, J_dot = (each(self._b) - each(self._a) for each in (at.jacobian, at.jacobian_dot))
        return direction[..., None, :] @ J_dot[..., :3, :] + direction_rate[..., None, :] @ J[..., :3, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        parts = (self._vector(at), self._relative(at.velocity), self._relative(at.acceleration))
        self._direction(at)  # raises an error if the distance is zero
        return np.asarray(_distance_drift(*(components(part) for part in parts)))[..., None]

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        a, b = at.frame_gradients(self._a), at.frame_gradients(self._b)
        return complex_step(
            lambda *parts: np.array([_distance_drift(*parts)]),
            (self._vector(at), (at.jacobian(self._b) - at.jacobian(self._a))[:3]),
            (self._relative(at.velocity), b.velocity - a.velocity),
            (self._relative(at.acceleration), b.acceleration - a.acceleration),
        )

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return [KernelRow(Form.DISTANCE, (attached(model, self._a), attached(model, self._b)), value=(Value.LENGTH, 0))]


def _distance_drift(
    vector: Sequence[Component], velocity: Sequence[Component], acceleration: Sequence[Component]
) -> Component:
    """Second derivative of the length of a vector."""
    length = dot(vector, vector) ** 0.5
    rate = dot(vector, velocity) / length
    return (dot(velocity, velocity) + dot(vector, acceleration) - rate * rate) / length
