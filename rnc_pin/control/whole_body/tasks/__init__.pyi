"""Exports of ``rnc_pin.control.whole_body.tasks``, which ``__init__.py`` imports at their first use."""

from .output_tasks import BasePoseTask as BasePoseTask
from .output_tasks import BoundTask as BoundTask
from .output_tasks import CenterOfMassTask as CenterOfMassTask
from .output_tasks import ControlTask as ControlTask
from .output_tasks import LookAtTask as LookAtTask
from .output_tasks import OutputTask as OutputTask
from .output_tasks import TaskRows as TaskRows
from .velocity_tasks import DampingTask as DampingTask
from .velocity_tasks import ManipulabilityTask as ManipulabilityTask
from .velocity_tasks import PostureTask as PostureTask
from .velocity_tasks import SingularityTask as SingularityTask
