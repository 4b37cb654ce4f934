"""Task: a base follows a reference pose in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.control.controller import check_size
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.model.coordinates import wrapped
from rnc_pin.model.parameter_types import NotNegative
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.outputs import FramePosition, FrameYaw
from rnc_pin.planning.references import Reference


@dataclass(frozen=True)
class BasePoseTask(ControlTask):
    """Frame of a base that follows a reference pose (x, y, yaw) in the plane.

    A base that cannot move sideways corrects a lateral error by turning while it moves: set ``lateral_gain`` (Y.
    Kanayama et al., IEEE ICRA 1990). The yaw rate then grows by ``lateral_gain u e``, with the reference's forward
    speed u and the lateral error e to the left. At rest such a base keeps a lateral error.

    Args:
        frame: frame of the base, with x forward.
        reference: of x, y [m] and yaw [rad].
        lateral_gain: yaw rate per forward speed and lateral error [rad/m^2].

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.BasePoseTask("base", rnc.planning.Hold([1.0, 0.0, 0.2]), gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0
        array([2. , 0. , 0.4])
    """

    frame: str
    reference: Reference
    lateral_gain: NotNegative = 0.0

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundBase(self, reduced)


class _BoundBase(BoundTask):
    def __init__(self, task: BasePoseTask, reduced: ReducedModel) -> None:
        self._position = FramePosition(task.frame, "xy").bind(reduced.robot)
        self._yaw = FrameYaw(task.frame).bind(reduced.robot)
        self.names = self.goal_names = (*self._position.names, *self._yaw.names)
        check_size(task.reference, 3, "base pose")
        self._reference, self._gain = task.reference, task.numbers("gain", task.gain, 3)
        (self._lateral_gain,) = task.numbers("lateral_gain", task.lateral_gain, 1)

    def rows(self, sample: ControlSample) -> TaskRows:
        at, desired = sample.end.position, self._reference.at(sample.time)
        yaw = float(self._yaw.value(at)[0])
        offset = desired.position[:2] - self._position.value(at)
        error = np.array([*offset, wrapped(desired.position[2] - yaw)])
        rate = desired.velocity + self._gain * error
        cosine, sine = np.cos(desired.position[2]), np.sin(desired.position[2])
        forward = cosine * desired.velocity[0] + sine * desired.velocity[1]
        rate[2] += self._lateral_gain * forward * (np.cos(yaw) * offset[1] - np.sin(yaw) * offset[0])
        return TaskRows(np.vstack([self._position.jacobian(at), self._yaw.jacobian(at)]), rate)

    def goal(self, time: float) -> np.ndarray:
        return self._reference.at(time).position
