"""Kinematic loops: two frames, or two points, that coincide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, ConstraintError, nearest
from rnc_pin.math.components import components, packed
from rnc_pin.math.linear_algebra import apply, complex_step
from rnc_pin.model.kernel_rows import Form, KernelRow
from rnc_pin.model.kinematics import Placement, PositionKinematics, VelocityKinematics, over_states
from rnc_pin.model.mechanisms import FrameAnchor, Phrases
from rnc_pin.model.offset_frame import OffsetFrame, triple
from rnc_pin.model.parameter_types import Vector
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

_KINDS = ("frame", "point")
_PARTS = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class LoopClosure:
    """Two frames coincide ("frame", six rows), or their origins do ("point", three rows). All rows are holonomic.

    Offsets and a rotation may be given relative to the frames, if the robot has no frames at the joined points.

    The rows are the motion of frame b relative to frame a, in the axes of a: first linear, then angular. Rows that a
    loop makes dependent are dropped: a planar loop keeps two of three rows, or three of six. The dropped rows have to
    be satisfied too, so a loop that cannot close raises an error.

    The rows are those of Pinocchio's ``FrameAnchorConstraintModel`` and ``PointAnchorConstraintModel``. Unlike those,
    they have rates.

    Args:
        frame_a: name of a frame, or ``"universe"`` for the world.
        frame_b: name of the frame that coincides with it.
        kind: "frame" or "point".
        offset_a: the joined point in the axes of frame a [m].
        offset_b: the joined point in the axes of frame b [m].
        rpy: orientation of frame b relative to frame a in the closed loop: roll, pitch and yaw as in a URDF [rad]. Only
            for kind "frame".

    Raises:
        ModelError: unknown frame.
        ConfigurationError: unknown kind, an offset or orientation that is not three finite numbers, or an orientation
            for kind "point".
        ConstraintError: both frames are on one body.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> handle = rnc.LoopClosure("platform_body", "tip", kind="point")  # the hand holds on to the platform
        >>> system = rnc.NonholonomicSystem(robot, [handle], ["joint_1"])
        >>> system.m, [row.reason for row in system.dropped_rows]
        (2, ['zero at every configuration'])
    """

    frame_a: str
    frame_b: str
    kind: Literal["frame", "point"] = "frame"
    offset_a: Vector = (0.0, 0.0, 0.0)
    offset_b: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    def bind(self, robot: Robot) -> Rows:
        if self.kind not in _KINDS:
            raise ConfigurationError(
                f"kind of loop closure '{self.kind}' is not known{nearest(str(self.kind), _KINDS)}"
            )
        between = f"'{self.frame_a}' and '{self.frame_b}'"
        turned = triple(self.rpy, f"rpy of the loop of {between}")
        if self.kind == "point" and turned.any():
            raise ConfigurationError(f"loop of {between} with kind 'point' has no orientation: omit rpy")
        a = OffsetFrame(robot, self.frame_a, self.offset_a)
        b = OffsetFrame(robot, self.frame_b, self.offset_b, pin.rpy.rpyToMatrix(turned).T)
        if a.joint == b.joint:
            raise ConstraintError(f"frames {between} are on one body: there is no loop")
        return _ClosureRows((self.frame_a, self.frame_b), a, b, self.kind == "point")


class _ClosureRows(Rows):
    """Rows of the relative twist ``W = X J_b - J_a`` of frame b relative to a, in the axes of a.

    X is the action matrix of the placement of b in a. The origin of b, at p in a, has the relative velocity
    ``W_linear + W_angular x p``. Frames a and b include the offsets and the rotation, so that they coincide in the
    closed loop.
    """

    def __init__(self, frames: tuple[str, str], a: OffsetFrame, b: OffsetFrame, point: bool) -> None:
        self._frames, self._a, self._b, self._point = frames, a, b, point
        size = 3 if point else 6
        self.names = tuple(f"closure_{part}({a.name}, {b.name})" for part in _PARTS[:size])
        self.units = ("m/s",) * 3 + ("rad/s",) * (size - 3)
        self.holonomic = (True,) * size

    def _relative(self, at: PositionKinematics) -> Placement:
        """Placement of frame b in frame a."""
        a, b = self._a.placement(at), self._b.placement(at)
        back = a.rotation.mT
        return Placement(back @ b.rotation, apply(back, b.translation - a.translation))

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        relative = self._relative(at)
        return self._selected(relative.translation, self._twists(at, relative))

    def _twists(self, at: PositionKinematics, relative: Placement) -> np.ndarray:
        return _action(relative) @ self._b.jacobian(at) - self._a.jacobian(at)

    def _selected(self, p: np.ndarray, W: np.ndarray) -> np.ndarray:
        return W[..., :3, :] - _skew(p) @ W[..., 3:, :] if self._point else W

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        relative = self._relative(at)
        W = self._twists(at, relative)
        twist = apply(W, at.v)
        X_J = _action(relative) @ self._b.jacobian(at)
        X_J_dot = _action(relative) @ self._b.jacobian_dot(at)
        W_dot = _motion_cross(twist) @ X_J + X_J_dot - self._a.jacobian_dot(at)
        if not self._point:
            return W_dot
        p = relative.translation
        return self._selected(p, W_dot) - _skew(self._point_rate(twist, p)) @ W[..., 3:, :]

    def _point_rate(self, twist: np.ndarray, p: np.ndarray) -> np.ndarray:
        return twist[..., :3] + apply(_skew(twist[..., 3:]), p)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        relative = self._relative(at)
        X, p = _action(relative), relative.translation
        X_v = apply(X @ self._b.jacobian(at), at.v)
        twist = X_v - apply(self._a.jacobian(at), at.v)
        W_dot = apply(_motion_cross(twist), X_v) + apply(X, self._b.acceleration(at))
        W_dot = W_dot - self._a.acceleration(at)
        if not self._point:
            return W_dot
        moved = apply(_skew(twist[..., 3:]), self._point_rate(twist, p))
        return W_dot[..., :3] + apply(_skew(W_dot[..., 3:]), p) + moved

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        a, b = self._a.motion_gradients(at), self._b.motion_gradients(at)
        motions = a.velocity, a.acceleration, b.velocity, b.acceleration
        apart = b.translation - a.translation, (b.jacobian - a.jacobian)[:3]

        def in_world(*parts: np.ndarray) -> np.ndarray:
            return _relative_acceleration(self._point, *parts)

        value = in_world(apart[0], *(value for value, _ in motions))
        gradient = complex_step(in_world, apart, *motions)
        # The components are along the axes of a, which turn too.
        turn, spin = a.rotation.T, a.jacobian[3:]
        blocks = [
            turn @ (gradient[k : k + 3] + pin.skew(value[k : k + 3]) @ spin) for k in range(0, len(self.names), 3)
        ]
        return np.vstack(blocks)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        relative = self._relative(at)
        if self._point:
            return relative.translation
        flat = relative.rotation.reshape(*at.q.shape[:-1], 9)
        return over_states(_log6, (6,), flat, relative.translation)

    def mechanisms(self) -> tuple[FrameAnchor]:
        return (FrameAnchor(self._frames, (self._a.offset, self._b.offset), self._point),)

    def phrases(self) -> Phrases:
        return Phrases(robot="a mechanism with closed loops", prevents="open its loops")

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        form, frames = Form.POINT if self._point else Form.CLOSURE, (self._a.attached(model), self._b.attached(model))
        return [KernelRow(form, frames, (k,)) for k in range(len(self.names))]


def _relative_acceleration(
    point: bool,
    apart: np.ndarray,
    velocity_a: np.ndarray,
    acceleration_a: np.ndarray,
    velocity_b: np.ndarray,
    acceleration_b: np.ndarray,
) -> np.ndarray:
    """Rate (6,) of the motion of b relative to a, seen in the axes of a, in world axes.

    Args:
        point: True for the relative motion at the origin of b, False for that at the origin of a.
        apart: origin of b relative to that of a.
        velocity_a, acceleration_a, velocity_b, acceleration_b: motions of both frames at their origins, (6,).
    """
    first, second = velocity_b - velocity_a, acceleration_b - acceleration_a
    turning, angular = (velocity_a, acceleration_a) if point else (velocity_b, acceleration_b)
    slip = first[:3] - np.cross(turning[3:], apart)
    slip_rate = second[:3] - np.cross(angular[3:], apart) - np.cross(turning[3:], first[:3])
    linear = slip_rate - np.cross(velocity_a[3:], slip)
    return np.concatenate([linear, second[3:] - np.cross(velocity_a[3:], first[3:])])


def _log6(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    logarithm: np.ndarray = pin.log6(pin.SE3(rotation.reshape(3, 3), translation)).vector
    return logarithm


def _skew(vectors: np.ndarray) -> np.ndarray:
    """Skew-symmetric matrices (..., 3, 3) of vectors (..., 3)."""
    x, y, z = components(vectors)
    return packed([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], x)


def _action(placement: Placement) -> np.ndarray:
    """Action matrices (..., 6, 6) that transform motions from a frame to its parent frame."""
    R, nothing = placement.rotation, np.zeros_like(placement.rotation)
    return np.concatenate(
        [np.concatenate([R, _skew(placement.translation) @ R], axis=-1), np.concatenate([nothing, R], axis=-1)], axis=-2
    )


def _motion_cross(twists: np.ndarray) -> np.ndarray:
    """Matrices (..., 6, 6) of the motion cross product with twists (..., 6) on the left."""
    angular, linear = _skew(twists[..., 3:]), _skew(twists[..., :3])
    return np.concatenate(
        [
            np.concatenate([angular, linear], axis=-1),
            np.concatenate([np.zeros_like(angular), angular], axis=-1),
        ],
        axis=-2,
    )
