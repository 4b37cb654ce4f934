"""Wheels that roll on a plane, upright or leaning; knife edges that prevent side slip; casters that only carry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import Form, KernelRow, wrench_rows
from rnc_pin.constraints.ground_plane import GroundPlane, RollingRows, WheelDisk, on_carrier, plane_below
from rnc_pin.constraints.rolling_body import RollingBody
from rnc_pin.constraints.surfaces import CurvedGround, Torus, admit_ground
from rnc_pin.errors import ConfigurationError, ConstraintError
from rnc_pin.math.linear_algebra import Entry, cross
from rnc_pin.model.frame_rows import ConstantWrenchRows, DirectionRows, OffsetFrame, frame_direction
from rnc_pin.model.input_validation import Axis, NotNegative, Positive, Vector, is_number
from rnc_pin.model.kinematics import OWN_AXES, Kinematics, PositionKinematics
from rnc_pin.model.rows import Friction, GroundContact, Rows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class RollingWheel:
    """Wheel whose contact point has the velocity of the ground: rolling, lateral and vertical rows.

    The contact point is the lowest point of a disk about its axle, at any lean angle. The rows are the velocity of the
    material point there: along the wheel's heading, sideways along the ground, and up. The vertical row is holonomic:
    the lowest point stays at height zero. For a planar base, it is zero and is dropped.

    A Mecanum or omni wheel touches the ground with a roller that turns freely. One row, named ``roller(frame)``,
    replaces the rolling and lateral rows: the velocity along the roller's axis. A wheel that skids has no lateral row.

    Args:
        frame: a frame at the centre of the wheel that turns with it.
        radius: radius of the wheel [m].
        axis: the axle as the frame's own axis "x", "y" or "z"; by default the axis of the joint that supports the
            frame.
        roller: angle from the wheel's heading to the axis of the roller on the ground [rad], within a quarter turn: 0
            for an omni wheel, plus or minus pi/4 for a Mecanum wheel. If the axle points to the left (joint axis +y,
            heading +x), the angle is positive to the left, seen from above. Reversing the axle does not change it. None
            for a wheel without rollers.
        lateral: True if the wheel resists sideways motion; False for a wheel that skids.
        vertical: True if the lowest point keeps its height. Use False on a planar base if the wheel is steered about an
            inclined axis: steering would lift the base, which a planar base cannot do.
        ground: a ``GroundPlane``, to which "lowest", "height" and "heading" refer; None for z = 0 at rest. On a curved
            ground, such as the edge of a curb, the wheel is a ``RollingBody`` with a ``Torus``.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the radius is not positive, no axis is given and the joint has none, the axis of the roller
            is across the wheel, or the ground is of another kind.
        ConfigurationError: a roller for a wheel that skids; a roller or fewer rows on curved ground.
        SingularityError: during evaluation, the wheel lies flat.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", radius=0.3, axis="y")])
        >>> reduced = system.reduce([rnc.FrameAngularVelocity("disk", axis) for axis in "xyz"])
        >>> q = reduced.assembled(robot.configuration())  # puts it on the ground
        >>> reduced.at(q, [0.0, 2.0, 0.0]).v[[0, 4]].round(3)
        array([0.6, 2. ])
    """

    frame: str
    radius: Positive
    axis: Axis | None = None
    roller: float | None = None
    lateral: bool = True
    vertical: bool = True
    ground: GroundPlane | CurvedGround | None = None

    def bind(self, robot: Robot) -> Rows:
        if not (is_number(self.radius) and self.radius > 0):
            raise ConstraintError(f"radius of wheel '{self.frame}' has to be positive, found {self.radius!r}")
        if self.roller is not None and not abs(self.roller) < np.pi / 2:
            raise ConstraintError(
                f"roller of wheel '{self.frame}' has to point less than pi/2 = 1.5708 rad away from the wheel's "
                f"heading, found {self.roller} rad (0 for an omni wheel, 0.7854 or -0.7854 for a Mecanum wheel)"
            )
        # A roller already says which direction slips.
        if self.roller is not None and not self.lateral:
            raise ConfigurationError(f"wheel '{self.frame}' has both roller and lateral=False: omit one of them")
        # Files draw axles along y or z: the axis of the joint is the one about which the wheel turns.
        axle = _joint_axis(self.frame, robot) if self.axis is None else frame_direction(self.axis)
        if self.ground is not None and not isinstance(self.ground, GroundPlane):
            ground = admit_ground(self.ground, f"wheel '{self.frame}'")
            if self.roller is not None or not (self.lateral and self.vertical):
                raise ConfigurationError(f"wheel '{self.frame}' on curved ground: takes no roller, lateral or vertical")
            # A Torus is round about its own z by default: z turns to the axle.
            turned = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axle).matrix()
            rim, rpy = Torus(self.radius), tuple(pin.rpy.matrixToRpy(turned).tolist())
            return RollingBody(self.frame, rim, rpy=rpy, ground=ground).bind(robot)
        plane = plane_below(self.ground, f"wheel '{self.frame}'") or GroundPlane()
        rows = RollingRows(WheelDisk(self.frame, self.radius, axle, *_parts(self)), _friction(self), plane, robot)
        return on_carrier(rows, self.frame, self.ground, robot)


def _friction(kind: RollingWheel) -> Friction:
    """Directions of friction on the ground."""
    if kind.roller is None:
        return "all" if kind.lateral else "longitudinal"
    # cos(pi/2) and the like leave 1e-17 in angles that users compute.
    return "oblique" if abs(kind.roller) > 1e-9 else "longitudinal"


def _parts(kind: RollingWheel) -> tuple[tuple[str, ...], np.ndarray | None]:
    """Names of the rows, and their combination (k, 3) of the rolling, lateral and vertical rows; None for identity."""
    names: tuple[str, ...]
    if kind.roller is not None:
        names, rows = ("roller",), [[float(np.cos(kind.roller)), float(np.sin(kind.roller)), 0.0]]
    elif kind.lateral:
        names, rows = ("rolling", "lateral"), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    else:
        names, rows = ("rolling",), [[1.0, 0.0, 0.0]]
    if not kind.vertical:
        return names, np.array(rows)
    names, rows = (*names, "vertical"), [*rows, [0.0, 0.0, 1.0]]
    # None spares a product with the identity at each evaluation.
    return names, None if len(rows) == 3 else np.array(rows)


def _joint_axis(name: str, robot: Robot) -> np.ndarray:
    """Axis of the revolute joint that supports a frame, in the frame's own axes."""
    frame = robot.model.frames[robot.frame_id(name)]
    joint = robot.model.joints[frame.parentJoint]
    if joint.nv != 1:
        raise ConstraintError(
            f"joint '{robot.model.names[frame.parentJoint]}' of wheel '{name}' has no single axis: "
            "give the axle with axis='x', 'y' or 'z'"
        )
    # The axis is constant in the frame's own axes, so any configuration shows it.
    position = Kinematics(robot).position(robot.configuration())
    axis: np.ndarray = position.jacobian(robot.frame_id(name), OWN_AXES)[3:, joint.idx_v]
    # A unit axis, or zero for a prismatic joint: nothing lies between.
    if np.linalg.norm(axis) < 0.5:
        raise ConstraintError(f"joint of wheel '{name}' is not revolute: give the axle with axis='x', 'y' or 'z'")
    return axis


