"""Controllers in a loop that somebody else runs."""

from rnc_pin.loop.control_loop import ControlLoop, Decision, LoopOptions
from rnc_pin.loop.loop_state import LoopState

__all__ = ["ControlLoop", "Decision", "LoopOptions", "LoopState"]
