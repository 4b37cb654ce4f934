"""Task: the centre of mass follows a reference."""

from __future__ import annotations

from dataclasses import dataclass

import pinocchio as pin

from rnc_pin.control.controller import check_size
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.planning.references import Reference


@dataclass(frozen=True)
class CenterOfMassTask(ControlTask):
    """Centre of mass of the robot that follows a reference in the world.

    Args:
        reference: of the coordinates [m].
        axes: world axes, e.g. "xy" or "xyz".

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.CenterOfMassTask(rnc.planning.Hold([1.5, 0.0]), axes="xy", gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0  # the centre is at x = 1 m
        array([1., 0.])
    """

    reference: Reference
    axes: str = "xyz"

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundCenter(self, reduced)


class _BoundCenter(BoundTask):
    def __init__(self, task: CenterOfMassTask, reduced: ReducedModel) -> None:
        self._axes = [axis_index(axis) for axis in task.axes]
        if not self._axes or len(set(self._axes)) != len(self._axes):
            raise ConfigurationError(f"axes '{task.axes}' of the centre of mass: name each of x, y, z at most once")
        check_size(task.reference, len(self._axes), "centre-of-mass")
        self.names = tuple(f"center_of_mass_{axis}" for axis in task.axes)
        self._gain = task.numbers("gain", task.gain, len(self._axes))
        self._reference, self._model = task.reference, reduced.robot.model
        self._data = self._model.createData()

    def rows(self, sample: ControlSample) -> TaskRows:
        desired = self._reference.at(sample.time)
        jacobian = pin.jacobianCenterOfMass(self._model, self._data, sample.end.q).reshape(3, -1)[self._axes]
        error = desired.position - self._data.com[0][self._axes]
        return TaskRows(jacobian, desired.velocity + self._gain * error)
