"""Disk that rolls without slip on a plane, upright or leaning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias, cast

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.carried_ground import on_carrier
from rnc_pin.constraints.curved_grounds import CurvedGround, admit_ground
from rnc_pin.constraints.ground_axes import InGroundAxes
from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.constraints.wheel_on_surface import WheelDisk, WheelOnSurfaceRows
from rnc_pin.errors import ConfigurationError, ConstraintError
from rnc_pin.math.components import Component, components, cross, packed, packed_vector, smallest
from rnc_pin.math.linear_algebra import apply, complex_step, product
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, plane_motion
from rnc_pin.model.kinematics import (
    OWN_AXES,
    Kinematics,
    PositionKinematics,
    VelocityKinematics,
)
from rnc_pin.model.mechanisms import Friction, GroundContact, Phrases
from rnc_pin.model.parameter_types import Axis, Positive
from rnc_pin.model.rows import Rows, check_defined
from rnc_pin.robots.robot import Robot

_FLAT = 1e-6  # sine of the angle between axle and vertical below which a wheel lies flat

Axle: TypeAlias = "tuple[Component, Component, Component, Component]"


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
        ground: a ``GroundPlane``, ``SphericalGround``, ``CylindricalGround``, ``HeightField``, or an object with the
            methods of a ``CurvedGround``; None for z = 0 at rest. "Lowest", "height" and "heading" then refer to its
            tangent plane at the contact point. The wheel has to be curved more than the ground.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the radius is not positive, no axis is given and the joint has none, the axis of the roller
            is across the wheel, or the ground has no such methods.
        ConfigurationError: a roller for a wheel that skids.
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
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise ConstraintError(f"radius of wheel '{self.frame}' has to be positive, found {self.radius}")
        if self.roller is not None and not abs(self.roller) < np.pi / 2:
            raise ConstraintError(
                f"roller of wheel '{self.frame}' has to point less than pi/2 = 1.5708 rad away from the wheel's "
                f"heading, found {self.roller} rad (0 for an omni wheel, 0.7854 or -0.7854 for a Mecanum wheel)"
            )
        if self.roller is not None and not self.lateral:
            raise ConfigurationError(f"wheel '{self.frame}' has both roller and lateral=False: omit one of them")
        if self.ground is not None and not isinstance(self.ground, GroundPlane):
            ground, (parts, combination) = admit_ground(self.ground, f"wheel '{self.frame}'"), _parts(self)
            disk = WheelDisk(self.frame, self.radius, _axle(self, robot), parts, combination)
            return on_carrier(WheelOnSurfaceRows(disk, ground, robot), self.frame, ground, robot)
        plane = None if self.ground is None or self.ground.is_default else self.ground
        rows = RollingRows(self, robot) if plane is None else _RowsOnPlane(self, plane, robot)
        return on_carrier(rows, self.frame, self.ground, robot)


class RollingRows(Rows):
    """Rows of a wheel that is bound to a robot.

    The axle is a = (x, y, z), and s is the length of its horizontal part. The wheel heads along
    ``h = (y, -x, 0) / s``, ``c = (x, y, 0) / s`` is sideways, and u is up. The contact point is at
    ``arm = radius (z c - s u)`` from the centre. With the centre's velocity v and the angular velocity w, the material
    point there has the velocity ``v + w x arm``. The rows are

        rolling   h . v - radius a . w
        lateral   c . v + radius s h . w
        vertical  u . v + radius z h . w.

    The directions h and c turn about the vertical at ``turn = w_z - z (x w_x + y w_y) / s^2``. The rows of a roller
    and of a wheel that skids are constant combinations of these rows.

    Attributes:
        wheel: name of the frame; ``frame``: its index.
        radius: radius [m]. The rows are affine in it. An estimator sets it on its own copy.
        axle: axle in the frame's own axes (3,).
    """

    on_ground = True

    def __init__(self, kind: RollingWheel, robot: Robot) -> None:
        parts, self._combination = _parts(kind)
        self._friction = _friction(kind)
        self.names = tuple(f"{part}({kind.frame})" for part in parts)
        self.units = ("m/s",) * len(parts)
        self.holonomic = tuple(part == "vertical" for part in parts)
        self.wheel, self.frame = kind.frame, robot.frame_id(kind.frame)
        self.radius = kind.radius
        self._seen: tuple[np.ndarray | None, Axle] = None, (0.0, 0.0, 0.0, 0.0)
        self.axle = _axle(kind, robot)

    def _axis(self, at: PositionKinematics) -> Axle:
        """Axle in world axes, and the length of its horizontal part."""
        seen_at, axle = self._seen
        if seen_at is not at.q:
            x, y, z = components(apply(at.rotation(self.frame), self.axle))
            s = (x * x + y * y) ** 0.5
            if smallest(s) < _FLAT:
                check_defined("a wheel lies flat on the ground", at, s, _FLAT, self.names)
            axle = x, y, z, s
            self._seen = at.q, axle  # the Jacobian and the bias acceleration share it
        return axle

    def _combined(self, rows: np.ndarray) -> np.ndarray:
        """Rows of this wheel as combinations of the rolling, lateral and vertical rows (..., 3, l)."""
        return rows if self._combination is None else self._combination @ rows

    def contact_matrix(self, at: PositionKinematics) -> np.ndarray:
        """Matrix (..., k, 6) of the rows with respect to the centre's velocity and the angular velocity, world axes."""
        x, y, z, s = self._axis(at)
        r, hx, hy = self.radius, y / s, -x / s
        return self._combined(
            packed(
                [
                    [hx, hy, 0.0, -r * x, -r * y, -r * z],
                    [-hy, hx, 0.0, r * y, -r * x, 0.0],
                    [0.0, 0.0, 1.0, r * z * hx, r * z * hy, 0.0],
                ],
                x,
            )
        )

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return product(self.contact_matrix(at), at.jacobian(self.frame))

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        x, y, z, s = self._axis(at)
        w = components(at.velocity(self.frame)[..., 3:])
        dx, dy, dz = cross(w, (x, y, z))
        r, hx, hy, turn = self.radius, y / s, -x / s, w[2] - z * (x * w[0] + y * w[1]) / (s * s)
        rate = packed(
            [
                [-turn * hy, turn * hx, 0.0, -r * dx, -r * dy, -r * dz],
                [-turn * hx, -turn * hy, 0.0, r * dy, -r * dx, 0.0],
                [0.0, 0.0, 0.0, r * (dz * hx - z * turn * hy), r * (dz * hy + z * turn * hx), 0.0],
            ],
            x,
        )
        return self._combined(rate) @ at.jacobian(self.frame) + self.contact_matrix(at) @ at.jacobian_dot(self.frame)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        x, y, z, _ = self._axis(at)
        velocity, acceleration = components(at.velocity(self.frame)), components(at.acceleration(self.frame))
        bias_acceleration = packed_vector(_bias_acceleration(self.radius, (x, y, z), velocity, acceleration), x)
        return bias_acceleration if self._combination is None else apply(self._combination, bias_acceleration)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        _, _, _, s = self._axis(at)
        height = at.placement(self.frame).translation[..., 2] - self.radius * s
        return np.asarray(height)[..., None] * self.holonomic

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        x, y, z, s = self._axis(at)
        directions = self.contact_matrix(at)[..., :3]
        arm = packed_vector([self.radius * z * x / s, self.radius * z * y / s, -self.radius * s], s)
        contact = at.placement(self.frame).translation + arm
        return np.broadcast_to(contact[..., None, :], directions.shape), directions

    def mechanisms(self) -> tuple[GroundContact]:
        return (GroundContact(self.wheel, self.radius, self.axle, friction=self._friction),)

    def phrases(self) -> Phrases:
        prevents = "slip at" if self._friction == "all" else "roll without turning"
        return Phrases("rolling wheel", prevents=prevents, where=self.wheel)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        axle = at.placement(self.frame).rotation @ self.axle
        motion, velocity, acceleration = (
            at.frame_gradients(self.frame),
            at.velocity(self.frame),
            at.acceleration(self.frame),
        )
        gradient = complex_step(
            lambda *parts: np.array(_bias_acceleration(self.radius, *parts)),
            (axle, -pin.skew(axle) @ at.jacobian(self.frame)[3:]),
            (velocity, np.vstack([motion.velocity, motion.angular_velocity])),
            (acceleration, np.vstack([motion.acceleration, motion.angular_acceleration])),
        )
        return self._combined(gradient)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        frame = attached(model, self.frame)
        combination = np.eye(3) if self._combination is None else self._combination
        return [KernelRow(Form.WHEEL, (frame,), (), [self.radius, *self.axle, *weights]) for weights in combination]


