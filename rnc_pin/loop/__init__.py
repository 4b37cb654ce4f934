"""Control loop for an external process: measurements in, actuator inputs out."""

from rnc_pin.loop.control_loop import ControlLoop, Decision
from rnc_pin.loop.loop_state import LoopState
from rnc_pin.loop.options import LoopOptions
from rnc_pin.loop.velocity_loop import BaseTwist, VelocityCommand, VelocityInputLoop, VelocityLoop

__all__ = [
    "BaseTwist",
    "ControlLoop",
    "Decision",
    "LoopOptions",
    "LoopState",
    "VelocityCommand",
    "VelocityInputLoop",
    "VelocityLoop",
]
