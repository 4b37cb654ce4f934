"""Kinematics in the axes of a ground plane, in which the plane is z = 0."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rnc_pin.constraints.ground_plane import GroundPlane
from rnc_pin.math.linear_algebra import apply, rotated_motions
from rnc_pin.model.kinematics import ALL, WORLD_AXES, Components, FrameDerivatives, Placement, VelocityKinematics


class InGroundAxes(VelocityKinematics):
    """Kinematics of frames whose components are along the axes of a plane, with the origin at its point.

    Rows that are written for z = 0 hold on the plane if they read the kinematics through this class. Values are those
    of ``original``, which stores them.

    Args:
        original: kinematics in world axes; without a velocity, only methods of ``PositionKinematics`` exist.
        plane: the plane.
    """

    def __init__(self, original: VelocityKinematics, plane: GroundPlane) -> None:
        self._original, self.q, self._axes, self._origin = original, original.q, plane.axes, np.asarray(plane.point)

    def placement(self, frame: int) -> Placement:
        place = self._original.placement(frame)
        return Placement(self._axes @ place.rotation, apply(self._axes, place.translation - self._origin))

    def jacobian(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        return self._turned(self._original.jacobian(frame, axes))[..., rows, :]

    def jacobian_dot(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES) -> np.ndarray:
        return self._turned(self._original.jacobian_dot(frame, axes))

    def velocity(self, frame: int) -> np.ndarray:
        return self._turned(self._original.velocity(frame)[..., None])[..., 0]

    def acceleration(self, frame: int, axes: pin.ReferenceFrame = WORLD_AXES, rows: Components = ALL) -> np.ndarray:
        return self._turned(self._original.acceleration(frame, axes)[..., None])[..., 0][..., rows]

    def frame_gradients(self, frame: int) -> FrameDerivatives:
        return FrameDerivatives(*(self._axes @ each for each in self._original.frame_gradients(frame)))

    def _turned(self, motions: np.ndarray) -> np.ndarray:
        """Columns (..., 6, k) of linear and angular components, along the axes of the plane."""
        return rotated_motions(self._axes, motions)
