"""Task: a frame looks at a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin import _kernel
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.errors import ConfigurationError, SingularityError
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.parameter_types import Axis
from rnc_pin.model.reduced_model import ReducedModel

_NEAR = 1e-6  # [m]


@dataclass(frozen=True)
class LookAtTask(ControlTask):
    """Frame whose own axis points at a point of the world, or at another frame.

    With the axis a, the unit vector d to the point and the error ``e = a - d``, the task is ``e_dot = -gain e``. The
    three rows have rank two: the rotation about the axis is free.

    Args:
        frame: name of the frame, e.g. of a camera.
        target: point in the world (x, y, z) [m], or the name of a frame.
        axis: the frame's own axis.

    Raises:
        SingularityError: at a sample, the point is at the origin of the frame.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.LookAtTask("tip", target=[2.0, 3.0, 0.48], axis="x", gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0  # -gain (a - d): the point is to the left of the tip
        array([-2.,  2.,  0.])
    """

    frame: str
    target: Sequence[float] | str
    axis: Axis = "x"

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundLook(self, reduced)


class _BoundLook(BoundTask):
    def __init__(self, task: LookAtTask, reduced: ReducedModel) -> None:
        robot = reduced.robot
        self._frame, self._axis = robot.frame_id(task.frame), axis_index(task.axis)
        self._other = robot.frame_id(task.target) if isinstance(task.target, str) else None
        self._point = np.zeros(3) if isinstance(task.target, str) else np.asarray(task.target, dtype=float)
        if self._point.shape != (3,) or not np.isfinite(self._point).all():
            raise ConfigurationError(f"frame '{task.frame}' looks at a frame or at (x, y, z), found {task.target}")
        self.names = tuple(f"{task.frame} looks {axis}" for axis in "xyz")
        self._gain = task.numbers("gain", task.gain, 3)

    def rows(self, sample: ControlSample) -> TaskRows:
        at = sample.end.position
        here, J = at.placement(self._frame), at.jacobian(self._frame)
        axis, point, other = here.rotation[:, self._axis].copy(), self._point, None
        if self._other is not None:
            point, other = at.placement(self._other).translation, at.jacobian(self._other)
        ray = point - here.translation
        length = float(np.sqrt(ray @ ray))
        if length < _NEAR:
            raise SingularityError(
                "a frame cannot look at its own origin", q=sample.end.q.copy(), condition=np.inf, rows=self.names
            )
        direction = ray / length
        rate = -self._gain * (axis - direction)
        rows = np.empty((3, J.shape[-1]))
        if _kernel.library.look_rows(J, other, axis, ray, length, rows):
            return TaskRows(rows, rate)
        approach = -J[:3] if other is None else other[:3] - J[:3]
        turn = (approach - np.outer(direction, direction @ approach)) / length
        return TaskRows(-pin.skew(axis) @ J[3:] - turn, rate)
