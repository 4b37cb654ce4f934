"""Kinematics at one configuration, from a record of the compiled kernel instead of Pinocchio."""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from rnc_pin import _kernel
from rnc_pin.math.components import Component
from rnc_pin.model.kinematics import ALL, WORLD_AXES, Components, Kinematics, Placement, PositionKinematics


class KnownKinematics(PositionKinematics):
    """Kinematics at one configuration with known inertia, joint placements and joint Jacobians.

    Frames follow from these, so that Pinocchio need not visit the configuration again.

    Args:
        at: Pinocchio's model and data, for all other quantities.
        q: configuration (nq,).
        t: time [s].
        record: M (nv, nv), J (6, nv) in the world, and placements of joints (njoints, 12).
    """

    def __init__(self, at: Kinematics, q: Array, t: Component, record: Array) -> None:
        super().__init__(at, q, t)
        self._record = record
        self._frames: dict[int, tuple[Placement, Array]] = {}

    @property
    def M(self) -> Array:
        found: Array = self._record["M"]
        return found

    def placement(self, frame: int) -> Placement:
        return self._frame(frame)[0]

    def jacobian(self, frame: int, axes: object = WORLD_AXES, rows: Components = ALL) -> Array:
        if axes != WORLD_AXES:
            return super().jacobian(frame, axes, rows)
        found = self._frame(frame)[1]
        return found if rows == ALL else found[rows]

    def _frame(self, frame: int) -> tuple[Placement, Array]:
        known = self._frames.get(frame)
        if known is None:
            joint, own, support = self._at.frame_constants(frame)
            numbers = np.empty(12 + 6 * self._at.nv)
            record = self._record
            if not _kernel.library.frame_kinematics(record["J"], record["placements"][joint], own, support, numbers):
                return super().placement(frame), super().jacobian(frame)
            numbers.setflags(write=False)
            columns = numbers[:12].reshape(4, 3)
            known = self._frames[frame] = Placement(columns[:3].T, columns[3]), numbers[12:].reshape(6, -1)
        return known
