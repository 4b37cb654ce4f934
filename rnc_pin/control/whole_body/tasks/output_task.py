"""Task: an output follows a reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.control.controller import check_size
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.rows import OutputKind
from rnc_pin.planning.references import Reference


@dataclass(frozen=True)
class OutputTask(ControlTask):
    """Output that follows a reference: ``J v = xd_dot + gain (xd - x)``.

    Any output serves, whether it is a reducing output, a vertical output or neither. Angles and orientations take the
    shortest rotation. A quasi-velocity such as a speed follows the velocity of its reference; it has no position error.

    Args:
        output: the output, e.g. ``rnc.FramePosition("hand")``.
        reference: its reference.
    """

    output: OutputKind
    reference: Reference

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundOutput(self, reduced)


class _BoundOutput(BoundTask):
    def __init__(self, task: OutputTask, reduced: ReducedModel) -> None:
        block = task.output.bind(reduced.robot)
        stack = OutputStack([block])
        self.names = self.goal_names = stack.names
        check_size(task.reference, stack.size, f"'{', '.join(stack.names)}'")
        self._block, self._reference = block, task.reference
        self._coordinates = stack.coordinates
        self._gain = task.numbers("gain", task.gain, stack.size)

    def rows(self, sample: ControlSample) -> TaskRows:
        at, desired = sample.end.position, self._reference.at(sample.time)
        rate = self._coordinates.to_rates(desired.position, desired.velocity, desired.acceleration)[0]
        if not self._block.quasi:
            rate = rate + self._gain * self._coordinates.difference(desired.position, self._block.value(at))
        return TaskRows(self._block.jacobian(at), rate)

    def goal(self, time: float) -> np.ndarray:
        return self._reference.at(time).position
