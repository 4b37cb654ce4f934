"""Outputs of one frame relative to another: distance, angle and angular velocity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.math.components import Entry, components, dot
from rnc_pin.math.linear_algebra import apply, complex_step
from rnc_pin.model.frame_rows import DirectionRows, axis_index, evaluated, rate_of
from rnc_pin.model.kernel_rows import Form, KernelRow, Value, attached, component_rows
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.relative_rows import RelativeOutputRows
from rnc_pin.model.rows import OutputRows, check_defined
from rnc_pin.outputs.frame_outputs import AngleRow
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


@dataclass(frozen=True)
class RelativeAngle:
    """Angle of a frame's own axis about an axis of another frame [rad], in (-pi, pi].

    It is measured in the plane normal to ``about``: zero along the reference's next axis (x for "z", y for "x", z for
    "y"), positive by the right-hand rule. For the world as reference and ``about="z"`` it is ``FrameYaw``.

    Args:
        frame: name of the frame.
        reference: name of the other frame, or "universe" for the world.
        axis: the frame's own axis, "x", "y" or "z".
        about: the axis of the reference, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(vertical=[rnc.RelativeAngle("tip", "platform_body")])
        >>> x1, _ = reduced.at(robot.configuration({"joint_1": 0.4, "joint_2": -1.0})).outputs()
        >>> x1.round(3)
        array([-0.6])
    """

    frame: str
    reference: str
    axis: Axis = "x"
    about: Axis = "z"

    def bind(self, robot: Robot) -> OutputRows:
        reference = robot.frame_id(self.reference)
        if reference == robot.frame_id(self.frame):
            raise ConfigurationError(f"angle of frame '{self.frame}' relative to itself: name another reference")
        name = f"{self.frame}_angle_{self.axis}_about_{self.reference}_{self.about}"
        return RelativeOutputRows(AngleRow(robot, self.frame, self.axis, name, self.about), reference)


@dataclass(frozen=True)
class RelativeAngularVelocity:
    """Angular velocity of a frame relative to another, about the first frame's own axis [rad/s].

    It is a quasi-velocity, not the rate of a coordinate: in a trajectory, ``x2`` contains its integral over time. With
    ``OutputForce`` it is the torque of a motor between two bodies, whatever joints are between them.

    Args:
        frame: name of the frame.
        reference: name of the other frame, or "universe" for the world.
        axis: the frame's own axis, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(vertical=[rnc.RelativeAngularVelocity("tip", "platform_body")])
        >>> reduced.at(robot.configuration()).J1.round(3)  # the sum of the three joint velocities
        array([[0., 1., 1., 1.]])
    """

    frame: str
    reference: str
    axis: Axis = "z"

    def bind(self, robot: Robot) -> OutputRows:
        return RelativeOutputRows(_AngularVelocityRow(self, robot), robot.frame_id(self.reference))


class _AngularVelocityRow(DirectionRows, OutputRows):
    quasi = True
    units = ("rad/s",)
    angular = (False,)

    def __init__(self, kind: RelativeAngularVelocity, robot: Robot) -> None:
        self.names = (f"{kind.frame}_angular_velocity_{kind.axis}_of_{kind.reference}",)
        self.frame, self._axis = robot.frame_id(kind.frame), axis_index(kind.axis)
        self.directions = np.eye(3)[:, [self._axis]]

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return [[0.0, 0.0, 0.0, *directions[0]]]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return component_rows(Form.OWN, attached(model, self.frame), [3 + self._axis])
