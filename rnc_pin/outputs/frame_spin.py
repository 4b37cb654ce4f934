"""A frame's angular velocity about its own axis: a quasi-velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.model.frame_velocity import OwnAxisSpin
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FrameSpin:
    """Angular velocity of a frame about the frame's own axis [rad/s], e.g. the roll rate of a bicycle.

    It is the rate of no coordinate: in a trajectory its integral over time stands in ``x2``.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".
    """

    frame: str
    axis: str = "z"

    def bind(self, robot: Robot) -> OutputRows:
        return _SpinRow(self, robot)


class _SpinRow(OwnAxisSpin, OutputRows):
    quasi = True

    def __init__(self, kind: FrameSpin, robot: Robot) -> None:
        super().__init__(robot.frame_id(kind.frame), kind.axis)
        self.names = (f"{kind.frame}_spin_{kind.axis}",)
        self.units = ("rad/s",)
        self.angular = (False,)
        self._zero = np.zeros(1)

    def value(self, state: Kinematics) -> np.ndarray:
        return self._zero
