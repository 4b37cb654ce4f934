"""Centre of mass of the robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError, ModelError
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.offset_frame import OffsetFrame
from rnc_pin.model.rows import OutputRows
from rnc_pin.model.wrench_rows import PointRows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class CenterOfMass:
    """World coordinates of the centre of mass of the whole robot [m]; their rates are its momentum over its mass.

    Args:
        axes: world axes, e.g. "xy" or "xyz".

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")])
        >>> reduced = system.reduce(vertical=[rnc.CenterOfMass("xy")])
        >>> x1, _ = reduced.at(robot.configuration()).outputs()
        >>> x1.round(3)
        array([1., 0.])
    """

    axes: str = "xyz"

    def bind(self, robot: Robot) -> OutputRows:
        chosen = [axis_index(axis) for axis in self.axes]
        if not chosen or len(set(chosen)) != len(chosen):
            raise ConfigurationError(f"axes '{self.axes}' of the centre of mass: name each of x, y, z at most once")
        return _CenterOfMassRows(robot, chosen)


class _CenterOfMassRows(OutputRows):
    """Sum of the velocities of the bodies' centres, each times its part of the mass."""

    def __init__(self, robot: Robot, chosen: list[int]) -> None:
        self._chosen = chosen
        self.names = tuple(f"center_of_mass_{'xyz'[axis]}" for axis in chosen)
        self.units, self.angular = ("m/s",) * len(chosen), (False,) * len(chosen)
        inertias = robot.model.inertias
        heavy = [index for index, each in enumerate(inertias) if index and each.mass > 0]
        total = sum(inertias[index].mass for index in heavy)
        self._bodies = [(inertias[index].mass / total, PointRows(_center(robot, index))) for index in heavy]

    def _sum(self, of: Callable[[PointRows], np.ndarray]) -> np.ndarray:
        return np.asarray(sum(share * of(center) for share, center in self._bodies))

    def value(self, at: PositionKinematics) -> np.ndarray:
        return self._sum(lambda center: center.point.placement(at).translation)[..., self._chosen]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._sum(lambda center: center.jacobian(at))[..., self._chosen, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._sum(lambda center: center.jacobian_dot(at))[..., self._chosen, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return self._sum(lambda center: center.bias_acceleration(at))[..., self._chosen]

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        return self._sum(lambda center: center.bias_acceleration_gradient(at))[self._chosen]


def _center(robot: Robot, joint: int) -> OffsetFrame:
    """Centre of mass of the body behind a joint.

    Raises:
        ModelError: it has no frame.
    """
    model, inertia = robot.model, robot.model.inertias[joint]
    for index, frame in enumerate(model.frames):
        if frame.parentJoint == joint and robot.frame_id(frame.name) == index:
            return OffsetFrame(robot, frame.name, frame.placement.actInv(inertia.lever))
    raise ModelError(
        f"body behind joint '{model.names[joint]}' has no frame with a name of its own: add one with model.addFrame"
    )
