"""Kinds of outputs: of one frame, of joints, of several frames, and of a user's functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from rnc_pin._kernel.kernel_rows import Form, KernelRow, Value, attached
from rnc_pin.errors import ConfigurationError, ConstraintError, check_known
from rnc_pin.math.linear_algebra import Entry, apply, complex_step, components, dot
from rnc_pin.model.frame_rows import DirectionRows, FrameVelocityRows, axis_index, evaluated, rate_of
from rnc_pin.model.input_validation import Axes, Axis
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES, PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import ConstantRows, OutputKind, OutputRows, check_defined
from rnc_pin.model.user_functions import UserFunction, admitted_rate, check_rate
from rnc_pin.robots.model_checks import joints_with_moving_axes
from rnc_pin.robots.robot import Robot

__all__ = [
    "CenterOfMass",
    "Distance",
    "FrameAngularVelocity",
    "FrameOrientation",
    "FramePosition",
    "FrameSpeed",
    "FrameTilt",
    "FrameYaw",
    "JointPosition",
    "Output",
    "velocity_outputs",
]


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
        chosen = _chosen_axes(self.axes, f"frame '{self.frame}'")
        return _PositionRows(robot, self.frame, chosen, [f"{self.frame}_{axis}" for axis in self.axes])


def _chosen_axes(axes: str, whose: str) -> list[int]:
    """Indices of world axes, each named once."""
    # In the order of the user: "yx" gives y before x, as the names of the rows say.
    chosen = [axis_index(axis) for axis in axes]
    if not chosen or len(set(chosen)) != len(chosen):
        raise ConfigurationError(f"axes '{axes}' of {whose}: name each of x, y, z at most once")
    return chosen


class _FrameRows(FrameVelocityRows, OutputRows):
    """Outputs whose rates are components of a frame's velocity."""

    def __init__(
        self, robot: Robot, frame: str, rows: Sequence[int], names: Sequence[str], axes: pin.ReferenceFrame = WORLD_AXES
    ) -> None:
        super().__init__(robot, frame, rows, axes)
        # Differences of rotation vectors are no errors: ``rotation`` has them compared on SO(3).
        self.names, self.angular = tuple(names), (False,) * len(rows)


class _PositionRows(_FrameRows):
    def value(self, at: PositionKinematics) -> np.ndarray:
        return at.placement(self._frame).translation[..., self._rows]

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        rows, axes = super().kernel_rows(model), np.arange(3)[self._rows].tolist()
        return [row._replace(value=(Value.COORDINATE, axis)) for row, axis in zip(rows, axes, strict=True)]


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
        return _OrientationRows(robot, self.frame, (3, 4, 5), [f"{self.frame}_orientation_{axis}" for axis in "xyz"])


class _OrientationRows(_FrameRows):
    rotation = True

    def value(self, at: PositionKinematics) -> np.ndarray:
        rotation = at.placement(self._frame).rotation
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
        # The x axis is meant if none is named: only other axes need a letter.
        name = f"{self.frame}_yaw" + ("" if self.axis == "x" else f"_{self.axis}")
        return _YawRow(robot, self.frame, self.axis, name)


class _YawRow(_DirectionAngleRow):
    angular = (True,)
    in_kernel = Form.YAW, Value.HEADING
    undefined = "a yaw is not defined for a vertical axis"

    def formula(self, *directions: Sequence[Entry]) -> list[list[Entry]]:
        return [yaw_wrench(directions[0])]

    def value(self, at: PositionKinematics) -> np.ndarray:
        x, y, _ = np.moveaxis(at.placement(self.frame).rotation[..., self._axis], -1, 0)
        # The two-argument form tells all four quadrants, so the angle covers a full turn.
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
        x, y, z = np.moveaxis(at.placement(self.frame).rotation[..., self._axis], -1, 0)
        # Not arcsin(z): near a vertical axis it would lose half of the digits, and rounding of z above one gives NaN.
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
        names = [f"{self.frame}_speed_{self.axis}"]
        return _QuasiVelocityRow(robot, self.frame, [axis_index(self.axis)], names, OWN_AXES)


class _QuasiVelocityRow(_FrameRows):
    quasi = True


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
        check_known(self.axes, ["own", "world"], f"angular velocity of '{self.frame}': axes")
        axes, of = (OWN_AXES, "") if self.axes == "own" else (WORLD_AXES, "world_")
        names = [f"{self.frame}_angular_velocity_{of}{self.axis}"]
        return _QuasiVelocityRow(robot, self.frame, [3 + axis_index(self.axis)], names, axes)


# ---------------------------------------------------------------------- outputs of the robot


TOGETHER = 1e-9
"""Distance below which two frames coincide [m]."""


@dataclass(frozen=True)
class Distance:
    """Distance between the origins of two frames [m].

    Args:
        frame_a: name of one frame.
        frame_b: name of the other.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> reduced = system.reduce(vertical=[rnc.Distance("platform_body", "tip")])
        >>> x1, _ = reduced.at(robot.configuration()).outputs()  # the arm is straight
        >>> x1.round(3)
        array([3.])
    """

    frame_a: str
    frame_b: str

    def bind(self, robot: Robot) -> OutputRows:
        return _DistanceRow(self, robot)


