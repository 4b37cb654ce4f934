"""User-defined constraint rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics, over_states
from rnc_pin.model.rows import Rows, admit_rows
from rnc_pin.model.user_functions import DerivedRate, Function, Rate, check_rate
from rnc_pin.robots.robot import Robot


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
            ``residual`` without ``rheonomic``, or a given rate differs from differences at random states.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> row = np.array([[0.0, 1.0, 1.0, 1.0]])  # the hand does not turn
        >>> level = rnc.Pfaffian(lambda q: row, names=["level"])
        >>> rnc.NonholonomicSystem(robot, [level], ["joint_1", "joint_2", "joint_3"]).constraints.names
        ('level',)
    """

    rows: Callable[..., np.ndarray]
    rows_dot: Callable[..., np.ndarray] | None = None
    names: Sequence[str] | None = None
    rate: Callable[..., np.ndarray] | None = None
    rate_dot: Callable[..., np.ndarray] | None = None
    residual: Callable[..., np.ndarray] | None = None
    rheonomic: bool = False

    def bind(self, robot: Robot) -> Rows:
        if self.rate is None and self.rate_dot is not None:
            raise ConstraintError("a Pfaffian constraint takes 'rate_dot' only together with 'rate'")
        if self.rate is not None and self.residual is not None and not self.rheonomic:
            raise ConstraintError("a Pfaffian constraint takes 'rate' or 'residual', not both")
        return _PfaffianRows(self, robot)


class _PfaffianRows(Rows):
    def __init__(self, kind: Pfaffian, robot: Robot) -> None:
        self.rheonomic = self.turning = kind.rheonomic
        first = (robot.configuration(), *((0.0,) if kind.rheonomic else ()))
        sample = np.atleast_1d(np.asarray(kind.rows(*first), dtype=float))
        self._shape = (sample.shape[0], robot.nv)
        self.names = tuple(kind.names or [f"row[{i}]" for i in range(self._shape[0])])
        if len(self.names) != self._shape[0]:
            raise ConstraintError(f"{len(self.names)} names for {self._shape[0]} Pfaffian rows")
        self.unnamed = not kind.names
        self.units = ("",) * self._shape[0]
        self._kind = kind
        self.affine = kind.rate is not None
        self.holonomic = (kind.residual is not None,) * self._shape[0]
        admit_rows(sample, self._shape, "rows(q) of a Pfaffian constraint")
        self._rows_dot = self._rate_of(kind.rows, kind.rows_dot, ("rows(q)", "rows_dot(q, v)"), robot)
        if kind.rate is not None:
            admit_rows(kind.rate(*first), self._shape[:1], "rate(q) of a Pfaffian constraint")
            self._rate_dot = self._rate_of(kind.rate, kind.rate_dot, ("rate(q)", "rate_dot(q, v)"), robot)

    def _rate_of(self, function: Function, given: Rate | None, labels: tuple[str, str], robot: Robot) -> Rate:
        if given is None:
            return DerivedRate(robot, function, f"{labels[0]} of a Pfaffian constraint", self.rheonomic)
        told = labels[0], f"{labels[1]} of a Pfaffian constraint"
        check_rate(robot, function, given, told, self.names, timed=self.rheonomic)
        return given

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        return self._evaluated(self._kind.rows, "rows(q)", self._shape, at, at.q)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        return self._evaluated(self._rows_dot, "rows_dot(q, v)", self._shape, at, at.q, at.v)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        bias_acceleration = apply(self.jacobian_dot(at), at.v)
        return bias_acceleration - self.rate_dot(at) if self.affine else bias_acceleration

    def rate(self, at: PositionKinematics) -> np.ndarray:
        if self._kind.rate is None:
            return super().rate(at)
        return self._evaluated(self._kind.rate, "rate(q)", self._shape[:1], at, at.q)

    def rate_dot(self, at: VelocityKinematics) -> np.ndarray:
        if not self.affine:
            return self._zeros(at)
        return self._evaluated(self._rate_dot, "rate_dot(q, v)", self._shape[:1], at, at.q, at.v)

    def residual(self, at: PositionKinematics) -> np.ndarray:
        if self._kind.residual is None:
            return super().residual(at)
        return self._evaluated(self._kind.residual, "residual(q)", self._shape[:1], at, at.q)

    def _evaluated(
        self,
        function: Callable[..., object],
        what: str,
        shape: tuple[int, ...],
        at: PositionKinematics,
        *arrays: np.ndarray,
    ) -> np.ndarray:
        def admitted(*state: np.ndarray | float) -> np.ndarray:
            return admit_rows(function(*state), shape, f"{what} of a Pfaffian constraint")

        def admitted_at(*state: np.ndarray) -> np.ndarray:
            return admitted(*state[:-1], float(state[-1][0]))

        if not self.rheonomic:
            return over_states(admitted, shape, *arrays)
        times = np.broadcast_to(at.t, at.q.shape[:-1])[..., None]
        return over_states(admitted_at, shape, *arrays, times)
