"""Task: velocities stay small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.model.reduced_model import ReducedModel


@dataclass(frozen=True)
class DampingTask(ControlTask):
    """Velocities that stay small: of the reducing outputs, or of joints. The gain has no effect.

    Args:
        joints: names of joints; by default the reduced velocities v2.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.DampingTask(joints=["joint_1"], weight=0.1)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0
        array([0.])
    """

    joints: Sequence[str] | None = None

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundDamping(self, reduced)


class _BoundDamping(BoundTask):
    constant = True

    def __init__(self, task: DampingTask, reduced: ReducedModel) -> None:
        self._jacobian: np.ndarray | None = None
        names: Sequence[str] = reduced.reducing.names
        if task.joints is not None:
            places = [reduced.robot.velocity_indices(name) for name in task.joints]
            indices = [index for each in places for index in range(each.start, each.stop)]
            names, self._jacobian = [reduced.robot.velocity_names[k] for k in indices], np.eye(reduced.n)[indices]
        self.names = tuple(f"{name} damping" for name in names)
        self._rest = np.zeros(len(names))

    def rows(self, sample: ControlSample) -> TaskRows:
        return TaskRows(sample.end.J2 if self._jacobian is None else self._jacobian, self._rest)
