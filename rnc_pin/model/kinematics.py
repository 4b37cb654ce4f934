"""One model, one data: what Pinocchio computes at a state, for the rows of constraints and outputs to read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.robots.robot import Robot

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
OWN_AXES = pin.ReferenceFrame.LOCAL


class FrameGradients(NamedTuple):
    """Derivatives of a frame's motion, in world axes, along the tangent space at q, (3, nv) each."""

    velocity: np.ndarray
    spin: np.ndarray
    acceleration: np.ndarray
    angular_acceleration: np.ndarray


class Kinematics:
    """The state at which rows are evaluated, and Pinocchio's workspace at that state.

    ``set_position`` gives frame placements and Jacobians and the inertia matrix ``M``; ``set_velocity``
    placements, velocities, accelerations at zero ``vdot`` and ``bias``, the nonlinear effects;
    ``set_rates`` all of these, time variations of Jacobians and the Coriolis matrix ``C``; ``set_gradients`` also the
    derivatives of velocities and accelerations with respect to q.
    """

    __slots__ = ("C", "M", "_zero", "bias", "data", "model", "q", "v")

    def __init__(self, robot: Robot) -> None:
        self.model = robot.model
        self.data = robot.model.createData()
        self._zero = np.zeros(robot.nv)
        self.q = pin.neutral(robot.model)
        self.v = self._zero
        self.M = self.C = np.zeros((robot.nv, robot.nv))  # (nv, nv)
        self.bias = self._zero  # (nv,)

    def set_position(self, q: np.ndarray) -> None:
        self.q = q
        pin.computeJointJacobians(self.model, self.data, q)
        self.M = pin.crba(self.model, self.data, q)

    def set_velocity(self, q: np.ndarray, v: np.ndarray) -> None:
        self.q, self.v = q, v
        pin.forwardKinematics(self.model, self.data, q, v, self._zero)
        self.bias = pin.nonLinearEffects(self.model, self.data, q, v)

    def set_rates(self, q: np.ndarray, v: np.ndarray) -> None:
        self.set_position(q)
        self.set_velocity(q, v)
        pin.computeJointJacobiansTimeVariation(self.model, self.data, q, v)
        self.C = pin.computeCoriolisMatrix(self.model, self.data, q, v)

    def set_gradients(self, q: np.ndarray, v: np.ndarray) -> None:
        """Prepare ``frame_gradients`` at (q, v) and zero ``vdot``."""
        self.set_rates(q, v)
        pin.computeForwardKinematicsDerivatives(self.model, self.data, q, v, self._zero)

    def own_acceleration_gradient(self, frame: int) -> np.ndarray:
        """Derivative of ``own_acceleration`` with respect to q, (6, nv). Needs ``set_gradients``."""
        return pin.getFrameAccelerationDerivatives(self.model, self.data, frame, OWN_AXES)[1]

    def frame_gradients(self, frame: int) -> FrameGradients:
        """Derivatives with respect to q, v fixed, of what ``velocity`` and ``acceleration`` give.

        Needs ``set_gradients``. Pinocchio differentiates components along the frame's own axes; turning
        those into world axes adds the frame's own rotation.
        """
        turn = self.placement(frame).rotation
        twist = self.jacobian(frame, OWN_AXES)[3:]  # own rotation for unit motions of the coordinates
        v = pin.getFrameVelocity(self.model, self.data, frame, OWN_AXES)
        a = pin.getFrameAcceleration(self.model, self.data, frame, OWN_AXES)
        v_q, a_q = pin.getFrameAccelerationDerivatives(self.model, self.data, frame, OWN_AXES)[:2]
        # The acceleration of the origin as a point is that of the frame plus spin x velocity.
        point = a.linear + np.cross(v.angular, v.linear)
        point_q = a_q[:3] - pin.skew(v.linear) @ v_q[3:] + pin.skew(v.angular) @ v_q[:3]

        def world(vector: np.ndarray, gradient: np.ndarray) -> np.ndarray:
            return turn @ (gradient - pin.skew(vector) @ twist)

        return FrameGradients(
            world(v.linear, v_q[:3]), world(v.angular, v_q[3:]), world(point, point_q), world(a.angular, a_q[3:])
        )

    def placement(self, frame: int) -> pin.SE3:
        """Placement of a frame in the world."""
        return pin.updateFramePlacement(self.model, self.data, frame)

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        """Frame Jacobian (6, nv): linear rows first, about the frame's origin."""
        return pin.getFrameJacobian(self.model, self.data, frame, axes)

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        """Time derivative of ``jacobian``, (6, nv)."""
        return pin.getFrameJacobianTimeVariation(self.model, self.data, frame, axes)

    def velocity(self, frame: int) -> pin.Motion:
        """Velocity of a frame's origin and its angular velocity, in world axes."""
        return pin.getFrameVelocity(self.model, self.data, frame, WORLD_AXES)

    def acceleration(self, frame: int) -> pin.Motion:
        """Acceleration of a frame's origin (that of a point) at zero ``vdot``, in world axes."""
        return pin.getFrameClassicalAcceleration(self.model, self.data, frame, WORLD_AXES)

    def own_acceleration(self, frame: int) -> pin.Motion:
        """Rate of the frame's velocity components along its own axes, at zero ``vdot``."""
        return pin.getFrameAcceleration(self.model, self.data, frame, OWN_AXES)
