"""Exports of ``rnc_pin.control.loop``, which ``__init__.py`` imports at their first use."""

from .control_loop import ControlLoop as ControlLoop
from .control_loop import Decision as Decision
from .loop_state import LoopState as LoopState
from .options import LoopOptions as LoopOptions
from .options import LoopSettings as LoopSettings
from .velocity_loop import BaseTwist as BaseTwist
from .velocity_loop import VelocityCommand as VelocityCommand
from .velocity_loop import VelocityInputLoop as VelocityInputLoop
from .velocity_loop import VelocityLoop as VelocityLoop
