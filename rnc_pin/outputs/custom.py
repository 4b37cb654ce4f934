"""User-defined outputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics, over_states
from rnc_pin.model.rows import OutputRows, admit_rows
from rnc_pin.model.user_functions import DerivedRate, Rate, check_rate
from rnc_pin.robots.robot import Robot


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
    def __init__(self, kind: Output, robot: Robot) -> None:
        size = len(kind.names)
        if isinstance(kind.names, str) or size == 0:
            raise ConstraintError(f"names of a user-defined output have to be a list of strings, found {kind.names!r}")
        self.names = tuple(kind.names)
        self.units = ("",) * size
        self.angular = (kind.angular,) * size
        self.quasi = kind.value is None
        self._kind = kind
        self._shape = (size, robot.nv)
        admit_rows(kind.jacobian(robot.configuration()), self._shape, f"jacobian(q) of output {self.names}")
        whose = f" of output {self.names}"
        if kind.value is not None:
            along = partial(_product, kind.jacobian)
            admit_rows(kind.value(robot.configuration()), self._shape[:1], f"value(q){whose}")
            check_rate(robot, kind.value, along, ("value(q)", f"jacobian(q) v{whose}"), self.names, kind.angular)
        if kind.jacobian_dot is None:
            self._jacobian_dot: Rate = DerivedRate(robot, kind.jacobian, f"jacobian(q){whose}")
        else:
            self._jacobian_dot = kind.jacobian_dot
            labels = "jacobian(q)", f"jacobian_dot(q, v){whose}"
            check_rate(robot, kind.jacobian, kind.jacobian_dot, labels, self.names)

    def value(self, at: PositionKinematics) -> np.ndarray:
        value = self._kind.value
        if value is None:
            return super().value(at)
        return over_states(partial(self._admitted, value, "value(q)", self._shape[:1]), self._shape[:1], at.q)

    def jacobian(self, at: PositionKinematics) -> np.ndarray:
        rows = partial(self._admitted, self._kind.jacobian, "jacobian(q)", self._shape)
        return over_states(rows, self._shape, at.q)

    def jacobian_dot(self, at: VelocityKinematics) -> np.ndarray:
        rows = partial(self._admitted, self._jacobian_dot, "jacobian_dot(q, v)", self._shape)
        return over_states(rows, self._shape, at.q, at.v)

    def bias_acceleration(self, at: VelocityKinematics) -> np.ndarray:
        return apply(self.jacobian_dot(at), at.v)

    def _admitted(
        self, function: Callable[..., object], what: str, shape: tuple[int, ...], *state: np.ndarray
    ) -> np.ndarray:
        return admit_rows(function(*state), shape, f"{what} of output {self.names}")


def _product(jacobian: Callable[[np.ndarray], np.ndarray], q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.asarray(jacobian(q) @ v)
