"""Wheels that roll on a plane, upright or leaning, and knife edges that prevent side slip.

A ``RollingWheel`` is bound to ``RollingRows``, whose formula is ``wheel_wrenches``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import Form, KernelRow, attached, wrench_rows
from rnc_pin.constraints.ground_plane import GroundPlane, admit_plane, on_carrier
from rnc_pin.constraints.rolling_body import RollingBody
from rnc_pin.constraints.surfaces import CurvedGround, Torus, admit_ground, check_positive
from rnc_pin.errors import ConfigurationError, ConstraintError
from rnc_pin.math.linear_algebra import Entry, cross, dot
from rnc_pin.model.frame_rows import FLAT, DirectionRows, OffsetFrame, evaluated, frame_direction
from rnc_pin.model.input_validation import Axis, Positive, Vector
from rnc_pin.model.kinematics import OWN_AXES, Kinematics, PositionKinematics
from rnc_pin.model.rows import Friction, GroundContact, Rows, check_defined
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
        check_positive(f"radius of wheel '{self.frame}'", self.radius)
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
        rows = RollingRows(self.frame, self.radius, axle, *_parts(self), self.ground or GroundPlane(), robot)
        return on_carrier(rows, self.frame, self.ground, robot)


def _parts(kind: RollingWheel) -> tuple[dict[str, Vector], Friction]:
    """Word of each row, with its weights of the rolling, lateral and vertical rows; and the directions of friction."""
    parts: dict[str, Vector] = {"rolling": (1.0, 0.0, 0.0)}
    friction: Friction = "longitudinal"
    if kind.roller is not None:
        parts = {"roller": (float(np.cos(kind.roller)), float(np.sin(kind.roller)), 0.0)}
        # cos(pi/2) and the like leave 1e-17 in angles that users compute.
        friction = "oblique" if abs(kind.roller) > 1e-9 else friction
    elif kind.lateral:
        parts["lateral"], friction = (0.0, 1.0, 0.0), "all"
    return parts | {"vertical": (0.0, 0.0, 1.0)} if kind.vertical else parts, friction


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


def wheel_level(axle: Sequence[Entry], normal: Sequence[Entry]) -> Entry:
    """Sine of the angle between the axle of a wheel and the normal of its plane.

    Args:
        axle: unit axle of the wheel, three components in the axes of the normal.
        normal: unit normal of the plane, three components.
    """
    across = cross(axle, normal)
    return dot(across, across) ** 0.5


def wheel_wrenches(axle: Sequence[Entry], normal: Sequence[Entry], radius: Entry) -> list[list[Entry]]:
    """Rolling, lateral and vertical rows (3, 6) of a wheel on a plane.

    The axle is a, the normal n, ``z = a . n`` and s the length of ``a x n``. The wheel heads along ``h = a x n / s``,
    and ``c = n x h`` is sideways. The contact point is at ``arm = radius (z c - s n)`` from the centre. With the
    centre's velocity v and the angular velocity w, the material point there has the velocity ``v + w x arm``. Its
    components are

        rolling   h . v - radius a . w
        lateral   c . v + radius s h . w
        vertical  n . v + radius z h . w.

    Args:
        axle: unit axle of the wheel, three components in world axes.
        normal: unit normal of the plane, three components in world axes.
        radius: radius of the wheel [m].
    """
    across, s, z = cross(axle, normal), wheel_level(axle, normal), dot(axle, normal)
    # Of unit length: rolling and lateral rows are speeds at any lean of the wheel.
    heading = [each / s for each in across]
    rolling = [*heading, *(-radius * each for each in axle)]
    # The arm to the contact is r (z h' - s n): its moments are in closed form, without the point itself.
    lateral = [*cross(normal, heading), *(radius * each for each in across)]
    return [rolling, lateral, [*normal, *(radius * z * each for each in heading)]]


class RollingRows(DirectionRows):
    """Rows of a ``RollingWheel`` that is bound to a robot: ``wheel_wrenches``. A roller or a wheel that skids combines
    them. The kernel has the same formula as ``Form.WHEEL``, generated from it.

    Args:
        wheel: name of a frame at the centre.
        radius: radius [m]. The rows are affine in it. An estimator sets it on its own copy.
        axle: axle in the frame's own axes (3,).
        parts: word of each row, with its weights of the rolling, lateral and vertical rows.
        friction: directions of friction on the ground.
        plane: the ground.
        robot: the robot that has the frame.
    """

    on_ground = True
    undefined = "a wheel lies flat on the ground"

    def __init__(
        self,
        wheel: str,
        radius: float,
        axle: np.ndarray,
        parts: Mapping[str, Vector],
        friction: Friction,
        plane: GroundPlane,
        robot: Robot,
    ) -> None:
        self.names = tuple(f"{part}({wheel})" for part in parts)
        self.units = ("m/s",) * len(parts)
        self.holonomic = tuple(part == "vertical" for part in parts)
        self.wheel, self.frame, self._friction = wheel, robot.frame_id(wheel), friction
        # A wheel needs the direction of its axle only: its turn about the axle moves no contact.
        self.radius, self.axle, self.directions = radius, axle, axle[:, None]
        # All three rows are the wrenches themselves: None spares a product with the identity at each evaluation.
        self.combination = None if len(parts) == 3 else np.array(list(parts.values()))
        self.ground = None if plane.is_default else plane
        self._point, self._up = np.asarray(plane.point), plane.axes[2]
        self._normal = self._up.tolist()
        self.twist, self.affine = plane.twist, plane.moves

    def regularity(self, *directions: Sequence[Entry]) -> Entry:
        return wheel_level(directions[0], self._normal)

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return wheel_wrenches(directions[0], self._normal, self.radius)

    def wrenches_at(self, q: np.ndarray, rotation: np.ndarray) -> list[list[float]]:
        """Wrenches (k, 6) as numbers of Python.

        Args:
            q: one configuration (nq,), for messages.
            rotation: rotation of the frame there (3, 3).

        Raises:
            SingularityError: the wheel lies flat.
        """
        # An estimator calls this for each sample: Python numbers are faster than arrays of three.
        (axle,) = self.world_directions(rotation)
        check_defined(self.undefined, q, cast("float", wheel_level(axle, self._normal)), FLAT, self.names)
        found = cast("list[list[float]]", wheel_wrenches(axle, self._normal, self.radius))
        return found if self.combination is None else self.combination.dot(found).tolist()

    def _contact(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Contact points (..., 3), and the directions of rolling, lateral and vertical rows there (..., 3, 3)."""
        self.check_defined(at)
        place = at.placement(self.frame)
        wrenches = evaluated(self.formula, self.world_directions(place.rotation))
        directions, moments = wrenches[..., :3], wrenches[..., 3:]
        # The contact is beside the wheel's heading: only its arm up and sideways gives moments about the heading.
        sideways, down = (np.vecdot(moments[..., k, :], directions[..., 0, :])[..., None] for k in (2, 1))
        arm = sideways * directions[..., 1, :] - down * directions[..., 2, :]
        return place.translation + arm, directions

    def residual(self, at: PositionKinematics) -> np.ndarray:
        height = (self._contact(at)[0] - self._point) @ self._up
        # Only the vertical row has a residual: the others are not integrable.
        return np.asarray(height)[..., None] * self.holonomic

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact, directions = self._contact(at)
        directions = self._combined(directions)
        return np.broadcast_to(contact[..., None, :], directions.shape), directions

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self.wheel, self.radius, self.axle, friction=self._friction),)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        combination = np.eye(3) if self.combination is None else self.combination
        numbers = [[*self.axle, self.radius, *self._normal, *weights] for weights in combination]
        return wrench_rows(Form.WHEEL, attached(model, self.frame), numbers, self.twist)


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
        plane = admit_plane(self.ground, f"knife edge '{self.frame}'")
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
