"""Rows as the compiled kernel evaluates them: wrenches on frames, momenta and steering linkages.

``Rows.kernel_rows`` returns one ``KernelRow`` for each row. The formulas are in ``rnc_pin/_kernel/kernel.c``.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import pinocchio as pin

INTEGERS, NUMBERS = 5, 24
"""Largest number of integers and of floats in a ``KernelRow``."""
_MOTION = 16  # place of the twist of the ground in the numbers of a row


class Form(IntEnum):
    """Formula of a row; the values are those of ``kernel.c``."""

    CONSTANT = 0
    """Constant Jacobian."""
    EXTERNAL = 1
    """Values come from Python."""
    WORLD = 2
    """Force and torque at a frame's origin, constant in world axes. Numbers: force (3), torque (3)."""
    OWN = 3
    """The same, constant in the frame's own axes. Integers: 0, 1 if the ground moves. Numbers: 16 to 21 for its
    twist."""
    WHEEL = 4
    """Contact of a rolling wheel. Integers: 1 if the plane slopes, 1 if its material moves. Numbers: radius, axle (3),
    weights of rolling, lateral and vertical rows (3), axes of the plane by rows (9), twist of the ground (6)."""
    YAW = 5
    """Yaw of a frame's axis. Integers: axis."""
    TILT = 6
    """Tilt of a frame's axis. Integers: axis."""
    DISTANCE = 7
    """Distance of two frames' origins."""
    CLOSURE = 8
    """Twist of the second frame relative to the first, in its axes and at its origin. Integers: component."""
    POINT = 9
    """The same, at the origin of the second frame. Integers: component."""
    MOMENTUM = 10
    """Momentum of a joint. Integers: first entry of v, row, bits of the components of a spatial velocity that the joint
    allows (0 for axes of the body), size. Numbers: placement of the world in the joint's fixed frame (12)."""
    ACKERMANN = 11
    """Steering linkage. Integers: index in q and v of the left joint, of the right joint, bits of continuous joints.
    Numbers: track over wheelbase, sign of the left joint, of the right joint."""
    ROLLING = 12
    """Contact of a body on a plane; the frame has the axes of its shape. Integers: 0 for an ellipsoid, 1 for a torus,
    1 if the material moves, 1 for the angular velocity about the normal, axis of the torus. Numbers: direction (3),
    normal (3), squares of the semi-axes or radius and tube (3), 7 unused, twist of the ground (6)."""


FORMS_OF_FORCES = frozenset({Form.CONSTANT, *(form for form in Form if Form.WORLD <= form <= Form.POINT)})
"""Formulas of rows along which a force may act."""


CARRIED = frozenset({Form.WORLD, Form.OWN, Form.WHEEL, Form.ROLLING})
"""Formulas of one frame that a second frame can carry: they are then functions of the motion relative to it."""


class Value(IntEnum):
    """Formula of an output's value; the numbers are those of ``kernel.c``."""

    NONE = 0
    """A quasi-velocity, or a value that Python evaluates."""
    JOINT = 1
    """Position of a joint; the parameter is its index in q."""
    CONTINUOUS_JOINT = 2
    """The same for a joint that is stored as (cos, sin)."""
    COORDINATE = 3
    """Coordinate of the frame's origin; the parameter is the axis."""
    HEADING = 4
    """Yaw of the axis of a row ``Form.YAW``."""
    ELEVATION = 5
    """Tilt of the axis of a row ``Form.TILT``."""
    LENGTH = 6
    """Distance of a row ``Form.DISTANCE``."""


class KernelForce(NamedTuple):
    """Force that follows from the value y and the rate w of a row.

    ``constant + stiffness (rest - y) - damping w - limit tanh(w / speed)``. The order is that of ``kernel.c``.
    """

    constant: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    turns: float = 0.0
    """1.0 if values are angles, which are compared modulo a full turn."""
    damping: float = 0.0
    limit: float = 0.0
    speed: float = 1.0


class AttachedFrame(NamedTuple):
    """Frame with a constant placement on a joint."""

    joint: int
    placement: pin.SE3


class KernelRow(NamedTuple):
    """One row: its formula, frames, constants, and the right-hand side mu of its constraint."""

    form: Form
    frames: tuple[AttachedFrame, ...] = ()
    integers: Sequence[int] = ()
    numbers: Sequence[float] = ()
    rate: float = 0.0
    joint: int = 0
    """Joint of a momentum row."""
    value: tuple[Value, int] = (Value.NONE, 0)
    """Value of an output, with its parameter."""
    constant: np.ndarray | None = None
    """Jacobian (nv,) of a constant row that is in no stack of rows, such as that of a force."""


def attached(model: pin.Model, frame: int, offset: pin.SE3 | None = None) -> AttachedFrame:
    """Frame of a model, or a frame with a constant placement on it."""
    found = model.frames[frame]
    placement = found.placement if offset is None else found.placement * offset
    return AttachedFrame(found.parentJoint, pin.SE3(placement))


def rolling_rows(
    shape: tuple[int, int, Sequence[float]], frame: AttachedFrame, axes: np.ndarray, motion: Sequence[float]
) -> list[KernelRow]:
    """Rows of a rolling body: along the axes (3, 3) of its plane, and about the normal.

    Args:
        shape: 0 for an ellipsoid with the squares of its semi-axes, or 1 for a torus with its axis, radius and tube.
        frame: frame with the axes of the shape.
        axes: two directions along the plane, and its normal, as rows.
        motion: twist of the plane's material, ``plane_motion``.
    """
    kind, axis, sizes = shape
    numbers = [*sizes, *[0.0] * (_MOTION - 6 - len(sizes)), *motion]
    moves = int(any(motion))
    parts = [(direction, 0) for direction in axes] + [(axes[2], 1)]
    return [
        KernelRow(
            Form.ROLLING, (frame,), (kind, moves, pivot, axis), [*direction.tolist(), *axes[2].tolist(), *numbers]
        )
        for direction, pivot in parts
    ]


def component_rows(form: Form, frame: AttachedFrame, components: Sequence[int]) -> list[KernelRow]:
    """Components of a frame's velocity (linear x, y, z, then angular), in world axes or in its own axes."""
    return [KernelRow(form, (frame,), (), np.eye(6)[k].tolist()) for k in components]


def plane_motion(velocity: np.ndarray, spin: float, normal: np.ndarray, point: np.ndarray) -> list[float]:
    """Twist of a plane's material about the world's origin: velocity as if it reached there, then angular, (6,)."""
    angular = spin * np.asarray(normal)
    return [*(np.asarray(velocity) - np.cross(angular, point)).tolist(), *angular.tolist()]


def on_moving_ground(rows: Sequence[KernelRow], motion: Sequence[float]) -> list[KernelRow]:
    """Rows ``Form.OWN`` relative to ground with a twist (6,)."""
    return [
        row._replace(integers=(0, 1), numbers=[*row.numbers, *[0.0] * (_MOTION - len(row.numbers)), *motion])
        for row in rows
    ]


def placement_numbers(placement: pin.SE3) -> list[float]:
    """Rotation by rows, then translation, (12,)."""
    return [*placement.rotation.ravel().tolist(), *placement.translation.tolist()]
