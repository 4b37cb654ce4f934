"""Couplings of joints and frames: gears and belts, Ackermann steering, and kinematic loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, cast

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import Form, KernelRow, wrench_rows
from rnc_pin.errors import ConfigurationError, ConstraintError, check_known
from rnc_pin.math.linear_algebra import Component, Entry, apply, components, cross, packed
from rnc_pin.model.frame_rows import DirectionRows, OffsetFrame, frame_direction, triple
from rnc_pin.model.input_validation import Axis, Vector, is_number
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics, over_states
from rnc_pin.model.relative_rows import CouplingRow, RelativeRows
from rnc_pin.model.rows import FrameAnchor, JointCoupler, Rows
from rnc_pin.robots.joint_values import SingleJoint
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
        if not (is_number(self.ratio) and self.ratio != 0 and is_number(self.offset)):
            raise ConstraintError(
                f"coupling of '{self.joint}' to '{self.driver}' needs a ratio other than zero and a finite offset, "
                f"found {self.ratio!r} and {self.offset!r}"
            )
        return CouplingRow(robot, self.joint, self.driver, self.ratio, self.offset)


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
        check_known(self.kind, ("frame", "point"), "kind of loop closure")
        between = f"'{self.frame_a}' and '{self.frame_b}'"
        turned = triple(self.rpy, f"rpy of the loop of {between}")
        if self.kind == "point" and turned.any():
            raise ConfigurationError(f"loop of {between} with kind 'point' has no orientation: omit rpy")
        # The rotation counts for frame b only: turned back by it, both frames coincide in the closed loop.
        a = OffsetFrame(robot, self.frame_a, self.offset_a)
        b = OffsetFrame(robot, self.frame_b, self.offset_b, pin.rpy.rpyToMatrix(turned).T)
        if a.joint == b.joint:
            raise ConstraintError(f"frames {between} are on one body: there is no loop")
        return _ClosureRows((self.frame_a, self.frame_b), a, b, self.kind == "point")


class PointRows(DirectionRows):
    """Velocity of a point (3,), in world axes.

    Args:
        point: frame with its origin there.
    """

    units = ("m/s",) * 3

    def __init__(self, point: OffsetFrame) -> None:
        self.names = tuple(f"{point.name}_{axis}" for axis in "xyz")
        self.point, self.frame = point, point.index
        self.directions = point.offset.translation[:, None]

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return [[*axis, *cross(directions[0], axis)] for axis in np.eye(3).tolist()]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return wrench_rows(Form.WORLD, self.point.attached(model), np.eye(6)[:3].tolist())


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
        # A point is seen from a. A whole frame is: a seen from b and reversed, so that b's own axes need no rate.
        super().__init__(*((PointRows(b), a.index) if point else (_TwistRows(a), b.index)))
        self._frames, self._a, self._b, self._point = frames, a, b, point
        self.names = tuple(f"closure_{part}({a.name}, {b.name})" for part in _PARTS[: 3 if point else 6])
        self.holonomic = (True,) * len(self.names)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        a, b = self._a.placement(at), self._b.placement(at)
        back = a.rotation.mT
        apart, turned = apply(back, b.translation - a.translation), back @ b.rotation
        # The logarithm is the twist that closes the loop in unit time: a Newton step for the projection.
        if self._point:
            return apart
        return over_states(lambda point, rotation: pin.log6(pin.SE3(rotation, point)).vector, (6,), apart, turned)

    def lines_of_action(self, at: PositionKinematics) -> None:
        return None

    def mechanisms(self) -> tuple[FrameAnchor]:
        return (FrameAnchor(self._frames, (self._a.offset, self._b.offset), self._point),)


@dataclass(frozen=True)
class AckermannSteering:
    """Steering linkage of a car: the axles of both steered wheels and the fixed axle meet in one centre of rotation.

    A URDF cannot describe this linkage. Without it, the wheels slip or the car only drives straight ahead. With
    steering angles l and r to the left, wheelbase L and distance w of the pivots, the row is the rate of
    ``sin(l - r) - w / L sin(l) sin(r)``, which is zero if ``cot(r) - cot(l) = w / L``. It is holonomic, and regular
    at every angle, zero included. With ``axis``, the pivots may have different distances L_l and L_r from the fixed
    axle, such as a front wheel and a rear wheel on both sides of it: the row is then the rate of
    ``sin(l) cos(r) - L_l / L_r cos(l) sin(r) - w / L_r sin(l) sin(r)``.

    Distances are measured at the robot's neutral configuration. There, the wheels have to point straight ahead.
    Wheels may be offset from their pivots along their own axles.

    Args:
        left, right: the steering joints, in either order. Their axes are vertical, up or down; a lean of up to 17
            degrees is allowed, and the row ignores it.
        axle: a frame on the fixed axle, e.g. of a rear wheel.
        axis: the frame's own axis along the fixed axle, "x", "y" or "z", or its direction in the frame's own axes (3,).
            By default the fixed axle is parallel to the line between the pivots.

    Raises:
        ModelError: unknown joint or frame.
        ConstraintError: joints that do not turn about vertical axes, or pivots whose line is on the fixed axle.

    Example:
        >>> import pinocchio as pin
        >>> model, mass = pin.Model(), pin.Inertia(1.0, np.zeros(3), np.eye(3))
        >>> for name, pivot in {"left": (1.5, 0.5, 0.0), "right": (1.5, -0.5, 0.0)}.items():
        ...     joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array(pivot)), name)
        ...     model.appendBodyToJoint(joint, mass, pin.SE3.Identity())
        >>> linkage = rnc.AckermannSteering("left", "right", axle="universe")
        >>> system = rnc.NonholonomicSystem(rnc.Robot(model), [linkage])
        >>> q = system.assembled(np.array([0.5, 0.0]), hold=["left"])
        >>> np.diff(1.5 / np.tan(q)).round(6)  # the centre is nearer to the left wheel by the distance of the pivots
        array([1.])
    """

    left: str
    right: str
    axle: str
    axis: Axis | Vector | None = None

    def bind(self, robot: Robot) -> Rows:
        pivots = [_pivot(self.left, robot), _pivot(self.right, robot)]
        return _AckermannRow(self, pivots, *_ratios(self, pivots, robot))


class _Pivot(NamedTuple):
    joint: SingleJoint
    where: np.ndarray
    """Position in the horizontal plane (2,) [m], at the neutral configuration."""
    sign: float
    """1 for an axis that points up, -1 for one that points down."""


def linkage(left: Sequence[Entry], right: Sequence[Entry], p: Entry, k: Entry) -> tuple[Entry, Entry, Entry, Entry]:
    """Function f of the steering angles l and r, and its derivatives f_l, f_r and f_lr; ``f_ll = f_rr = -f``.

    ``f(l, r) = sin(l) cos(r) - p cos(l) sin(r) - k sin(l) sin(r)``.

    Args:
        left: cosine and sine of l.
        right: cosine and sine of r.
        p: ratio of the wheelbases, 1 for a pair.
        k: track over the wheelbase of ``right``; negative if the joint ``left`` is on the right.
    """
    (cl, sl), (cr, sr) = left, right
    return (
        sl * cr - p * cl * sr - k * sl * sr,
        # All four share sines and cosines; second derivatives by one angle are -f, so no others are needed.
        cl * cr + p * sl * sr - k * cl * sr,
        -(p * cl * cr + sl * sr) - k * sl * cr,
        p * sl * cr - cl * sr - k * cl * cr,
    )


class _AckermannRow(Rows):
    """Rate of the function f of a ``linkage``."""

    holonomic = (True,)
    units = ("rad/s",)

    def __init__(self, kind: AckermannSteering, pivots: list[_Pivot], reach: float, ratio: float) -> None:
        self.names = (f"ackermann({kind.left}, {kind.right})",)
        self._steering, self._pivots, self._reach, self._ratio = kind, pivots, reach, ratio

    def _shape(self, at: PositionKinematics) -> list[Component]:
        """f, f_l, f_r and f_lr."""
        q = components(at.q)
        left, right = (_direction(pivot, q) for pivot in self._pivots)
        return cast("list[Component]", linkage(left, right, self._reach, self._ratio))

    def _row(self, at: PositionKinematics, l_entry: Component, r_entry: Component) -> np.ndarray:
        """Row (..., 1, nv) from its entries for unit steering rates to the left."""
        row: list[Component] = [0.0] * at.M.shape[-1]
        for pivot, entry in zip(self._pivots, (l_entry, r_entry), strict=True):
            # An axis that points down counts angles to the right.
            row[pivot.joint.idx_v] = pivot.sign * entry
        return packed([row], l_entry)

    def _rates(self, at: VelocityKinematics) -> tuple[Component, Component]:
        """Steering rates of both joints to the left."""
        v = components(at.v)
        left, right = (pivot.sign * v[pivot.joint.idx_v] for pivot in self._pivots)
        return left, right

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        _, f_l, f_r, _ = self._shape(at)
        return self._row(at, f_l, f_r)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        f, _, _, f_lr = self._shape(at)
        left, right = self._rates(at)
        return self._row(at, f_lr * right - f * left, f_lr * left - f * right)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        f, _, _, f_lr = self._shape(at)
        left, right = self._rates(at)
        return np.stack([2 * f_lr * left * right - f * (left * left + right * right)], axis=-1)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        _, f_l, f_r, _ = self._shape(at)
        left, right = self._rates(at)
        squares, both = left * left + right * right, 2 * left * right
        return self._row(at, -f_l * squares - f_r * both, -f_r * squares - f_l * both)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        return np.stack([self._shape(at)[0]], axis=-1)

    def mechanisms(self) -> tuple[JointCoupler]:
        return (JointCoupler(self._steering.left, self._steering.right, function=self._left_angle, period=np.pi),)

    def _left_angle(self, position: float) -> tuple[float, float]:
        """Position of the left joint up to half turns, from the position of the right joint, and its slope."""
        left, right = (pivot.sign for pivot in self._pivots)
        r, p, k = right * position, self._reach, self._ratio
        sine, cosine = p * np.sin(r), np.cos(r) - k * np.sin(r)  # tan(l) = p sin r / (cos r - k sin r)
        # arctan2 has no pole where the left wheel is at a quarter turn.
        return left * float(np.arctan2(sine, cosine)), left * float(p / (sine * sine + cosine * cosine)) * right

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        left, right = (pivot.joint for pivot in self._pivots)
        continuous = left.continuous + 2 * right.continuous
        integers = (left.idx_q, left.idx_v, right.idx_q, right.idx_v, continuous)
        numbers = [self._ratio, *(pivot.sign for pivot in self._pivots), self._reach]
        return [KernelRow(Form.ACKERMANN, (), integers, numbers)]


def _direction(pivot: _Pivot, q: Sequence[Component]) -> tuple[Component, Component]:
    """Cosine and sine of a steering angle, positive to the left."""
    # A continuous joint is stored as (cos, sin): no trigonometric function is called.
    entry = q[pivot.joint.idx_q]
    if pivot.joint.continuous:
        return entry, pivot.sign * q[pivot.joint.idx_q + 1]
    return np.cos(entry), pivot.sign * np.sin(entry)


def _pivot(name: str, robot: Robot) -> _Pivot:
    index = robot.joint_id(name)
    joint, data = robot.model.joints[index], robot.model.createData()
    if joint.nv != 1:
        raise ConstraintError(f"steering joint '{name}' has {joint.nv} degrees of freedom, expected one")
    columns = pin.computeJointJacobians(robot.model, data, robot.configuration()).reshape(6, robot.nv)
    x, y, z = columns[3:, joint.idx_v]
    # Horizontal part of a unit axis above which it is not vertical: kingpins lean by up to 17 degrees.
    most_horizontal = 0.3
    # A prismatic joint has no angular column at all: z alone tells it.
    if not (abs(z) > 0.5 and np.hypot(x, y) < most_horizontal):
        found = "slides" if not columns[3:, joint.idx_v].any() else f"turns about ({x:.4g}, {y:.4g}, {z:.4g})"
        raise ConstraintError(f"steering joint '{name}' {found}, expected a vertical axis, (0, 0, 1) or (0, 0, -1)")
    return _Pivot(SingleJoint.of(joint), data.oMi[index].translation[:2].copy(), float(np.sign(z)))


def _ratios(kind: AckermannSteering, pivots: list[_Pivot], robot: Robot) -> tuple[float, float]:
    """Wheelbase of the first pivot, and track, over the wheelbase of the second pivot."""
    frame, data = robot.frame_id(kind.axle), robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration())
    placement = data.oMf[frame]
    left, right = (pivot.where - placement.translation[:2] for pivot in pivots)
    track = left - right
    across = track if kind.axis is None else placement.rotation[:2] @ frame_direction(kind.axis)
    length = float(np.linalg.norm(across))
    least_horizontal = 0.9  # of a unit axis: below it the axis is not along a level axle
    if kind.axis is not None and length < least_horizontal:
        raise ConstraintError(f"axis {kind.axis} of frame '{kind.axle}' is vertical, expected the axis along its axle")
    least_length = 1e-6  # wheelbase or track [m] below which their ratio is rounding
    x, y = across / length if length > least_length else (1.0, 0.0)
    # Distances in front of the fixed axle and to its side; a turn of the axle's direction by pi changes no ratio.
    fore_l, fore_r = (float(each[0] * y - each[1] * x) for each in (left, right))
    beside_l, beside_r = (float(each[0] * x + each[1] * y) for each in (left, right))
    # A pivot on the fixed axle would need an infinite ratio: the row has no finite coefficients.
    least = min(abs(fore_l), abs(fore_r)) if length > least_length else 0.0
    if least < least_length:
        raise ConstraintError(
            f"track and wheelbase of steering joints '{kind.left}' and '{kind.right}' with frame '{kind.axle}' have to "
            f"be above {least_length:g} m, found {np.linalg.norm(track):.3g} m and {least:.3g} m"
        )
    return fore_l / fore_r, (beside_l - beside_r) / fore_r
