"""Control loop for an external process: measurements in, actuator inputs out."""

from rnc_pin.loop.control_loop import ControlLoop, Decision
from rnc_pin.loop.loop_state import LoopState
from rnc_pin.loop.options import LoopOptions

__all__ = ["ControlLoop", "Decision", "LoopOptions", "LoopState"]
