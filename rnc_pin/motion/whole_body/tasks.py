"""Tasks of whole-body control, rows ``J v = rate``: outputs and bases, and what other tasks leave free."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.array_shapes import Array, Float
from rnc_pin.control.controller import check_size
from rnc_pin.control.twist_controller import TwistController
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.math.linear_algebra import as_slice
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.evaluator import evaluator_for
from rnc_pin.model.input_validation import Axes, NotNegative
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import ConstantRows, OutputKind, OutputStack
from rnc_pin.motion.whole_body.limits.control_limit import ControlSample
from rnc_pin.outputs import CenterOfMass, FramePosition, FrameYaw, JointPosition
from rnc_pin.references.reference import Hold, Reference

_BASE_ACCELERATION = (2.0, 2.0, 2.0)  # of a base whose pivots are aimed [m/s^2, m/s^2, rad/s^2]

__all__ = [
    "BasePoseTask", "BoundTask", "CenterOfMassTask", "ControlTask", "DampingTask", "OutputTask", "PostureTask",
    "SingularityTask", "TaskRows",
]  # fmt: skip


class TaskRows(NamedTuple):
    """Rows of a task at one sample: the program minimises ``weight (J v - rate)^2`` of each."""

    jacobian: Float[Array, "k nv"]
    """Jacobian J on the full velocity at the end of the sample; the program multiplies it by R."""
    rate: Float[Array, " k"]
    """Desired rate."""


class BoundTask(ABC):
    """Task of one model.

    Attributes:
        names: name of each row, (k,).
        followed: outputs that follow a reference; None if there are none.
        reference: their reference.
        output: the same rows as outputs that follow a reference; None for other rows.
        constant: True if the Jacobian on the full velocity does not depend on the configuration, as for joints, or if
            the rows are speeds without a position error: a sampled loop needs no damping then.
    """

    names: tuple[str, ...]
    followed: OutputStack | None = None
    reference: Reference
    output: BoundOutput | None = None
    constant: bool = False

    @abstractmethod
    def rows(self, sample: ControlSample) -> TaskRows:
        """Return the rows at the end of a sample."""

    def errors(self, time: float, position: PositionKinematics, v: Float[Array, " nv"]) -> dict[str, float]:
        """Return the distances from the goal by name, for the verdict of a run; none if the task has no goal.

        Args:
            time: the time [s].
            position: kinematics at a configuration.
            v: velocity there, for goals of speeds.
        """
        if self.followed is None:
            return {}
        # Quasi-velocities have no position: their goal is the velocity of the reference.
        stack, point = self.followed, self.reference.at(time)
        away = stack.coordinates.difference(point.position, stack.value(position))
        away = np.where(stack.quasi, point.velocity - stack.jacobian(position) @ v, away)
        return dict(zip(stack.names, np.abs(away).tolist(), strict=True))


@dataclass(frozen=True, kw_only=True)
class ControlTask(ABC):
    """Task of whole-body control: a description without a model.

    To add a task, derive a frozen dataclass with its settings and a ``bind`` method.

    Args:
        weight: weight of the squared error within the same priority; a number, or one for each row.
        gain: rate of convergence [1/s]; a number, or one for each row.
        priority: level of the task. Level 0 is strictly above level 1, and so on.
    """

    weight: float | Sequence[float] = 1.0
    gain: float | Sequence[float] = 1.0
    priority: int = 0

    @abstractmethod
    def bind(self, reduced: ReducedModel) -> BoundTask:
        """Return the task of a model, with all names resolved.

        Raises:
            ModelError: a joint or frame does not exist.
            ConfigurationError: the settings do not fit the model.
        """

    def numbers(self, name: str, value: float | Sequence[float], size: int) -> Float[Array, " k"]:
        """Return a setting as one number for each of ``size`` rows.

        Raises:
            ConfigurationError: a number is negative or not finite, or their count is neither one nor ``size``.
        """
        array = np.asarray(value, dtype=float)
        if array.shape not in ((), (size,)) or not (np.isfinite(array).all() and (array >= 0).all()):
            raise ConfigurationError(
                f"{name} of {type(self).__name__} has to be a number or {size} numbers, not negative, found {value}"
            )
        return np.array(np.broadcast_to(array, (size,)))


# ------------------------------------------------------------------ tasks


@dataclass(frozen=True)
class OutputTask(ControlTask):
    """Output that follows a reference: ``J v = xd_dot + gain (xd - x)``.

    Any output serves, whether it is a reducing output, a vertical output or neither. Angles and orientations take the
    shortest rotation. A quasi-velocity such as a speed follows the velocity of its reference; it has no position error.

    Args:
        output: the output, e.g. ``rnc.FramePosition("hand")``.
        reference: its reference.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.OutputTask(rnc.JointPosition("joint_1"), rnc.planning.Hold([0.5]), gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0  # gain times the error
        array([1.])
    """

    output: OutputKind
    reference: Reference

    def bind(self, reduced: ReducedModel) -> BoundOutput:
        return BoundOutput(self, [self.output], self.reference, reduced)


class BoundOutput(BoundTask):
    """Outputs that follow a reference, for one model; ``TaskStack`` evaluates those of all tasks together.

    Args:
        task: the task, which has the gain.
        outputs: the outputs.
        reference: their reference.
        reduced: the model.

    Attributes:
        blocks: rows of each output.
        reference: their reference.
        gain: rate of convergence of each row (k,) [1/s]; zero for a quasi-velocity.
    """

    def __init__(
        self, task: ControlTask, outputs: Sequence[OutputKind], reference: Reference, reduced: ReducedModel
    ) -> None:
        self.blocks, self.reference = [each.bind(reduced.robot) for each in outputs], reference
        self.followed = stack = OutputStack(self.blocks)
        self.names, self.output = stack.names, self
        self.constant = all(isinstance(block, ConstantRows) or block.quasi for block in self.blocks)
        check_size(reference, len(self.names), f"'{', '.join(self.names)}'")
        # A quasi-velocity has no position, so its gain has no effect.
        self.gain = task.numbers("gain", task.gain, len(self.names)) * ~stack.quasi
        self._reduced = reduced

    @cached_property
    def _alone(self) -> OutputsTogether:
        return OutputsTogether([self], self._reduced)

    def rows(self, sample: ControlSample) -> TaskRows:
        (jacobian,), (rate,) = self._alone.rows(sample)
        return TaskRows(jacobian, rate)


class OutputsTogether:
    """Several output tasks of one model, with one evaluation of all outputs.

    Args:
        tasks: the tasks.
        reduced: the model.
    """

    def __init__(self, tasks: Sequence[BoundOutput], reduced: ReducedModel) -> None:
        self._reduced, self._stack = reduced, OutputStack([block for task in tasks for block in task.blocks])
        stops = np.cumsum([0, *(len(task.names) for task in tasks)]).tolist()
        placed = [(task.reference, slice(*part)) for task, part in zip(tasks, pairwise(stops), strict=True)]
        # Positions and rates of goals that never change are written once.
        self._held, self._gain = np.zeros((2, 1, stops[-1])), np.concatenate([task.gain for task in tasks])
        for reference, where in placed:
            if isinstance(reference, Hold):
                self._held[0, :, where] = reference.at(0.0).position
        self._references = [(reference, where) for reference, where in placed if not isinstance(reference, Hold)]
        # Made now: it takes longer than a sample.
        self._evaluator = evaluator_for(reduced.reduction_data.measuring(self._stack), reduced.evaluator)

    def rows(self, *samples: ControlSample) -> tuple[Float[Array, "s k nv"], Float[Array, "s k"]]:
        """Return the rows of all tasks at the ends of samples, and their rates."""
        k, coordinates = len(self._gain), self._stack.coordinates
        J, points = np.empty((len(samples), k, self._reduced.n)), np.empty((3, len(samples), k))
        points[:2], (desired, rate, found) = self._held, points
        for i, sample in enumerate(samples):
            found[i] = self._evaluator.vertical_outputs(sample.end, J[i])
            for reference, where in self._references:
                desired[i, where], rate[i, where] = reference.at(sample.time)[:2]
            # Rates are angular velocities there, which are no derivatives of rotation vectors.
            if coordinates.rotations:
                rate[i], _ = coordinates.to_rates(desired[i], rate[i], rate[i])  # for any acceleration
        return J, rate + self._gain * coordinates.difference(desired, found)


@dataclass(frozen=True)
class CenterOfMassTask(ControlTask):
    """Centre of mass of the robot that follows a reference in the world.

    Args:
        reference: of the coordinates [m].
        axes: world axes, e.g. "xy" or "xyz".

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.CenterOfMassTask(rnc.planning.Hold([1.5, 0.0]), axes="xy", gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0  # the centre is at x = 1 m
        array([1., 0.])
    """

    reference: Reference
    axes: Axes = "xyz"

    def bind(self, reduced: ReducedModel) -> BoundOutput:
        check_size(self.reference, len(self.axes), "centre-of-mass")
        return BoundOutput(self, [CenterOfMass(self.axes)], self.reference, reduced)


@dataclass(frozen=True)
class BasePoseTask(ControlTask):
    """Frame of a base that follows a reference pose (x, y, yaw) in the plane.

    A base that cannot move sideways corrects a lateral error by turning while it moves: set ``lateral_gain`` (Y.
    Kanayama et al., IEEE ICRA 1990). The yaw rate then grows by ``lateral_gain u e``, with the reference's forward
    speed u and the lateral error e to the left. At rest such a base keeps a lateral error.

    Pivots of its wheels are aimed at the twist of the task, at one more row for each pivot; the base waits for them.

    Args:
        frame: frame of the base, with x forward.
        reference: of x, y [m] and yaw [rad].
        lateral_gain: yaw rate per forward speed and lateral error [rad/m^2].

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.BasePoseTask("base", rnc.planning.Hold([1.0, 0.0, 0.2]), gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0
        array([2. , 0. , 0.4])
    """

    frame: str
    reference: Reference
    lateral_gain: NotNegative = 0.0

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundBase(self, reduced)

    def numbers(self, name: str, value: float | Sequence[float], size: int) -> Float[Array, " k"]:
        given = np.atleast_1d(np.asarray(value, dtype=float))
        # Settings of a pose are three numbers; the rows of pivots take the largest of them.
        more = [given.max()] * (size - 3) if given.shape == (3,) else []  # rows of pivots
        return super().numbers(name, [*given, *more] if more else value, size)


class _BoundBase(BoundTask):
    def __init__(self, task: BasePoseTask, reduced: ReducedModel) -> None:
        outputs = FramePosition(task.frame, "xy"), FrameYaw(task.frame)
        self._pose = self.followed = OutputStack([each.bind(reduced.robot) for each in outputs])
        self._evaluator = evaluator_for(reduced.reduction_data.measuring(self._pose), reduced.evaluator)
        self._aiming, self._pivots = _aiming(reduced, task.frame), np.zeros((0, reduced.n))
        steering = () if self._aiming is None else self._aiming.steering
        if self._aiming is not None:
            self._pivots = np.eye(reduced.n)[self._aiming.base.pivots]
            self.constant = True  # its speeds change at limited accelerations
        self.names = (*self._pose.names, *(f"{name} aim" for name in steering))
        check_size(task.reference, 3, "base pose")
        self.reference, self._gain = task.reference, task.numbers("gain", task.gain, 3)
        (self._lateral_gain,) = task.numbers("lateral_gain", task.lateral_gain, 1)

    def rows(self, sample: ControlSample) -> TaskRows:
        desired, J = self.reference.at(sample.time), np.empty((3, len(sample.end.v)))
        placed = self._evaluator.vertical_outputs(sample.end, J)
        yaw, error = float(placed[2]), self._pose.coordinates.difference(desired.position, placed)
        rate = desired.velocity + self._gain * error
        cosine, sine = np.cos(desired.position[2]), np.sin(desired.position[2])
        forward = cosine * desired.velocity[0] + sine * desired.velocity[1]
        # A base that cannot move sideways turns towards the path while it moves.
        rate[2] += self._lateral_gain * forward * (np.cos(yaw) * error[1] - np.sin(yaw) * error[0])
        rows = np.vstack([J, self._pivots])
        if self._aiming is None:
            return TaskRows(rows, rate)
        # Pivots turn with the base: they are aimed at the twist in its own axes.
        turn = pin.rpy.rpyToMatrix(0.0, 0.0, yaw)
        twist, rates = self._aiming.aimed(sample.end.q, rate @ turn, sample.start.v, sample.dt or self._aiming.dt)
        return TaskRows(rows, np.append(turn @ twist, rates))


def _aiming(reduced: ReducedModel, frame: str) -> TwistController | None:
    """Aiming of the pivots of a base; None for a base without them."""
    try:
        found = TwistController(reduced, frame, max_acceleration=_BASE_ACCELERATION)
    except RncError:  # such as a base that a force drives
        return None
    return found if found.steering else None


@dataclass(frozen=True)
class DampingTask(ControlTask):
    """Velocities that stay small: of the reducing outputs, or of joints. The gain has no effect.

    Args:
        joints: names of joints; by default the reduced velocities v2.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.DampingTask(joints=["joint_1"], weight=0.1)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0
        array([0.])
    """

    joints: Sequence[str] | None = None

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundDamping(self, reduced)


class _BoundDamping(BoundTask):
    constant = True

    def __init__(self, task: DampingTask, reduced: ReducedModel) -> None:
        self._jacobian: np.ndarray | None = None
        names: Sequence[str] = reduced.reducing.names
        if task.joints is not None:
            indices = [k for name in task.joints for k in range(reduced.n)[reduced.robot.velocity_indices(name)]]
            names, self._jacobian = [reduced.robot.velocity_names[k] for k in indices], np.eye(reduced.n)[indices]
        self.names = tuple(f"{name} damping" for name in names)
        self._rest = np.zeros(len(names))

    def rows(self, sample: ControlSample) -> TaskRows:
        return TaskRows(sample.end.J2 if self._jacobian is None else self._jacobian, self._rest)


@dataclass(frozen=True)
class PostureTask(ControlTask):
    """Joints that move towards given positions: ``v = gain (qd - q)``.

    Args:
        joints: joint name to position [rad or m]; other joints are free.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> task = rnc.control.tasks.PostureTask({"joint_1": 0.5, "joint_2": -0.2}, gain=2.0)
        >>> sample = rnc.control.ControlSample(reduced, 0.0, robot.configuration(), np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0
        array([ 1. , -0.4])
    """

    joints: Mapping[str, float]

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundPosture(self, reduced)


class _BoundPosture(BoundTask):
    constant = True

    def __init__(self, task: PostureTask, reduced: ReducedModel) -> None:
        robot = reduced.robot
        if not task.joints:
            raise ConfigurationError("a posture needs at least one joint with its position")
        self._goal = robot.configuration(task.joints)
        indices = [k for name in task.joints for k in range(robot.nv)[robot.velocity_indices(name)]]
        self._joints = [robot.velocity_names[index] for index in indices]
        self.names = tuple(f"{name} posture" for name in self._joints)
        self._model, self._gain = robot.model, task.numbers("gain", task.gain, len(indices))
        self._jacobian, self._v = np.eye(reduced.n)[indices], as_slice(np.array(indices))
        # Joints with one number each are outputs: those of all tasks are evaluated in one call.
        if all(robot.model.joints[robot.joint_id(name)].nv == 1 for name in task.joints):
            outputs = [JointPosition(name) for name in task.joints]
            self.output = BoundOutput(task, outputs, Hold(list(task.joints.values())), reduced)

    def rows(self, sample: ControlSample) -> TaskRows:
        error = pin.difference(self._model, sample.end.q, self._goal)[self._v]  # angles take the shortest way
        return TaskRows(self._jacobian, self._gain * error)

    def errors(self, time: float, position: PositionKinematics, v: Float[Array, " nv"]) -> dict[str, float]:
        away = pin.difference(self._model, position.q, self._goal)[self._v]
        return dict(zip(self._joints, np.abs(away).tolist(), strict=True))


@dataclass(frozen=True)
class SingularityTask(ControlTask):
    """Motion away from singular configurations: ``v2 = gain dw/dx2``, ``w = log |det E|``.

    E is the stack of constraint rows and reducing outputs. Give the task a lower priority than the others.
    The gradient is exact.
    """

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundSingularity(self, reduced)


class _BoundSingularity(BoundTask):
    def __init__(self, task: SingularityTask, reduced: ReducedModel) -> None:
        self.names = tuple(f"{name} regularity" for name in reduced.reducing.names)
        self._gain = task.numbers("gain", task.gain, reduced.r)

    def rows(self, sample: ControlSample) -> TaskRows:
        # The derivative of log |det E| is the trace of E^-1 times that of E.
        rates = sample.along_reducing_outputs().E_dot
        return TaskRows(sample.end.J2, self._gain * np.einsum("ij,sji->s", sample.end.E_inverse, rates))
