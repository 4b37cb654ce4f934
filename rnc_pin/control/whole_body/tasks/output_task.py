"""Task: an output follows a reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.control.controller import check_size
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.compiled import evaluator_for
from rnc_pin.model.numpy_evaluator import NumPyEvaluator
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.rows import ConstantRows, OutputKind
from rnc_pin.planning.references import Reference


@dataclass(frozen=True)
class OutputTask(ControlTask):
    """Output that follows a reference: ``J v = xd_dot + gain (xd - x)``.

    Any output serves, whether it is a reducing output, a vertical output or neither. Angles and orientations take the
    shortest rotation. A quasi-velocity such as a speed follows the velocity of its reference; it has no position error.

    Args:
        output: the output, e.g. ``rnc.FramePosition("hand")``.
        reference: its reference.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.OutputTask(rnc.JointPosition("joint_1"), rnc.planning.Hold([0.5]), gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0  # gain times the error
        array([1.])
    """

    output: OutputKind
    reference: Reference

    def bind(self, reduced: ReducedModel) -> BoundOutput:
        return BoundOutput(self, self.output, self.reference, reduced)


class BoundOutput(BoundTask):
    """Output that follows a reference, for one model; ``TaskStack`` evaluates all of them together.

    Args:
        task: the task, which has the gain.
        output: the output.
        reference: its reference.
        reduced: the model.

    Attributes:
        block: rows of the output.
        reference: its reference.
        gain: rate of convergence of each row (k,) [1/s]; zero for a quasi-velocity.
    """

    def __init__(self, task: ControlTask, output: OutputKind, reference: Reference, reduced: ReducedModel) -> None:
        self.block, self.reference = output.bind(reduced.robot), reference
        self._together = OutputsTogether([self], reduced)
        self.names = self.goal_names = self.block.names
        self.constant = isinstance(self.block, ConstantRows)
        check_size(reference, len(self.names), f"'{', '.join(self.names)}'")
        self.gain = task.numbers("gain", task.gain, len(self.names)) * (not self.block.quasi)

    def rows(self, sample: ControlSample) -> TaskRows:
        return self._together.rows(sample)

    def goal(self, time: float) -> np.ndarray:
        return self.reference.at(time).position


class OutputsTogether:
    """Several output tasks of one model, with one evaluation of all outputs.

    Args:
        tasks: the tasks.
        reduced: the model.
    """

    def __init__(self, tasks: Sequence[BoundOutput], reduced: ReducedModel) -> None:
        self._tasks, self._reduced = tasks, reduced
        self._stack = OutputStack([task.block for task in tasks])

    @cached_property
    def _evaluator(self) -> NumPyEvaluator:
        return evaluator_for(self._reduced.reduction_data.measuring(self._stack), self._reduced.evaluator)

    @cached_property
    def _gain(self) -> np.ndarray:
        return np.concatenate([task.gain for task in self._tasks])

    def rows(self, sample: ControlSample) -> TaskRows:
        """Return the rows of all tasks at the end of a sample."""
        here = sample.end.configuration.in_reduction(self._evaluator)
        points = [task.reference.at(sample.time) for task in self._tasks]
        position, velocity, acceleration = (np.concatenate(each) for each in list(zip(*points, strict=True))[:3])
        coordinates = self._stack.coordinates
        rate = coordinates.to_rates(position, velocity, acceleration)[0]
        return TaskRows(here.J1, rate + self._gain * coordinates.difference(position, here.outputs()[0]))
