"""Task: distance from configurations at which the reducing outputs do not parametrise the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.model.reduced_model import ReducedModel


@dataclass(frozen=True)
class SingularityTask(ControlTask):
    """Motion away from singular configurations: ``v2 = gain dw/dx2``, ``w = log |det E|``.

    E is the stack of constraint rows and reducing outputs. Give the task a lower priority than the others.
    The gradient is exact. For the singular configurations of another output, use ``ManipulabilityTask``.
    """

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundSingularity(self, reduced)


class _BoundSingularity(BoundTask):
    def __init__(self, task: SingularityTask, reduced: ReducedModel) -> None:
        self.names = tuple(f"{name} regularity" for name in reduced.reducing.names)
        self._gain = task.numbers("gain", task.gain, reduced.r)

    def rows(self, sample: ControlSample) -> TaskRows:
        rates = sample.along_reducing_outputs().E_dot
        return TaskRows(sample.end.J2, self._gain * np.einsum("ij,sji->s", sample.end.E_inverse, rates))
