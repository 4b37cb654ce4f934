"""Rows of a wheel that rolls on a plane, upright or leaning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias, cast

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.ground_axes import InGroundAxes
from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.math.components import Component, components, cross, packed, packed_vector, smallest
from rnc_pin.math.linear_algebra import apply, complex_step, product
from rnc_pin.model.kernel_rows import Form, KernelRow, attached, plane_motion
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import Friction, GroundContact, Phrases
from rnc_pin.model.rows import Rows, check_defined
from rnc_pin.robots.robot import Robot

_FLAT = 1e-6  # sine of the angle between axle and vertical below which a wheel lies flat

Axle: TypeAlias = "tuple[Component, Component, Component, Component]"


class WheelDisk(NamedTuple):
    """Wheel without a tyre."""

    frame: str
    """Name of a frame at its centre."""
    radius: float
    """Radius [m]."""
    axle: np.ndarray
    """Axle in the frame's own axes (3,)."""
    parts: tuple[str, ...]
    """Words of the rows, (k,)."""
    combination: np.ndarray | None
    """Rows as combinations (k, 3) of the rolling, lateral and vertical rows; None for identity."""


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

    def __init__(self, disk: WheelDisk, friction: Friction, robot: Robot) -> None:
        parts, self._combination, self._friction = disk.parts, disk.combination, friction
        self.names = tuple(f"{part}({disk.frame})" for part in parts)
        self.units = ("m/s",) * len(parts)
        self.holonomic = tuple(part == "vertical" for part in parts)
        self.wheel, self.frame = disk.frame, robot.frame_id(disk.frame)
        self.radius = disk.radius
        self._seen: tuple[np.ndarray | None, Axle] = None, (0.0, 0.0, 0.0, 0.0)
        self.axle = disk.axle

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


class RowsOnPlane(RollingRows):
    """Rows of ``RollingRows`` in the axes of a plane, less the velocity of its material at the contact point."""

    def __init__(self, disk: WheelDisk, friction: Friction, plane: GroundPlane, robot: Robot) -> None:
        super().__init__(disk, friction, robot)
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
