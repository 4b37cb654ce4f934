"""Surface of a convex body as ground for another body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.body_shapes import BodyShape, grid_triangles
from rnc_pin.constraints.curved_grounds import Levelled, unit_vectors
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.frame_rows import triple
from rnc_pin.model.parameter_types import Vector

_EYE = np.eye(3)
_FINE = 32  # edges of the drawn surface


class LevelledShape(BodyShape, Levelled, Protocol):
    """Shape with a function that is zero on its surface, in the axes of its body."""


@dataclass(frozen=True)
class BodySurface:
    """Outside of a convex body, on which another body rolls. Both move; a frame carries the surface.

    Args:
        shape: ``Sphere``, ``Ellipsoid``, ``Torus`` with a tube, or a ``BodyShape`` with ``level``, ``gradient`` and
            ``hessian``.
        frame: name of the frame that carries the shape; None for a body at rest in the world.
        at: centre of the shape in the frame's axes [m].
        rpy: orientation of the shape relative to the frame: roll, pitch and yaw as in a URDF [rad].

    Raises:
        ConstraintError: a shape without these methods.
        ConfigurationError: vectors that are not three finite numbers.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> hill = rnc.BodySurface(rnc.Ellipsoid((2.0, 1.0, 0.5)))
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.2, ground=hill)]).reduce()
        >>> q = reduced.assembled(robot.configuration({"root_joint": [0, 0, 1, 0, 0, 0, 1]}))
        >>> q[2].round(6)  # height of the centre above that of the hill
        np.float64(0.7)
    """

    shape: LevelledShape
    frame: str | None = None
    at: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        names = ("point", "level", "gradient", "hessian")
        missing = [name for name in names if not hasattr(self.shape, name)]
        if missing or isinstance(self.shape, type):
            raise ConstraintError(
                "shape of a body's surface: expected Sphere, Ellipsoid, Torus or an object with the methods "
                f"{', '.join(names)}, found {self.shape!r}"
            )
        if getattr(self.shape, "tube", 1.0) == 0:
            raise ConstraintError("shape of a body's surface: a Torus with tube=0 is a sharp edge; give it a tube")
        triple(self.at, "centre of a body's surface")
        triple(self.rpy, "rpy of a body's surface")

    @property
    def _axes(self) -> np.ndarray:
        """Axes of the shape as columns (3, 3)."""
        return np.asarray(pin.rpy.rpyToMatrix(np.asarray(self.rpy, dtype=float)))

    def _local(self, point: np.ndarray) -> np.ndarray:
        return np.asarray((point - np.asarray(self.at)) @ self._axes)

    @property
    def moves(self) -> bool:
        """False: the surface is at rest in the frame that carries it."""
        return False

    @property
    def angular_velocity(self) -> np.ndarray:
        """Zero (3,)."""
        return np.zeros(3)

    @property
    def along(self) -> np.ndarray:
        """Direction of the first rolling row: the carrier's x."""
        return _EYE[0]

    def level(self, point: np.ndarray) -> np.ndarray:
        """Function (...) that is zero on the surface and grows outwards, at each point (..., 3) [m]."""
        return self.shape.level(self._local(point))

    def gradient(self, point: np.ndarray) -> np.ndarray:
        """Gradient (..., 3) of ``level`` at each point (..., 3)."""
        return apply(self._axes, self.shape.gradient(self._local(point)))

    def hessian(self, point: np.ndarray) -> np.ndarray:
        """Second derivatives (..., 3, 3) of ``level`` at each point (..., 3)."""
        axes = self._axes
        return np.asarray(axes @ self.shape.hessian(self._local(point)) @ axes.T)

    def below(self, place: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the surface whose normals are along the lines from its centre to each place (..., 3)."""
        normal = unit_vectors(self._local(place), _EYE[2])
        return np.asarray(self.at) + apply(self._axes, self.shape.point(normal))

    def material_velocity(self, place: np.ndarray) -> np.ndarray:
        """Zero (..., 3) at each place (..., 3)."""
        return np.zeros_like(place)

    def mesh(self, center: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Whole surface, for drawings: vertices (n, 3) and triangles (m, 3).

        Args:
            center: not used.
            size: not used.
        """
        tilt = (np.arange(_FINE) + 0.5) * np.pi / _FINE
        around = np.linspace(0.0, 2 * np.pi, 2 * _FINE + 1)
        height, angle = np.meshgrid(np.cos(tilt), around, indexing="ij")
        width = np.sqrt(1.0 - height**2)
        normals = np.stack([width * np.cos(angle), width * np.sin(angle), height], axis=-1).reshape(-1, 3)
        vertices = np.asarray(self.at) + apply(self._axes, self.shape.point(normals))
        return vertices, grid_triangles(_FINE, 2 * _FINE + 1)
