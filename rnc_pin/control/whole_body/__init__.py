"""Whole-body control within limits: tasks and limits as a quadratic program in the reduced velocities."""

from rnc_pin.control.whole_body import limits, tasks
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.inverse_dynamics_qp import InputSolution, InverseDynamicsQP, InverseDynamicsState
from rnc_pin.control.whole_body.velocity_qp import LimitReport, ProgramSolution, ProgramState, VelocityQP

__all__ = [
    "ControlSample",
    "InputSolution",
    "InverseDynamicsQP",
    "InverseDynamicsState",
    "LimitReport",
    "ProgramSolution",
    "ProgramState",
    "VelocityQP",
    "limits",
    "tasks",
]
