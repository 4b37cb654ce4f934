"""Rows of your own: functions of the configuration, and outputs that keep a value or follow a prescribed motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin._kernel.kernel_rows import KernelRow
from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.coordinates import Coordinates, left_jacobian
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics, over_states
from rnc_pin.model.rows import OutputKind, OutputRows, Rows
from rnc_pin.model.user_functions import Function, Rate, UserFunction, admitted_rate, central_difference, check_rate
from rnc_pin.robots.robot import Robot

_WHOSE = " of a Pfaffian constraint"


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
    value: float | tuple[float, ...] | Array

    def bind(self, robot: Robot) -> Rows:
        rows = self.output.bind(robot)
        # A copy: later changes of the caller's array must not move the weld.
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

    def __init__(self, output: OutputRows, value: Array, name: str) -> None:
        self._output, self._value = output, value
        self.names = tuple(f"{name}({each})" for each in output.names)
        self.units = output.units
        self.holonomic = () if output.quasi else (True,) * len(self.names)
        self._coordinates = Coordinates(output.angular, (0,) if output.rotation else ())

    def jacobian(self, at: PositionKinematics) -> Array:
        return self._output.jacobian(at)

    def jacobian_dot(self, at: VelocityKinematics) -> Array:
        return self._output.jacobian_dot(at)

    def bias_acceleration(self, at: VelocityKinematics) -> Array:
        return self._output.bias_acceleration(at)

    def bias_acceleration_gradient(self, at: VelocityKinematics) -> Array | None:
        return self._output.bias_acceleration_gradient(at)

    def residual(self, at: PositionKinematics) -> Array:
        # A quasi-velocity has no value whose drift could be removed.
        if self._output.quasi:
            return self._zeros(at)
        return -self._coordinates.difference(self._wanted(at), self._output.value(at))

    def kernel_rows(self, model: pin.Model) -> list[KernelRow] | None:
        """Rows of the output.

        Args:
            model: model of the robot.
        """
        return self._output.kernel_rows(model)

    def _wanted(self, at: PositionKinematics) -> Array:
        """Value (..., k) that the output should have."""
        return np.broadcast_to(self._value, (*at.q.shape[:-1], len(self.names)))


class PrescribedPoint(Protocol):
    """Value of a prescribed motion at one time, such as a ``ReferencePoint``."""

    @property
    def position(self) -> Array: ...
    @property
    def velocity(self) -> Array: ...
    @property
    def acceleration(self) -> Array: ...


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
        motion: its motion, a ``Reference`` of the output's size. Its time is the time of the run, which starts at zero.
        start_time: time of the motion at the start of the run [s], to continue a motion in a later run.

    Raises:
        ConstraintError: the motion has another size than the output, or its velocity is not the rate of its position,
            or its acceleration not the rate of its velocity, at any of a few times.

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
        # At once: in a run a wrong rate would only show as drift, which the projection removes.
        _check_rates(self.motion, self.start_time, rows.names)
        return _PrescribedRows(rows, self.motion, self.start_time)


def _check_rates(motion: Motion, start: float, names: Sequence[str]) -> None:
    """Refuse a motion whose rates are wrong at all times that are looked at; at single times they may jump."""
    longest = 1.0  # [s] of a motion that is looked at: a reference may never end
    span = min(float(getattr(motion, "duration", longest)) or longest, longest)
    # Times, off round ones where motions change, and the step of differences.
    shares, step_share = np.linspace(0.09, 0.93, 8), 1e-4
    times, step = start + span * shares, step_share * span

    def value(name: str, t: float, later: float = 0.0) -> Array:
        return np.array(getattr(motion.at(t + later), name), dtype=float).ravel()

    different, still, few = 0.01, 1e-6, 2  # part of the largest rate; rate at rest; times in motion that decide nothing
    for rate, of in (("velocity", "position"), ("acceleration", "velocity")):
        given = np.array([value(rate, t) for t in times.tolist()])
        expected = np.array([central_difference(partial(value, of, t), step) for t in times.tolist()])
        scale = max(np.abs(expected).max(initial=0.0), np.abs(given).max(initial=0.0))
        moving = np.maximum(np.abs(expected), np.abs(given)) > max(different * scale, still)
        wrong = (np.abs(given - expected) > different * scale) & moving
        for column in np.flatnonzero((wrong == moving).all(axis=0) & (moving.sum(axis=0) > few)).tolist():
            row = int(np.argmax(wrong[:, column]))
            raise ConstraintError(
                f"prescribed motion of {names[column]}: its {rate} is not the rate of its {of}: "
                f"{given[row, column]:.6g} at t = {times[row]:.3g} s, differences give {expected[row, column]:.6g}"
            )


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

    def bias_acceleration(self, at: VelocityKinematics) -> Array:
        return self._output.bias_acceleration(at) - self.rate_dot(at)

    def rate(self, at: PositionKinematics) -> Array:
        return self._over_times(at, 1)

    def rate_dot(self, at: VelocityKinematics) -> Array:
        return self._over_times(at, 2)

    def rates_over_time(self, t: float) -> tuple[Array, Array]:
        return self._at(t)[1:]

    def _wanted(self, at: PositionKinematics) -> Array:
        return self._over_times(at, 0)

    def _over_times(self, at: PositionKinematics, order: int) -> Array:
        """Derivative (..., k) of the motion of an order from zero to two; angular ones for rotations."""
        batch = at.q.shape[:-1]
        # One time for all states, as in a sampled run: the motion is called once.
        if np.ndim(at.t) == 0:
            return np.broadcast_to(self._at(float(at.t))[order], (*batch, len(self.names)))
        return np.array([self._at(t)[order] for t in np.ravel(at.t).tolist()]).reshape(*batch, -1)

    def _at(self, t: float) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration (k,) at a time."""
        # One call for all three: a motion of a user may take long.
        point = self._motion.at(t + self._start_time)
        given = point.position, point.velocity, point.acceleration
        position, velocity, acceleration = (np.asarray(each, dtype=float) for each in given)
        if self._output.rotation:  # from rates of the rotation vector to the angular velocity and its rate
            J, J_dot = left_jacobian(position, velocity)
            velocity, acceleration = J @ velocity, J @ acceleration + J_dot @ velocity
        return position, velocity, acceleration


