"""rnc_pin: dynamics, redundancy and control of nonholonomic mechanical systems on Pinocchio."""

from rnc_pin.analysis import Linearization, Report, analyze, linearize
from rnc_pin.constraints import (
    JointCoupling,
    LoopClosure,
    MomentumConservation,
    NoSideSlip,
    Pfaffian,
    RollingBall,
    RollingWheel,
)
from rnc_pin.errors import (
    ConfigurationError,
    ConstraintError,
    DivergenceError,
    InfeasibleError,
    InputError,
    LimitError,
    ModelError,
    ModelWarning,
    RncError,
    SimulationError,
    SingularityError,
)
from rnc_pin.model.actuation import FrameForce, FrameTorque
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduction import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.model.task import Task
from rnc_pin.outputs import (
    Distance,
    FrameOrientation,
    FramePosition,
    FrameSpeed,
    FrameSpin,
    FrameTilt,
    FrameYaw,
    JointPosition,
    Output,
)
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import Outcome, Trajectory, free_motion, kinematic_rollout, preflight, simulate, summarize

__all__ = [
    "ConfigurationError",
    "ConstraintError",
    "Distance",
    "DivergenceError",
    "FrameForce",
    "FrameOrientation",
    "FramePosition",
    "FrameSpeed",
    "FrameSpin",
    "FrameTilt",
    "FrameTorque",
    "FrameYaw",
    "InfeasibleError",
    "InputError",
    "JointCoupling",
    "JointPosition",
    "LimitError",
    "Linearization",
    "LoopClosure",
    "Measurement",
    "ModelError",
    "ModelWarning",
    "MomentumConservation",
    "NoSideSlip",
    "NonholonomicSystem",
    "Outcome",
    "Output",
    "Pfaffian",
    "ReducedModel",
    "Report",
    "RncError",
    "Robot",
    "RollingBall",
    "RollingWheel",
    "SimulationError",
    "SingularityError",
    "Task",
    "Trajectory",
    "analyze",
    "free_motion",
    "kinematic_rollout",
    "linearize",
    "preflight",
    "simulate",
    "summarize",
]
