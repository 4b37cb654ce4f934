"""Distance between two frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.math.components import Entry, components, dot
from rnc_pin.math.linear_algebra import apply, complex_step
from rnc_pin.model.kernel_rows import Form, KernelRow, Value, attached
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import OutputRows, check_defined
from rnc_pin.model.wrench_rows import evaluated, rate_of
from rnc_pin.robots.robot import Robot

TOGETHER = 1e-9
"""Distance below which two frames coincide [m]."""


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


def distance_force(vector: Sequence[Entry]) -> list[list[Entry]]:
    """Force (1, 3) at the end of a vector whose power is the rate of its length: the unit vector."""
    length = dot(vector, vector) ** 0.5
    return [[each / length for each in vector]]


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

    def _force(self, at: PositionKinematics) -> np.ndarray:
        vector = components(self._vector(at))
        length = dot(vector, vector) ** 0.5
        check_defined("a distance has no rate where it is zero", at.q, length, TOGETHER, self.names)
        return evaluated(distance_force, [vector])

    def _relative(self, both: Callable[[int], np.ndarray]) -> np.ndarray:
        """Linear velocity or acceleration (..., 3) of frame b relative to frame a."""
        return both(self._b)[..., :3] - both(self._a)[..., :3]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._force(at) @ (at.jacobian(self._b) - at.jacobian(self._a))[..., :3, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        rate = rate_of(distance_force, [components(self._vector(at))], [components(self._relative(at.velocity))])
        J, J_dot = ((each(self._b) - each(self._a))[..., :3, :] for each in (at.jacobian, at.jacobian_dot))
        return np.asarray(self._force(at) @ J_dot + rate @ J)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        self._force(at)  # raises an error if the distance is zero
        return _bias(self._vector(at), self._relative(at.velocity), self._relative(at.acceleration))

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        a, b = at.frame_gradients(self._a), at.frame_gradients(self._b)
        return complex_step(
            _bias,
            (self._vector(at), (at.jacobian(self._b) - at.jacobian(self._a))[:3]),
            (self._relative(at.velocity), b.velocity - a.velocity),
            (self._relative(at.acceleration), b.acceleration - a.acceleration),
        )

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return [KernelRow(Form.DISTANCE, (attached(model, self._a), attached(model, self._b)), value=(Value.LENGTH, 0))]


def _bias(vector: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Second derivative (..., 1) of the length of a vector."""
    parts = [components(vector)], [components(velocity)]
    force, rate = evaluated(distance_force, parts[0]), rate_of(distance_force, *parts)
    return np.asarray(apply(force, acceleration) + apply(rate, velocity))
