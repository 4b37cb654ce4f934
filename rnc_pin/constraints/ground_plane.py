"""Plane on which bodies roll, ground of any form that another body carries, and rows of a wheel that rolls on a plane.

A plane may slope, slide like a conveyor, or turn like a turntable. A wheel may be upright or lean. The kinds that users
name, such as ``RollingWheel``, are in ``wheels_and_blades``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import Form, KernelRow, attached, wrench_rows
from rnc_pin.errors import ConfigurationError, ConstraintError
from rnc_pin.math.linear_algebra import Entry, cross, dot
from rnc_pin.model.frame_rows import FLAT, DirectionRows, frame_direction, triple
from rnc_pin.model.input_validation import Vector, is_number
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.relative_rows import RelativeRows
from rnc_pin.model.rows import Friction, GroundContact, GroundSurface, Rows, carrier_of, check_defined
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class GroundPlane:
    """Plane whose material may slide in it and turn about its normal. It has a constant place, or a frame carries it.

    Args:
        normal: direction out of the ground, in world axes; its length has no meaning.
        point: a point of the plane, about which it turns [m].
        velocity: velocity of the material at ``point`` [m/s], along the plane.
        spin: angular velocity of the material about the normal [rad/s].
        frame: name of a frame of the robot that carries the plane, e.g. a table that tilts. Its axes and origin then
            stand for the axes of the world, and motion is relative to it. None for the world.

    Raises:
        ConfigurationError: not three finite numbers, a normal of no length, or a velocity out of the plane.

    Example:
        >>> slope = rnc.GroundPlane(normal=(0.0, -0.1, 1.0))
        >>> turntable = rnc.GroundPlane(spin=2.0)
    """

    normal: Vector = (0.0, 0.0, 1.0)
    point: Vector = (0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    spin: float = 0.0
    frame: str | None = None

    def __post_init__(self) -> None:
        normal = frame_direction(self.normal, "normal of the ground")
        triple(self.point, "point of the ground")
        velocity = triple(self.velocity, "velocity of the ground")
        across = float(velocity @ normal)
        rounding = 1e-9  # part of the speed across the plane that comes from a normal of finite precision
        if abs(across) > rounding * max(1.0, float(np.linalg.norm(velocity))):
            raise ConfigurationError(
                f"velocity of the ground has to be along it, found {across:g} m/s along its normal"
            )
        if not is_number(self.spin):
            raise ConfigurationError(f"spin of the ground: expected a finite number, found {self.spin!r}")

    @property
    def moves(self) -> bool:
        """True if the material of the ground moves."""
        return bool(self.spin) or any(self.velocity)

    @property
    def is_default(self) -> bool:
        """True for the plane z = 0 at rest, in the axes of what carries it."""
        return not self.moves and np.array_equal(self.axes, np.eye(3)) and not self.point[2]

    @property
    def angular_velocity(self) -> np.ndarray:
        """Angular velocity of the material in world axes (3,) [rad/s]."""
        return np.asarray(self.spin * self.axes[2])

    @property
    def twist(self) -> np.ndarray | None:
        """Twist (6,) of the material about the world's origin, as if it reached there; None at rest."""
        angular = self.angular_velocity
        # Rows act on one twist for all points: the velocity is carried from the plane's point to the world's origin.
        linear = np.asarray(self.velocity) - np.cross(angular, np.asarray(self.point))
        return np.concatenate([linear, angular]) if self.moves else None

    def height(self, place: np.ndarray) -> float:
        """Height of a point (3,) above the plane [m].

        Args:
            place: the point.
        """
        return float(self.axes[2] @ (place - np.asarray(self.point)))

    def material_velocity(self, place: np.ndarray) -> np.ndarray:
        """Velocity of the material at points (..., 3) [m/s], in world axes.

        Args:
            place: the points.
        """
        return np.asarray(self.velocity) + np.cross(self.angular_velocity, place - np.asarray(self.point))

    def mesh(self, center: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Square around a point, for drawings: vertices (4, 3) and triangles (2, 3).

        Args:
            center: point near the middle (3,) [m].
            size: half width [m].
        """
        along, across, normal = self.axes
        middle = center - normal * (normal @ (center - np.asarray(self.point)))
        corners = [middle + size * (a * along + b * across) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return np.array(corners), np.array([[0, 1, 2], [0, 2, 3]])

    @property
    def axes(self) -> np.ndarray:
        """Two axes along the plane and its normal as rows, (3, 3); world axes if the normal is vertical."""
        up = np.asarray(self.normal, dtype=float) / np.linalg.norm(self.normal)
        # The first axis is the world's x in the plane, or its y for a plane across x.
        along = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
        first = along - up * (up @ along)
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(up, first), up])


def plane_below(ground: object, body: str) -> GroundPlane | None:
    """Return the plane of a constraint; None for the plane z = 0 at rest, whose rows are simpler.

    Args:
        ground: ground that the user gave; None for z = 0 at rest.
        body: the constraint that takes it, for messages.

    Raises:
        ConstraintError: a ground that is not a plane; the message names the constraint that takes it.
    """
    if ground is not None and not isinstance(ground, GroundPlane):
        raise ConstraintError(
            f"ground of {body}: expected a GroundPlane, found {ground!r}; RollingWheel, RollingBall and RollingBody "
            "roll on curved grounds"
        )
    return None if ground is None or ground.is_default else ground


def on_carrier(rows: Rows, body: str, ground: GroundSurface | None, robot: Robot) -> Rows:
    """Return rows on a ground; if a frame carries the ground, the same rows for the motion relative to this frame.

    Args:
        rows: rows for the ground in the world.
        body: name of the frame of the body.
        ground: the ground; None for z = 0 at rest.
        robot: the robot.

    Raises:
        ModelError: the robot has no such frame.
        ConstraintError: the body carries the ground itself.
    """
    carrier = carrier_of(ground)
    if ground is None or carrier is None:
        return rows
    frame = robot.frame_id(carrier)
    frames = robot.model.frames
    # Relative to itself a body never moves: its rows would be zero at every configuration.
    if frames[frame].parentJoint == frames[robot.frame_id(body)].parentJoint:
        raise ConstraintError(f"'{body}' carries its own ground: frame '{carrier}' of the ground is on the same body")
    return CarriedRows(rows, frame, ground)


class CarriedRows(RelativeRows):
    """Rows on a ground, for the motion relative to the frame that carries it.

    Args:
        rows: rows for ground in the world.
        carrier: index of the frame that carries the ground.
        ground: the ground, in the axes of this frame.
    """

    def __init__(self, rows: Rows, carrier: int, ground: GroundSurface) -> None:
        super().__init__(rows, carrier)
        self.ground = ground


# ------------------------------------------------------------------ wheels on a plane


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


class RollingRows(DirectionRows):
    """Rows of a ``RollingWheel`` that is bound to a robot: ``wheel_wrenches``. A roller or a wheel that skids combines
    them. The kernel has the same formula as ``Form.WHEEL``, generated from it.

    Attributes:
        wheel: name of the frame.
        radius: radius [m]. The rows are affine in it. An estimator sets it on its own copy.
        axle: axle in the frame's own axes (3,).
    """

    on_ground = True
    undefined = "a wheel lies flat on the ground"

    def __init__(self, disk: WheelDisk, friction: Friction, plane: GroundPlane, robot: Robot) -> None:
        self.names = tuple(f"{part}({disk.frame})" for part in disk.parts)
        self.units = ("m/s",) * len(disk.parts)
        self.holonomic = tuple(part == "vertical" for part in disk.parts)
        self.wheel, self.frame = disk.frame, robot.frame_id(disk.frame)
        # A wheel needs the direction of its axle only: its turn about the axle moves no contact.
        self.radius, self.axle, self.directions = disk.radius, disk.axle, disk.axle[:, None]
        self.combination, self._friction = disk.combination, friction
        self.ground = None if plane.is_default else plane
        self._point, self._up = np.asarray(plane.point), plane.axes[2]
        # ``a @ skew(n)`` is ``a x n`` for stacks of axles, without the overhead of numpy.cross.
        self._normal, self._turned = self._up.tolist(), pin.skew(self._up)
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
        if self.combination is None:
            return found
        combined: list[list[float]] = self.combination.dot(found).tolist()
        return combined

    def _contact(self, at: PositionKinematics) -> tuple[np.ndarray, np.ndarray]:
        """Contact points (..., 3), and the directions of rolling, lateral and vertical rows there (..., 3, 3)."""
        place, normal = at.placement(self.frame), self._up
        axle = place.rotation @ self.axle
        across = axle @ self._turned  # a x n
        s, z = np.sqrt(np.vecdot(across, across))[..., None], np.asarray(axle @ normal)[..., None]
        check_defined(self.undefined, at.q, s[..., 0], FLAT, self.names)
        heading = across / s
        sideways = heading @ self._turned.T  # n x h
        directions = np.empty((*heading.shape, 3))
        directions[..., 0, :], directions[..., 1, :], directions[..., 2, :] = heading, sideways, normal
        return place.translation + self.radius * (z * sideways - s * normal), directions

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
