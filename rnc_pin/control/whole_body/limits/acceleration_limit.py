"""Limit: accelerations of the reduced velocities or of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.control.whole_body.limits.limited_joints import selection_rows
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.parameter_types import Numbers
from rnc_pin.model.reduced_model import ReducedModel


@dataclass(frozen=True)
class AccelerationLimit(ControlLimit):
    """Limit of the acceleration between two samples: of every reduced velocity, or of joints. A soft limit.

    Args:
        limit: largest acceleration [rad/s^2 or m/s^2]; one number, or one for each reduced velocity or joint entry.
        joints: names of joints; by default the limit is on the reduced velocities v2.
        priority: order in which soft limits give way; the largest number first.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> limit = rnc.control.limits.AccelerationLimit(2.0, joints=["joint_1", "joint_2"])
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = limit.bind(reduced).rows(sample)
        >>> rows.lower.round(6), rows.upper.round(6)  # the limit times dt, about the velocity of the start
        (array([-0.02, -0.02]), array([0.02, 0.02]))
    """

    limit: float | Numbers
    joints: Sequence[str] | None = None
    priority: int = field(default=2, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundAccelerations(self, reduced)


class _BoundAccelerations(BoundLimit):
    def __init__(self, limit: AccelerationLimit, reduced: ReducedModel) -> None:
        self._indices: list[int] | None = None
        names: Sequence[str] = reduced.reducing.names
        if limit.joints is not None:
            velocities = [reduced.robot.velocity_indices(name) for name in limit.joints]
            self._indices = [index for each in velocities for index in range(each.start, each.stop)]
            self._jacobian = selection_rows(self._indices, reduced.n)
            names = [reduced.robot.velocity_names[index] for index in self._indices]
        self.names = tuple(f"{name} acceleration" for name in names)
        largest = np.asarray(limit.limit, dtype=float)
        if largest.shape not in ((), (len(names),)) or not ((largest > 0) & (largest < np.inf)).all():
            raise ConfigurationError(
                f"an acceleration limit has to be a positive number or {len(names)}, found {limit.limit}"
            )
        self._largest = largest

    def rows(self, sample: ControlSample) -> LimitRows:
        change = self._largest * sample.dt
        if self._indices is None:
            return LimitRows(sample.end.J2, sample.start.v2 - change, sample.start.v2 + change)
        v = sample.start.v[self._indices]
        return LimitRows(self._jacobian, v - change, v + change)
