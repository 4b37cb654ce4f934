"""Position of a frame in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.frame_velocity import FrameVelocityRows, axis_index
from rnc_pin.model.kernel_rows import KernelRow, Value
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.rows import OutputRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FramePosition:
    """World coordinates of a frame's origin [m].

    Args:
        frame: name of the frame.
        axes: world axes, e.g. "xy" or "xyz".

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")])
        >>> reduced = system.reduce(vertical=[rnc.FramePosition("tip", "xy")])
        >>> x1, _ = reduced.at(robot.configuration({"root_joint": [1.0, 2.0, 0.0], "joint_2": np.pi / 2})).outputs()
        >>> x1.round(3)
        array([2., 3.])
    """

    frame: str
    axes: str = "xyz"

    def bind(self, robot: Robot) -> OutputRows:
        chosen = [axis_index(axis) for axis in self.axes]
        if not chosen or len(set(chosen)) != len(chosen):
            raise ConfigurationError(f"axes '{self.axes}' of frame '{self.frame}': name each of x, y, z at most once")
        return _PositionRows(self, robot, chosen)


class _PositionRows(FrameVelocityRows, OutputRows):
    def __init__(self, kind: FramePosition, robot: Robot, chosen: list[int]) -> None:
        super().__init__(robot, kind.frame, chosen)
        self.names = tuple(f"{kind.frame}_{axis}" for axis in kind.axes)
        self.angular = (False,) * len(chosen)

    def value(self, at: PositionKinematics) -> np.ndarray:
        return at.placement(self._frame).translation[..., self._rows]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        axes = np.arange(3)[self._rows].tolist()
        return [
            row._replace(value=(Value.COORDINATE, axis))
            for row, axis in zip(super().kernel_rows(model) or [], axes, strict=True)
        ]
