"""Outputs that keep a value or follow a prescribed motion: welded joints, held walls, rheonomic rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError
from rnc_pin.math.components import Component
from rnc_pin.model.coordinates import Coordinates, left_jacobian
from rnc_pin.model.kernel_rows import KernelRow
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import ConstantRows, OutputKind, OutputRows, Phrases, Rows
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class FixedOutput:
    """Output with a constant value: holonomic rows ``x(q) = value``.

    Any output with a value can be kept: a joint is welded, a frame holds its place, its distance or its orientation.
    A motion over time is a ``PrescribedMotion``.

    Args:
        output: joint, frame, distance or any other output with a value: ``rnc.FramePosition("hand")``.
        value: its value (k,) [m or rad]; rotations as rotation vectors.

    Raises:
        ConstraintError: the value has another size than the output, or the output is a speed, which has no value.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> welded = rnc.FixedOutput(rnc.JointPosition("joint_1"), 0.3)
        >>> reduced = rnc.NonholonomicSystem(robot, [welded], ["joint_2", "joint_3"]).reduce()
        >>> reduced.rheonomic, reduced.constraints.names
        (False, ('fixed(joint_1)',))
    """

    output: OutputKind
    value: float | tuple[float, ...] | np.ndarray

    def bind(self, robot: Robot) -> Rows:
        rows = self.output.bind(robot)
        names, value = ", ".join(rows.names), np.array(self.value, dtype=float, ndmin=1)
        if value.shape != (len(rows.names),) or not np.isfinite(value).all():
            raise ConstraintError(f"fixed output {names}: expected {len(rows.names)} numbers, found {self.value!r}")
        if rows.quasi:
            raise ConstraintError(f"fixed output {names}: a speed has no value; PrescribedMotion prescribes its rate")
        return FixedRows(rows, value, "fixed")


class FixedRows(Rows):
    """Rows of an output whose value is given.

    Args:
        output: bound rows of the output.
        value: its value (k,).
        name: word before the names of the output.
    """

    def __init__(self, output: OutputRows, value: np.ndarray, name: str) -> None:
        self._output, self._value = output, value
        self.names = tuple(f"{name}({each})" for each in output.names)
        self.units = output.units
        self.holonomic = () if output.quasi else (True,) * len(self.names)
        self._coordinates = Coordinates(output.angular, (0,) if output.rotation else ())

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._output.jacobian(at)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._output.jacobian_dot(at)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return self._output.bias_acceleration(at)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> np.ndarray | None:
        return self._output.bias_acceleration_gradient(at)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        if self._output.quasi:
            return self._zeros(at)
        return -self._coordinates.difference(self._wanted(at), self._output.value(at))

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        """Rows of the output."""
        rows = self._output.kernel_rows(model)
        if rows is None or not isinstance(self._output, ConstantRows):
            return rows
        return [row._replace(constant=line) for row, line in zip(rows, self._output.matrix, strict=True)]

    def phrases(self) -> Phrases:
        return Phrases(prevents="leave the value that is fixed for", where=", ".join(self._output.names))

    def _wanted(self, at: PositionKinematics) -> np.ndarray:
        """Value (..., k) that the output should have."""
        return np.broadcast_to(self._value, (*at.q.shape[:-1], len(self.names)))


class PrescribedPoint(Protocol):
    """Value of a prescribed motion at one time, such as a ``ReferencePoint``."""

    @property
    def position(self) -> np.ndarray: ...
    @property
    def velocity(self) -> np.ndarray: ...
    @property
    def acceleration(self) -> np.ndarray: ...


class Motion(Protocol):
    """Motion of k outputs over time, such as a ``Reference``."""

    size: int

    def at(self, t: float) -> PrescribedPoint: ...


@dataclass(frozen=True)
class PrescribedMotion:
    """Output that follows a given function of time: ``x(q) = f(t)``, or ``J v = fdot(t)`` for a quasi-velocity.

    The rows are rheonomic, ``A(q) v = mu(t)``: evaluations of the model need the time. Whatever moves the output does
    work, and the energy balance of a run includes it. Outputs with a value are holonomic: the run starts at ``f(0)``.

    Args:
        output: joint, frame, distance or any other output: ``rnc.JointPosition("pivot")``.
        motion: its motion, a ``Reference`` of the output's size. Its time is that of the run or of the phase, which
            starts at zero.
        start_time: time of the motion at the start of the run or phase [s], to continue a motion in a later phase.

    Raises:
        ConstraintError: the motion has another size than the output.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> swing = rnc.planning.Harmonic([0.0], amplitude=[0.3], frequency=0.5)
        >>> driven = rnc.PrescribedMotion(rnc.JointPosition("joint_1"), swing)
        >>> reduced = rnc.NonholonomicSystem(robot, [driven], ["joint_2", "joint_3"]).reduce()
        >>> reduced.rheonomic, reduced.constraints.names
        (True, ('prescribed(joint_1)',))
        >>> state = reduced.at(reduced.assembled(robot.configuration()), v2=[0.0, 0.0, 0.0], t=0.0)
    """

    output: OutputKind
    motion: Motion
    start_time: float = 0.0

    def bind(self, robot: Robot) -> Rows:
        rows = self.output.bind(robot)
        size = getattr(self.motion, "size", None)
        if size != len(rows.names):
            raise ConstraintError(
                f"prescribed motion of {', '.join(rows.names)}: expected a Reference of size {len(rows.names)}, "
                f"found {self.motion!r}" + ("" if size is None else f" of size {size}")
            )
        if not np.isfinite(self.start_time):
            raise ConstraintError(f"start_time of a prescribed motion: expected a number, found {self.start_time!r}")
        return _PrescribedRows(rows, self.motion, self.start_time)


class _PrescribedRows(FixedRows):
    """Rows of an output with the rates of a motion as right-hand side; the kernel gets these rates from Python.

    Args:
        output: bound rows of the output.
        motion: its motion.
        start_time: time of the motion at time zero [s].
    """

    affine = rheonomic = True

    def __init__(self, output: OutputRows, motion: Motion, start_time: float) -> None:
        super().__init__(output, np.zeros(len(output.names)), "prescribed")
        self._motion, self._start_time = motion, start_time

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return self._output.bias_acceleration(at) - self.rate_dot(at)

    def rate(self, at: PositionKinematics) -> np.ndarray:
        return self._over_times(at, 1)

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._over_times(at, 2)

    def rates_over_time(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        return self._at(t)[1:]

    def _wanted(self, at: PositionKinematics) -> np.ndarray:
        return self._over_times(at, 0)

    def phrases(self) -> Phrases:
        return Phrases(prevents="leave the motion that is prescribed for", where=", ".join(self._output.names))

    def _over_times(self, at: PositionKinematics, order: int) -> np.ndarray:
        """Derivative (..., k) of the motion of an order from zero to two; angular ones for rotations."""
        batch = at.q.shape[:-1]
        times: Component = at.t
        if np.ndim(times) == 0:
            return np.broadcast_to(self._at(float(times))[order], (*batch, len(self.names)))
        return np.array([self._at(t)[order] for t in np.ravel(times).tolist()]).reshape(*batch, -1)

    def _at(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity and acceleration (k,) at a time."""
        position, velocity, acceleration = (
            np.asarray(each, dtype=float)
            for point in [self._motion.at(t + self._start_time)]
            for each in (point.position, point.velocity, point.acceleration)
        )
        if self._output.rotation:  # from rates of the rotation vector to the angular velocity and its rate
            J, J_dot = left_jacobian(position, velocity)
            velocity, acceleration = J @ velocity, J @ acceleration + J_dot @ velocity
        return position, velocity, acceleration