class _RowsOnPlane(RollingRows):
    """Rows of ``RollingRows`` in the axes of a plane, less the velocity of its material at the contact point."""

    def __init__(self, kind: RollingWheel, plane: GroundPlane, robot: Robot) -> None:
        super().__init__(kind, robot)
        self.ground = self._plane = plane
        self.affine = plane.moves
        self._sliding = plane.axes @ plane.velocity
        self._level = np.array_equal(plane.axes, np.eye(3))

    def _local(self, at: PositionKinematics) -> InGroundAxes:
        return at if isinstance(at, InGroundAxes) else InGroundAxes(cast(VelocityKinematics, at), self._plane)

    def contact_matrix(self, at: PositionKinematics) -> np.ndarray:
        matrix = super().contact_matrix(self._local(at))
        if isinstance(at, InGroundAxes):
            return matrix
        axes = self._plane.axes
        return np.concatenate([matrix[..., :3] @ axes, matrix[..., 3:] @ axes], axis=-1)

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return super().jacobian(self._local(at))

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return super().jacobian_dot(self._local(at))

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        bias = super().bias_acceleration(self._local(at))
        return bias - self.rate_dot(at) if self.affine else bias

    def residual(self, at: PositionKinematics) -> np.ndarray:
        return super().residual(self._local(at))

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        points, directions = super().lines_of_action(self._local(at))
        axes = self._plane.axes
        return points @ axes + np.asarray(self._plane.point), directions @ axes

    # ------------------------------------------------------------------ moving ground

    def rate(self, at: PositionKinematics) -> np.ndarray:
        if not self.affine:
            return self._zeros(at)
        local = self._local(at)
        x, y, z, s = self._axis(local)
        center = components(local.placement(self.frame).translation)
        rows = self._material((x, y, z), center)
        return self._weighted(packed_vector([*rows, 0.0 * s], s))

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        if not self.affine:
            return self._zeros(at)
        local = self._local(at)
        x, y, z, s = self._axis(local)
        center, velocity = components(local.placement(self.frame).translation), components(local.velocity(self.frame))
        return self._weighted(packed_vector(self._material_rate((x, y, z), center, velocity), s))

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        local = self._local(at)
        gradient = super().bias_acceleration_gradient(local)
        if not self.affine:
            return gradient
        place, J, motion = local.placement(self.frame), local.jacobian(self.frame), local.frame_gradients(self.frame)
        axle = place.rotation @ self.axle
        rate = complex_step(
            lambda *parts: np.array(self._material_rate(*parts)),
            (axle, -pin.skew(axle) @ J[3:]),
            (place.translation, J[:3]),
            (local.velocity(self.frame), np.vstack([motion.velocity, motion.angular_velocity])),
        )
        return gradient - self._combined(rate)

    def _weighted(self, rows: np.ndarray) -> np.ndarray:
        return rows if self._combination is None else apply(self._combination, rows)

    def _material(self, axle: Sequence[Component], center: Sequence[Component]) -> tuple[Component, Component]:
        """Velocity of the material at the contact point, along the heading and sideways."""
        x, y, z = axle
        s, spin = (x * x + y * y) ** 0.5, self._plane.spin
        u_x = self._sliding[0] - spin * (center[1] + self.radius * z * y / s)
        u_y = self._sliding[1] + spin * (center[0] + self.radius * z * x / s)
        return (y * u_x - x * u_y) / s, (x * u_x + y * u_y) / s

    def _material_rate(
        self, axle: Sequence[Component], center: Sequence[Component], velocity: Sequence[Component]
    ) -> list[Component]:
        """Rates of ``_material`` and of zero, with the linear and angular velocity of the wheel."""
        x, y, z = axle
        v_x, v_y, _, w_x, w_y, w_z = velocity
        square, spin = x * x + y * y, self._plane.spin
        s = square**0.5
        turn, rise = w_z - z * (x * w_x + y * w_y) / square, w_x * y - w_y * x
        ahead, aside = self._material(axle, center)
        # The contact point moves with the centre and, as the wheel leans and turns, along both directions.
        moved_ahead = (y * v_x - x * v_y) / s - self.radius * z * turn
        moved_aside = (x * v_x + y * v_y) / s + self.radius * rise
        return [turn * aside - spin * moved_aside, spin * moved_ahead - turn * ahead, 0.0 * x]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        plane, axes = self._plane, self._plane.axes
        motion = plane_motion(np.asarray(plane.velocity), plane.spin, axes[2], np.asarray(plane.point))
        of_plane, integers = [*axes.ravel().tolist(), *motion], (int(not self._level), int(self.affine))
        rows = super().kernel_rows(model) or []
        return [row._replace(integers=integers, numbers=[*row.numbers, *of_plane]) for row in rows]


