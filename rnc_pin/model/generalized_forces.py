"""Generalized forces: ``B(q) T`` of actuators, and f(q, v) of springs, dampers and others that follow from the state.

    B T + f(q, v) = H* vdot + C* v + g* + A^T lambda

A *kind* such as ``Spring(output, stiffness)`` is a description without a robot. ``bind(robot)`` resolves its names.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from rnc_pin._kernel.kernel_rows import KernelForce, KernelRow
from rnc_pin.errors import ConstraintError, InputError, ModelError, check_unique
from rnc_pin.model.frame_rows import axis_index
from rnc_pin.model.input_validation import Axis, Positive
from rnc_pin.model.kinematics import OWN_AXES, PositionKinematics, VelocityKinematics
from rnc_pin.model.user_functions import UserFunction
from rnc_pin.robots.joint_values import NO_LIMIT
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FrameForce:
    """Force at a frame's origin along the frame's own axis [N], e.g. of a drive wheel or a thruster.

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".
        limit: largest magnitude [N], used if a simulation enforces actuator limits.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> thruster = rnc.FrameForce("sleigh", "x", limit=2.0)
        >>> print(rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], [thruster]))
        NonholonomicSystem of 'chaplygin_sleigh': 3 degrees of freedom less 1 independent row leave 2
          rows kept: no_side_slip(sleigh.y)
          actuators: force(sleigh.x)
    """

    frame: str
    axis: Axis
    limit: Positive = np.inf


@dataclass(frozen=True)
class FrameTorque:
    """Torque on a frame's body about the frame's own axis [N m].

    Args:
        frame: name of the frame.
        axis: the frame's own axis, "x", "y" or "z".
        limit: largest magnitude [N m], used if a simulation enforces actuator limits.

    Example:
        >>> robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        >>> drives = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")], drives).reduce()
        >>> reduced.actuation.names
        ('force(base.x)', 'torque(base.z)', 'joint_1', 'joint_2')
    """

    frame: str
    axis: Axis
    limit: Positive = np.inf


@dataclass(frozen=True)
class OpenDifferential:
    """Torque of one motor on several joints through an open differential [N m].

    The joints have equal torques, and the motor turns at the mean of their speeds: its torque is the sum of theirs.

    Args:
        joints: names of the joints, such as both rear wheels of a car.
        limit: largest magnitude [N m], used if a simulation enforces actuator limits.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> motor = rnc.OpenDifferential(["left_wheel_joint", "right_wheel_joint"], limit=20.0)
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
        >>> system = rnc.NonholonomicSystem(robot, wheels, [motor])
        >>> reduced = system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")])
        >>> at = reduced.at(robot.configuration())
        >>> at.input_matrix[:, 0].round(6)  # speed of a wheel of 0.1 m per speed of the base; it does not turn the base
        array([10.,  0.])
    """

    joints: Sequence[str]
    limit: Positive = np.inf


MatrixFunction = Callable[[np.ndarray], np.ndarray]
Actuator = str | FrameForce | FrameTorque | OpenDifferential
Actuators = Sequence[Actuator] | np.ndarray | MatrixFunction


class Actuation:
    """Actuators of a robot as one actuation matrix B(q).

    Args:
        actuators: a list of joint names, ``FrameForce`` and ``FrameTorque``; or a constant matrix
            (nv, p); or a function ``B(q) -> (nv, p)``.
        robot: the robot that the actuators drive.

    Attributes:
        names: name of each input, (p,).
        units: unit "N" or "N m" of each input, (p,); empty if B is given as a matrix or a function.
        limits: largest magnitudes (p,) [N or N m]; joints have the URDF's effort limits.
        frames: for each force or torque on a frame: column of B, index of the frame, and row of its Jacobian.
        configured: columns of ``frames``, which are not the torque or force of one joint.
    """

    def __init__(self, actuators: Actuators, robot: Robot) -> None:
        self._function: UserFunction | None = None
        self.frames: list[tuple[int, int, int]] = []
        if callable(actuators) or isinstance(actuators, np.ndarray):
            # A function is called once here, so that its shape is known.
            given = actuators(robot.configuration()) if callable(actuators) else actuators
            self._constant = np.array(given, dtype=float)  # the caller may change the matrix
            shape = self._constant.shape
            if len(shape) != 2 or shape[0] != robot.nv:
                raise ConstraintError(f"actuation matrix has shape {shape}, expected ({robot.nv}, p)")
            if callable(actuators):
                self._function = UserFunction(actuators, shape, "actuation matrix B(q)")
            self.names = tuple(f"T[{i}]" for i in range(shape[1]))
            self.units = ("",) * shape[1]
            self.limits = np.full(shape[1], np.inf)
        else:
            if isinstance(actuators, str) or not isinstance(actuators, Iterable):
                raise ConstraintError(f"actuators: expected a list, a matrix or a function B(q), found {actuators!r}")
            listed = list(actuators)
            self._constant = np.zeros((robot.nv, len(listed)))
            found = [self._read_one(column, each, robot) for column, each in enumerate(listed)]
            self.names, self.units = tuple(name for name, *_ in found), tuple(unit for _, unit, _ in found)
            self.limits = np.array([limit for *_, limit in found])
            # Inputs are found by name in messages, limits and records: two with one name could not be told apart.
            check_unique(self.names, "duplicate actuator", ConstraintError)
        self.size = len(self.names)
        # Columns of frames depend on q; if there are none, B is constant and costs nothing at a state.
        self.configured = frozenset(column for column, *_ in self.frames)

    def _read_one(self, column: int, actuator: Actuator, robot: Robot) -> tuple[str, str, float]:
        """Set a column of B; return the name, the unit and the limit of its input."""
        if isinstance(actuator, FrameForce | FrameTorque):
            # Rows of a frame's Jacobian: linear ones first, then angular.
            offset, word, unit = (0, "force", "N") if isinstance(actuator, FrameForce) else (3, "torque", "N m")
            self.frames.append((column, robot.frame_id(actuator.frame), offset + axis_index(actuator.axis)))
            return f"{word}({actuator.frame}.{actuator.axis})", unit, actuator.limit
        if isinstance(actuator, OpenDifferential):
            if isinstance(actuator.joints, str) or len(set(actuator.joints)) < 2:
                raise ConstraintError(f"a differential needs two joints or more, found {actuator.joints!r}")
            remedy = "a differential drives those with one"
            places = [robot.single_joint(each, remedy).idx_v for each in actuator.joints]
            # The sum of the torques of the joints is the torque of the motor.
            self._constant[places, column] = 1.0 / len(places)
            return f"differential({', '.join(actuator.joints)})", "N m", actuator.limit
        if isinstance(actuator, str):
            index = robot.velocity_indices(actuator)
            if index.stop - index.start != 1:
                raise ModelError(
                    f"actuator '{actuator}' is a joint of several degrees of freedom: "
                    "use FrameForce and FrameTorque on the link that it moves"
                )
            self._constant[index.start, column] = 1.0
            # Zero is no limit here: nothing is clipped to it. For the verdict it can be a limit (limit_replay).
            stated = float(robot.model.upperEffortLimit[index.start])
            slides = robot.model.joints[robot.joint_id(actuator)].shortname().startswith("JointModelP")
            return actuator, "N" if slides else "N m", stated if 0 < stated < NO_LIMIT else np.inf
        raise ConstraintError(
            f"actuator {actuator!r} has the wrong type: expected a joint's name, FrameForce, "
            "FrameTorque or OpenDifferential"
        )

    @property
    def stated_limits(self) -> dict[str, float]:
        """Limits by name of forces on frames and of differentials [N or N m]; those of joints are in the file."""
        return {
            name: float(limit)
            for column, (name, limit) in enumerate(zip(self.names, self.limits, strict=True))
            if limit < np.inf and (column in self.configured or name.startswith("differential("))
        }

    @property
    def constant(self) -> np.ndarray | None:
        """Actuation matrix B (nv, p) if it does not depend on the configuration, else None."""
        return None if self._function is not None or self.configured else self._constant

    @property
    def parts(self) -> tuple[np.ndarray, list[tuple[int, int, int]]] | None:
        """Constant part of B (nv, p) and ``frames``; None for a user's function."""
        return None if self._function is not None else (self._constant, self.frames)

    def matrix(self, at: PositionKinematics) -> np.ndarray:
        """Actuation matrix B(q), (..., nv, p).

        Args:
            at: kinematics at configurations (..., nq).
        """
        if self._function is not None:
            return self._function.over(at.q)
        constant = np.broadcast_to(self._constant, (*at.q.shape[:-1], *self._constant.shape))
        if not self.configured:
            return constant
        matrix = np.array(constant)
        for column, frame, row in self.frames:
            # Virtual work: a force along a row of the Jacobian acts on v as the transpose of that row.
            matrix[..., column] = at.jacobian(frame, OWN_AXES, slice(row, row + 1))[..., 0, :]
        return matrix

    def matrix_rate(self, at: VelocityKinematics) -> np.ndarray | None:
        """Rate of B along v, (..., nv, p); None for a user's function, because its rate is unknown.

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """
        if self._function is not None:
            return None
        rate = np.zeros((*at.q.shape[:-1], *self._constant.shape))
        for column, frame, row in self.frames:
            rate[..., column] = at.jacobian_dot(frame, OWN_AXES)[..., row, :]
        return rate


