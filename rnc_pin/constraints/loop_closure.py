"""Kinematic loops: two frames, or two points, that stay together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, ConstraintError, nearest
from rnc_pin.math.components import components, packed
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kinematics import OWN_AXES, Motion, Placement, Position, Rates, over_states
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

_KINDS = ("frame", "point")
_PARTS = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class LoopClosure:
    """Two frames coincide ("frame", six rows), or their origins do ("point", three rows). All rows are holonomic.

    Rows are the motion of frame b relative to frame a in the axes of a: of its origin, then of its axes. Where a loop
    makes rows dependent (a planar loop leaves two of three, or three of six) the others drop out; each of those has
    to be satisfied all the same, so a loop that cannot close is refused.

    The rows are those of Pinocchio's ``FrameAnchorConstraintModel`` and ``PointAnchorConstraintModel``, which have no
    rates; here they have.

    Args:
        frame_a: name of a frame, or ``"universe"`` for the world.
        frame_b: name of the frame that stays on it.
        kind: "frame" or "point".

    Raises:
        ModelError: no such frame.
        ConfigurationError: unknown kind.
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

    def bind(self, robot: Robot) -> Rows:
        if self.kind not in _KINDS:
            raise ConfigurationError(
                f"kind of loop closure '{self.kind}' is not known{nearest(str(self.kind), _KINDS)}"
            )
        frames = robot.model.frames
        a, b = robot.frame_id(self.frame_a), robot.frame_id(self.frame_b)
        if frames[a].parentJoint == frames[b].parentJoint:
            raise ConstraintError(f"frames '{self.frame_a}' and '{self.frame_b}' are on one body: there is no loop")
        return _ClosureRows(robot, a, b, self.kind == "point", f"{self.frame_a}, {self.frame_b}")


class _ClosureRows(Rows):
    """With X the action of frame b seen from a, the twist of b relative to a in the axes of a is ``W = X J_b - J_a``.

    The origin of b, at p seen from a, moves there at ``W_linear + W_angular x p``.
    """

    def __init__(self, robot: Robot, a: int, b: int, point: bool, between: str) -> None:
        self._a, self._b, self._point = a, b, point
        size = 3 if point else 6
        self.names = tuple(f"closure_{part}({between})" for part in _PARTS[:size])
        self.units = ("m/s",) * 3 + ("rad/s",) * (size - 3)
        self.holonomic = (True,) * size
        self.joints = tuple(robot.model.frames[frame].parentJoint for frame in (a, b))

    def _relative(self, at: Position) -> Placement:
        """Placement of frame b in frame a."""
        a, b = at.placement(self._a), at.placement(self._b)
        back = a.rotation.mT
        return Placement(back @ b.rotation, apply(back, b.translation - a.translation))

    def jacobian(self, at: Position) -> np.ndarray:
        relative = self._relative(at)
        return self._selected(relative.translation, self._twists(at, relative))

    def _twists(self, at: Position, relative: Placement) -> np.ndarray:
        return _action(relative) @ at.jacobian(self._b, OWN_AXES) - at.jacobian(self._a, OWN_AXES)

    def _selected(self, p: np.ndarray, W: np.ndarray) -> np.ndarray:
        return W[..., :3, :] - _skew(p) @ W[..., 3:, :] if self._point else W

    def jacobian_dot(self, at: Rates) -> np.ndarray:
        relative = self._relative(at)
        W = self._twists(at, relative)
        twist = apply(W, at.v)
        X_J = _action(relative) @ at.jacobian(self._b, OWN_AXES)
        X_J_dot = _action(relative) @ at.jacobian_dot(self._b, OWN_AXES)
        W_dot = _motion_cross(twist) @ X_J + X_J_dot - at.jacobian_dot(self._a, OWN_AXES)
        if not self._point:
            return W_dot
        p = relative.translation
        return self._selected(p, W_dot) - _skew(self._point_rate(twist, p)) @ W[..., 3:, :]

    def _point_rate(self, twist: np.ndarray, p: np.ndarray) -> np.ndarray:
        return twist[..., :3] + apply(_skew(twist[..., 3:]), p)

    def drift(self, at: Motion) -> np.ndarray:
        relative = self._relative(at)
        X, p = _action(relative), relative.translation
        X_v = apply(X @ at.jacobian(self._b, OWN_AXES), at.v)
        twist = X_v - apply(at.jacobian(self._a, OWN_AXES), at.v)
        W_dot = apply(_motion_cross(twist), X_v) + apply(X, at.acceleration(self._b, OWN_AXES))
        W_dot = W_dot - at.acceleration(self._a, OWN_AXES)
        if not self._point:
            return W_dot
        moved = apply(_skew(twist[..., 3:]), self._point_rate(twist, p))
        return W_dot[..., :3] + apply(_skew(W_dot[..., 3:]), p) + moved

    def residual(self, at: Position) -> np.ndarray:
        relative = self._relative(at)
        if self._point:
            return relative.translation
        flat = relative.rotation.reshape(*at.q.shape[:-1], 9)
        return over_states(_log6, (6,), flat, relative.translation)


def _log6(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    logarithm: np.ndarray = pin.log6(pin.SE3(rotation.reshape(3, 3), translation)).vector
    return logarithm


def _skew(vectors: np.ndarray) -> np.ndarray:
    """Matrices (..., 3, 3) of the vector product with (..., 3) from the left."""
    x, y, z = components(vectors)
    return packed([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], x)


def _action(placement: Placement) -> np.ndarray:
    """Matrices (..., 6, 6) that carry motions from a frame to that in which it is placed."""
    R, nothing = placement.rotation, np.zeros_like(placement.rotation)
    return np.concatenate(
        [np.concatenate([R, _skew(placement.translation) @ R], axis=-1), np.concatenate([nothing, R], axis=-1)], axis=-2
    )


def _motion_cross(twists: np.ndarray) -> np.ndarray:
    """Matrices (..., 6, 6) of the product of motions with (..., 6) from the left."""
    turning, moving = _skew(twists[..., 3:]), _skew(twists[..., :3])
    return np.concatenate(
        [
            np.concatenate([turning, moving], axis=-1),
            np.concatenate([np.zeros_like(turning), turning], axis=-1),
        ],
        axis=-2,
    )
