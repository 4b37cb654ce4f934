"""Bodies that touch a plane along a line: cylinders and cones on their sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rnc_pin.constraints.body_shapes import BodyShape, Torus, check_positive
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.parameter_types import Axis, Positive


class Apex:
    """Single point, the apex of a cone."""

    def point(self, normal: np.ndarray) -> np.ndarray:
        """Zeros (..., 3)."""
        return np.zeros_like(normal)

    def point_rate(self, normal: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Zeros (..., 3)."""
        return np.zeros_like(rate)

    def regularity(self, normal: np.ndarray) -> np.ndarray:
        """One: every normal has one point."""
        return np.ones(normal.shape[:-1])


class LineEnd(NamedTuple):
    """End of the line along which a body touches a plane."""

    shape: BodyShape
    offset: np.ndarray
    """Centre of the shape, in the axes of the body's shape (3,) [m]."""


@dataclass(frozen=True)
class Cylinder:
    """Cylinder on its side, e.g. a roller. It touches a plane along a line, so it rolls straight.

    On its rim it is a ``Torus`` with ``tube=0``.

    Args:
        radius: radius [m].
        length: length along the axis, centred at the shape's origin [m].
        axis: the body's axis about which it is round, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> roller = rnc.RollingBody("ball", rnc.Cylinder(0.2, length=0.5, axis="y"))
        >>> rnc.NonholonomicSystem(robot, [roller]).r
        1
    """

    radius: Positive
    length: Positive
    axis: Axis = "z"

    def __post_init__(self) -> None:
        check_positive("radius of a cylinder", self.radius)
        check_positive("length of a cylinder", self.length)
        axis_index(self.axis)

    def ends(self) -> tuple[LineEnd, LineEnd]:
        """Both rims."""
        rim, half = Torus(self.radius, axis=self.axis), 0.5 * self.length * np.eye(3)[axis_index(self.axis)]
        return LineEnd(rim, -half), LineEnd(rim, half)


@dataclass(frozen=True)
class Cone:
    """Cone on its side. It touches a plane along a line, so it rolls about its apex.

    On its rim alone it is a ``Torus`` with ``tube=0``.

    Args:
        radius: radius of the base [m].
        height: distance of the apex from the base [m]. The shape's origin is the centre of the base, and the apex is
            in the positive direction of the axis.
        axis: the body's axis about which it is round, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> cone = rnc.RollingBody("ball", rnc.Cone(0.1, height=0.3))
        >>> rnc.NonholonomicSystem(robot, [cone]).r
        1
    """

    radius: Positive
    height: Positive
    axis: Axis = "z"

    def __post_init__(self) -> None:
        check_positive("radius of a cone", self.radius)
        check_positive("height of a cone", self.height)
        axis_index(self.axis)

    def ends(self) -> tuple[LineEnd, LineEnd]:
        """Rim and apex."""
        along = self.height * np.eye(3)[axis_index(self.axis)]
        return LineEnd(Torus(self.radius, axis=self.axis), np.zeros(3)), LineEnd(Apex(), along)
