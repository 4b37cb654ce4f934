"""Forces conjugate to outputs: ``f = J^T u(y, ydot)`` with the value y, the rate ``ydot = J v`` and a law u."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from rnc_pin.errors import ConstraintError
from rnc_pin.math.linear_algebra import apply, apply_transposed
from rnc_pin.model.kernel_rows import FORMS_OF_FORCES, KernelForce, KernelRow, Value
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.passive_forces import ForceGradient, PassiveForce
from rnc_pin.model.rows import ConstantRows, OutputKind
from rnc_pin.robots.robot import Robot

_WRONG = 1e-6  # relative error that rounding and differences do not explain
_DOUBT = 100.0  # times the error estimate that a difference may be wrong by


class OutputForceLaw(PassiveForce):
    """Force conjugate to an output: power = force times rate, summed over the rows.

    Args:
        word: kind of the force, for its name.
        output: the output.
        robot: the robot.

    Attributes:
        rows: the bound output, k rows.
    """

    def __init__(self, word: str, output: OutputKind, robot: Robot) -> None:
        self._model, self.rows = robot.model, output.bind(robot)
        self.name = f"{word}({', '.join(self.rows.names)})"

    @abstractmethod
    def law(self, y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Forces (..., k) for values and rates (..., k)."""

    @abstractmethod
    def slopes(self, y: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Derivatives (k, k) of the forces at one state by values and by rates, and their error."""

    def force(self, at: VelocityKinematics) -> np.ndarray:
        J = self.rows.jacobian(at)
        return apply_transposed(J, self.law(self.rows.value(at), apply(J, at.v)))

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        J, J_q = self.rows.jacobian(at), self.rows.jacobian_dot(along)  # (nv, k, nv); the first index is the direction
        y, rate = self.rows.value(at), J @ at.v
        by_value, by_rate, error = self.slopes(y, rate)
        moved = by_value @ J + by_rate @ (J_q @ at.v).T
        turned = np.einsum("jka,k->aj", J_q, self.law(y, rate))
        return ForceGradient(turned + J.T @ moved, J.T @ by_rate @ J, error * float(np.square(J).sum()))

    def kernel_forces(self) -> list[tuple[KernelRow, KernelForce]] | None:
        laws, rows = self.kernel_laws(), self.rows.kernel_rows(self._model)
        if laws is None or rows is None or any(row.form not in FORMS_OF_FORCES for row in rows):
            return None
        if any(law.stiffness and row.value[0] == Value.NONE for law, row in zip(laws, rows, strict=True)):
            return None
        if isinstance(self.rows, ConstantRows):
            rows = [row._replace(constant=line) for row, line in zip(rows, self.rows.matrix, strict=True)]
        return list(zip(rows, laws, strict=True))

    def kernel_laws(self) -> list[KernelForce] | None:
        """Law of each row, (k,); None for other laws."""
        return None

    def energy(self, y: np.ndarray) -> np.ndarray:
        """Potential energy (...) [J] at values (..., k)."""
        return np.zeros(y.shape[:-1])

    def potential(self, at: PositionKinematics) -> np.ndarray:
        return self.energy(self.rows.value(at)) if self.conservative else super().potential(at)


def check_entries(what: str, found: np.ndarray, wanted: np.ndarray, doubt: float, source: str, by: str = "") -> None:
    """Compare what a user gave with another result.

    Args:
        what: name of the quantity, for the message.
        found: entries that the user gave.
        wanted: the same from another source.
        doubt: estimated error of that source.
        source: name of the source, for the message.
        by: words behind the entry, such as " by q".

    Raises:
        ConstraintError: an entry differs by more than rounding and the error explain.
    """
    wrong = ~(np.abs(found - wanted) <= _WRONG * (1.0 + np.abs(wanted).max(initial=0.0)) + _DOUBT * doubt)
    if wrong.any():
        at = tuple(np.argwhere(wrong)[0])
        entry = [int(k) for k in at]
        raise ConstraintError(f"{what}: entry {entry}{by} is {found[at]:.6g}, {source} gives {wanted[at]:.6g}")
