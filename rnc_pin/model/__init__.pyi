"""Exports of ``rnc_pin.model``, which ``__init__.py`` imports at their first use."""

from . import integrators as integrators
from .actuation import Actuator as Actuator
from .actuation import FrameForce as FrameForce
from .actuation import FrameTorque as FrameTorque
from .actuation import OpenDifferential as OpenDifferential
from .configuration_evaluation import ConfigurationEvaluation as ConfigurationEvaluation
from .coordinates import Coordinates as Coordinates
from .coordinates import heading_of as heading_of
from .coordinates import wrapped as wrapped
from .evaluator import ReducedRegressor as ReducedRegressor
from .frame_rows import OffsetFrame as OffsetFrame
from .frame_rows import axis_index as axis_index
from .input_validation import NotNegative as NotNegative
from .input_validation import Positive as Positive
from .input_validation import is_number as is_number
from .input_validation import vector as vector
from .kinematics import Kinematics as Kinematics
from .passive_forces import ForceKind as ForceKind
from .reduced_kinematics import Measurement as Measurement
from .reduced_model import ReducedModel as ReducedModel
from .row_stack import OutputStack as OutputStack
from .rows import ConstraintKind as ConstraintKind
from .rows import OutputKind as OutputKind
from .state_evaluation import StateEvaluation as StateEvaluation
from .system import NonholonomicSystem as NonholonomicSystem
from .task import Task as Task
