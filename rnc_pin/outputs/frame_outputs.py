"""Outputs of one frame: position, orientation, heading, tilt, speed and angular velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.math.linear_algebra import Entry
from rnc_pin.model.frame_rows import DirectionRows, FrameVelocityRows, axis_index
from rnc_pin.model.input_validation import Axes, Axis
from rnc_pin.model.kernel_rows import Form, KernelRow, Value, attached
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES, PositionKinematics
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
    axes: Axes = "xyz"

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


@dataclass(frozen=True)
class FrameOrientation:
    """Orientation of a frame: its rate is the angular velocity in world axes, its error is on SO(3).

    The value is the rotation vector [rad], with a length of at most pi; in a trajectory it continues without jumps. The
    error of a reference Rd is ``log(Rd R^T)`` in world axes, the shortest rotation, so unwinding does not occur.
    References are rotation vectors, too; controllers convert their derivatives to angular velocities.

    Args:
        frame: name of the frame.

    Example:
        >>> robot = rnc.Robot.from_urdf("floating_arm.urdf", base="free", gravity=(0, 0, 0))
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], ["shoulder", "elbow"])
        >>> reduced = system.reduce(vertical=[rnc.FrameOrientation("hand")])
        >>> reduced.vertical.names
        ('hand_orientation_x', 'hand_orientation_y', 'hand_orientation_z')
    """

    frame: str

    def bind(self, robot: Robot) -> OutputRows:
        return _OrientationRows(self, robot)


class _OrientationRows(FrameVelocityRows, OutputRows):
    rotation = True

    def __init__(self, kind: FrameOrientation, robot: Robot) -> None:
        super().__init__(robot, kind.frame, (3, 4, 5))
        self.names = tuple(f"{kind.frame}_orientation_{axis}" for axis in "xyz")
        self.angular = (False,) * 3

    def value(self, at: PositionKinematics) -> np.ndarray:
        rotation = at.placement(self._frame).rotation
        if rotation.ndim == 2:  # one state, on the hot path
            return np.asarray(pin.log3(rotation))
        vectors = np.empty(rotation.shape[:-1])
        # Pinocchio's logarithm takes one matrix; it is exact near half turns, where a short formula is not.
        for i in np.ndindex(vectors.shape[:-1]):
            vectors[i] = pin.log3(rotation[i])
        return vectors


def level(direction: Sequence[Entry]) -> Entry:
    """Length of the part of a direction along the first two axes.

    Args:
        direction: three components of a unit vector.
    """
    x, y, _ = direction
    return (x * x + y * y) ** 0.5


def yaw_wrench(direction: Sequence[Entry]) -> list[Entry]:
    """Wrench (6,) whose power is the rate of the angle of a direction in the plane of the first two axes.

    Args:
        direction: three components of a unit vector that is not vertical.
    """
    x, y, z = direction
    square = x * x + y * y
    return [0.0, 0.0, 0.0, -z * x / square, -z * y / square, 1.0]


def tilt_wrench(direction: Sequence[Entry]) -> list[Entry]:
    """Wrench (6,) whose power is the rate of the angle of a direction above this plane.

    It is a torque about the line in the plane that is perpendicular to the direction: ``rate = (w x d)_z / level``.

    Args:
        direction: three components of a unit vector that is not vertical.
    """
    x, y, _ = direction
    length = level(direction)
    return [0.0, 0.0, 0.0, y / length, -x / length, 0.0]


class _DirectionAngleRow(DirectionRows, OutputRows):
    """Output whose rate is the power of a wrench, a function of the direction of a frame's own axis.

    Args:
        robot: the robot that has the frame.
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".
        name: name of the output.

    Attributes:
        in_kernel: the row and its value in the compiled kernel.
    """

    units = ("rad/s",)
    angular: tuple[bool, ...] = (False,)
    in_kernel: tuple[Form, Value]

    def __init__(self, robot: Robot, frame: str, axis: str, name: str) -> None:
        self.names = (name,)
        self.frame, self._axis = robot.frame_id(frame), axis_index(axis)
        self.directions = np.eye(3)[:, [self._axis]]

    def regularity(self, *directions: Sequence[Entry]) -> Entry:
        return level(directions[0])  # both angles lose their rates where the axis is vertical

    def _direction(self, at: PositionKinematics) -> np.ndarray:
        return at.rotation(self.frame)[..., self._axis]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        (form, value), numbers = self.in_kernel, self.directions[:, 0].tolist()
        return [KernelRow(form, (attached(model, self.frame),), (self._axis,), numbers, value=(value, 0))]


@dataclass(frozen=True)
class FrameYaw:
    """Angle of a frame's own axis in the world's x-y plane [rad], in (-pi, pi].

    It is exact in three dimensions too, if the axis is not vertical.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z"; for a wheel that turns with its frame, the axle.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce(vertical=[rnc.FrameYaw("sleigh")])
        >>> x1, _ = reduced.at(robot.configuration({"root_joint": [0.0, 0.0, 0.7]})).outputs()
        >>> x1.round(3)
        array([0.7])
    """

    frame: str
    axis: Axis = "x"

    def bind(self, robot: Robot) -> OutputRows:
        name = f"{self.frame}_yaw" + ("" if self.axis == "x" else f"_{self.axis}")
        return _YawRow(robot, self.frame, self.axis, name)


class _YawRow(_DirectionAngleRow):
    angular = (True,)
    in_kernel = Form.YAW, Value.HEADING
    undefined = "a yaw is not defined for a vertical axis"

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return [yaw_wrench(directions[0])]

    def value(self, at: PositionKinematics) -> np.ndarray:
        x, y, _ = np.moveaxis(self._direction(at), -1, 0)
        return np.arctan2(y, x)[..., None]


@dataclass(frozen=True)
class FrameTilt:
    """Angle of a frame's own axis above the horizontal plane [rad], in (-pi/2, pi/2), e.g. of a leaning wheel's axle.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".

    Raises:
        SingularityError: during evaluation, the axis is vertical, so that the tilt has no rate.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", 0.3, axis="y")])
        >>> reduced = system.reduce(vertical=[rnc.FrameTilt("disk", "y")])
        >>> lean = robot.configuration({"root_joint": [0, 0, 0.3, np.sin(0.1), 0, 0, np.cos(0.1)]})  # by 0.2 rad
        >>> reduced.at(lean).outputs()[0].round(3)
        array([0.2])
    """

    frame: str
    axis: Axis = "y"

    def bind(self, robot: Robot) -> OutputRows:
        return _TiltRow(robot, self.frame, self.axis, f"{self.frame}_tilt_{self.axis}")


class _TiltRow(_DirectionAngleRow):
    in_kernel = Form.TILT, Value.ELEVATION
    undefined = "the tilt of a vertical axis has no rate"

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return [tilt_wrench(directions[0])]

    def value(self, at: PositionKinematics) -> np.ndarray:
        x, y, z = np.moveaxis(self._direction(at), -1, 0)
        return np.arctan2(z, np.hypot(x, y))[..., None]


@dataclass(frozen=True)
class FrameSpeed:
    """Velocity of a frame's origin along the frame's own axis [m/s], e.g. a vehicle's forward speed.

    It is a quasi-velocity, not the rate of a coordinate: in a trajectory, ``x2`` contains its integral over time.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> reduced.reducing.names, reduced.reducing.quasi  # a speed is the rate of no coordinate, a yaw rate is
        (('sleigh_speed_x', 'sleigh_yaw'), array([ True, False]))
    """

    frame: str
    axis: Axis = "x"

    def bind(self, robot: Robot) -> OutputRows:
        return _QuasiVelocityRow(robot, self.frame, axis_index(self.axis), f"{self.frame}_speed_{self.axis}")


class _QuasiVelocityRow(FrameVelocityRows, OutputRows):
    quasi = True
    angular = (False,)

    def __init__(self, robot: Robot, frame: str, row: int, name: str, axes: pin.ReferenceFrame = OWN_AXES) -> None:
        super().__init__(robot, frame, (row,), axes)
        self.names = (name,)


@dataclass(frozen=True)
class FrameAngularVelocity:
    """Angular velocity of a frame about its own axis [rad/s], e.g. the roll rate of a bicycle, or about a world axis.

    It is a quasi-velocity, not the rate of a coordinate: in a trajectory, ``x2`` contains its integral over time.

    Args:
        frame: name of the frame.
        axis: "x", "y" or "z".
        axes: "own" for the frame's own axis, "world" for an axis of the world.

    Raises:
        ConfigurationError: unknown axis or axes.

    Example:
        >>> robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.3)])
        >>> reduced = system.reduce([rnc.FrameAngularVelocity("ball", axis) for axis in "xyz"])
        >>> reduced.reducing.names
        ('ball_angular_velocity_x', 'ball_angular_velocity_y', 'ball_angular_velocity_z')
    """

    frame: str
    axis: Axis = "z"
    axes: Literal["own", "world"] = "own"

    def bind(self, robot: Robot) -> OutputRows:
        if self.axes not in ("own", "world"):
            found = nearest(str(self.axes), ["own", "world"])
            raise ConfigurationError(f"angular velocity of '{self.frame}': axes '{self.axes}' is not known{found}")
        axes, of = (OWN_AXES, "") if self.axes == "own" else (WORLD_AXES, "world_")
        name = f"{self.frame}_angular_velocity_{of}{self.axis}"
        return _QuasiVelocityRow(robot, self.frame, 3 + axis_index(self.axis), name, axes)