# ------------------------------------------------------------------ passive forces


class ForceGradient(NamedTuple):
    """Derivatives of a generalized force at one state, along the tangent space at q and by v."""

    q: np.ndarray
    """(nv, nv); the last index is the direction."""
    v: np.ndarray
    """(nv, nv)."""
    error: float
    """Estimated error of finite differences; 0.0 if both are in closed form."""


class ForceSums(NamedTuple):
    """Sums of forces (..., nv)."""

    total: np.ndarray
    without_potential: np.ndarray
    """Sum of the forces that are not conservative."""


class PassiveForce(ABC):
    """Generalized force that follows from the state, bound to a robot.

    Attributes:
        name: name in messages and summaries.
        conservative: True if the force is the negative gradient of ``potential``. The work of other forces counts as
            work done on the system.
        generalized: True if it is a user's function of q and v, so that its wrench on the robot is unknown.
    """

    name: str
    conservative: bool = False
    generalized: bool = False

    @abstractmethod
    def force(self, at: VelocityKinematics) -> np.ndarray:
        """Generalized force (..., nv).

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """

    @abstractmethod
    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        """Derivatives at one state.

        Args:
            at: the state.
            along: kinematics at the same configuration for each unit velocity, (nv,) states.
        """

    def potential(self, at: PositionKinematics) -> np.ndarray:
        """Potential energy (...) [J]; zero if not ``conservative``.

        Args:
            at: kinematics at configurations (..., nq).
        """
        return np.zeros(at.q.shape[:-1])

    def kernel_forces(self) -> list[tuple[KernelRow, KernelForce]] | None:
        """Rows along which the force acts, with their laws, for the compiled kernel; None if Python evaluates it."""
        return None


