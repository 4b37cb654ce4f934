"""Limit: accelerations of the reduced velocities or of joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rnc_pin.control.controller import LimitedAcceleration
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.control.whole_body.limits.limited_joints import selection_rows
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.parameter_types import Numbers, Positive
from rnc_pin.model.reduced_model import ReducedModel


@dataclass(frozen=True)
class AccelerationLimit(ControlLimit):
    """Limit of the acceleration between two samples: of every reduced velocity, or of joints. A soft limit.

    Args:
        limit: largest acceleration [rad/s^2 or m/s^2]; one number, or one for each reduced velocity or joint entry, or
            one by the name of each joint, e.g. ``{"joint_1": 2.0}``.
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

    limit: float | Numbers | Mapping[str, Positive]
    joints: Sequence[str] | None = None
    priority: int = field(default=2, kw_only=True)

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundAccelerations(self, reduced)

    def entries(self, reduced: ReducedModel) -> tuple[LimitedAcceleration, ...]:
        """Limited entries of the accelerations of a model.

        Raises:
            ModelError: a joint does not exist.
            ConfigurationError: the limits are not positive, or do not fit the entries.
        """
        joints, given = self.joints, self.limit
        largest = np.zeros(0) if isinstance(given, Mapping) else np.asarray(given, dtype=float)
        if isinstance(given, Mapping):
            if joints is not None or not given:
                raise ConfigurationError("an acceleration limit has joints by name: give one or more, and no 'joints'")
            places = [reduced.robot.velocity_indices(name) for name in given]
            sizes = [place.stop - place.start for place in places]
            joints, largest = list(given), np.repeat(np.array(list(given.values()), dtype=float), sizes)
        if joints is None:
            quantity: Literal["v", "v2"] = "v2"
            columns, names = list(range(reduced.r)), list(reduced.reducing.names)
        else:
            quantity, velocities = "v", [reduced.robot.velocity_indices(name) for name in joints]
            columns = [index for each in velocities for index in range(each.start, each.stop)]
            names = [reduced.robot.velocity_names[index] for index in columns]
        if largest.shape not in ((), (len(names),)) or not ((largest > 0) & (largest < np.inf)).all():
            raise ConfigurationError(
                f"an acceleration limit has to be a positive number or {len(names)}, found {self.limit}"
            )
        limits = np.broadcast_to(largest, len(names)).tolist()
        found = zip(names, columns, limits, strict=True)
        return tuple(LimitedAcceleration(name, quantity, column, -limit, limit) for name, column, limit in found)


class _BoundAccelerations(BoundLimit):
    def __init__(self, limit: AccelerationLimit, reduced: ReducedModel) -> None:
        entries = limit.entries(reduced)
        self.names = tuple(f"{each.name} acceleration" for each in entries)
        self._largest = np.array([each.upper for each in entries])
        of_joints = limit.joints is not None or isinstance(limit.limit, Mapping)
        self._indices = [each.column for each in entries] if of_joints else None
        if self._indices is not None:
            self._jacobian = selection_rows(self._indices, reduced.n)

    def rows(self, sample: ControlSample) -> LimitRows:
        change = self._largest * sample.dt
        if self._indices is None:
            return LimitRows(sample.end.J2, sample.start.v2 - change, sample.start.v2 + change)
        v = sample.start.v[self._indices]
        return LimitRows(self._jacobian, v - change, v + change)
