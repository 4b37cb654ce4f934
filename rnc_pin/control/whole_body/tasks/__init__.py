"""Tasks of whole-body control; one file each."""

from rnc_pin.control.whole_body.tasks.base_pose_task import BasePoseTask
from rnc_pin.control.whole_body.tasks.center_of_mass_task import CenterOfMassTask
from rnc_pin.control.whole_body.tasks.control_task import BoundTask, ControlTask, TaskRows
from rnc_pin.control.whole_body.tasks.damping_task import DampingTask
from rnc_pin.control.whole_body.tasks.look_at_task import LookAtTask
from rnc_pin.control.whole_body.tasks.manipulability_task import ManipulabilityTask
from rnc_pin.control.whole_body.tasks.output_task import OutputTask
from rnc_pin.control.whole_body.tasks.posture_task import PostureTask
from rnc_pin.control.whole_body.tasks.singularity_task import SingularityTask

__all__ = [
    "BasePoseTask",
    "BoundTask",
    "CenterOfMassTask",
    "ControlTask",
    "DampingTask",
    "LookAtTask",
    "ManipulabilityTask",
    "OutputTask",
    "PostureTask",
    "SingularityTask",
    "TaskRows",
]
