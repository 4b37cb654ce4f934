"""Knife edge: zero velocity along one of a frame's own axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.carried_ground import on_carrier
from rnc_pin.constraints.ground_plane import GroundPlane, plane_below
from rnc_pin.math.linear_algebra import complex_step
from rnc_pin.model.frame_velocity import FrameVelocityRows, axis_index
from rnc_pin.model.kernel_rows import Form, KernelRow, component_rows, on_moving_ground, plane_motion
from rnc_pin.model.kinematics import (
    OWN_AXES,
    PositionKinematics,
    VelocityKinematics,
)
from rnc_pin.model.mechanisms import GroundContact, Phrases
from rnc_pin.model.offset_frame import OffsetFrame
from rnc_pin.model.parameter_types import Axis, Vector
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class NoSideSlip:
    """Zero velocity of a point of a frame along the frame's own axis, e.g. of a skate or an axle without slip.

    On ground that moves, it is the velocity relative to the material of the ground.

    The row is nonholonomic on a body that can turn. The point is the frame's origin, or a point with an offset, e.g.
    the middle of an axle at which the robot has no frame, or the point about which a skid-steered base turns.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".
        at: the point, in the frame's own axes [m].
        ground: the plane; None for ground at rest. Only its motion has an effect.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the ground is no plane.
        ConfigurationError: unknown axis, or a point that is not three finite numbers.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh", at=(0.5, 0, 0))])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> reduced.at(robot.configuration()).A.round(3)
        array([[0. , 1. , 0.5]])
    """

    frame: str
    axis: Axis = "y"
    at: Vector = (0.0, 0.0, 0.0)
    ground: GroundPlane | None = None

    def bind(self, robot: Robot) -> Rows:
        point = OffsetFrame(robot, self.frame, self.at)
        plane = plane_below(self.ground, f"knife edge '{self.frame}'")
        if plane is not None and plane.moves:
            rows: Rows = _RowOnMovingPlane(self, robot, point, plane)
        else:
            rows = (_NoSideSlipRow if point.name == self.frame else _OffsetRow)(self, robot, point)
        return on_carrier(rows, self.frame, self.ground, robot)


class _NoSideSlipRow(FrameVelocityRows):
    def __init__(self, kind: NoSideSlip, robot: Robot, point: OffsetFrame) -> None:
        self._edge, self._axis, self._point = kind, axis_index(kind.axis), point
        super().__init__(robot, kind.frame, (self._axis,), OWN_AXES)
        self.names = (f"no_side_slip({point.name}.{kind.axis})",)

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        placement = self._point.placement(at)
        return placement.translation[..., None, :].copy(), placement.rotation[..., :, self._axis][..., None, :].copy()

    def mechanisms(self) -> tuple[GroundContact]:
        center = np.asarray(self._edge.at, dtype=float)
        return (GroundContact(self._edge.frame, None, np.eye(3)[self._axis], center, "lateral"),)

    def phrases(self) -> Phrases:
        return Phrases("knife edge", prevents="slide sideways at", where=self._edge.frame)


class _OffsetRow(_NoSideSlipRow):
    """The same row at a point with an offset; it may depend on all six components of the frame's velocity."""

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._point.jacobian(at)[..., self._rows, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._point.jacobian_dot(at)[..., self._rows, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return self._point.acceleration(at)[..., self._rows]

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        return self._point.acceleration_gradient(at)[self._rows]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        return component_rows(Form.OWN, self._point.attached(model), [self._axis])


class _RowOnMovingPlane(_OffsetRow):
    """The same row less the velocity of the material ``e . u(p)``, along the axis e at the point p."""

    affine = True

    def __init__(self, kind: NoSideSlip, robot: Robot, point: OffsetFrame, plane: GroundPlane) -> None:
        super().__init__(kind, robot, point)
        self.ground = self._plane = plane

    def rate(self, at: PositionKinematics) -> np.ndarray:
        place = self._point.placement(at)
        along = place.rotation[..., :, self._axis]
        return np.asarray((along * self._plane.material_velocity(place.translation)).sum(axis=-1, keepdims=True))

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        place, parent, velocity = self._point.placement(at), at.placement(self._frame), at.velocity(self._frame)
        moved = velocity[..., :3] + np.cross(velocity[..., 3:], place.translation - parent.translation)
        return self._rate_dot(place.rotation[..., :, self._axis], place.translation, velocity[..., 3:], moved)

    def _rate_dot(self, along: np.ndarray, place: np.ndarray, w: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Rate (..., 1), with the angular velocity w and the velocity v of the point."""
        turned = np.cross(w, along) * self._plane.material_velocity(place)
        moved = along * np.cross(self._plane.angular_velocity, v)
        return np.asarray((turned + moved).sum(axis=-1, keepdims=True))

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return super().bias_acceleration(at) - self.rate_dot(at)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        motion = self._point.motion_gradients(at)
        (v, v_q), along = motion.velocity, motion.rotation[:, self._axis]
        rate = complex_step(
            self._rate_dot,
            (along, -pin.skew(along) @ motion.jacobian[3:]),
            (motion.translation, motion.jacobian[:3]),
            (v[3:], v_q[3:]),
            (v[:3], v_q[:3]),
        )
        return super().bias_acceleration_gradient(at) - rate

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        plane = self._plane
        motion = plane_motion(np.asarray(plane.velocity), plane.spin, plane.axes[2], np.asarray(plane.point))
        frame = self._point.attached(model)
        return on_moving_ground(component_rows(Form.OWN, frame, [self._axis]), motion)
