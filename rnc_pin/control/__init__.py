"""Controllers: one file each, one protocol, gains beside them."""

from rnc_pin.control.actuator_velocity import ActuatorVelocityController
from rnc_pin.control.chained_stabilizer import ChainedStabilizer
from rnc_pin.control.computed_torque import ComputedTorque
from rnc_pin.control.controller import (
    Command,
    Controller,
    Describable,
    Description,
    KinematicController,
    VelocityTarget,
    describe,
)
from rnc_pin.control.estimation import AdaptedModel, EstimatedModel, ParametrizedCopy, Regressor
from rnc_pin.control.estimator import Estimator
from rnc_pin.control.gain_design import (
    PositionGains,
    Preset,
    VelocityGains,
    design_position_gains,
    design_velocity_gains,
)
from rnc_pin.control.jacobian_transpose import JacobianTransposeController, effective_inertia
from rnc_pin.control.momentum_regressor import MomentumRegressor, UnknownMass
from rnc_pin.control.position_tracker import PositionState, PositionTracker
from rnc_pin.control.reducing import ReducingOutputController
from rnc_pin.control.redundancy import RedundancyController
from rnc_pin.control.secondary import Combined, JointLimits, Posture, Secondary, SingularityDistance
from rnc_pin.control.slithering import DrivenPath, SlitheringReference
from rnc_pin.control.split import SplitController
from rnc_pin.control.state_feedback import StateFeedback
from rnc_pin.control.steering import SteeringController
from rnc_pin.control.uncertain import UncertainController
from rnc_pin.control.uncertain_redundancy import UncertainRedundancyController
from rnc_pin.control.unicycle_stabilizer import UnicycleStabilizer
from rnc_pin.control.velocity_tracker import TrackerState, VelocityTracker
from rnc_pin.control.wheel_regressor import UnknownRadius, UnknownTrack, WheelRegressor
from rnc_pin.control.whole_body import (
    ControlSample,
    InputSolution,
    InverseDynamicsQP,
    InverseDynamicsState,
    LimitReport,
    ProgramSolution,
    ProgramState,
    VelocityQP,
    limits,
    tasks,
)
from rnc_pin.control.zero_input import ZeroInput

__all__ = [
    "ActuatorVelocityController",
    "AdaptedModel",
    "ChainedStabilizer",
    "Combined",
    "Command",
    "ComputedTorque",
    "ControlSample",
    "Controller",
    "Describable",
    "Description",
    "DrivenPath",
    "EstimatedModel",
    "Estimator",
    "InputSolution",
    "InverseDynamicsQP",
    "InverseDynamicsState",
    "JacobianTransposeController",
    "JointLimits",
    "KinematicController",
    "LimitReport",
    "MomentumRegressor",
    "ParametrizedCopy",
    "PositionGains",
    "PositionState",
    "PositionTracker",
    "Posture",
    "Preset",
    "ProgramSolution",
    "ProgramState",
    "ReducingOutputController",
    "RedundancyController",
    "Regressor",
    "Secondary",
    "SingularityDistance",
    "SlitheringReference",
    "SplitController",
    "StateFeedback",
    "SteeringController",
    "TrackerState",
    "UncertainController",
    "UncertainRedundancyController",
    "UnicycleStabilizer",
    "UnknownMass",
    "UnknownRadius",
    "UnknownTrack",
    "VelocityGains",
    "VelocityQP",
    "VelocityTarget",
    "VelocityTracker",
    "WheelRegressor",
    "ZeroInput",
    "describe",
    "design_position_gains",
    "design_velocity_gains",
    "effective_inertia",
    "limits",
    "tasks",
]
