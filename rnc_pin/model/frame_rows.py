"""Rows of one frame: components of its velocity, or wrenches on it.

A kind of the second form states its wrenches; Jacobian, rates and slopes follow here. With the velocity V of a frame
(linear at its origin, then angular, in world axes), the rows are ``W (V - G)``. The wrenches W depend on the frame's
place. G is the velocity of the ground's material, as if it reached to the frame's origin.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TypeAlias, cast

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import AttachedFrame, Form, KernelRow, attached, wrench_rows
from rnc_pin.errors import ConfigurationError, check_known
from rnc_pin.math.linear_algebra import (
    Component,
    Dual,
    Entry,
    apply,
    as_slice,
    complex_step,
    components,
    cross,
    packed,
    product,
    vector_product,
)
from rnc_pin.model.input_validation import Vector
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES, Placement, PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import Rows, check_defined
from rnc_pin.robots.robot import Robot

_UNIT = np.eye(3)


def point_name(frame: str, point: np.ndarray) -> str:
    """Name of a point (3,) in a frame's axes: that of the frame, with the coordinates unless it is the origin.

    Args:
        frame: name of the frame.
        point: coordinates (3,) in the frame's axes [m].
    """
    return f"{frame}[{' '.join(f'{each:g}' for each in point)}]" if point.any() else frame


class OffsetFrame:
    """Frame with a constant offset and rotation relative to a parent frame.

    Args:
        robot: the robot that has the frame.
        frame: name of the parent frame.
        at: origin of the offset frame in the parent's axes (3,) [m].
        rotation: rotation of the offset frame relative to the parent (3, 3); identity by default.

    Attributes:
        name: name of the parent frame, with the point if this is not its origin.
        index: index of the parent frame in the model.
        joint: index of the joint that supports the frame.
        offset: constant placement on the parent frame.

    Raises:
        ModelError: unknown frame.
        ConfigurationError: a point that is not three finite numbers.
    """

    def __init__(self, robot: Robot, frame: str, at: Vector, rotation: np.ndarray = _UNIT) -> None:
        point = triple(at, f"point on frame '{frame}'")
        self.index = robot.frame_id(frame)
        self.joint = robot.model.frames[self.index].parentJoint
        self.name = point_name(frame, point)
        self._point, self._rotation = point, rotation
        self.offset = pin.SE3(rotation, point)

    def placement(self, at: PositionKinematics) -> Placement:
        """Placement of the offset frame in the world.

        Args:
            at: kinematics at configurations (..., nq).
        """
        place = at.placement(self.index)
        return Placement(place.rotation @ self._rotation, place.translation + apply(place.rotation, self._point))

    def attached(self, model: pin.Model) -> AttachedFrame:
        """Joint and constant placement of the offset frame.

        Args:
            model: Pinocchio's model of the robot.
        """
        return attached(model, self.index, self.offset)


def triple(values: Vector, what: str) -> np.ndarray:
    """Convert a value to three finite numbers (3,); the error message names it by ``what``.

    Args:
        values: three numbers.
        what: the value in messages.
    """
    found = np.asarray(values, dtype=float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ConfigurationError(f"{what}: expected three finite numbers, found {values}")
    return found


# ------------------------------------------------------------------ components of a velocity

AXES = {"x": 0, "y": 1, "z": 2}


def axis_index(axis: str) -> int:
    """Index 0, 1 or 2 of the axis "x", "y" or "z".

    Args:
        axis: name of the axis.
    """
    check_known(axis, AXES, "axis")
    return AXES[axis]


def frame_direction(axis: str | Vector, what: str = "axis") -> np.ndarray:
    """Unit vector (3,) along an axis of a frame, or along a vector; the error message names it by ``what``.

    Args:
        axis: name of the axis, or components.
        what: the vector in messages.
    """
    found = _UNIT[axis_index(axis)] if isinstance(axis, str) else triple(axis, what)
    if not found.any():
        raise ConfigurationError(f"{what} has no length")
    # Of unit length, so that the rows along it are in m/s.
    return np.asarray(found / np.linalg.norm(found))


class FrameVelocityRows(Rows):
    """Rows of a frame's Jacobian, in world axes or in the frame's own axes.

    Args:
        robot: the robot that has the frame.
        frame: name of the frame.
        rows: indices among the six rows (linear x, y, z, angular x, y, z).
        axes: axes of the components.
    """

    def __init__(self, robot: Robot, frame: str, rows: Sequence[int], axes: pin.ReferenceFrame = WORLD_AXES) -> None:
        self._frame, self._axes = robot.frame_id(frame), axes
        self.units = tuple("m/s" if row < 3 else "rad/s" for row in rows)
        # A slice is a view, not a copy, on the hot path.
        self._rows = as_slice(np.array(rows))

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return at.jacobian(self._frame, self._axes, self._rows)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return at.jacobian_dot(self._frame, self._axes)[..., self._rows, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return at.acceleration(self._frame, self._axes, self._rows)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        return at.frame_gradients(self._frame, self._axes)[1][self._rows]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        form = Form.OWN if self._axes == OWN_AXES else Form.WORLD
        return wrench_rows(form, attached(model, self._frame), np.eye(6)[self._rows].tolist())


# ------------------------------------------------------------------ wrenches

FLAT = 1e-6
"""Sine of the angle between two directions below which they count as parallel."""


class WrenchRows(Rows):
    """Rows ``W (V - G)`` with the twist V of a frame and the twist G of the ground, or of another frame.

    Attributes:
        frame: index of the frame.
        twist: twist (6,) of the ground's material about the world's origin, in world axes; None for ground at rest.
        combination: matrix (k, l) if the rows are combinations of l wrenches; None for the wrenches themselves.
    """

    frame: int
    twist: np.ndarray | None = None
    combination: np.ndarray | None = None

    @abstractmethod
    def wrench(self, place: Placement) -> np.ndarray:
        """Wrenches (..., l, 6) or (l, 6) for placements of the frame; analytic in complex numbers.

        Args:
            place: placements of the frame in the world.
        """

    @abstractmethod
    def wrench_rate(self, place: Placement, velocity: np.ndarray) -> np.ndarray:
        """Rate of ``wrench`` for velocities (..., 6) of the frame.

        Args:
            place: placements of the frame in the world.
            velocity: its velocities (..., 6): linear at its origin, then angular, in world axes.
        """

    def check_defined(self, at: PositionKinematics) -> None:
        """Raise ``SingularityError`` at states where the wrenches are not defined.

        Args:
            at: kinematics at configurations (..., nq).
        """

    def _combined(self, wrenches: np.ndarray) -> np.ndarray:
        return wrenches if self.combination is None else self.combination @ wrenches

    def wrenches(self, at: PositionKinematics) -> np.ndarray:
        """W at states, (..., k, 6) or (k, 6), kept there; do not write to it.

        Args:
            at: kinematics at configurations (..., nq).
        """
        # Jacobian, rate and right-hand side of one state share the wrenches.
        known = at.wrenches.get(self)
        if known is None:
            self.check_defined(at)
            known = at.wrenches[self] = self._combined(self.wrench(at.placement(self.frame)))
        return known

    def _wrench_rates(self, at: VelocityKinematics) -> np.ndarray:
        self.check_defined(at)
        return self._combined(self.wrench_rate(at.placement(self.frame), at.velocity(self.frame)))

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return product(self.wrenches(at), at.jacobian(self.frame))

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        frame = self.frame
        return np.asarray(self._wrench_rates(at) @ at.jacobian(frame) + self.wrenches(at) @ at.jacobian_dot(frame))

    def rate(self, at: PositionKinematics) -> np.ndarray:
        if self.twist is None:
            return self._zeros(at)
        # W V = W G where the contact moves with the ground.
        return apply(self.wrenches(at), _carried(self.twist, at.placement(self.frame).translation))

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        if self.twist is None:
            return self._zeros(at)
        # Product rule of W G.
        turned = apply(self._wrench_rates(at), _carried(self.twist, at.placement(self.frame).translation))
        return np.asarray(turned + apply(self.wrenches(at), _carried_rate(self.twist, at.velocity(self.frame))))

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        self.check_defined(at)
        return self._bias(at.placement(self.frame), at.velocity(self.frame), at.acceleration(self.frame))

    def _bias(self, place: Placement, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        slip = velocity
        if self.twist is not None:
            # d/dt W (V - G) = W (Vdot - Gdot) + Wdot (V - G); Vdot is that at zero vdot.
            slip = velocity - _carried(self.twist, place.translation)
            acceleration = acceleration - _carried_rate(self.twist, velocity)
        wrench, rate = self._combined(self.wrench(place)), self._combined(self.wrench_rate(place, velocity))
        return np.asarray(apply(wrench, acceleration) + apply(rate, slip))

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        self.check_defined(at)
        # The formula is analytic in the frame's place and motion, whose derivatives Pinocchio has: the complex step
        # joins them exactly.
        gradients, J, place = at.frame_gradients(self.frame), at.jacobian(self.frame), at.placement(self.frame)
        # Rotating by a column w of the angular Jacobian changes each axis e of the frame by w x e.
        turned = np.cross(J[3:, None, :], place.rotation[:, :, None], axis=0)  # (3, 3, nv)
        return complex_step(
            lambda flat, origin, *motions: self._bias(Placement(flat.reshape(-1, 3, 3), origin), *motions),
            (place.rotation.ravel(), turned.reshape(9, -1)),
            (place.translation, J[:3]),
            (at.velocity(self.frame), gradients[0]),
            (at.acceleration(self.frame), gradients[1]),
        )


def _carried(twist: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Velocity G (..., 6) of material with a twist (6,) at the frame's origin (..., 3)."""
    # Rigid material: velocity at the world's origin, plus its rotation about that point.
    angular = np.broadcast_to(twist[3:], origin.shape)
    return np.concatenate([twist[:3] + vector_product(angular, origin), angular], axis=-1)


