"""Checks of the arguments of ``simulate``, before the run starts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rnc_pin.deprecation import present_keywords
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.loop import LoopOptions
from rnc_pin.loop.options import FORMER_OPTIONS, admit_controller, admit_model, type_name
from rnc_pin.simulation.plant import Plant
from rnc_pin.simulation.stop import Stop

_MACHINE = ("reset", "read", "apply", "advance")


def check_parts(
    reduced: Any, controller: Any, plant: Any, stop: Any, machine: Any, loop: Any, observer: Any
) -> LoopOptions:
    """Check the types of arguments. Return the options of the loop, under present names.

    Raises:
        ConfigurationError: names the argument and the expected type.
    """
    admit_model(reduced)
    admit_controller(controller)
    for name, value, kind in (("plant", plant, Plant), ("stop", stop, Stop)):
        if not isinstance(value, kind):
            raise ConfigurationError(f"{name}: expected a {kind.__name__}, found {type_name(value)}")
    lacking = [each for each in _MACHINE if not callable(getattr(machine, each, None))]
    if machine is not None and (lacking or isinstance(machine, type)):
        raise ConfigurationError(f"machine: expected methods {', '.join(_MACHINE)}, found {type_name(machine)}")
    if loop is not None and not isinstance(loop, Mapping):
        raise ConfigurationError(f"loop: expected a mapping of options of ControlLoop, found {type_name(loop)}")
    options: LoopOptions = present_keywords(loop or {}, FORMER_OPTIONS, "loop", stacklevel=5)
    for option in options:
        if option not in LoopOptions.__annotations__:
            raise ConfigurationError(f"loop: no option '{option}'{nearest(str(option), LoopOptions.__annotations__)}")
    if observer is not None and not callable(observer):
        raise ConfigurationError(f"observer: expected a function of a Sample, found {type_name(observer)}")
    return options
