"""Rows of a body that rolls without slip on a curved surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.body_shapes import BodyShape
from rnc_pin.constraints.curved_grounds import CurvedGround
from rnc_pin.math.linear_algebra import apply, complex_step, cross_columns, vector_product
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import Phrases
from rnc_pin.model.offset_frame import point_name
from rnc_pin.model.rows import Rows, check_defined
from rnc_pin.robots.robot import Robot

_STEPS, _ACCURATE = 60, 1e-12  # Newton steps, and the last one relative to the size of the contact
_FLAT = 1e-6  # smallest relative curvature of body and ground
_LEANS = 0.9  # component of the normal along a direction above which another direction is projected on the surface
_EYE = np.eye(3)


class SurfaceContact(NamedTuple):
    """Contact of body and surface: nearest points, in world axes."""

    point: np.ndarray
    """Point g of the surface (..., 3) [m]."""
    gap: np.ndarray
    """Distance d of the body from the surface (...) [m]."""
    normal: np.ndarray
    """Normal n of the surface (..., 3), out of the ground."""
    turning: np.ndarray
    """Derivative K of the normal by the point, (..., 3, 3)."""
    arm: np.ndarray
    """From the frame's origin to the contact point of the body (..., 3)."""
    spread: np.ndarray
    """Derivative B of that point by the body's outward normal, (..., 3, 3)."""
    along: np.ndarray
    """Direction (..., 3) whose projection on the surface is the first axis."""

    @property
    def relative(self) -> np.ndarray:
        """Matrix M = I + (B + d) K of the nearest points (..., 3, 3)."""
        return np.asarray(_EYE + (self.spread + self.gap[..., None, None] * _EYE) @ self.turning)


