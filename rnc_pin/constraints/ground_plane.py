"""Plane on which bodies roll, and ground of any form that another body carries.

A plane may slope, slide like a conveyor, or turn like a turntable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError, ConstraintError
from rnc_pin.model.frame_rows import frame_direction, triple
from rnc_pin.model.input_validation import Vector, is_number
from rnc_pin.model.relative_rows import RelativeRows
from rnc_pin.model.rows import GroundSurface, Rows, carrier_of
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
        return np.concatenate([self.material_velocity(np.zeros(3)), angular]) if self.moves else None

    @property
    def along(self) -> np.ndarray:
        """Direction of the first rolling row, along the plane: the world's x."""
        return np.eye(3)[0]

    def level(self, point: np.ndarray) -> np.ndarray:
        """Height (...) above the plane [m].

        Args:
            point: places (..., 3), in world axes [m].
        """
        return np.asarray((point - np.asarray(self.point)) @ self.axes[2])

    def height(self, place: np.ndarray) -> float:
        """Height of a point (3,) above the plane [m].

        Args:
            place: the point.
        """
        return float(self.level(place))

    def gradient(self, point: np.ndarray) -> np.ndarray:
        """Gradient (..., 3) of ``level``: the normal.

        Args:
            point: places (..., 3), in world axes [m].
        """
        return np.broadcast_to(self.axes[2], point.shape)

    def hessian(self, point: np.ndarray) -> np.ndarray:
        """Second derivatives (..., 3, 3) of ``level``: zero.

        Args:
            point: places (..., 3), in world axes [m].
        """
        return np.zeros((*point.shape, 3))

    def below(self, place: np.ndarray) -> np.ndarray:
        """Nearest points (..., 3) of the plane.

        Args:
            place: centres of bodies (..., 3), in world axes [m].
        """
        return np.asarray(place - self.level(place)[..., None] * self.axes[2])

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


def admit_plane(ground: object, body: str) -> GroundPlane:
    """Return the plane of a constraint.

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
    return ground or GroundPlane()


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
    found = RelativeRows(rows, frame)
    found.ground = ground
    return found
