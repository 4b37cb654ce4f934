"""No control: the robot moves freely."""

from __future__ import annotations

import numpy as np

from rnc_pin.control.controller import Command, DescribedMixin
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.reduced_model import ReducedModel


class ZeroInput(DescribedMixin):
    """All actuator inputs are zero, and no output has a goal.

    Args:
        reduced: the model.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> controller = rnc.control.ZeroInput(reduced)
        >>> run = rnc.simulate(reduced, controller, robot.configuration(), 0.1, dt=0.01, v2_0=[0.5, 0.0])
        >>> run.v2[-1].round(6) + 0.0  # straight on at constant speed
        array([0.5, 0. ])
    """

    def __init__(self, reduced: ReducedModel) -> None:
        self.inputs = np.zeros(reduced.p)
        self.inputs.setflags(write=False)

    def initial_state(self, measurement: Measurement) -> None:
        """Return None: the controller has no state."""

    def step(self, t: float, measurement: Measurement, state: None = None) -> tuple[Command, None]:
        return Command(T=self.inputs), None
