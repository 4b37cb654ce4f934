"""Couplings of joints and frames: gears and belts, and kinematic loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, ConstraintError, nearest
from rnc_pin.math.components import Entry, cross
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.frame_rows import DirectionRows, OffsetFrame, PointRows, triple
from rnc_pin.model.kernel_rows import Form, KernelRow, wrench_rows
from rnc_pin.model.kinematics import PositionKinematics, over_states
from rnc_pin.model.parameter_types import Vector
from rnc_pin.model.relative_rows import CouplingRow, RelativeRows
from rnc_pin.model.rows import FrameAnchor, Phrases, Rows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class JointCoupling:
    """Coupling ``q_joint = ratio * q_driver + offset``, as a holonomic row ``v_joint - ratio * v_driver = 0``.

    The system adds the couplings of the robot's file, e.g. ``<mimic>``, itself: see ``NonholonomicSystem``. Both joints
    have one degree of freedom. A continuous joint is stored as (cos, sin), without its number of full turns. Therefore
    positions are compared modulo the effect of full turns of both joints, e.g. a third of a turn for ratio 1/3. If a
    continuous driver has a ratio that is not a fraction of small integers, the row holds only at velocity level.

    Args:
        joint: the joint that follows.
        driver: the joint that leads.
        ratio: motion of the joint for unit motion of the driver, not zero.
        offset: position of the joint if the driver is at zero [rad or m].

    Raises:
        ModelError: unknown joint, or a joint with several degrees of freedom.
        ConstraintError: a joint coupled to itself, a ratio that is zero or not finite, or an offset that is not finite.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> gear = rnc.JointCoupling("joint_2", driver="joint_1", ratio=-0.5, offset=0.1)
        >>> system = rnc.NonholonomicSystem(robot, [gear], ["joint_1"])
        >>> q = system.assembled(robot.configuration({"joint_1": 0.4}), hold=["joint_1"])
        >>> round(robot.joint_values(q)["joint_2"], 3)
        -0.1
    """

    joint: str
    driver: str
    ratio: float = 1.0
    offset: float = 0.0

    def bind(self, robot: Robot) -> Rows:
        if self.joint == self.driver:
            raise ConstraintError(f"joint '{self.joint}' cannot be coupled to itself")
        if not (np.isfinite(self.ratio) and self.ratio != 0 and np.isfinite(self.offset)):
            raise ConstraintError(
                f"coupling of '{self.joint}' to '{self.driver}' needs a ratio other than zero and a finite offset, "
                f"found {self.ratio} and {self.offset}"
            )
        return CouplingRow(robot, self.joint, self.driver, self.ratio, self.offset)


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


class _TwistRows(DirectionRows):
    """Twist (6,) of a frame, reversed, along its own axes and at its origin."""

    def __init__(self, frame: OffsetFrame) -> None:
        self.names, self.units = _PARTS, ("m/s",) * 3 + ("rad/s",) * 3
        self._offset_frame, self.frame = frame, frame.index
        self.directions = np.hstack([np.eye(3), frame.offset.translation[:, None]])

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        *axes, arm = directions
        linear = [[*axis, *cross(arm, axis)] for axis in axes]
        return [[-entry for entry in row] for row in (*linear, *([0.0, 0.0, 0.0, *axis] for axis in axes))]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return wrench_rows(Form.OWN, self._offset_frame.attached(model), (-np.eye(6)).tolist())


class _ClosureRows(RelativeRows):
    """Twist of frame b relative to a, in the axes of a and at its origin; or the velocity of the origin of b there.

    The twist is the reversed one of a relative to b. Frames a and b include the offsets and the rotation, so that they
    coincide in the closed loop.
    """

    def __init__(self, frames: tuple[str, str], a: OffsetFrame, b: OffsetFrame, point: bool) -> None:
        super().__init__(*((PointRows(b), a.index) if point else (_TwistRows(a), b.index)))
        self._frames, self._a, self._b, self._point = frames, a, b, point
        self.names = tuple(f"closure_{part}({a.name}, {b.name})" for part in _PARTS[: 3 if point else 6])
        self.holonomic = (True,) * len(self.names)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        a, b = self._a.placement(at), self._b.placement(at)
        back = a.rotation.mT
        apart, turned = apply(back, b.translation - a.translation), back @ b.rotation
        return apart if self._point else over_states(_log6, (6,), turned.reshape(*at.q.shape[:-1], 9), apart)

    def lines_of_action(self, at: PositionKinematics) -> None:
        return None

    def mechanisms(self) -> tuple[FrameAnchor]:
        return (FrameAnchor(self._frames, (self._a.offset, self._b.offset), self._point),)

    def phrases(self) -> Phrases:
        return Phrases(robot="a mechanism with closed loops", prevents="open its loops")


def _log6(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    logarithm: np.ndarray = pin.log6(pin.SE3(rotation.reshape(3, 3), translation)).vector
    return logarithm
