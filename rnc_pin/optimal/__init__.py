"""Optimal control of reduced systems: plans within bounds, feedback along them, model-predictive control."""

from rnc_pin.optimal.action_models import ActionModel, action_model
from rnc_pin.optimal.bounds import BoundKind, DistanceBound, InputBound, OutputBound, VelocityBound
from rnc_pin.optimal.costs import AccelerationCost, CostKind, EffortCost, OutputCost, PostureCost, VelocityCost
from rnc_pin.optimal.file_limits import FileLimits
from rnc_pin.optimal.guesses import driven_configurations
from rnc_pin.optimal.motion_plan import Integration, MotionPlan, PlanInfo, PlannedOutputs, PlanVerification
from rnc_pin.optimal.plan_feedback import PlanFeedback, tvlqr
from rnc_pin.optimal.planner import plan_motion as plan
from rnc_pin.optimal.predictive_control import PredictiveController, PredictiveState
from rnc_pin.optimal.sequential_quadratic import SolverSettings

__all__ = [
    "AccelerationCost",
    "ActionModel",
    "BoundKind",
    "CostKind",
    "DistanceBound",
    "EffortCost",
    "FileLimits",
    "InputBound",
    "Integration",
    "MotionPlan",
    "OutputBound",
    "OutputCost",
    "PlanFeedback",
    "PlanInfo",
    "PlanVerification",
    "PlannedOutputs",
    "PostureCost",
    "PredictiveController",
    "PredictiveState",
    "SolverSettings",
    "VelocityBound",
    "VelocityCost",
    "action_model",
    "driven_configurations",
    "plan",
    "tvlqr",
]
