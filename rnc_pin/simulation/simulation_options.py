"""Arguments and options of ``simulate``, and the samples that it passes to an observer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rnc_pin.control.controller import Command, Controller, State
from rnc_pin.control.loop import LoopOptions
from rnc_pin.control.loop.options import type_name
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.io.json import Json
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants import Plant
from rnc_pin.printing import printed
from rnc_pin.simulation.run_info import Provenance
from rnc_pin.simulation.stop import DEFAULT_STOP, Stop


@printed()
class Sample(NamedTuple):
    """Argument of an observer, once per sample. Its arrays are never overwritten."""

    time: float
    """[s]"""
    measurement: Measurement
    command: Command
    T: np.ndarray
    """Applied actuator inputs (p,)."""
    state: State = None
    """State of the controller after the sample."""


Observer = Callable[[Sample], None]


@dataclass(frozen=True)
class SimulationOptions:
    """Options of a run of ``simulate``.

    Args:
        stop: conditions that end the run early: ``Stop(position_limits=True)``.
        loop: options of the ``ControlLoop`` of the controller. On a ``ReducedPlant`` of the same model, errors are
            raised by default; on another plant the loop gives a safe command instead. Inputs are clipped by the plant.
        controller_state: initial state of the controller; a new one by default.
        observer: function that is called with every ``Sample``.
        meta: origin of the run, stored with the trajectory: a ``Provenance``, or a mapping that JSON can represent.

    Raises:
        ConfigurationError: an option has the wrong type, or ``loop`` has an unknown key.

    Example:
        >>> times, observer = [], lambda sample: times.append(sample.time)
        >>> options = rnc.SimulationOptions(rnc.Stop(speed=5.0), {"velocity": "observer"}, observer=observer)
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> drives = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], drives)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.0, 0.0]))
        >>> tracker = rnc.control.VelocityTracker(target)
        >>> _ = rnc.simulate(reduced, tracker, robot.configuration(), 0.2, dt=0.1, options=options)
        >>> times
        [0.0, 0.1, 0.2]
    """

    stop: Stop = DEFAULT_STOP
    loop: LoopOptions = field(default_factory=LoopOptions)
    controller_state: State = None
    observer: Observer | None = None
    meta: Provenance | Mapping[str, Json] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.stop, Stop):
            raise ConfigurationError(f"stop: expected a Stop, found {type_name(self.stop)}")
        if not isinstance(self.loop, Mapping):
            raise ConfigurationError(
                f"loop: expected a mapping of options of ControlLoop, found {type_name(self.loop)}"
            )
        for option in self.loop:
            if option not in LoopOptions.__annotations__:
                hint = nearest(str(option), LoopOptions.__annotations__)
                raise ConfigurationError(f"loop: no option '{option}'{hint}")
        object.__setattr__(self, "loop", dict(self.loop))
        if self.observer is not None and not callable(self.observer):
            raise ConfigurationError(f"observer: expected a function of a Sample, found {type_name(self.observer)}")


DEFAULT_OPTIONS = SimulationOptions()


class RunArguments(NamedTuple):
    """Arguments of one run, as for ``simulate``, with a number of samples instead of a duration."""

    reduced: ReducedModel
    controller: Controller
    q0: np.ndarray
    dt: float
    samples: int
    """Number of samples, or the expected one if the caller ends the run."""
    v2_0: np.ndarray | None = None
    plant: Plant | None = None
    options: SimulationOptions = DEFAULT_OPTIONS
