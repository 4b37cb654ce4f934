"""Task: joints stay near given positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel


@dataclass(frozen=True)
class PostureTask(ControlTask):
    """Joints that move towards given positions: ``v = gain (qd - q)``.

    Args:
        joints: joint name to position [rad or m]; other joints are free.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.PostureTask({"joint_1": 0.5, "joint_2": -0.2}, gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0
        array([ 1. , -0.4])
    """

    joints: Mapping[str, float]

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundPosture(self, reduced)


class _BoundPosture(BoundTask):
    constant = True

    def __init__(self, task: PostureTask, reduced: ReducedModel) -> None:
        robot = reduced.robot
        if not task.joints:
            raise ConfigurationError("a posture needs at least one joint with its position")
        self._goal = robot.configuration(task.joints)
        places = [robot.velocity_indices(name) for name in task.joints]
        self._v = [index for each in places for index in range(each.start, each.stop)]
        self.names = tuple(f"{robot.velocity_names[index]} posture" for index in self._v)
        self._model, self._gain = robot.model, task.numbers("gain", task.gain, len(self._v))
        self._jacobian = np.eye(reduced.n)[self._v]

    def rows(self, sample: ControlSample) -> TaskRows:
        error = pin.difference(self._model, sample.end.q, self._goal)[self._v]  # angles take the shortest way
        return TaskRows(self._jacobian, self._gain * error)