def distance_force(vector: Sequence[Entry]) -> list[list[Entry]]:
    """Force (1, 3) at the end of a vector whose power is the rate of its length: the unit vector.

    Args:
        vector: three components of the vector, not all zero.
    """
    length = dot(vector, vector) ** 0.5
    return [[each / length for each in vector]]


class _DistanceRow(OutputRows):
    def __init__(self, kind: Distance, robot: Robot) -> None:
        self.names = (f"distance_{kind.frame_a}_{kind.frame_b}",)
        self.units = ("m/s",)
        self.angular = (False,)
        self._a, self._b = robot.frame_id(kind.frame_a), robot.frame_id(kind.frame_b)

    def _vector(self, at: PositionKinematics) -> np.ndarray:
        return at.placement(self._b).translation - at.placement(self._a).translation

    def value(self, at: PositionKinematics) -> np.ndarray:
        return np.linalg.norm(self._vector(at), axis=-1, keepdims=True)

    def _force(self, at: PositionKinematics) -> np.ndarray:
        vector = components(self._vector(at))
        length = dot(vector, vector) ** 0.5
        # A unit vector from one origin to the other has no direction there.
        check_defined("a distance has no rate where it is zero", at.q, length, TOGETHER, self.names)
        return evaluated(distance_force, [vector])

    def _relative(self, both: Callable[[int], np.ndarray]) -> np.ndarray:
        """Linear velocity or acceleration (..., 3) of frame b relative to frame a."""
        return both(self._b)[..., :3] - both(self._a)[..., :3]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._force(at) @ (at.jacobian(self._b) - at.jacobian(self._a))[..., :3, :]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        rate = rate_of(distance_force, [components(self._vector(at))], [components(self._relative(at.velocity))])
        J, J_dot = ((each(self._b) - each(self._a))[..., :3, :] for each in (at.jacobian, at.jacobian_dot))
        return np.asarray(self._force(at) @ J_dot + rate @ J)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        self._force(at)  # raises an error if the distance is zero
        return _bias(self._vector(at), self._relative(at.velocity), self._relative(at.acceleration))

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        by_velocity, by_acceleration = (at.frame_gradients(self._b) - at.frame_gradients(self._a))[:, :3]
        # Both motions have exact derivatives by Pinocchio; the formula that joins them is analytic.
        return complex_step(
            _bias,
            (self._vector(at), (at.jacobian(self._b) - at.jacobian(self._a))[:3]),
            (self._relative(at.velocity), by_velocity),
            (self._relative(at.acceleration), by_acceleration),
        )

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        return [KernelRow(Form.DISTANCE, (attached(model, self._a), attached(model, self._b)), value=(Value.LENGTH, 0))]


