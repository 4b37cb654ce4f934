"""Limit: velocities of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Lt

from rnc_pin.array_shapes import Float
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.limits.control_limit import BoundLimit, ControlLimit, LimitRows
from rnc_pin.control.whole_body.limits.limited_joints import limited_velocities, selection_rows
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.parameter_types import Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.state_evaluation import StateEvaluation


@dataclass(frozen=True)
class JointVelocityLimit(ControlLimit):
    """Velocity limits of joints, from the robot's file by default. A hard limit.

    ``InverseDynamicsQP`` keeps it for the mean velocity over each sample too.

    Args:
        joints: names; by default every joint with a velocity limit in the file, or every joint of one degree of freedom
            if ``limit`` is given.
        limit: limit of all these joints [rad/s or m/s]; the limits of the file by default.
        margin: share of the limit that stays unused. It covers the change of R within a sample.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> limit = rnc.control.limits.JointVelocityLimit(joints=["joint_1"], limit=0.5, margin=0.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = limit.bind(reduced).rows(sample)
        >>> rows.lower.round(6), rows.upper.round(6)
        (array([-0.5]), array([0.5]))
    """

    hard: ClassVar[bool] = True

    joints: Sequence[str] | None = None
    limit: Positive | None = None
    margin: Annotated[float, Ge(0), Lt(1)] = 1e-3

    def __post_init__(self) -> None:
        if not 0 <= self.margin < 1 or not (self.limit is None or self.limit > 0):
            raise ConfigurationError(
                f"a joint velocity limit needs a positive limit and a margin of 0 to 1, found {self.limit} and "
                f"{self.margin}"
            )

    def bind(self, reduced: ReducedModel) -> BoundLimit:
        return _BoundVelocities(self, reduced)


class _BoundVelocities(BoundLimit):
    averaged = True

    def __init__(self, limit: JointVelocityLimit, reduced: ReducedModel) -> None:
        indices, largest = limited_velocities(reduced.robot, limit.joints, limit.limit)
        used = (1.0 - limit.margin) * largest
        names = reduced.robot.velocity_names
        self.names = tuple(f"{names[index]} velocity" for index in indices)
        self._rows = LimitRows(selection_rows(indices, reduced.n), -used, used)
        self._indices, self._largest = indices, largest

    def rows(self, sample: ControlSample) -> LimitRows:
        return self._rows

    def exceeded_by(
        self, state: StateEvaluation, time: float, mean: Float[np.ndarray, " nv"] | None = None
    ) -> Float[np.ndarray, " k"]:
        fastest = np.abs(state.v[self._indices])
        if mean is not None:
            fastest = np.maximum(fastest, np.abs(mean[self._indices]))
        return fastest - self._largest
