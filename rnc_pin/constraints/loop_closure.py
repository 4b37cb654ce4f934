"""Kinematic loops: two frames, or two points, that stay together. On Pinocchio's anchor constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, ConstraintError, nearest
from rnc_pin.model.kinematics import OWN_AXES, Kinematics
from rnc_pin.model.rows import Rows
from rnc_pin.robots.robot import Robot

AnchorModel = Any  # pin.FrameAnchorConstraintModel or pin.PointAnchorConstraintModel

_KINDS = ("frame", "point")
_PARTS = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class LoopClosure:
    """Two frames coincide ("frame", six rows), or their origins do ("point", three rows). All rows are holonomic.

    Rows are the motion of frame b relative to frame a in the axes of a: of its origin, then of its axes. Where a loop
    makes rows dependent (a planar loop leaves two of three, or three of six) the others drop out; each of those has
    to be satisfied all the same, so a loop that cannot close is refused.

    Jacobians are those of Pinocchio's ``FrameAnchorConstraintModel`` and ``PointAnchorConstraintModel``; their rates,
    which Pinocchio does not have, are exact.

    Args:
        frame_a: name of a frame, or ``"universe"`` for the world.
        frame_b: name of the frame that stays on it.
        kind: "frame" or "point".

    Raises:
        ModelError: no such frame.
        ConfigurationError: unknown kind.
        ConstraintError: both frames are on one body.
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
        a, b = frames[robot.frame_id(self.frame_a)], frames[robot.frame_id(self.frame_b)]
        if a.parentJoint == b.parentJoint:
            raise ConstraintError(f"frames '{self.frame_a}' and '{self.frame_b}' are on one body: there is no loop")
        make = pin.FrameAnchorConstraintModel if self.kind == "frame" else pin.PointAnchorConstraintModel
        anchor = make(robot.model, a.parentJoint, a.placement, b.parentJoint, b.placement)
        return AnchorRows(anchor, f"{self.frame_a}, {self.frame_b}")


class AnchorRows(Rows):
    """Rows of one of Pinocchio's anchor constraints.

    With J1 and J2 the Jacobians of both frames in their own axes and X the action of frame 2 seen from 1, the twist
    of 2 relative to 1 is ``W = X J2 v - J1 v``, and the point p of 2 seen from 1 moves at ``W_linear + W_angular x p``.

    Args:
        anchor: the constraint.
        between: what it is between, for the names.
    """

    def __init__(self, anchor: AnchorModel, between: str) -> None:
        self._anchor = anchor
        self._point = isinstance(anchor, pin.PointAnchorConstraintModel)
        size = 3 if self._point else 6
        self.names = tuple(f"closure_{part}({between})" for part in _PARTS[:size])
        self.units = ("m/s",) * 3 + ("rad/s",) * (size - 3)
        self.holonomic = (True,) * size
        self._joints = (anchor.joint1_id, anchor.joint2_id)
        self._placements = (anchor.joint1_placement.copy(), anchor.joint2_placement.copy())
        self._to_frame = tuple(each.toActionMatrixInverse() for each in self._placements)

    def jacobian(self, state: Kinematics) -> np.ndarray:
        anchor, data = self._anchor, self._anchor.createData()
        anchor.calc(state.model, state.data, data)
        return anchor.jacobian(state.model, state.data, data)

    def residual(self, state: Kinematics) -> np.ndarray:
        relative = self._relative(state)
        return relative.translation if self._point else pin.log6(relative).vector

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        relative = self._relative(state)
        (J1, J2), (J1_dot, J2_dot) = (
            self._jacobians(state, pin.getJointJacobian),
            self._jacobians(state, pin.getJointJacobianTimeVariation),
        )
        X = relative.toActionMatrix()
        W = X @ J2 - J1
        twist = pin.Motion(W @ state.v)
        W_dot = twist.action @ X @ J2 + X @ J2_dot - J1_dot
        if not self._point:
            return W_dot
        p = relative.translation
        p_dot = twist.linear + np.cross(twist.angular, p)
        return W_dot[:3] - pin.skew(p) @ W_dot[3:] - pin.skew(p_dot) @ W[3:]

    def drift(self, state: Kinematics) -> np.ndarray:
        relative = self._relative(state)
        (a, b), (A, B) = self._placements, self._joints
        velocities, accelerations = state.data.v, state.data.a
        twist = relative.act(b.actInv(velocities[B])) - a.actInv(velocities[A])
        W_dot = twist.cross(relative.act(b.actInv(velocities[B])))
        W_dot += relative.act(b.actInv(accelerations[B])) - a.actInv(accelerations[A])
        if not self._point:
            return W_dot.vector
        p = relative.translation
        p_dot = twist.linear + np.cross(twist.angular, p)
        return W_dot.linear + np.cross(W_dot.angular, p) + np.cross(twist.angular, p_dot)

    def _relative(self, state: Kinematics) -> pin.SE3:
        """Placement of frame 2 in frame 1."""
        (a, b), (A, B), placements = self._placements, self._joints, state.data.oMi
        return (placements[A] * a).actInv(placements[B] * b)

    def _jacobians(self, state: Kinematics, getter: object) -> list[np.ndarray]:
        assert callable(getter)
        return [
            to_frame @ getter(state.model, state.data, joint, OWN_AXES) if joint else np.zeros((6, state.model.nv))
            for to_frame, joint in zip(self._to_frame, self._joints, strict=True)
        ]