@dataclass(frozen=True)
class Pfaffian:
    """User-defined constraint ``A(q) v = 0``, ``A(q) v = mu(q)``, or with time ``A(q, t) v = mu(q, t)``.

    Args:
        rows: matrix A, ``rows(q) -> (k, nv)``.
        rows_dot: ``rows_dot(q, v) -> (k, nv)``, the rate of ``rows`` along v; derived from ``rows`` by default.
        names: name of each row; ``row[0]``, ``row[1]``, ... by default, numbered over all constraints of a system.
        rate: right-hand side mu, ``rate(q) -> (k,)``, e.g. for a conveyor or a turntable.
        rate_dot: ``rate_dot(q, v) -> (k,)``, the rate of mu along v; derived from ``rate`` by default.
        residual: ``residual(q) -> (k,)`` for holonomic rows: the function of q that has the rate ``A v`` and stays at
            zero. The simulation removes its drift.
        rheonomic: True if the functions depend on time: each takes t [s] as its last argument, and rates include its
            flow. A ``residual(q, t)`` then has the rate ``A v - mu``, and ``rate`` is needed too.

    Raises:
        InputError: a function returns an array of wrong shape.
        ConstraintError: ``names`` does not fit the rows, ``rate_dot`` is given without ``rate``, ``rate`` together with
            ``residual`` without ``rheonomic``, or a given rate differs from differences at random states, as does the
            rate of ``residual``.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> row = np.array([[0.0, 1.0, 1.0, 1.0]])  # the hand does not turn
        >>> level = rnc.Pfaffian(lambda q: row, names=["level"])
        >>> rnc.NonholonomicSystem(robot, [level], ["joint_1", "joint_2", "joint_3"]).constraints.names
        ('level',)
    """

    rows: Callable[..., Array]
    rows_dot: Callable[..., Array] | None = None
    names: Sequence[str] | None = None
    rate: Callable[..., Array] | None = None
    rate_dot: Callable[..., Array] | None = None
    residual: Callable[..., Array] | None = None
    rheonomic: bool = False

    def bind(self, robot: Robot) -> Rows:
        for name in ("rows", "rows_dot", "rate", "rate_dot", "residual"):
            given = getattr(self, name)
            if not callable(given) and (given is not None or name == "rows"):
                raise ConstraintError(
                    f"'{name}' of a Pfaffian constraint has to be a function, such as lambda q: matrix, "
                    f"found {type(given).__name__}"
                )
        if self.rate is None and self.rate_dot is not None:
            raise ConstraintError("a Pfaffian constraint takes 'rate_dot' only together with 'rate'")
        if self.rate is not None and self.residual is not None and not self.rheonomic:
            raise ConstraintError("a Pfaffian constraint takes 'rate' or 'residual', not both")
        return _PfaffianRows(self, robot)