@dataclass(frozen=True)
class NoSideSlip:
    """Zero velocity of a point of a frame along the frame's own axis, e.g. of a skate or an axle without slip.

    On ground that moves, it is the velocity relative to the material of the ground.

    The row is nonholonomic on a body that can turn. The point is the frame's origin, or a point with an offset, e.g.
    the middle of an axle at which the robot has no frame, or the point about which a skid-steered base turns.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z", or a direction in the frame's own axes (3,).
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
    axis: Axis | Vector = "y"
    at: Vector = (0.0, 0.0, 0.0)
    ground: GroundPlane | None = None

    def bind(self, robot: Robot) -> Rows:
        plane = plane_below(self.ground, f"knife edge '{self.frame}'") or GroundPlane()
        return on_carrier(_NoSideSlipRow(self, plane, robot), self.frame, self.ground, robot)


class _NoSideSlipRow(DirectionRows):
    """Velocity of a point at an arm from the frame's origin, along an axis of the frame."""

    units = ("m/s",)

    def __init__(self, kind: NoSideSlip, plane: GroundPlane, robot: Robot) -> None:
        self._edge, self._axis = kind, frame_direction(kind.axis)
        self._point = OffsetFrame(robot, kind.frame, kind.at)
        self.names = (f"no_side_slip({self._point.name}.{kind.axis})",)
        self.frame, self.directions = self._point.index, np.array([self._axis, kind.at], dtype=float).T
        # A plane at rest changes nothing for a velocity along the frame's own axis.
        self.ground = plane if plane.moves else None
        self.twist, self.affine = plane.twist, plane.moves

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        along, arm = directions
        return [[*along, *cross(arm, along)]]

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        placement = self._point.placement(at)
        return placement.translation[..., None, :].copy(), (placement.rotation @ self._axis)[..., None, :]

    def mechanisms(self) -> tuple[GroundContact]:
        center = np.asarray(self._edge.at, dtype=float)
        return (GroundContact(self._edge.frame, None, self._axis, center, "lateral"),)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return wrench_rows(Form.OWN, self._point.attached(model), [[*self._axis.tolist(), 0.0, 0.0, 0.0]], self.twist)