@runtime_checkable
class ForceKind(Protocol):
    """Description of a force that can be bound to a robot."""

    def bind(self, robot: Robot) -> PassiveForce: ...


class PassiveForces:
    """All passive forces of a system.

    Args:
        kinds: descriptions.
        robot: the robot on which they act.

    Attributes:
        kinds: the descriptions.
        names: name of each force.

    Raises:
        ConstraintError: an entry is no force.
    """

    def __init__(self, kinds: Sequence[ForceKind], robot: Robot) -> None:
        self.kinds, self._forces = tuple(kinds), [kind.bind(robot) for kind in kinds]
        for kind, force in zip(kinds, self._forces, strict=True):
            if not isinstance(force, PassiveForce):
                raise ConstraintError(f"forces: {kind!r} is no force: expected a kind from rnc_pin.forces")
        self._nv = robot.nv
        self.names = tuple(force.name for force in self._forces)

    def __bool__(self) -> bool:
        return bool(self._forces)

    def __iter__(self) -> Iterator[PassiveForce]:
        return iter(self._forces)

    def sums(self, at: VelocityKinematics) -> ForceSums:
        """Sums of the forces at states.

        Args:
            at: kinematics at states, configurations (..., nq) and velocities (..., nv).
        """
        total, without_potential = np.zeros((2, *at.q.shape[:-1], self._nv))
        for each in self._forces:
            force = each.force(at)
            total += force
            # Work of the others leaves the energy of the system, and has to be counted as work.
            if not each.conservative:
                without_potential += force
        return ForceSums(total, without_potential)

    def kernel_forces(self) -> list[tuple[KernelRow, KernelForce]] | None:
        """Rows and laws of all forces for the compiled kernel; None if Python evaluates one of them."""
        # One force of a user is enough: Python then evaluates all of them.
        found = [each.kernel_forces() for each in self._forces]
        known = [each for each in found if each is not None]
        return [pair for pairs in known for pair in pairs] if len(known) == len(found) else None

    def potential(self, at: PositionKinematics) -> np.ndarray:
        """Potential energy of all conservative forces (...) [J].

        Args:
            at: kinematics at configurations (..., nq).
        """
        return np.sum([each.potential(at) for each in self._forces], axis=0)

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        """Derivatives of the total force at one state; arguments as of ``PassiveForce.gradient``."""
        q, v, error = np.zeros((self._nv, self._nv)), np.zeros((self._nv, self._nv)), 0.0
        for each in self._forces:
            found = each.gradient(at, along)
            q, v, error = q + found.q, v + found.v, error + found.error
        return ForceGradient(q, v, error)


def admit_coefficients(values: float | Sequence[float], size: int, what: str) -> np.ndarray:
    """Convert one number, or one for each row of an output, to an array (size,).

    Args:
        values: the numbers.
        size: number of rows of the output.
        what: the coefficient in messages.

    Raises:
        InputError: the numbers are not finite, or not as many as the rows.
    """
    found = np.asarray(values, dtype=float)
    if found.shape not in ((), (size,)) or not np.isfinite(found).all():
        many = f" or {size}" if size > 1 else ""
        raise InputError(f"{what} {values!r}: expected one finite number{many}")
    return np.array(np.broadcast_to(found, (size,)))
