"""Smooth Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import InputError
from rnc_pin.forces.output_force_law import OutputForceLaw
from rnc_pin.model.kernel_rows import KernelForce
from rnc_pin.model.parameter_types import Numbers, Positive
from rnc_pin.model.passive_forces import PassiveForce, admit_coefficients
from rnc_pin.model.rows import OutputKind
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class SmoothFriction:
    """Coulomb friction without stiction: force ``-limit tanh(ydot / speed)`` conjugate to the rate of an output.

    Friction with stiction is that of ``ReducedPlant(joint_friction=True)``; it has no derivatives.

    Args:
        output: an output; a quasi-velocity too.
        limit: friction at high speed, one number or one for each row [N or N m].
        speed: rate at which 76 % of it act [m/s or rad/s].

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> friction = rnc.forces.SmoothFriction(rnc.JointPosition("joint_2"), limit=2.0, speed=0.01)
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names, forces=[friction]).reduce()
        >>> v2 = np.array([0.0, 0.0, 1.0, 0.0])
        >>> float(reduced.at(robot.configuration(), v2).passive_force[2])
        -2.0
    """

    output: OutputKind
    limit: float | Numbers
    speed: Positive

    def bind(self, robot: Robot) -> PassiveForce:
        return _SmoothFriction(self, robot)


class _SmoothFriction(OutputForceLaw):
    def __init__(self, kind: SmoothFriction, robot: Robot) -> None:
        super().__init__("friction", kind.output, robot)
        self._limit = admit_coefficients(kind.limit, len(self.rows.names), f"{self.name}: limit")
        if not 0 < kind.speed < np.inf:
            raise InputError(f"{self.name}: speed {kind.speed!r}: expected a positive number")
        self._speed = float(kind.speed)

    def law(self, y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return -self._limit * np.tanh(rate / self._speed)

    def slopes(self, y: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        slope = -self._limit / self._speed * (1.0 - np.square(np.tanh(rate / self._speed)))
        return np.zeros((len(y), len(y))), np.diag(slope), 0.0

    def kernel_laws(self) -> list[KernelForce]:
        return [KernelForce(limit=each, speed=self._speed) for each in self._limit.tolist()]
