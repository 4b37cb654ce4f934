"""Bodies with smooth convex surfaces that roll without slip on planes and on curved surfaces, and casters."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from threading import get_ident
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import Form, KernelRow, attached, wrench_rows
from rnc_pin.constraints.ground_plane import GroundPlane, admit_plane, on_carrier
from rnc_pin.constraints.surfaces import (
    BodyShape,
    CurvedGround,
    CylindricalGround,
    Sphere,
    SphericalGround,
    admit_ground,
    check_positive,
    scalar_product,
    support_numbers,
)
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import Component, Entry, apply, components, cross, dot, vector_product
from rnc_pin.model.frame_rows import FLAT, ConstantWrenchRows, WrenchRows, evaluated, point_name, rate_of, triple
from rnc_pin.model.input_validation import NotNegative, Positive, Vector
from rnc_pin.model.kinematics import Placement, PositionKinematics
from rnc_pin.model.rows import GroundContact, Rows, check_defined
from rnc_pin.robots.robot import Robot

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

    def directions(self) -> list[Sequence[Component]]:
        """Arm, normal and ``along`` by their components."""
        return [components(each) for each in (self.arm, self.normal, self.along)]


def contact_axes(normal: Sequence[Entry], along: Sequence[Entry]) -> list[Sequence[Entry]]:
    """Two axes along the ground and its normal, (3,) each.

    Args:
        normal: unit normal of the ground (3,).
        along: direction (3,) whose projection on the surface is the first axis.
    """
    leaning = dot(normal, along)
    across = [a - leaning * n for a, n in zip(along, normal, strict=True)]
    length = dot(across, across) ** 0.5
    first = [each / length for each in across]
    return [first, cross(normal, first), normal]


def contact_wrenches(arm: Sequence[Entry], normal: Sequence[Entry], along: Sequence[Entry]) -> list[list[Entry]]:
    """Wrenches (4, 6) of a contact: forces along its axes at an arm, and a torque about its normal.

    Args:
        arm: vector from the frame's origin to the contact point (3,).
        normal: unit normal of the ground (3,).
        along: direction (3,) whose projection on the surface is the first axis.
    """
    return [*([*axis, *cross(arm, axis)] for axis in contact_axes(normal, along)), [0.0, 0.0, 0.0, *normal]]


def curved_gradient(away: Sequence[Entry], scale: Entry, axis: Sequence[Entry]) -> list[Entry]:
    """Gradient (3,) of the level of a sphere or cylinder, at a vector ``away`` from a point of its axis.

    Args:
        away: vector from a point of the axis to the place (3,) [m].
        scale: one over the radius of the ground, negative inside [1/m].
        axis: unit axis of a cylinder (3,); zero for a sphere.
    """
    height = dot(axis, away)
    return [scale * (u - height * a) for u, a in zip(away, axis, strict=True)]


def curved_wrench(
    away: Sequence[Entry],
    along: Sequence[Entry],
    scale: Entry,
    axis: Sequence[Entry],
    radius: Entry,
    weights: Sequence[Entry],
) -> list[Entry]:
    """Wrench (6,) of a ball on a sphere or cylinder, about the centre of the ball.

    The gradient of the level at this centre has the direction of the normal n at the contact, which is at ``-radius n``
    from the centre. So no equation has to be solved, other than for bodies of any form.

    Args:
        away: vector from a point of the axis of the ground to the centre of the ball (3,).
        along: direction (3,) whose projection on the surface is the first axis of the contact.
        scale: one over the radius of the ground, negative inside.
        axis: axis of a cylinder (3,); zero for a sphere.
        radius: radius of the ball.
        weights: weights (4,) of the forces along both axes and the normal, and of the torque about the normal.
    """
    # Both levels are quadratic forms, so that their gradients at the centre and at the contact are parallel.
    gradient = curved_gradient(away, scale, axis)
    length = dot(gradient, gradient) ** 0.5
    normal = [each / length for each in gradient]
    forces = zip(*contact_axes(normal, along), strict=True)
    force = [weights[0] * a + weights[1] * b + weights[2] * n for a, b, n in forces]
    arm = [-radius * n for n in normal]
    return [*force, *(m + weights[3] * n for m, n in zip(cross(arm, force), normal, strict=True))]


_PARTS = ("rolling_x", "rolling_y", "vertical", "pivoting")


class BodyContactRows(WrenchRows):
    """Rows of a body at its contact with the ground: two rolling rows, a vertical row, and one about the normal."""

    on_ground = True

    def name_rows(self, frame: str, center: np.ndarray, parts: Sequence[str]) -> None:
        """Name the rows of a contact below a point of a frame.

        Args:
            frame: name of the body's frame.
            center: point of the frame (3,), in its own axes [m].
            parts: word of each row.
        """
        self.names = tuple(f"{part}({point_name(frame, center)})" for part in parts)
        self.units = tuple("rad/s" if part == "pivoting" else "m/s" for part in parts)
        self.holonomic = tuple(part == "vertical" for part in parts)

    @abstractmethod
    def contact_axes(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Contact point (..., 3) in the world, and the axes there as rows (..., 3, 3).

        Args:
            at: kinematics of the configurations.
        """

    def lines_of_action(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        contact, axes = self.contact_axes(at)
        # Pivoting is a torque: it has no line of action.
        points = np.full((*contact.shape[:-1], len(self.names), 3), np.nan)
        directions = points.copy()
        points[..., :3, :], directions[..., :3, :] = contact[..., None, :], axes
        return points, directions


class SurfaceContactRows(BodyContactRows):
    """Rows ``axes (v + w x arm) = axes u`` and, without pivoting, ``n . w = n . W``, with axes that follow the surface.

    The point g of the surface, with the normal n, and the body's point with the outward normal -n are a distance d
    apart along n: ``origin + arm(-n) = g + d n``. Newton's method solves this for g and d. Its derivative gives their
    rates. Body and ground touch at one point if the body is curved more than the ground. A plane is ground without
    curvature, where the first step ends the search.

    Args:
        frame: name of the body's frame.
        shape: the body's surface.
        placement: placement of the shape on the frame.
        pivots: True if the body may turn about the normal.
        ground: the surface, whose material moves as a rigid body with the velocity u and the angular velocity W.
        robot: the robot.
    """

    def __init__(
        self, frame: str, shape: BodyShape, placement: pin.SE3, pivots: bool, ground: CurvedGround, robot: Robot
    ) -> None:
        self._shape, self.frame = shape, robot.frame_id(frame)
        self._center, self._turned = placement.translation, placement.rotation
        self._surface = ground
        self.ground = None if isinstance(ground, GroundPlane) and ground.is_default else ground
        if ground.moves:
            velocity = np.asarray(ground.material_velocity(np.zeros(3)), dtype=float)
            self.affine, self.twist = True, np.concatenate([velocity, np.asarray(ground.angular_velocity, dtype=float)])
        self.name_rows(frame, self._center, _PARTS[: 3 if pivots else 4])
        # The Jacobian and the bias acceleration of a thread share the contact.
        self._seen: dict[int, tuple[np.ndarray, SurfaceContact]] = {}

    # ------------------------------------------------------------------ contact point; formulas take complex numbers

    def _at(self, rotation: np.ndarray, point: np.ndarray, gap: np.ndarray) -> SurfaceContact:
        """Both surfaces where the ground has the normal of one of its points."""
        gradient = self._surface.gradient(point)
        length = scalar_product(gradient, gradient) ** 0.5
        normal = gradient / length
        bent = self._surface.hessian(point) / length[..., None]
        # Shape operator of the ground: rate of the unit normal along the surface, from the Hessian without its normal
        # part.
        turning = bent - normal[..., :, None] * (normal[..., None, :] @ bent)
        axes = rotation @ self._turned
        outward = -apply(axes.mT, normal)
        arm = apply(rotation, self._center) + apply(axes, self._shape.point(outward))
        each = np.broadcast_to(outward[..., None, :], (*outward.shape[:-1], 3, 3))
        columns = self._shape.point_rate(each, axes)  # along the world's x, y and z
        return SurfaceContact(point, gap, normal, turning, arm, axes @ columns.mT, self._direction(normal))

    def _stepped(self, origin: np.ndarray, found: SurfaceContact) -> tuple[np.ndarray, np.ndarray]:
        """Newton step (..., 3) and (...) of point and gap."""
        apart = origin + found.arm - found.point - found.gap[..., None] * found.normal
        # Two right sides, one factorisation: the step for a fixed gap, and its change for a wider one.
        solved = _solve(found.relative, np.stack([apart, found.normal], axis=-1))
        gradient = self._surface.gradient(found.point)
        to_gap = self._surface.level(found.point) + scalar_product(gradient, solved[..., 0])[..., 0]
        wider = to_gap / scalar_product(gradient, solved[..., 1])[..., 0]
        return solved[..., 0] - wider[..., None] * solved[..., 1], wider

    def _solved(self, at: PositionKinematics) -> SurfaceContact:
        """Contact at configurations; raises an error if it is not one point."""
        rotation, origin = at.placement(self.frame)
        most_steps, accurate = 60, 1e-12  # Newton steps, and the last one relative to the size of the contact
        with np.errstate(all="ignore"):
            # The nearest point to the centre is the solution for a ball, and near it for other bodies.
            point = self._surface.below(origin + apply(rotation, self._center))
            found = self._at(rotation, point, np.zeros(point.shape[:-1]))
            # The first gap is the distance along the normal: for a ball it is exact, and Newton's method ends at once.
            gap = scalar_product(origin + found.arm - point, found.normal)[..., 0]
            found = found._replace(gap=gap)
            size = np.linalg.norm(found.arm, axis=-1) + np.linalg.norm(point, axis=-1)
            for _ in range(most_steps):
                moved, wider = self._stepped(origin, found)
                found = self._at(rotation, found.point + moved, found.gap + wider)
                last = np.linalg.norm(moved, axis=-1) + np.abs(wider)
                if not (last > accurate * size).any():
                    break
            # A state that is not finite passes here: other checks name it.
            known = np.where(np.isnan(at.q).any(axis=-1), np.nan, (last <= 1e3 * accurate * size).astype(float))
            regularity = self._shape.regularity(-apply((rotation @ self._turned).mT, found.normal))
            # A body may be flat, where its arm is not a number, or curved no more than the ground below it.
            separate = np.fmin(regularity, _smaller_eigenvalue(found.relative))
        what = "the ground" if isinstance(self._surface, GroundPlane) else "curved ground"
        check_defined(f"a body touches {what} at more than one point", at.q, separate, FLAT, self.names)
        check_defined(f"the contact of a body with {what} is not found", at.q, known, FLAT, self.names)
        return found

    def _contact(self, at: PositionKinematics) -> SurfaceContact:
        seen = self._seen.get(get_ident())
        # Identity of the array means the same state: arrays of a state are not written to.
        if seen is None or seen[0] is not at.q:
            seen = self._seen[get_ident()] = at.q, self._solved(at)
        return seen[1]

    def _rates(self, found: SurfaceContact, v: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates (..., 3) of the arm and of the normal, for velocities of the frame (..., 3)."""
        turned = apply(found.spread, vector_product(w, found.normal))
        moved = v + vector_product(w, found.arm)
        # Only what moves along the surface moves the contact point; the rest opens or closes the gap.
        along = moved + turned - scalar_product(found.normal, moved) * found.normal
        normal = apply(found.turning, _solve(found.relative, along[..., None])[..., 0])
        return vector_product(w, found.arm) + turned - apply(found.spread, normal), normal

    def _direction(self, normal: np.ndarray) -> np.ndarray:
        """Direction (..., 3) that is projected on the surface: a constant one, or another where that has no length."""
        along = self._surface.along
        other = _EYE[int(np.argmin(np.abs(along)))]
        leaning = 0.9  # cosine of 26 degrees: nearer to the direction, its projection on the surface gets short
        return np.where(np.abs(scalar_product(normal, along)) > leaning, other, along)

    # ------------------------------------------------------------------ rows

    def check_defined(self, at: PositionKinematics) -> None:
        """Raise a ``SingularityError`` if body and ground do not touch at one point.

        Args:
            at: kinematics of the configurations.
        """
        self._contact(at)

    def _found(self, place: Placement) -> SurfaceContact:
        """Contact at the placements for which it was checked. One Newton step from there gives its derivatives."""
        found = self._seen[get_ident()][1]
        # Newton's method converges quadratically: one step with complex numbers gives exact first derivatives.
        if not np.iscomplexobj(place.rotation):
            return found
        origin = place.translation
        point, gap = np.broadcast_to(found.point, origin.shape), np.broadcast_to(found.gap, origin.shape[:-1])
        moved, wider = self._stepped(origin, self._at(place.rotation, point.astype(complex), gap))
        return self._at(place.rotation, found.point + moved, found.gap + wider)

    def wrench(self, place: Placement) -> np.ndarray:
        found = self._found(place)
        return evaluated(contact_wrenches, found.directions())[..., : len(self.names), :]

    def wrench_rate(self, place: Placement, velocity: np.ndarray) -> np.ndarray:
        found = self._found(place)
        rates = [components(each) for each in self._rates(found, velocity[..., :3], velocity[..., 3:])]
        # The axes follow the surface: the direction that is projected on it is constant.
        return rate_of(contact_wrenches, found.directions(), [*rates, [0.0] * 3])[..., : len(self.names), :]

    def residual(self, at: PositionKinematics) -> np.ndarray:
        return np.asarray(self._contact(at).gap[..., None] * self.holonomic)

    # ------------------------------------------------------------------ descriptions

    def contact_axes(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        found = self._contact(at)
        _, *directions = found.directions()
        return at.placement(self.frame).translation + found.arm, evaluated(contact_axes, directions)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        """Rows of the kernel for a known shape on a plane, or a ball on a sphere or cylinder; None for other ones.

        Args:
            model: model of the robot.
        """
        shape, ground, support = self._shape, self._surface, support_numbers(self._shape)
        if isinstance(ground, GroundPlane) and support is not None:
            frame, normal = attached(model, self.frame, pin.SE3(self._turned, self._center)), ground.axes[2]
            numbers = [[*axis, *normal, *support] for axis in ground.axes]
            pivot = wrench_rows(Form.WORLD, frame, [[0.0, 0.0, 0.0, *normal]], self.twist)
            return [*wrench_rows(Form.ROLLING, frame, numbers, self.twist), *pivot][: len(self.names)]
        if type(shape) is not Sphere:  # a subclass may have methods of its own
            return None
        if type(ground) is SphericalGround:
            axis, point = np.zeros(3), ground.center
        elif type(ground) is CylindricalGround:
            axis, point = ground.along, ground.point
        else:
            return None
        scale = (-1.0 if ground.inside else 1.0) / ground.radius
        quadric = [*map(float, point), scale, *axis.tolist(), float(shape.radius)]
        numbers = [[*quadric, *weights] for weights in np.eye(4)[: len(self.names)].tolist()]
        return wrench_rows(Form.CURVED, attached(model, self.frame, pin.SE3(_EYE, self._center)), numbers, self.twist)


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution (..., 3, k); NaN if a matrix is exactly singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.full(np.broadcast_shapes(matrix.shape[:-1], right.shape[:-1]) + right.shape[-1:], np.nan)


def _smaller_eigenvalue(matrix: np.ndarray) -> np.ndarray:
    """Smaller eigenvalue (...) besides the one along the normal, which is one."""
    # The normal is an eigenvector with eigenvalue one, so trace and determinant leave a quadratic equation.
    total, product = np.trace(matrix, axis1=-2, axis2=-1) - 1.0, np.linalg.det(matrix)
    return np.asarray((total - np.sqrt(np.maximum(total**2 - 4 * product, 0.0))) / 2)


# ---------------------------------------------------------------------- bodies that roll


@dataclass(frozen=True)
class RollingBody:
    """Body whose contact point has the velocity of the ground: two rolling rows and a vertical row.

    The contact point is where the surface has its lowest point above the ground, so it moves over the body. The
    vertical row is holonomic: the surface touches the ground. The body has to be curved more than curved ground.

    Args:
        frame: name of a frame of the body.
        shape: ``Sphere``, ``Ellipsoid``, ``Torus``, or an object with the methods of a ``BodyShape``.
        at: centre of the shape in the frame's axes [m].
        rpy: orientation of the shape relative to the frame: roll, pitch and yaw as in a URDF [rad].
        pivoting: False to add a row: the body does not turn about the normal relative to the ground, as soft contact
            areas prevent.
        ground: a ``GroundPlane``, ``SphericalGround``, ``CylindricalGround``, or an object
            with the methods of a ``CurvedGround``; None for z = 0 at rest. A frame can carry it.

    Raises:
        ModelError: unknown frame.
        ConstraintError: a shape without the methods of a ``BodyShape``, or a ground of another kind.
        SingularityError: during evaluation, the contact is not one point, e.g. a disk lies flat.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> egg = rnc.RollingBody("ball", rnc.Ellipsoid((0.2, 0.2, 0.3)))
        >>> reduced = rnc.NonholonomicSystem(robot, [egg]).reduce()
        >>> q = reduced.assembled(robot.configuration({"root_joint": [0, 0, 1, 0, 0, 0, 1]}))
        >>> q[2].round(3)  # height of the centre
        np.float64(0.3)
    """

    frame: str
    shape: BodyShape
    at: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)
    pivoting: bool = True
    ground: GroundPlane | CurvedGround | None = None

    def bind(self, robot: Robot) -> Rows:
        # Protocols are not checked at run time: a missing method would fail at the first evaluation, far from its
        # cause.
        missing = [name for name in ("point", "point_rate", "regularity") if not hasattr(self.shape, name)]
        if missing or isinstance(self.shape, type):
            raise ConstraintError(
                f"shape of rolling body '{self.frame}': expected Sphere, Ellipsoid, Torus or an object "
                f"with the methods point, point_rate and regularity, found {self.shape!r}"
            )
        ground = admit_ground(self.ground or GroundPlane(), f"rolling body '{self.frame}'")
        center = triple(self.at, f"centre of rolling body '{self.frame}'")
        turned = pin.rpy.rpyToMatrix(triple(self.rpy, f"rpy of rolling body '{self.frame}'"))
        rows = SurfaceContactRows(self.frame, self.shape, pin.SE3(turned, center), self.pivoting, ground, robot)
        return on_carrier(rows, self.frame, self.ground, robot)


@dataclass(frozen=True)
class RollingBall:
    """Ball whose contact point has the velocity of the ground: two rolling rows and a vertical row.

    The contact point is ``radius`` below the centre at any attitude. The rows are the velocity of the material point
    there along the world's x, y and z, or along the axes of the ground. The vertical row is holonomic: the centre stays
    at height ``radius``. For a planar base on level ground, it is zero and is dropped.

    Args:
        frame: a frame at the centre of the ball that turns with it.
        radius: radius of the ball [m].
        ground: a plane, or curved ground as of a ``RollingBody``; None for z = 0 at rest.

    Raises:
        ModelError: unknown frame.
        ConstraintError: the radius is not positive, or a ground of another kind.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", radius=0.3)])
        >>> reduced = system.reduce([rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"])
        >>> q = robot.configuration({"root_joint": [0, 0, 0.3, 0, 0, 0, 1]})
        >>> reduced.at(q, [0.0, 2.0, 0.0]).v[[0, 4]].round(3)  # as it turns about y it goes along x
        array([0.6, 2. ])
    """

    frame: str
    radius: Positive
    ground: GroundPlane | CurvedGround | None = None

    def bind(self, robot: Robot) -> Rows:
        check_positive(f"radius of ball '{self.frame}'", self.radius)
        if self.ground is None or isinstance(self.ground, GroundPlane):
            rows = _BallRows(self.frame, self.radius, _PARTS[:3], self.ground or GroundPlane(), robot)
            return on_carrier(rows, self.frame, self.ground, robot)
        # On curved ground the arm turns with the normal below the ball: a ball there is a body like any other.
        return RollingBody(self.frame, Sphere(self.radius), ground=self.ground).bind(robot)


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
        check_positive(f"radius of caster '{self.frame}'", self.radius, or_zero=True)
        plane = admit_plane(self.ground, f"caster '{self.frame}'")
        rows = _BallRows(self.frame, self.radius, ("vertical",), plane, robot)
        return on_carrier(rows, self.frame, self.ground, robot)


class _BallRows(BodyContactRows, ConstantWrenchRows):
    """Velocity of the material at a constant arm from the centre of a ball, along the axes of a plane.

    Args:
        frame: name of a frame at the centre of the ball.
        radius: radius [m].
        parts: word of each row; a caster has the last row only, on which motion of the ground has no effect.
        plane: the plane.
        robot: the robot.
    """

    def __init__(self, frame: str, radius: float, parts: Sequence[str], plane: GroundPlane, robot: Robot) -> None:
        self.frame, self.ground = robot.frame_id(frame), None if plane.is_default else plane
        self.name_rows(frame, np.zeros(3), parts)
        slides = len(parts) == 1
        if not slides:
            self.twist, self.affine = plane.twist, plane.moves
        self._point, self._axes, self._normal = np.asarray(plane.point), plane.axes[-len(parts) :], plane.axes[2]
        self._arm = -radius * self._normal
        # The arm is constant in the world, so the rows are constant wrenches.
        self.matrix = np.hstack([self._axes, np.cross(self._arm, self._axes)])
        self._contact_of_body = GroundContact(frame, radius, friction="none" if slides else "all")

    def contact_axes(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        return at.placement(self.frame).translation + self._arm, self._axes

    def residual(self, at: PositionKinematics) -> np.ndarray:
        contact, _ = self.contact_axes(at)
        return np.asarray(((contact - self._point) @ self._normal)[..., None] * self.holonomic)

    def mechanisms(self) -> tuple[GroundContact]:
        return (self._contact_of_body,)