def _carried_rate(twist: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Rate of G (..., 6) for a velocity of the frame (..., 6)."""
    linear = velocity[..., :3]
    # The twist is constant: G changes because the frame moves through the field.
    moved = vector_product(np.broadcast_to(twist[3:], linear.shape), linear)
    return np.concatenate([moved, np.zeros_like(moved)], axis=-1)


class ConstantWrenchRows(WrenchRows):
    """Wrenches that are constant in the world, and so is the vector from the frame's origin to the contact.

    Attributes:
        matrix: the wrenches (k, 6).
    """

    matrix: np.ndarray

    def wrench(self, place: Placement) -> np.ndarray:
        return self.matrix

    def wrench_rate(self, place: Placement, velocity: np.ndarray) -> np.ndarray:
        return np.zeros_like(self.matrix)

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return wrench_rows(Form.WORLD, attached(model, self.frame), self.matrix.tolist(), self.twist)


class DirectionRows(WrenchRows):
    """Wrenches that are functions of directions which the frame carries. Dual numbers differentiate them.

    Attributes:
        directions: directions in the frame's own axes, as columns (3, c).
        undefined: reason why the wrenches are not defined where ``regularity`` is below ``FLAT``; empty if they are
            defined everywhere.
    """

    directions: np.ndarray
    undefined = ""

    def regularity(self, *directions: Sequence[Entry]) -> Entry:
        """Length that is zero where the wrenches are not defined."""
        return 1.0

    def check_defined(self, at: PositionKinematics) -> None:
        if self.undefined:
            # Checked at each evaluation: beyond, the formula divides by zero and gives numbers of any size.
            length = cast("Component", self.regularity(*self.world_directions(at.placement(self.frame).rotation)))
            check_defined(self.undefined, at.q, length, FLAT, self.names)

    @abstractmethod
    def formula(self, *directions: Sequence[Entry]) -> Sequence[Sequence[Entry]]:
        """Wrenches (l, 6) for c directions in world axes: plain arithmetic, so that entries can be symbols too."""

    def world_directions(self, rotation: np.ndarray) -> list[Sequence[Component]]:
        """Directions in world axes, for rotations (..., 3, 3) of the frame.

        Args:
            rotation: axes of the frame as columns, in the world.
        """
        # Numbers instead of arrays for one state: the formulas are plain arithmetic.
        columns = rotation @ self.directions
        return [components(columns[..., k]) for k in range(columns.shape[-1])]

    def wrench(self, place: Placement) -> np.ndarray:
        return evaluated(self.formula, self.world_directions(place.rotation))

    def wrench_rate(self, place: Placement, velocity: np.ndarray) -> np.ndarray:
        directions, turning = self.world_directions(place.rotation), components(velocity[..., 3:])
        # A direction that the frame carries turns with it: ddot = omega x d.
        return rate_of(self.formula, directions, [cross(turning, each) for each in directions])


Formula: TypeAlias = "Callable[..., Sequence[Sequence[Entry]]]"


def evaluated(formula: Formula, vectors: Sequence[Sequence[Component]]) -> np.ndarray:
    """Matrix (..., k, l) of a formula of vectors, which are given by their components.

    Args:
        formula: the formula.
        vectors: components of each vector.
    """
    return packed(cast("Sequence[Sequence[Component]]", formula(*vectors)), vectors[0][0])


def rate_of(
    formula: Formula, vectors: Sequence[Sequence[Component]], rates: Sequence[Sequence[Component]]
) -> np.ndarray:
    """Rate (..., k, l) of this matrix for rates of the vectors.

    Args:
        formula: the formula.
        vectors: components of each vector.
        rates: components of their rates.
    """
    # Dual numbers carry value and rate through the formula, so that no rate is written by hand.
    moving = [[Dual(*both) for both in zip(*each, strict=True)] for each in zip(vectors, rates, strict=True)]
    rows = [[entry.slope if isinstance(entry, Dual) else 0.0 for entry in row] for row in formula(*moving)]
    return packed(rows, vectors[0][0])
