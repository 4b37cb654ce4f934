"""Kinematics of one state: frames are read from Pinocchio's workspace."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kinematics.quantities import (
    ALL,
    OWN_AXES,
    WORLD_AXES,
    Components,
    Placement,
    PositionKinematics,
    RateKinematics,
    VelocityKinematics,
)
from rnc_pin.model.kinematics.workspace import Workspace

_WORLD = pin.Convention.WORLD


class SinglePositionKinematics(PositionKinematics):
    """Kinematics at one configuration.

    Args:
        workspace: Pinocchio's model and data.
        q: (nq,).
    """

    def __init__(self, workspace: Workspace, q: np.ndarray) -> None:
        at = self._at = workspace
        self.q = q
        # In the world convention, CRBA also computes placements and joint Jacobians.
        self.M = pin.crba(at.model, at.data, q, _WORLD)
        self.M.setflags(write=False)
        at.position_is_current(q)

    def placement(self, frame: int) -> Placement:
        at = self._at
        at.update_position(self.q)
        place = pin.updateFramePlacement(at.model, at.data, frame)
        return Placement(place.rotation, place.translation)

    def rotation(self, frame: int) -> np.ndarray:
        at = self._at
        if at.q is not self.q:
            at.update_position(self.q)
        return pin.updateFramePlacement(at.model, at.data, frame).rotation

    def joint_placement(self, joint: int) -> Placement:
        self._at.update_position(self.q)
        place = self._at.places[joint]
        return Placement(place.rotation.copy(), place.translation.copy())

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        at = self._at
        if at.q is not self.q:
            at.update_position(self.q)
        jacobian = pin.getFrameJacobian(at.model, at.data, frame, axes)
        if at.nv == 1:
            jacobian = at.by_columns(jacobian)
        return jacobian if rows is ALL else jacobian[rows]

    def with_velocity(self, v: np.ndarray) -> VelocityKinematics:
        return SingleVelocityKinematics(self, v)


class SingleVelocityKinematics(SinglePositionKinematics, VelocityKinematics):
    """Kinematics at one configuration and velocity.

    Args:
        position: the configuration.
        v: (nv,).
    """

    def __init__(self, position: SinglePositionKinematics, v: np.ndarray) -> None:
        at = self._at = position._at
        self.q, self.M, self.v = position.q, position.M, v
        self.bias = pin.nonLinearEffects(at.model, at.data, self.q, v)
        self.bias.setflags(write=False)
        at.v = None  # nonLinearEffects overwrites the velocities

    def velocity(self, frame: int) -> np.ndarray:
        at = self._at
        if at.v is not self.v or at.q is not self.q:
            at.update_velocity(self.q, self.v)
        return pin.getFrameVelocity(at.model, at.data, frame, WORLD_AXES).vector

    def joint_velocity(self, joint: int) -> np.ndarray:
        self._at.update_velocity(self.q, self.v)
        return self._at.data.v[joint].vector.copy()

    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        at = self._at
        if at.v is not self.v or at.q is not self.q:
            at.update_velocity(self.q, self.v)
        getter = pin.getFrameClassicalAcceleration if axes == WORLD_AXES else pin.getFrameAcceleration
        acceleration: np.ndarray = getter(at.model, at.data, frame, axes).vector
        return acceleration if rows is ALL else acceleration[rows]

    def rates(self) -> RateKinematics:
        return SingleRateKinematics(self)


class SingleRateKinematics(SingleVelocityKinematics, RateKinematics):
    """Kinematics of one state with rates along v.

    Args:
        motion: the state.
    """

    def __init__(self, motion: SingleVelocityKinematics) -> None:
        self._at = motion._at
        self.q, self.M, self.v, self.bias = motion.q, motion.M, motion.v, motion.bias

    @cached_property
    def C(self) -> np.ndarray:
        return self._at.coriolis(self.q, self.v)

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        at = self._at
        at.update_rates(self.q, self.v)
        return at.by_columns(pin.getFrameJacobianTimeVariation(at.model, at.data, frame, axes))


class FrameDerivatives(NamedTuple):
    """Derivatives of a frame's motion, in world axes, along the tangent space at q, (3, nv) each."""

    velocity: np.ndarray
    spin: np.ndarray
    acceleration: np.ndarray
    angular_acceleration: np.ndarray


class KinematicDerivatives(SingleRateKinematics):
    """Derivatives of velocities and accelerations of one state with respect to q, at fixed v and zero ``vdot``.

    Args:
        motion: the state.
    """

    def own_acceleration_gradient(self, frame: int) -> np.ndarray:
        """Derivative of the frame's acceleration in its own axes, (6, nv)."""
        at = self._at
        at.update_derivatives(self.q, self.v)
        return at.by_columns(pin.getFrameAccelerationDerivatives(at.model, at.data, frame, OWN_AXES)[1])

    def frame_gradients(self, frame: int) -> FrameDerivatives:
        """Derivatives of ``velocity`` and ``acceleration`` in world axes.

        Pinocchio differentiates components along the frame's own axes. The rotation to world axes adds a term, because
        the frame's rotation depends on q.
        """
        at = self._at
        at.update_derivatives(self.q, self.v)
        model, data = at.model, at.data
        turn = self.placement(frame).rotation
        twist = self.jacobian(frame, OWN_AXES)[3:]  # own rotation for unit motions of the coordinates
        v = pin.getFrameVelocity(model, data, frame, OWN_AXES)
        a = pin.getFrameAcceleration(model, data, frame, OWN_AXES)
        found = pin.getFrameAccelerationDerivatives(model, data, frame, OWN_AXES)[:2]
        v_q, a_q = (at.by_columns(each) for each in found)
        # Classical acceleration of the origin: spatial acceleration plus angular velocity x linear velocity.
        point = a.linear + np.cross(v.angular, v.linear)
        point_q = a_q[:3] - pin.skew(v.linear) @ v_q[3:] + pin.skew(v.angular) @ v_q[:3]

        def world(vector: np.ndarray, gradient: np.ndarray) -> np.ndarray:
            return turn @ (gradient - pin.skew(vector) @ twist)

        return FrameDerivatives(
            world(v.linear, v_q[:3]), world(v.angular, v_q[3:]), world(point, point_q), world(a.angular, a_q[3:])
        )
