"""Constant force and torque on a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rnc_pin.errors import InputError
from rnc_pin.math.linear_algebra import apply_transposed
from rnc_pin.model.kernel_rows import Form, KernelForce, KernelRow, attached
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES, VelocityKinematics
from rnc_pin.model.parameter_types import Vector
from rnc_pin.model.passive_forces import ForceGradient, PassiveForce
from rnc_pin.robots.robot import Robot


@dataclass(frozen=True)
class Wrench:
    """Constant force at a frame's origin and torque on its body, along world axes or the frame's own axes.

    Its work counts as work done on the system. With own axes it moves with the body, like a thruster.

    Args:
        frame: name of the frame.
        force: components along x, y and z [N].
        torque: components about x, y and z [N m].
        axes: "world" or "own".

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> wind = rnc.forces.Wrench("sleigh", force=(2.0, 0.0, 0.0))
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], forces=[wind]).reduce()
        >>> reduced.at(robot.configuration(), np.zeros(2)).passive_force
        array([2., 0., 0.])
    """

    frame: str
    force: Vector = (0.0, 0.0, 0.0)
    torque: Vector = (0.0, 0.0, 0.0)
    axes: Literal["world", "own"] = "world"

    def bind(self, robot: Robot) -> PassiveForce:
        return _Wrench(self, robot)


class _Wrench(PassiveForce):
    def __init__(self, kind: Wrench, robot: Robot) -> None:
        self.name = f"wrench({kind.frame})"
        self._frame = robot.frame_id(kind.frame)
        parts = [np.asarray(each, dtype=float) for each in (kind.force, kind.torque)]
        if any(each.shape != (3,) or not np.isfinite(each).all() for each in parts):
            raise InputError(f"{self.name}: expected three finite components of force and of torque")
        if kind.axes not in ("world", "own"):
            raise InputError(f"{self.name}: axes '{kind.axes}': expected 'world' or 'own'")
        self._model, self._axes = robot.model, OWN_AXES if kind.axes == "own" else WORLD_AXES
        self._wrench = np.concatenate(parts)

    def force(self, at: VelocityKinematics) -> np.ndarray:
        return apply_transposed(
            at.jacobian(self._frame, self._axes), np.broadcast_to(self._wrench, (*at.v.shape[:-1], 6))
        )

    def kernel_forces(self) -> list[tuple[KernelRow, KernelForce]]:
        form = Form.OWN if self._axes == OWN_AXES else Form.WORLD
        row = KernelRow(form, (attached(self._model, self._frame),), (), self._wrench.tolist())
        return [(row, KernelForce(constant=1.0))]

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        turned = np.einsum("jka,k->aj", along.jacobian_dot(self._frame, self._axes), self._wrench)
        return ForceGradient(turned, np.zeros_like(turned), 0.0)
