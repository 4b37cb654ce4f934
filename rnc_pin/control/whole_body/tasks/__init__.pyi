"""Exports of ``rnc_pin.control.whole_body.tasks``, which ``__init__.py`` imports at their first use."""

from .base_pose_task import BasePoseTask as BasePoseTask
from .center_of_mass_task import CenterOfMassTask as CenterOfMassTask
from .control_task import BoundTask as BoundTask
from .control_task import ControlTask as ControlTask
from .control_task import TaskRows as TaskRows
from .damping_task import DampingTask as DampingTask
from .look_at_task import LookAtTask as LookAtTask
from .manipulability_task import ManipulabilityTask as ManipulabilityTask
from .output_task import OutputTask as OutputTask
from .posture_task import PostureTask as PostureTask
from .singularity_task import SingularityTask as SingularityTask
