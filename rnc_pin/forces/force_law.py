"""Force law of a user, conjugate to an output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rnc_pin.forces.output_force_law import OutputForceLaw, check_entries
from rnc_pin.model.kinematics import over_states
from rnc_pin.model.passive_forces import PassiveForce
from rnc_pin.model.rows import OutputKind, admit_rows
from rnc_pin.model.user_functions import vector_gradient_with_error
from rnc_pin.robots.robot import Robot

Law = Callable[[np.ndarray, np.ndarray], np.ndarray]
Slopes = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class ForceLaw:
    """Force ``u(y, ydot)`` of a user, conjugate to an output: a nonlinear spring, an aerodynamic drag, a magnet.

    Args:
        output: an output with k rows; y is zero for a quasi-velocity.
        law: ``law(y, ydot) -> (k,)``, the force [N or N m].
        slopes: ``slopes(y, ydot)``, its derivatives (k, k) by y and by ydot; finite differences by default.
        potential: ``potential(y) -> float`` [J], if the force is its negative gradient. Without it, the work of the
            force counts as work done on the system.

    Raises:
        ConstraintError: slopes or potential differ from differences of the law at random values.
        InputError: the law returns an array of wrong shape.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> cubic = rnc.forces.ForceLaw(rnc.JointPosition("joint_2"), lambda y, rate: -5.0 * y**3)
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names, forces=[cubic]).reduce()
        >>> reduced.at(robot.configuration({"joint_2": 2.0}), np.zeros(4)).passive_force.round(3)
        array([  0.,   0., -40.,   0.])
    """

    output: OutputKind
    law: Law
    slopes: Slopes | None = None
    potential: Callable[[np.ndarray], float] | None = None

    def bind(self, robot: Robot) -> PassiveForce:
        return _ForceLaw(self, robot)


class _ForceLaw(OutputForceLaw):
    def __init__(self, kind: ForceLaw, robot: Robot) -> None:
        super().__init__("force_law", kind.output, robot)
        self._kind, self._size = kind, len(self.rows.names)
        self.conservative = kind.potential is not None
        generator = np.random.default_rng(0)
        for _ in range(2):
            self._check(*generator.uniform(0.1, 1.0, (2, self._size)))

    def _one(self, y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return admit_rows(self._kind.law(y, rate), (self._size,), f"law(y, ydot) of {self.name}")

    def law(self, y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return over_states(self._one, (self._size,), y, rate)

    def slopes(self, y: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        if self._kind.slopes is None:
            return self._differences(y, rate)
        shape = (self._size, self._size)
        by_value, by_rate = self._kind.slopes(y, rate)
        what = f"slopes(y, ydot) of {self.name}"
        return admit_rows(by_value, shape, what), admit_rows(by_rate, shape, what), 0.0

    def _differences(self, y: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        by_value, one = vector_gradient_with_error(lambda x: self._one(x, rate), y)
        by_rate, other = vector_gradient_with_error(lambda x: self._one(y, x), rate)
        return by_value, by_rate, max(one, other)

    def energy(self, y: np.ndarray) -> np.ndarray:
        assert self._kind.potential is not None
        return over_states(self._kind.potential, (), y)

    def _check(self, y: np.ndarray, rate: np.ndarray) -> None:
        self._one(y, rate)
        if self._kind.slopes is not None:
            *given, _ = self.slopes(y, rate)
            *expected, doubt = self._differences(y, rate)
            for by, found, wanted in zip(("y", "ydot"), given, expected, strict=True):
                check_entries(f"{self.name}: slopes by {by}", found, wanted, doubt, "a difference of the law")
        if self._kind.potential is not None:
            gradient, doubt = vector_gradient_with_error(self.energy, y)
            for moving in (rate, 0.0 * rate):
                force, source = self._one(y, moving), "the negative gradient of its potential"
                check_entries(f"{self.name}: force", force, -gradient, doubt, source)
