"""Exports of ``rnc_pin.optimal``, which ``__init__.py`` imports at their first use."""

from .action_models import ActionModel as ActionModel
from .action_models import action_model as action_model
from .bounds import BoundKind as BoundKind
from .bounds import DistanceBound as DistanceBound
from .bounds import InputBound as InputBound
from .bounds import OutputBound as OutputBound
from .bounds import VelocityBound as VelocityBound
from .costs import AccelerationCost as AccelerationCost
from .costs import CostKind as CostKind
from .costs import EffortCost as EffortCost
from .costs import OutputCost as OutputCost
from .costs import PostureCost as PostureCost
from .costs import VelocityCost as VelocityCost
from .file_limits import FileLimits as FileLimits
from .guesses import driven_configurations as driven_configurations
from .motion_plan import Integration as Integration
from .motion_plan import MotionPlan as MotionPlan
from .motion_plan import PlanInfo as PlanInfo
from .motion_plan import PlannedOutputs as PlannedOutputs
from .motion_plan import PlanVerification as PlanVerification
from .plan_feedback import PlanFeedback as PlanFeedback
from .plan_feedback import tvlqr as tvlqr
from .planner import plan as plan
from .predictive_control import PredictiveController as PredictiveController
from .predictive_control import PredictiveState as PredictiveState
from .sequential_quadratic import SolverSettings as SolverSettings