def _friction(kind: RollingWheel) -> Friction:
    """Directions of friction on the ground."""
    if kind.roller is None:
        return "all" if kind.lateral else "longitudinal"
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
    return names, None if len(rows) == 3 else np.array(rows)


def _bias_acceleration(
    radius: float, axle: Sequence[Component], velocity: Sequence[Component], acceleration: Sequence[Component]
) -> list[Component]:
    """Rates of the three rows at zero ``vdot``, from linear (0 to 2) and angular (3 to 5) velocity and acceleration."""
    x, y, z = axle
    vx, vy, _, wx, wy, wz = velocity
    ax, ay, az, bx, by, bz = acceleration
    square = x * x + y * y
    s = square**0.5
    turn = wz - z * (x * wx + y * wy) / square
    dx, dy = wy * z - wz * y, wz * x - wx * z  # rate of the axle: angular velocity x axle
    h_v, c_v = (y * vx - x * vy) / s, (x * vx + y * vy) / s
    h_w, c_w, h_b = (y * wx - x * wy) / s, (x * wx + y * wy) / s, (y * bx - x * by) / s
    return [
        turn * c_v + (y * ax - x * ay) / s - radius * (x * bx + y * by + z * bz),
        -turn * h_v + (x * ax + y * ay) / s + radius * (y * bx - x * by + dy * wx - dx * wy),
        az + radius * (s * h_w * h_w + z * turn * c_w + z * h_b),
    ]


def _axle(kind: RollingWheel, robot: Robot) -> np.ndarray:
    """Axle in the frame's own axes (3,)."""
    return _joint_axis(kind.frame, robot) if kind.axis is None else np.asarray(np.eye(3)[axis_index(kind.axis)])


def _joint_axis(name: str, robot: Robot) -> np.ndarray:
    """Axis of the revolute joint that supports a frame, in the frame's own axes."""
    frame = robot.model.frames[robot.frame_id(name)]
    joint = robot.model.joints[frame.parentJoint]
    if joint.nv != 1:
        raise ConstraintError(
            f"joint '{robot.model.names[frame.parentJoint]}' of wheel '{name}' has no single axis: "
            "give the axle with axis='x', 'y' or 'z'"
        )
    position = Kinematics(robot).position(robot.configuration())
    axis: np.ndarray = position.jacobian(robot.frame_id(name), OWN_AXES)[3:, joint.idx_v]
    if np.linalg.norm(axis) < 0.5:
        raise ConstraintError(f"joint of wheel '{name}' is not revolute: give the axle with axis='x', 'y' or 'z'")
    return axis
