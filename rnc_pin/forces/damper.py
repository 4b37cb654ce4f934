"""Viscous damper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.forces.output_force_law import OutputForceLaw
from rnc_pin.model.kernel_rows import KernelForce
from rnc_pin.model.parameter_types import Numbers
from rnc_pin.model.passive_forces import PassiveForce, admit_coefficients
from rnc_pin.model.rows import OutputKind
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class Damper:
    """Viscous damper: force ``-damping ydot`` conjugate to the rate of an output.

    A ``ReducedPlant`` integrates it explicitly, so ``dt`` has to resolve its decay. The joint damping of the robot's
    file (``simulation.joint_damping``) may be of any size.

    Args:
        output: an output; a quasi-velocity or an orientation too.
        damping: one number, or one for each row [N s/m or N m s/rad].

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> damper = rnc.forces.Damper(rnc.JointPosition("joint_2"), damping=3.0)
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names, forces=[damper]).reduce()
        >>> rnc.state_derivatives(reduced, robot.configuration(), np.zeros(4), np.zeros(4)).v2_dot_v2.shape
        (4, 4)
    """

    output: OutputKind
    damping: float | Numbers

    def bind(self, robot: Robot) -> PassiveForce:
        return _Damper(self, robot)


class _Damper(OutputForceLaw):
    def __init__(self, kind: Damper, robot: Robot) -> None:
        super().__init__("damper", kind.output, robot)
        self._damping = admit_coefficients(kind.damping, len(self.rows.names), f"{self.name}: damping")

    def law(self, y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return -self._damping * rate

    def slopes(self, y: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        return np.zeros((len(y), len(y))), -np.diag(self._damping), 0.0

    def kernel_laws(self) -> list[KernelForce]:
        return [KernelForce(damping=each) for each in self._damping.tolist()]
