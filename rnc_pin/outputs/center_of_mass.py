"""Centre of mass of the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rnc_pin.errors import ConfigurationError, ModelError
from rnc_pin.math.linear_algebra import apply, cross_columns
from rnc_pin.model.frame_velocity import axis_index
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.offset_frame import OffsetFrame
from rnc_pin.model.rows import OutputRows
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


class _Body(NamedTuple):
    """Body behind a joint: its part of the mass, a frame on it, and its centre of mass in the axes of this frame."""

    share: float
    frame: int
    center: np.ndarray
    place: OffsetFrame


class _CenterOfMassRows(OutputRows):
    """Sum of the bodies' centres, each moved by its frame: ``v + w x arm``, all in world axes."""

    def __init__(self, robot: Robot, chosen: list[int]) -> None:
        self._chosen, self._nv = chosen, robot.nv
        self.names = tuple(f"center_of_mass_{'xyz'[axis]}" for axis in chosen)
        self.units, self.angular = ("m/s",) * len(chosen), (False,) * len(chosen)
        heavy = [index for index, each in enumerate(robot.model.inertias) if index and each.mass > 0]
        total = sum(robot.model.inertias[index].mass for index in heavy)
        self._bodies = [_body(robot, index, total) for index in heavy]

    def _arms(self, at: PositionKinematics) -> list[np.ndarray]:
        """Vectors (..., 3) from the origin of each frame to the centre of its body."""
        return [apply(at.rotation(body.frame), body.center) for body in self._bodies]

    def value(self, at: PositionKinematics) -> np.ndarray:
        centers = (
            body.share * (at.placement(body.frame).translation + arm)
            for body, arm in zip(self._bodies, self._arms(at), strict=True)
        )
        return np.asarray(sum(centers))[..., self._chosen]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        total = np.zeros((*at.q.shape[:-1], 3, self._nv))
        for body, arm in zip(self._bodies, self._arms(at), strict=True):
            J = at.jacobian(body.frame)
            total += body.share * (J[..., :3, :] - cross_columns(arm, J[..., 3:, :]))
        return total[..., self._chosen, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        total = np.zeros((*at.q.shape[:-1], 3, self._nv))
        for body, arm in zip(self._bodies, self._arms(at), strict=True):
            J, J_dot = at.jacobian(body.frame), at.jacobian_dot(body.frame)
            arm_rate = np.cross(at.velocity(body.frame)[..., 3:], arm)
            moved = J_dot[..., :3, :] - cross_columns(arm, J_dot[..., 3:, :]) - cross_columns(arm_rate, J[..., 3:, :])
            total += body.share * moved
        return total[..., self._chosen, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        total = np.zeros((*at.q.shape[:-1], 3))
        for body, arm in zip(self._bodies, self._arms(at), strict=True):
            w, acceleration = at.velocity(body.frame)[..., 3:], at.acceleration(body.frame)
            swing = np.cross(acceleration[..., 3:], arm) + np.cross(w, np.cross(w, arm))
            total += body.share * (acceleration[..., :3] + swing)
        return total[..., self._chosen]

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        total = sum(body.share * body.place.motion_gradients(at).acceleration[1][:3] for body in self._bodies)
        return np.asarray(total)[self._chosen]


def _body(robot: Robot, joint: int, total: float) -> _Body:
    """Body behind a joint.

    Raises:
        ModelError: it has no frame.
    """
    model, inertia = robot.model, robot.model.inertias[joint]
    for index, frame in enumerate(model.frames):
        if frame.parentJoint == joint and robot.frame_id(frame.name) == index:
            center = frame.placement.actInv(inertia.lever)
            return _Body(inertia.mass / total, index, center, OffsetFrame(robot, frame.name, center))
    raise ModelError(
        f"body behind joint '{model.names[joint]}' has no frame with a name of its own: add one with model.addFrame"
    )
