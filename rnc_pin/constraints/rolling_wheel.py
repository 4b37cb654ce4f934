"""A disk that rolls without slip on the plane z = 0, upright or leaning."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError, SingularityError
from rnc_pin.math.linear_algebra import complex_step
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import OWN_AXES, Kinematics
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

_FLAT = 1e-6  # sine of the angle between axle and vertical below which a wheel lies flat


@dataclass(frozen=True)
class RollingWheel:
    """The lowest point of a wheel is at rest on the ground: rolling, lateral and vertical rows.

    The contact is the lowest point of a disk about its axle, wherever the wheel leans. Rows are the
    velocity of the material point there: along the heading of the wheel, along the ground across it,
    and up. The last is holonomic, the lowest point stays at height zero; for a planar base it is zero and drops out.

    Args:
        frame: a frame at the centre of the wheel that turns with it.
        radius: of the wheel [m].
        axis: the axle as the frame's own axis "x", "y" or "z"; by default the axis of the joint that
            carries the frame.

    Raises:
        ModelError: no such frame.
        ConstraintError: the radius is not positive, or no axis is given and the joint has none.
        SingularityError: while evaluated, the wheel lies flat.
    """

    frame: str
    radius: float
    axis: str | None = None

    def bind(self, robot: Robot) -> Rows:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ConstraintError(f"radius of wheel '{self.frame}' has to be positive, found {self.radius}")
        return RollingRows(self, robot)


class RollingRows(Rows):
    """The rows of a wheel bound to a robot.

    Attributes:
        wheel: name of the frame; ``frame``: its index.
        radius: [m]. The rows are affine in it, so an estimator sets it on a copy of its own.
    """

    holonomic = (False, False, True)
    on_ground = True

    def __init__(self, kind: RollingWheel, robot: Robot) -> None:
        self.names = tuple(f"{part}({kind.frame})" for part in ("rolling", "lateral", "vertical"))
        self.units = ("m/s",) * 3
        self.wheel, self.frame = kind.frame, robot.frame_id(kind.frame)
        self.radius = kind.radius
        self._axle = _joint_axis(kind.frame, robot) if kind.axis is None else np.eye(3)[axis_index(kind.axis)]

    def contact(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Axle, directions (3, 3) of the rows, centre to contact, and the sine of the axle's tilt."""
        axle = state.placement(self.frame).rotation @ self._axle
        x, y, z = axle
        sine = float(np.hypot(x, y))
        if sine < _FLAT:
            raise SingularityError(
                "a wheel lies flat on the ground", q=state.q.copy(), condition=1 / max(sine, 1e-300), rows=self.names
            )
        directions = np.array([[y / sine, -x / sine, 0.0], [x / sine, y / sine, 0.0], [0.0, 0.0, 1.0]])
        arm = self.radius / sine * np.array([z * x, z * y, z * z - 1.0])
        return axle, directions, arm, sine

    def jacobian(self, state: Kinematics) -> np.ndarray:
        _, directions, arm, _ = self.contact(state)
        jacobian = state.jacobian(self.frame)
        return directions @ (jacobian[:3] - pin.skew(arm) @ jacobian[3:])

    def _contact_rates(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        axle, directions, arm, sine = self.contact(state)
        velocity = state.velocity(self.frame)
        spin = velocity.angular
        axle_dot = pin.skew(spin) @ axle
        x, y, z = axle
        dx, dy, dz = axle_dot
        sine_dot = -z * dz / sine
        heading_dot = np.array([dy, -dx, 0.0]) / sine - directions[0] * sine_dot / sine
        across_dot = np.array([dx, dy, 0.0]) / sine - directions[1] * sine_dot / sine
        directions_dot = np.array([heading_dot, across_dot, np.zeros(3)])
        arm_dot = self.radius / sine * np.array([dz * x + z * dx, dz * y + z * dy, 2 * z * dz]) - arm * (
            sine_dot / sine
        )
        return directions, directions_dot, arm, arm_dot, velocity.linear + pin.skew(spin) @ arm

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        directions, directions_dot, arm, arm_dot, _ = self._contact_rates(state)
        jacobian, jacobian_dot = state.jacobian(self.frame), state.jacobian_dot(self.frame)
        contact = jacobian[:3] - pin.skew(arm) @ jacobian[3:]
        contact_dot = jacobian_dot[:3] - pin.skew(arm) @ jacobian_dot[3:] - pin.skew(arm_dot) @ jacobian[3:]
        return directions_dot @ contact + directions @ contact_dot

    def drift(self, state: Kinematics) -> np.ndarray:
        directions, directions_dot, arm, arm_dot, slip = self._contact_rates(state)
        acceleration = state.acceleration(self.frame)
        spin = state.velocity(self.frame).angular
        contact = acceleration.linear + pin.skew(acceleration.angular) @ arm + pin.skew(spin) @ arm_dot
        return directions_dot @ slip + directions @ contact

    def lines_of_action(self, state: Kinematics) -> tuple[np.ndarray, np.ndarray]:
        _, directions, arm, _ = self.contact(state)
        return np.tile(state.placement(self.frame).translation + arm, (3, 1)), directions

    def residual(self, state: Kinematics) -> np.ndarray:
        _, _, arm, _ = self.contact(state)
        return np.array([0.0, 0.0, state.placement(self.frame).translation[2] + arm[2]])

    def drift_gradient(self, state: Kinematics) -> np.ndarray:
        axle = state.placement(self.frame).rotation @ self._axle
        motion, velocity, acceleration = (
            state.frame_gradients(self.frame),
            state.velocity(self.frame),
            state.acceleration(self.frame),
        )
        return complex_step(
            partial(_contact_drift, self.radius),
            (axle, -pin.skew(axle) @ state.jacobian(self.frame)[3:]),
            (velocity.linear, motion.velocity),
            (velocity.angular, motion.spin),
            (acceleration.linear, motion.acceleration),
            (acceleration.angular, motion.angular_acceleration),
        )


def _contact_drift(
    radius: float,
    axle: np.ndarray,
    velocity: np.ndarray,
    spin: np.ndarray,
    acceleration: np.ndarray,
    angular_acceleration: np.ndarray,
) -> np.ndarray:
    """What ``drift`` gives, as one formula of the wheel's motion."""
    up = np.array([0.0, 0.0, 1.0])
    axle_rate = np.cross(spin, axle)
    z, z_rate = axle[2], axle_rate[2]
    sine = np.sqrt(1 - z * z)
    sine_rate = -z * z_rate / sine
    heading, across = np.cross(axle, up) / sine, (axle - z * up) / sine
    heading_rate = (np.cross(axle_rate, up) - sine_rate * heading) / sine
    across_rate = (axle_rate - z_rate * up - sine_rate * across) / sine
    arm = radius * (z * across - sine * up)
    arm_rate = radius * (z_rate * across + z * across_rate - sine_rate * up)
    slip = velocity + np.cross(spin, arm)
    slip_rate = acceleration + np.cross(angular_acceleration, arm) + np.cross(spin, arm_rate)
    return np.array(
        [heading.dot(slip_rate) + heading_rate.dot(slip), across.dot(slip_rate) + across_rate.dot(slip), slip_rate[2]]
    )


def _joint_axis(name: str, robot: Robot) -> np.ndarray:
    """Axis of the revolute joint that carries a frame, in the frame's own axes."""
    frame = robot.model.frames[robot.frame_id(name)]
    joint = robot.model.joints[frame.parentJoint]
    if joint.nv != 1:
        raise ConstraintError(
            f"wheel '{name}' hangs on joint '{robot.model.names[frame.parentJoint]}', which has no single axis: "
            "give the axle with axis='x', 'y' or 'z'"
        )
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, robot.configuration())
    axis = pin.getFrameJacobian(robot.model, data, robot.frame_id(name), OWN_AXES)[3:, joint.idx_v]
    if np.linalg.norm(axis) < 0.5:
        raise ConstraintError(f"wheel '{name}' hangs on a joint that does not turn: give the axle with axis=...")
    return axis
