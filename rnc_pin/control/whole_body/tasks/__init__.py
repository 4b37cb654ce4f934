"""Tasks of whole-body control; one file each."""

from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.control.whole_body.tasks.output_task import OutputTask

__all__ = ["BoundTask", "ControlTask", "OutputTask", "TaskRows"]