class _PfaffianRows(Rows):
    def __init__(self, kind: Pfaffian, robot: Robot) -> None:
        self.rheonomic = self.turning = kind.rheonomic
        first = (robot.configuration(), *((0.0,) if kind.rheonomic else ()))
        # One call tells the number of rows; checks of the function come after it.
        sample = np.atleast_1d(np.asarray(kind.rows(*first), dtype=float))
        self._shape = (sample.shape[0], robot.nv)
        self.names = tuple(kind.names or [f"row[{i}]" for i in range(self._shape[0])])
        if len(self.names) != self._shape[0]:
            raise ConstraintError(f"{len(self.names)} names for {self._shape[0]} Pfaffian rows")
        self.unnamed = not kind.names
        self.units = ("",) * self._shape[0]
        self.affine = kind.rate is not None
        self.holonomic = (kind.residual is not None,) * self._shape[0]
        self._functions: dict[str, UserFunction] = {}
        self._admit("rows", kind.rows)(*first)
        self._admit_rate("rows", kind.rows_dot, robot)
        if kind.rate is not None:
            self._admit("rate", kind.rate)(*first)
            self._admit_rate("rate", kind.rate_dot, robot)
        if kind.residual is not None:
            labels = "residual(q)", f"rows(q) v{_WHOSE}" + (", less rate(q)," if self.affine else "")
            residual, timed = self._admit("residual", kind.residual), self.rheonomic
            check_rate(robot, residual, self._residual_rate, labels, self.names, angular=True, timed=timed)

    def _admit(self, name: str, function: Function) -> UserFunction:
        """Keep a function of the user, with its results admitted."""
        shape = self._shape if name == "rows" else self._shape[:1]
        self._functions[name] = UserFunction(function, shape, f"{name}(q){_WHOSE}")
        return self._functions[name]

    def _admit_rate(self, name: str, given: Rate | None, robot: Robot) -> None:
        """Keep the rate of a function: the user's, or a derived one."""
        known = given, name, _WHOSE, self.names, self.rheonomic
        self._functions[f"{name}_dot"] = admitted_rate(robot, self._functions[name], *known)

    def _residual_rate(self, q: Array, v: Array, *t: float) -> Array:
        """Rate (k,) that the residual has by the rows."""
        found = self._functions["rows"](q, *t) @ v
        # The residual has to change as the rows say, or the projection would push against the velocities.
        return found - self._functions["rate"](q, *t) if self.affine else found

    def jacobian(self, at: PositionKinematics) -> Array:
        return self._evaluated("rows", at, at.q)

    def jacobian_dot(self, at: VelocityKinematics) -> Array:
        return self._evaluated("rows_dot", at, at.q, at.v)

    def bias_acceleration(self, at: VelocityKinematics) -> Array:
        return apply(self.jacobian_dot(at), at.v) - self.rate_dot(at)

    def rate(self, at: PositionKinematics) -> Array:
        return self._evaluated("rate", at, at.q) if self.affine else super().rate(at)

    def rate_dot(self, at: VelocityKinematics) -> Array:
        return self._evaluated("rate_dot", at, at.q, at.v) if self.affine else self._zeros(at)

    def residual(self, at: PositionKinematics) -> Array:
        return self._evaluated("residual", at, at.q) if "residual" in self._functions else super().residual(at)

    def _evaluated(self, name: str, at: PositionKinematics, *arrays: Array) -> Array:
        function = self._functions[name]
        if not self.rheonomic:
            return function.over(*arrays)
        times = np.broadcast_to(at.t, at.q.shape[:-1])[..., None]
        return over_states(lambda *state: function(*state[:-1], float(state[-1][0])), function.shape, *arrays, times)
