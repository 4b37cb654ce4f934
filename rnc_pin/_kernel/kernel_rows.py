"""Words in which rows and forces describe themselves to the compiled kernel.

``Rows.kernel_rows`` returns one ``KernelRow`` for each row: a wrench on frames, a momentum or a steering linkage. The
formulas of wrenches are generated from those of the rows by ``tools/generate_rows.py``; the others are in ``kernel.c``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import pinocchio as pin

INTEGERS, NUMBERS = 5, 18
"""Largest number of integers and of floats in a ``KernelRow``."""
AT_GROUND = 12
"""Place of the twist of the ground in the numbers of a row."""


class Form(IntEnum):
    """Formula of a row. From ``WORLD`` on, it is a wrench on one or two frames.

    A new wrench comes last here and has an entry in ``KINDS`` of ``tools/generate_rows.py``; ``valid`` in ``kernel.c``
    names the last form. Rows without a form are ``EXTERNAL``: Python evaluates them, and the kernel does the rest.

    A second frame carries the ground: the row is then a function of the motion relative to it. Integers of wrenches:
    axis of a yaw or tilt, and 1 if the material of the ground moves. Its twist is in the numbers from ``AT_GROUND`` on
    (6). The other numbers begin with the directions that the frame carries, in its own axes.
    """

    CONSTANT = 0
    """Constant Jacobian."""
    EXTERNAL = 1
    """Values come from Python."""
    MOMENTUM = 2
    """Momentum of a joint. Integers: first entry of v, row, bits of the components of a spatial velocity that the joint
    allows (0 for axes of the body), size. Numbers: placement of the world in the joint's fixed frame (12)."""
    ACKERMANN = 3
    """Steering linkage. Integers: index in q and v of the left joint, of the right joint, bits of continuous joints.
    Numbers: track over wheelbase, sign of the left joint, of the right joint, ratio of the wheelbases."""
    WORLD = 4
    """Force and torque at the frame's origin, constant in world axes. Numbers: force (3), torque (3)."""
    OWN = 5
    """The same, constant in the frame's own axes. Numbers: force (3), torque (3)."""
    WHEEL = 6
    """Contact of a rolling wheel. Numbers: axle (3), radius, normal of the plane (3), weights of the rolling, lateral
    and vertical rows (3)."""
    YAW = 7
    """Yaw of a direction. Numbers: the direction (3)."""
    TILT = 8
    """Tilt of a direction. Numbers: the direction (3)."""
    ROLLING = 9
    """Contact of a body on a plane; the frame has the axes of its shape. Numbers: direction (3), normal (3), and
    those of the support function: S (3), scale and tube."""
    DISTANCE = 10
    """Distance of two frames' origins."""
    CURVED = 11
    """Contact of a ball on a sphere or cylinder; the frame is at the centre of the ball. Numbers: a point of the axis
    of the ground (3), then the parameters of ``curved_wrench``."""


FORMS_OF_FORCES = frozenset({Form.CONSTANT, *(form for form in Form if form >= Form.WORLD)})
"""Formulas of rows along which a force may act."""


class Value(IntEnum):
    """Formula of an output's value."""

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

    ``constant + stiffness (rest - y) - damping w - limit tanh(w / speed)``.
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
    placement: tuple[float, ...]
    """``placement_numbers`` on the joint, (12,)."""


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
    """Jacobian (nv,) of a constant row."""


def attached(model: pin.Model, frame: int, offset: pin.SE3 | None = None) -> AttachedFrame:
    """Frame of a model, or a frame with a constant placement on it.

    Args:
        model: Pinocchio's model of the robot.
        frame: index of the frame in the model.
        offset: placement on the frame; None for the frame itself.
    """
    # The kernel places joints alone: a frame is a joint with a constant offset.
    found = model.frames[frame]
    placement = found.placement if offset is None else found.placement * offset
    return AttachedFrame(found.parentJoint, tuple(placement_numbers(placement)))


def wrench_rows(
    form: Form, frame: AttachedFrame, numbers: Iterable[Sequence[float]], twist: np.ndarray | None = None
) -> list[KernelRow]:
    """Rows of wrenches on one frame; unit wrenches give the components of its velocity.

    Args:
        form: their formula.
        frame: the frame.
        numbers: numbers of each row.
        twist: twist (6,) of the material of the ground about the world's origin, None at rest.
    """
    # Ground at rest has no entries for a twist, and its right-hand side is zero.
    if twist is None:
        return [KernelRow(form, (frame,), (), each) for each in numbers]
    if form == Form.WORLD and not twist[3:].any():  # the material has the same velocity everywhere
        return [KernelRow(form, (frame,), (), each, float(twist[:3] @ each[:3])) for each in numbers]
    # The twist has its place whatever numbers the form has: the kernel looks for it there.
    padded = ([*each, *[0.0] * (AT_GROUND - len(each)), *twist.tolist()] for each in numbers)
    return [KernelRow(form, (frame,), (0, 1), each) for each in padded]


def placement_numbers(placement: pin.SE3) -> list[float]:
    """Rotation by rows, then translation, (12,).

    Args:
        placement: the placement.
    """
    # In the order in which ``kernel.c`` reads a placement.
    return [*placement.rotation.ravel().tolist(), *placement.translation.tolist()]