class SurfaceContactRows(Rows):
    """Rows ``axes (v + w x arm) = axes u`` and, without pivoting, ``n . w = n . W``, with axes that follow the surface.

    The point g of the surface, with the normal n, and the body's point with the outward normal -n are a distance d
    apart along n: ``origin + arm(-n) = g + d n``. Newton's method solves this for g and d. Its derivative gives their
    rates. Body and ground touch at one point if the body is curved more than the ground.

    Args:
        frame: name of the body's frame.
        shape: the body's surface.
        placement: placement of the shape on the frame.
        pivots: True if the body may turn about the normal.
        ground: the surface, whose material has the velocity u and the angular velocity W.
        robot: the robot.
    """

    on_ground = True

    def __init__(
        self, frame: str, shape: BodyShape, placement: pin.SE3, pivots: bool, ground: CurvedGround, robot: Robot
    ) -> None:
        self._shape, self._body, self._frame = shape, frame, robot.frame_id(frame)
        self._center, self._turned, self._pivots = placement.translation, placement.rotation, pivots
        self.ground = self._surface = ground
        self.affine = ground.moves
        self._angular = np.asarray(ground.angular_velocity, dtype=float)
        parts = ("rolling_x", "rolling_y", "vertical", "pivoting")[: 3 if pivots else 4]
        self.names = tuple(f"{part}({point_name(frame, self._center)})" for part in parts)
        self.units = ("m/s",) * 3 + ("rad/s",) * (len(parts) - 3)
        self.holonomic = tuple(part == "vertical" for part in parts)
        self._seen: tuple[np.ndarray | None, SurfaceContact | None] = None, None

    # ------------------------------------------------------------------ contact point; formulas take complex numbers

    def _at(self, rotation: np.ndarray, point: np.ndarray, gap: np.ndarray) -> SurfaceContact:
        """Both surfaces where the ground has the normal of one of its points."""
        gradient = self._surface.gradient(point)
        length = _dot(gradient, gradient) ** 0.5
        normal = gradient / length
        bent = self._surface.hessian(point) / length[..., None]
        turning = bent - normal[..., :, None] * (normal[..., None, :] @ bent)
        axes = rotation @ self._turned
        outward = -apply(axes.mT, normal)
        arm = apply(rotation, self._center) + apply(axes, self._shape.point(outward))
        each = np.broadcast_to(outward[..., None, :], (*outward.shape[:-1], 3, 3))
        columns = self._shape.point_rate(each, axes)  # along the world's x, y and z
        return SurfaceContact(point, gap, normal, turning, arm, axes @ columns.mT, self._direction(rotation, normal))

    def _stepped(self, origin: np.ndarray, found: SurfaceContact) -> tuple[np.ndarray, np.ndarray]:
        """Newton step (..., 3) and (...) of point and gap."""
        apart = origin + found.arm - found.point - found.gap[..., None] * found.normal
        solved = _solve(found.relative, np.stack([apart, found.normal], axis=-1))
        gradient = self._surface.gradient(found.point)
        to_gap = self._surface.level(found.point) + _product(gradient, solved[..., 0])
        wider = to_gap / _product(gradient, solved[..., 1])
        return solved[..., 0] - wider[..., None] * solved[..., 1], wider

    def _solved(self, at: PositionKinematics) -> SurfaceContact:
        """Contact at configurations; raises an error if it is not one point."""
        rotation, origin = at.placement(self._frame)
        with np.errstate(all="ignore"):
            point = self._surface.below(origin + apply(rotation, self._center))
            found = self._at(rotation, point, np.zeros(point.shape[:-1]))
            gap = _product(origin + found.arm - point, found.normal)
            found = found._replace(gap=gap)
            size = np.linalg.norm(found.arm, axis=-1) + np.linalg.norm(point, axis=-1)
            for _ in range(_STEPS):
                moved, wider = self._stepped(origin, found)
                found = self._at(rotation, found.point + moved, found.gap + wider)
                last = np.linalg.norm(moved, axis=-1) + np.abs(wider)
                if not (last > _ACCURATE * size).any():
                    break
            known = np.where(np.isnan(at.q).any(axis=-1), np.nan, (last <= 1e3 * _ACCURATE * size).astype(float))
            check_defined("the contact of a body with curved ground is not found", at, known, _FLAT, self.names)
            regularity = self._shape.regularity(-apply((rotation @ self._turned).mT, found.normal))
            separate = np.minimum(regularity, _smaller_eigenvalue(found.relative))
        check_defined("a body touches curved ground at more than one point", at, separate, _FLAT, self.names)
        return found

    def _contact(self, at: PositionKinematics) -> SurfaceContact:
        seen_at, found = self._seen
        if found is None or seen_at is not at.q:
            found = self._solved(at)
            self._seen = at.q, found  # the Jacobian and the bias acceleration share it
        return found

    def _rates(self, found: SurfaceContact, v: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates (..., 3) of the arm and of the normal, for velocities of the frame (..., 3)."""
        turned = apply(found.spread, vector_product(w, found.normal))
        moved = v + vector_product(w, found.arm)
        along = moved + turned - _dot(found.normal, moved) * found.normal
        normal = apply(found.turning, _solve(found.relative, along[..., None])[..., 0])
        return vector_product(w, found.arm) + turned - apply(found.spread, normal), normal

    def _axes(self, found: SurfaceContact) -> np.ndarray:
        """Two directions along the surface and its normal, as rows (..., 3, 3)."""
        direction, normal = found.along, found.normal
        along = direction - normal * _dot(normal, direction)
        first = along / _dot(along, along) ** 0.5
        return np.stack([first, vector_product(normal, first), normal], axis=-2)

    def _axes_rate(self, found: SurfaceContact, rate: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Rate of the axes (..., 3, 3) for a rate of the normal (..., 3) and the body's angular velocity (..., 3)."""
        direction, normal, moved = found.along, found.normal, self._direction_rate(found, w)
        along = direction - normal * _dot(normal, direction)
        length = _dot(along, along) ** 0.5
        first, leaning = along / length, _dot(rate, direction) + _dot(normal, moved)
        turned = moved - rate * _dot(normal, direction) - normal * leaning
        turned = (turned - first * _dot(first, turned)) / length
        return np.stack([turned, vector_product(rate, first) + vector_product(normal, turned), rate], axis=-2)

    def _direction(self, rotation: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Direction (..., 3) that is projected on the surface: a constant one, or another where that has no length."""
        along = self._surface.along
        other = _EYE[int(np.argmin(np.abs(along)))]
        return np.where(np.abs(_dot(normal, along)) > _LEANS, other, along)

    def _direction_rate(self, found: SurfaceContact, w: np.ndarray) -> np.ndarray:
        """Rate of the direction (..., 3) for an angular velocity of the body (..., 3)."""
        return np.zeros_like(w)

    # ------------------------------------------------------------------ rows

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        found = self._contact(at)
        return self._rows(at.jacobian(self._frame), found.arm, self._axes(found))

    def _rows(self, J: np.ndarray, arm: np.ndarray, axes: np.ndarray) -> np.ndarray:
        rows = axes @ (J[..., :3, :] - cross_columns(arm, J[..., 3:, :]))
        return rows if self._pivots else np.concatenate([rows, axes[..., 2:, :] @ J[..., 3:, :]], axis=-2)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        found, J, velocity = self._contact(at), at.jacobian(self._frame), at.velocity(self._frame)
        arm_rate, normal_rate = self._rates(found, velocity[..., :3], velocity[..., 3:])
        axes = self._axes(found)
        rows = self._rows(at.jacobian_dot(self._frame), found.arm, axes)
        rows += self._rows(J, found.arm, self._axes_rate(found, normal_rate, velocity[..., 3:]))
        rows[..., :3, :] -= axes @ cross_columns(arm_rate, J[..., 3:, :])
        return rows

    def rate(self, at: PositionKinematics) -> np.ndarray:
        if not self.affine:
            return self._zeros(at)
        found = self._contact(at)
        place = at.placement(self._frame).translation + found.arm
        return self._components(
            self._axes(found),
            self._surface.material_velocity(place),
            np.broadcast_to(self._angular, place.shape),
        )

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        if not self.affine:
            return self._zeros(at)
        found, velocity = self._contact(at), at.velocity(self._frame)
        arm_rate, normal_rate = self._rates(found, velocity[..., :3], velocity[..., 3:])
        place = at.placement(self._frame).translation + found.arm
        spinning = np.broadcast_to(self._angular, place.shape)
        turned = vector_product(self._angular, velocity[..., :3] + arm_rate)
        return self._components(self._axes(found), turned, np.zeros_like(turned)) + self._components(
            self._axes_rate(found, normal_rate, velocity[..., 3:]), self._surface.material_velocity(place), spinning
        )

    def _components(self, axes: np.ndarray, linear: np.ndarray, angular: np.ndarray) -> np.ndarray:
        rows = apply(axes, linear)
        return rows if self._pivots else np.concatenate([rows, _dot(axes[..., 2, :], angular)], axis=-1)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        place = at.placement(self._frame).translation
        return self._bias(self._contact(at), place, at.velocity(self._frame), at.acceleration(self._frame))

    def _bias(
        self, found: SurfaceContact, origin: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        v, w, angular = velocity[..., :3], velocity[..., 3:], acceleration[..., 3:]
        arm_rate, normal_rate = self._rates(found, v, w)
        linear = acceleration[..., :3] + vector_product(angular, found.arm) + vector_product(w, arm_rate)
        slip, spinning = v + vector_product(w, found.arm), w
        if self.affine:
            linear = linear - vector_product(self._angular, v + arm_rate)
            slip, spinning = slip - self._surface.material_velocity(origin + found.arm), w - self._angular
        rates = self._components(self._axes_rate(found, normal_rate, w), slip, spinning)
        return self._components(self._axes(found), linear, angular) + rates

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        motion, (rotation, origin), found = (
            at.frame_gradients(self._frame),
            at.placement(self._frame),
            self._contact(at),
        )
        J = at.jacobian(self._frame)
        turned = np.cross(J[3:, None, :], rotation[:, :, None], axis=0)  # (3, 3, nv)

        def bias(flat: np.ndarray, place: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
            R = flat.reshape(3, 3)
            # One Newton step from the solution gives the first derivative of the contact exactly.
            moved, wider = self._stepped(place, self._at(R, found.point.astype(complex), found.gap))
            return self._bias(self._at(R, found.point + moved, found.gap + wider), place, velocity, acceleration)

        return complex_step(
            bias,
            (rotation.ravel(), turned.reshape(9, -1)),
            (origin, J[:3]),
            (at.velocity(self._frame), np.vstack([motion.velocity, motion.angular_velocity])),
            (at.acceleration(self._frame), np.vstack([motion.acceleration, motion.angular_acceleration])),
        )

    def residual(self, at: PositionKinematics) -> np.ndarray:
        return np.asarray(self._contact(at).gap[..., None] * self.holonomic)

    # ------------------------------------------------------------------ descriptions

    def _contact_axes(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Contact point (..., 3), and the axes there as rows (..., 3, 3)."""
        found = self._contact(at)
        return at.placement(self._frame).translation + found.arm, self._axes(found)

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact, axes = self._contact_axes(at)
        points = np.full((*contact.shape[:-1], len(self.names), 3), np.nan)
        directions = points.copy()
        points[..., :3, :], directions[..., :3, :] = contact[..., None, :], axes
        return points, directions

    def phrases(self) -> Phrases:
        return Phrases("rolling body", prevents="slip at", where=self._body)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product (...) without conjugation."""
    return np.asarray((a * b).sum(axis=-1))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product (..., 1), a factor of vectors."""
    return _product(a, b)[..., None]


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution (..., 3, k); NaN if a matrix is exactly singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.full(np.broadcast_shapes(matrix.shape[:-1], right.shape[:-1]) + right.shape[-1:], np.nan)


def _smaller_eigenvalue(matrix: np.ndarray) -> np.ndarray:
    """Smaller eigenvalue (...) besides that of the normal, which is one."""
    total, product = np.trace(matrix, axis1=-2, axis2=-1) - 1.0, np.linalg.det(matrix)
    return np.asarray((total - np.sqrt(np.maximum(total**2 - 4 * product, 0.0))) / 2)
