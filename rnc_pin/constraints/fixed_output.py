"""Output that keeps its value: a welded joint, a hand that holds on to a wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConstraintError
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.kernel_rows import KernelRow
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.mechanisms import Phrases
from rnc_pin.model.rows import ConstantRows, OutputKind, OutputRows, Rows
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