@dataclass(frozen=True)
class Caster:
    """Frictionless ball on the ground: it supports the robot and moves freely in the plane.

    It models a caster whose swivel and wheel are not joints of the model, a ball transfer unit, or a skid.
    The only row, vertical, is holonomic: the frame's origin stays at height ``radius``. For a planar base, the row is
    zero and is dropped.

    Args:
        frame: a frame at the centre of the ball.
        radius: radius of the ball [m]; 0 for a point contact.
        ground: the plane; None for z = 0. Its motion has no effect.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the radius is negative, or the ground is no plane.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="free")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, [*wheels, rnc.Caster("nose", radius=0.1)])
        >>> print(system.r, system.assembled(robot.configuration())[2].round(3))  # it stands, and drives as on a plane
        2 0.1
    """

    frame: str
    radius: NotNegative
    ground: GroundPlane | None = None

    def bind(self, robot: Robot) -> Rows:
        if not (is_number(self.radius) and self.radius >= 0):
            raise ConstraintError(f"radius of caster '{self.frame}' has to be zero or positive, found {self.radius!r}")
        plane = plane_below(self.ground, f"caster '{self.frame}'") or GroundPlane()
        return on_carrier(_CasterRow(self, plane, robot), self.frame, self.ground, robot)


class _CasterRow(ConstantWrenchRows):
    """Velocity of the centre along the normal of the plane."""

    holonomic = (True,)
    on_ground = True
    units = ("m/s",)

    def __init__(self, kind: Caster, plane: GroundPlane, robot: Robot) -> None:
        self.names, self.frame = (f"vertical({kind.frame})",), robot.frame_id(kind.frame)
        self.ground = None if plane.is_default else plane
        self._caster, self._point, self._normal = kind, np.asarray(plane.point), plane.axes[2]
        self.matrix = np.array([[*self._normal, 0.0, 0.0, 0.0]])

    def residual(self, at: PositionKinematics) -> np.ndarray:
        height = (at.placement(self.frame).translation - self._point) @ self._normal - self._caster.radius
        return np.asarray(height[..., None])

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact = at.placement(self.frame).translation[..., None, :] - self._caster.radius * self._normal
        return contact, np.broadcast_to(self._normal, contact.shape)

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self._caster.frame, self._caster.radius, friction="none"),)
