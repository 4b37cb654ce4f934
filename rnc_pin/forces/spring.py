"""Linear spring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.forces.output_force_law import OutputForceLaw
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.kernel_rows import KernelForce
from rnc_pin.model.parameter_types import Numbers
from rnc_pin.model.passive_forces import PassiveForce, admit_coefficients
from rnc_pin.model.rows import OutputKind
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class Spring:
    """Linear spring: force ``-stiffness (y - rest)`` conjugate to an output y.

    On a ``JointPosition`` it is a joint spring, such as that of an elastic joint; on a ``Distance`` a spring between
    two frames; on a ``FramePosition`` a spring from a frame to a point of the world. An angle that the file or the
    output wraps, e.g. of a continuous joint, is compared modulo a full turn.

    Args:
        output: an output with values; not a quasi-velocity and not an orientation of three angles.
        stiffness: one number, or one for each row [N/m or N m/rad].
        rest: value without force, one number or one for each row [m or rad].

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> spring = rnc.forces.Spring(rnc.JointPosition("joint_2"), stiffness=40.0, rest=0.5)
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names, forces=[spring]).reduce()
        >>> q = robot.configuration({"joint_2": 0.6})
        >>> reduced.inverse_dynamics(q, np.zeros(4), np.zeros(4)).round(3)  # what holds it
        array([0., 0., 4., 0.])
    """

    output: OutputKind
    stiffness: float | Numbers
    rest: float | Numbers = 0.0

    def bind(self, robot: Robot) -> PassiveForce:
        return _Spring(self, robot)


class _Spring(OutputForceLaw):
    conservative = True

    def __init__(self, kind: Spring, robot: Robot) -> None:
        super().__init__("spring", kind.output, robot)
        rows = self.rows
        if rows.quasi or rows.rotation:
            what = "a quasi-velocity, which has no value" if rows.quasi else "an orientation"
            raise ConstraintError(f"{self.name}: the output is {what}: use an angle, a position or a distance")
        size = len(rows.names)
        self._stiffness = admit_coefficients(kind.stiffness, size, f"{self.name}: stiffness")
        self._rest = admit_coefficients(kind.rest, size, f"{self.name}: rest")
        self._coordinates = Coordinates(rows.angular)

    def law(self, y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return self._stiffness * self._coordinates.difference(self._rest, y)

    def slopes(self, y: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        return -np.diag(self._stiffness), np.zeros((len(y), len(y))), 0.0

    def kernel_laws(self) -> list[KernelForce]:
        numbers = zip(self._stiffness.tolist(), self._rest.tolist(), self._coordinates.kinds.tolist(), strict=True)
        return [KernelForce(stiffness=stiffness, rest=rest, turns=turns) for stiffness, rest, turns in numbers]

    def energy(self, y: np.ndarray) -> np.ndarray:
        return 0.5 * (self._stiffness * np.square(self._coordinates.difference(self._rest, y))).sum(axis=-1)
