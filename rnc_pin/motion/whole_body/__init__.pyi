"""Exports of ``rnc_pin.motion.whole_body``, which ``__init__.py`` imports at their first use."""

from . import limits as limits
from . import tasks as tasks
from .inverse_dynamics_qp import InputSolution as InputSolution
from .inverse_dynamics_qp import InverseDynamicsQP as InverseDynamicsQP
from .inverse_dynamics_qp import InverseDynamicsState as InverseDynamicsState
from .limits.control_limit import ControlSample as ControlSample
from .whole_body_program import LimitReport as LimitReport
from .whole_body_program import ProgramSolution as ProgramSolution
from .whole_body_program import ProgramState as ProgramState
from .whole_body_program import VelocityQP as VelocityQP
from .whole_body_program import WholeBodyProgram as WholeBodyProgram
from .whole_body_program import program_of as program_of