def _bias(vector: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Second derivative (..., 1) of the length of a vector."""
    parts = [components(vector)], [components(velocity)]
    force, rate = evaluated(distance_force, parts[0]), rate_of(distance_force, *parts)
    return np.asarray(apply(force, acceleration) + apply(rate, velocity))


@dataclass(frozen=True)
class JointPosition:
    """Angle [rad] or displacement [m] of a joint with one degree of freedom.

    Args:
        joint: name of the joint. The value of a continuous joint is in (-pi, pi].

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> joints = ["joint_1", "joint_2", "joint_3"]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], joints)
        >>> reduced = system.reduce([rnc.JointPosition(name) for name in joints], [rnc.JointPosition("platform")])
        >>> reduced.at(robot.configuration()).A_star.round(3)  # how far the platform turns for each joint
        array([[-0.933, -0.533, -0.2  ]])
    """

    joint: str

    def bind(self, robot: Robot) -> OutputRows:
        return _JointRow(self, robot)


class _JointRow(ConstantRows, OutputRows):
    def __init__(self, kind: JointPosition, robot: Robot) -> None:
        # With several degrees of freedom there is no one number whose rate is an entry of v.
        joint = robot.single_joint(kind.joint, "use outputs of a frame (FramePosition, FrameYaw, FrameSpeed) for it")
        self.names, self.units, self.angular = (kind.joint,), (joint.unit,), (joint.continuous,)
        self._joint = joint
        self.matrix = np.zeros((1, robot.nv))
        self.matrix[0, joint.idx_v] = 1.0

    def kernel_rows(self, model: pin.Model) -> list[KernelRow]:
        value = Value.CONTINUOUS_JOINT if self.angular[0] else Value.JOINT
        return [KernelRow(Form.CONSTANT, value=(value, self._joint.idx_q), constant=self.matrix[0])]

    def value(self, at: PositionKinematics) -> np.ndarray:
        return self._joint.position(at.q)[..., None]


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

    axes: Axes = "xyz"

    def bind(self, robot: Robot) -> OutputRows:
        return _CenterOfMassRows(robot, _chosen_axes(self.axes, "the centre of mass"))


class _CenterOfMassRows(OutputRows):
    def __init__(self, robot: Robot, chosen: list[int]) -> None:
        self._chosen = chosen
        self.names = tuple(f"center_of_mass_{'xyz'[axis]}" for axis in chosen)
        self.units, self.angular = ("m/s",) * len(chosen), (False,) * len(chosen)

    def value(self, at: PositionKinematics) -> np.ndarray:
        # Value and Jacobian are side by side in one quantity: the value is column 0.
        return at.center_of_mass[..., self._chosen, 0]

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return at.center_of_mass[..., self._chosen, 1:]

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return at.of_center("rate")[..., self._chosen, :]

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return at.of_center("acceleration")[..., self._chosen, 0]

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray:
        return at.of_center("gradient")[self._chosen]


@dataclass(frozen=True)
class Output:
    """User-defined output ``x(q)`` with its Jacobian on the tangent space.

    Args:
        value: ``value(q) -> (k,)``, or None for a quasi-velocity.
        jacobian: ``jacobian(q) -> (k, nv)``.
        jacobian_dot: ``jacobian_dot(q, v) -> (k, nv)``, its rate along v; derived from ``jacobian`` by default.
        names: name of each row.
        angular: True if the values are angles, compared modulo a full turn.

    Raises:
        InputError: a function returns an array of wrong shape.
        ConstraintError: no names, or a given derivative differs from differences at random states.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> row = np.array([[1.0, 1.0, 1.0, 1.0]])
        >>> hand = rnc.Output(lambda q: row @ q, lambda q: row, names=["hand_angle"], angular=True)
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], robot.joint_names[1:])
        >>> x1, _ = system.reduce(vertical=[hand]).at(robot.configuration({"joint_1": 0.3, "joint_3": 0.4})).outputs()
        >>> x1.round(3)
        array([0.7])
    """

    value: Callable[[np.ndarray], np.ndarray] | None
    jacobian: Callable[[np.ndarray], np.ndarray]
    jacobian_dot: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    names: Sequence[str] = ()
    angular: bool = False

    def bind(self, robot: Robot) -> OutputRows:
        return _CustomRows(self, robot)


class _CustomRows(OutputRows):
    generalized = True

    def __init__(self, kind: Output, robot: Robot) -> None:
        size = len(kind.names)
        # A string is a sequence too: "ab" would silently name two rows a and b.
        if isinstance(kind.names, str) or size == 0:
            raise ConstraintError(f"names of a user-defined output have to be a list of strings, found {kind.names!r}")
        self.names, self.units, self.angular = tuple(kind.names), ("",) * size, (kind.angular,) * size
        self.quasi = kind.value is None
        shape, whose = (size, robot.nv), f" of output {self.names}"
        self._jacobian = UserFunction(kind.jacobian, shape, f"jacobian(q){whose}")
        # One call at once: a wrong shape is told where the output is made, not in the first step of a run.
        self._jacobian(robot.configuration())
        if kind.value is not None:
            self._value = UserFunction(kind.value, shape[:1], f"value(q){whose}")
            self._value(robot.configuration())
            # A value and a Jacobian of the user are two statements: differences at random states show if they disagree.
            labels = "value(q)", f"jacobian(q) v{whose}"
            check_rate(robot, self._value, lambda q, v: self._jacobian(q) @ v, labels, self.names, kind.angular)
        known = kind.jacobian_dot, "jacobian", whose, self.names, False
        self._jacobian_dot = admitted_rate(robot, self._jacobian, *known)

    def value(self, at: PositionKinematics) -> np.ndarray:
        return super().value(at) if self.quasi else self._value.over(at.q)

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._jacobian.over(at.q)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._jacobian_dot.over(at.q, at.v)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        # An output has no right-hand side: its acceleration at zero vdot is Jdot v.
        return apply(self.jacobian_dot(at), at.v)


def velocity_outputs(robot: Robot) -> dict[str, OutputKind | None]:
    """Return the entries of ``v`` as outputs, by name: joints, and speeds of bodies that move freely.

    Args:
        robot: the robot. None stands for an entry of a joint whose axes move in its body.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> list(rnc.velocity_outputs(robot))
        ['base_speed_x', 'base_speed_y', 'base_angular_velocity_z', 'joint_1', 'joint_2']
    """
    axes: tuple[Axis, ...] = ("x", "y", "z")
    found: dict[str, OutputKind | None] = {}
    for k, name in enumerate(robot.joint_names, start=1):
        # The body that the joint moves: its speeds are the entries of v, in its own axes.
        joint, body = robot.model.joints[k], next(iter(robot.links_of(k)), None)
        kinds: list[OutputKind] = [JointPosition(name)] if joint.nv == 1 else []
        if joint.nv > 1 and body is not None and name not in joints_with_moving_axes(robot.model):
            # Columns of S are unit motions: their largest entry names the axis, 0 to 2 linear and 3 to 5 angular.
            along = np.abs(joint.createData().S).argmax(axis=0).tolist()
            kinds = [FrameSpeed(body, axes[k]) if k < 3 else FrameAngularVelocity(body, axes[k - 3]) for k in along]
        # None marks entries that no output describes, so that a caller can say so.
        own = {kind.bind(robot).names[0]: kind for kind in kinds}
        found |= own or dict.fromkeys(robot.velocity_names[robot.velocity_indices(name)])
    return found
