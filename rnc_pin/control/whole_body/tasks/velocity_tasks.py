"""Tasks for what other tasks leave free: damping, posture, manipulability, distance from singular configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.control.whole_body.limits.control_limit import ControlSample
from rnc_pin.control.whole_body.tasks.output_tasks import BoundTask, ControlTask, TaskRows
from rnc_pin.errors import ConfigurationError, SingularityError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import OutputKind


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
        self._v = [k for name in task.joints for k in range(robot.nv)[robot.velocity_indices(name)]]
        self.names = tuple(f"{robot.velocity_names[index]} posture" for index in self._v)
        self._model, self._gain = robot.model, task.numbers("gain", task.gain, len(self._v))
        self._jacobian = np.eye(reduced.n)[self._v]

    def rows(self, sample: ControlSample) -> TaskRows:
        error = pin.difference(self._model, sample.end.q, self._goal)[self._v]  # angles take the shortest way
        return TaskRows(self._jacobian, self._gain * error)


@dataclass(frozen=True)
class ManipulabilityTask(ControlTask):
    """Motion that increases the manipulability of an output: ``v2 = gain dw/dx2``, ``w = log det(A A^T) / 2``.

    A is the Jacobian of the output in reduced velocities, ``A = J R``. ``exp(w)`` is the manipulability of T.
    Yoshikawa, Int. J. Robotics Research 4(2), 1985. Give the task a lower priority than the output itself: it then is
    the secondary objective of law (12). The gradient is exact.

    Args:
        output: the output, e.g. ``rnc.FramePosition("hand")``.

    Raises:
        SingularityError: at a sample, A has no full rank, so w has no gradient.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf")  # the arm alone
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()
        >>> task = rnc.control.tasks.ManipulabilityTask(rnc.FramePosition("tip", "xy"))
        >>> q = robot.configuration({"joint_2": 1.0})
        >>> sample = rnc.control.ControlSample(reduced, 0.0, q, np.zeros(reduced.r), dt=0.01)
        >>> rows = task.bind(reduced).rows(sample)
        >>> rows.rate.round(6) + 0.0  # w = log |sin q2|, so dw/dq2 = 1 / tan q2
        array([0.      , 0.642093])
    """

    output: OutputKind

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundManipulability(self, reduced)


class _BoundManipulability(BoundTask):
    def __init__(self, task: ManipulabilityTask, reduced: ReducedModel) -> None:
        self._block = task.output.bind(reduced.robot)
        self.names = tuple(f"{name} manipulability" for name in reduced.reducing.names)
        self._gain = task.numbers("gain", task.gain, reduced.r)

    def rows(self, sample: ControlSample) -> TaskRows:
        end, motions = sample.end, sample.along_reducing_outputs()
        J = self._block.jacobian(end.position)
        A = J @ end.R
        try:
            weights = np.linalg.solve(A @ A.T, A)
        except np.linalg.LinAlgError:
            raise SingularityError(
                "the manipulability of an output is zero", q=end.q.copy(), condition=np.inf, rows=self._block.names
            ) from None
        rates = self._block.jacobian_dot(motions.rates) @ end.R + J @ motions.R_dot  # (r, k, r), one for each motion
        return TaskRows(end.J2, self._gain * np.einsum("kr,skr->s", weights, rates))


@dataclass(frozen=True)
class SingularityTask(ControlTask):
    """Motion away from singular configurations: ``v2 = gain dw/dx2``, ``w = log |det E|``.

    E is the stack of constraint rows and reducing outputs. Give the task a lower priority than the others.
    The gradient is exact. For the singular configurations of another output, use ``ManipulabilityTask``.
    """

    def bind(self, reduced: ReducedModel) -> BoundTask:
        return _BoundSingularity(self, reduced)


class _BoundSingularity(BoundTask):
    def __init__(self, task: SingularityTask, reduced: ReducedModel) -> None:
        self.names = tuple(f"{name} regularity" for name in reduced.reducing.names)
        self._gain = task.numbers("gain", task.gain, reduced.r)

    def rows(self, sample: ControlSample) -> TaskRows:
        rates = sample.along_reducing_outputs().E_dot
        return TaskRows(sample.end.J2, self._gain * np.einsum("ij,sji->s", sample.end.E_inverse, rates))
