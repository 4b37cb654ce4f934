"""Whole-body control within limits: tasks and limits as a quadratic program in the reduced velocities."""

from rnc_pin.control.whole_body import limits, tasks
from rnc_pin.control.whole_body.control_sample import ControlSample
from rnc_pin.control.whole_body.inverse_dynamics_qp import InputSolution, InverseDynamicsQP, InverseDynamicsState
from rnc_pin.control.whole_body.velocity_qp import ProgramSolution, ProgramState, VelocityQP
from rnc_pin.control.whole_body.whole_body_program import LimitReport, WholeBodyProgram

__all__ = [
    "ControlSample",
    "InputSolution",
    "InverseDynamicsQP",
    "InverseDynamicsState",
    "LimitReport",
    "ProgramSolution",
    "ProgramState",
    "VelocityQP",
    "WholeBodyProgram",
    "limits",
    "tasks",
]
