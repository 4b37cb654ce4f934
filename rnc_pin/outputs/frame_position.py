"""Where a frame is in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FramePosition:
    """World coordinates of a frame's origin [m].

    Args:
        frame: name of the frame.
        axes: which world axes, e.g. "xy" or "xyz".
    """

    frame: str
    axes: str = "xyz"

    def bind(self, robot: Robot) -> OutputRows:
        return _PositionRows(self, robot)


class _PositionRows(OutputRows):
    def __init__(self, kind: FramePosition, robot: Robot) -> None:
        chosen = [axis_index(axis) for axis in kind.axes]
        if not chosen or len(set(chosen)) != len(chosen):
            raise ConfigurationError(f"axes '{kind.axes}' of frame '{kind.frame}': name each of x, y, z at most once")
        self.names = tuple(f"{kind.frame}_{axis}" for axis in kind.axes)
        self.units = ("m/s",) * len(chosen)
        self.angular = (False,) * len(chosen)
        self._frame = robot.frame_id(kind.frame)
        self._axes: slice | list[int] = chosen
        if chosen == list(range(chosen[0], chosen[-1] + 1)):
            self._axes = slice(chosen[0], chosen[-1] + 1)  # a view, not a copy, on the hot path

    def value(self, state: Kinematics) -> np.ndarray:
        return state.placement(self._frame).translation[self._axes]

    def jacobian(self, state: Kinematics) -> np.ndarray:
        return state.jacobian(self._frame)[self._axes]

    def jacobian_dot(self, state: Kinematics) -> np.ndarray:
        return state.jacobian_dot(self._frame)[self._axes]

    def drift(self, state: Kinematics) -> np.ndarray:
        return state.acceleration(self._frame).linear[self._axes]

    def drift_gradient(self, state: Kinematics) -> np.ndarray:
        return state.frame_gradients(self._frame).acceleration[self._axes]
