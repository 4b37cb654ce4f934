"""What ``rnc_pin`` exports: read by type checkers and editors, and by ``__init__.py`` to import each name lazily."""

from . import analysis, constraints, control, errors, outputs, planning, robots, simulation
from .analysis import Linearization, Report, analyze, linearize
from .constraints import (
    JointCoupling,
    LoopClosure,
    MomentumConservation,
    NoSideSlip,
    Pfaffian,
    RollingBall,
    RollingWheel,
)
from .errors import (
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
from .model.actuation import FrameForce, FrameTorque
from .model.measurement import Measurement
from .model.reduced_model import ReducedModel
from .model.system import NonholonomicSystem
from .model.task import Task
from .outputs import (
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
from .robots.robot import Robot
from .simulation import Outcome, Trajectory, free_motion, kinematic_rollout, preflight, simulate, summarize
from .version import __version__

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
    "__version__",
    "analysis",
    "analyze",
    "constraints",
    "control",
    "errors",
    "free_motion",
    "kinematic_rollout",
    "linearize",
    "outputs",
    "planning",
    "preflight",
    "robots",
    "simulate",
    "simulation",
    "summarize",
]
