"""Forces on a robot beside those of outputs: a wrench on a frame, and a function of a user."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rnc_pin.errors import InputError
from rnc_pin.forces.output_forces import check_entries
from rnc_pin.math.linear_algebra import apply_transposed
from rnc_pin.model.kernel_rows import Form, KernelForce, KernelRow, attached
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES, VelocityKinematics, over_states
from rnc_pin.model.parameter_types import Vector
from rnc_pin.model.passive_forces import ForceGradient, PassiveForce
from rnc_pin.model.rows import admit_rows
from rnc_pin.model.user_functions import gradient_with_error, vector_gradient_with_error
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


Function = Callable[[np.ndarray, np.ndarray], np.ndarray]
Gradient = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class ForceFunction:
    """Generalized force ``f(q, v)`` of a user. Its work counts as work done on the system.

    Args:
        function: ``function(q, v) -> (nv,)``, in the order and axes of v.
        gradient: ``gradient(q, v)``, its derivatives (nv, nv) along the tangent space at q and by v; finite
            differences by default.
        name: name in messages.

    Raises:
        InputError: a function returns an array of wrong shape.
        ConstraintError: ``gradient`` differs from differences at random states.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> drag = rnc.forces.ForceFunction(lambda q, v: -0.1 * np.abs(v) * v, name="drag")
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names, forces=[drag]).reduce()
        >>> reduced.at(robot.configuration(), np.array([0.0, 0.0, 2.0, 0.0])).passive_force.round(3)
        array([ 0. ,  0. , -0.4,  0. ])
    """

    function: Function
    gradient: Gradient | None = None
    name: str = "force_function"

    def bind(self, robot: Robot) -> PassiveForce:
        return _ForceFunction(self, robot)


class _ForceFunction(PassiveForce):
    def __init__(self, kind: ForceFunction, robot: Robot) -> None:
        self.name, self._kind, self._model, self._nv = kind.name, kind, robot.model, robot.nv
        generator = np.random.default_rng(0)
        for _ in range(2):
            q, v = robot.random_configuration(generator, 1.0), generator.uniform(0.1, 1.0, robot.nv)
            self._one(q, v)
            if kind.gradient is not None:
                *given, _ = self._given(q, v)
                *expected, doubt = self._differences(q, v)
                for by, found, wanted in zip(("q", "v"), given, expected, strict=True):
                    what = f"gradient(q, v) of {self.name}"
                    check_entries(what, found, wanted, doubt, "a difference", f" by {by}")

    def _one(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return admit_rows(self._kind.function(q, v), (self._nv,), f"function(q, v) of {self.name}")

    def force(self, at: VelocityKinematics) -> np.ndarray:
        return over_states(self._one, (self._nv,), at.q, at.v)

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        return self._given(at.q, at.v) if self._kind.gradient is not None else self._differences(at.q, at.v)

    def _given(self, q: np.ndarray, v: np.ndarray) -> ForceGradient:
        assert self._kind.gradient is not None
        by_q, by_v = self._kind.gradient(q, v)
        shape, what = (self._nv, self._nv), f"gradient(q, v) of {self.name}"
        return ForceGradient(admit_rows(by_q, shape, what), admit_rows(by_v, shape, what), 0.0)

    def _differences(self, q: np.ndarray, v: np.ndarray) -> ForceGradient:
        by_q, one = gradient_with_error(self._model, lambda p: self._one(p, v), q)
        by_v, other = vector_gradient_with_error(lambda w: self._one(q, w), v)
        return ForceGradient(by_q, by_v, max(one, other))
