"""Forces that follow from the state: springs, dampers, friction, wrenches, functions of a user."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rnc_pin._kernel.kernel_rows import FORMS_OF_FORCES, Form, KernelForce, KernelRow, Value, attached
from rnc_pin.errors import ConstraintError, InputError
from rnc_pin.math.linear_algebra import apply, apply_transposed
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.frame_rows import triple
from rnc_pin.model.generalized_forces import ForceGradient, PassiveForce, admit_coefficients
from rnc_pin.model.input_validation import Numbers, Positive, Vector
from rnc_pin.model.kinematics import OWN_AXES, WORLD_AXES, PositionKinematics, VelocityKinematics
from rnc_pin.model.rows import OutputKind
from rnc_pin.model.user_functions import UserFunction, gradient_with_error, slopes_with_error
from rnc_pin.robots.robot import Robot

__all__ = ["Damper", "ForceFunction", "SmoothFriction", "Spring", "Wrench"]


@dataclass(frozen=True)
class Spring:
    """Linear spring: force ``-stiffness (y - rest)`` conjugate to an output y.

    On a ``JointPosition`` it is a joint spring, such as in an elastic joint; on a ``Distance`` a spring between
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
        return _OutputForce("spring", self.output, robot, stiffness=self.stiffness, rest=self.rest)


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
        return _OutputForce("damper", self.output, robot, damping=self.damping)


@dataclass(frozen=True)
class SmoothFriction:
    """Coulomb friction without stiction: force ``-limit tanh(ydot / speed)`` conjugate to the rate of an output.

    ``ReducedPlant(joint_friction=True)`` has friction with stiction, without derivatives.

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
        return _OutputForce("friction", self.output, robot, self.speed, limit=self.limit)


class _OutputForce(PassiveForce):
    """Force ``f = J^T u(y, ydot)`` conjugate to an output y with the rate ``ydot = J v``, and

        u = stiffness (rest - y) - damping ydot - limit tanh(ydot / speed),

    as of the kernel's ``KernelForce``.
    """

    def __init__(
        self, word: str, output: OutputKind, robot: Robot, speed: float = 1.0, **given: float | Numbers
    ) -> None:
        self._model, self._rows = robot.model, output.bind(robot)
        rows, size = self._rows, len(self._rows.names)
        self.name = f"{word}({', '.join(rows.names)})"
        self.generalized = rows.generalized
        self.conservative = "stiffness" in given
        # A stretch needs a value, and of three angles in turn the force would not be the gradient of its square.
        if self.conservative and (rows.quasi or rows.rotation):
            what = "a quasi-velocity, which has no value" if rows.quasi else "an orientation"
            raise ConstraintError(f"{self.name}: the output is {what}: use an angle, a position or a distance")
        if not 0 < speed < np.inf:
            raise InputError(f"{self.name}: speed {speed!r}: expected a positive number")
        self._stiffness, self._rest, self._damping, self._limit = (
            admit_coefficients(given.get(name, 0.0), size, f"{self.name}: {name}")
            for name in ("stiffness", "rest", "damping", "limit")
        )
        self._speed, self._coordinates = float(speed), Coordinates(rows.angular)

    def _law(self, y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Forces u (..., k) for values and rates (..., k)."""
        # Angles are compared modulo a turn: a spring on a wheel pulls the shorter way.
        spring = self._stiffness * self._coordinates.difference(self._rest, y)
        return spring - self._damping * rate - self._limit * np.tanh(rate / self._speed)

    def force(self, at: VelocityKinematics) -> np.ndarray:
        # Virtual work: the force conjugate to y acts on v as J^T u.
        J = self._rows.jacobian(at)
        return apply_transposed(J, self._law(self._rows.value(at), apply(J, at.v)))

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        J, J_q = self._rows.jacobian(at), self._rows.jacobian_dot(along)  # (nv, k, nv); first index: the direction
        y, rate = self._rows.value(at), J @ at.v
        # Slope of limit tanh(rate / speed), largest at rest.
        friction = self._limit / self._speed * (1.0 - np.square(np.tanh(rate / self._speed)))
        # Derivatives of u by the rate and by y; J_q @ v is the change of the rate with the configuration.
        by_rate = -np.diag(self._damping + friction)
        moved = by_rate @ (J_q @ at.v).T - self._stiffness[:, None] * J
        turned = np.einsum("jka,k->aj", J_q, self._law(y, rate))
        return ForceGradient(turned + J.T @ moved, J.T @ by_rate @ J, 0.0)

    def kernel_forces(self) -> list[tuple[KernelRow, KernelForce]] | None:
        rows = self._rows.kernel_rows(self._model)
        # Momenta and steering linkages are rows of constraints only: the kernel has no forces along them.
        if rows is None or any(row.form not in FORMS_OF_FORCES for row in rows):
            return None
        # Only a spring compares values; a damper on a wrapped angle needs no turns.
        turns = self._coordinates.angular & self.conservative
        columns = np.stack([self._stiffness, self._rest, turns, self._damping, self._limit], axis=1).tolist()
        laws = [KernelForce._make([0.0, *row, self._speed]) for row in columns]
        # The kernel has values of some outputs only. NumPy evaluates a spring on the others.
        if any(law.stiffness and row.value[0] == Value.NONE for law, row in zip(laws, rows, strict=True)):
            return None
        return list(zip(rows, laws, strict=True))

    def potential(self, at: PositionKinematics) -> np.ndarray:
        if not self.conservative:
            return super().potential(at)
        # The same wrapped stretch as in the force, or energy would jump where the force does not.
        stretch = self._coordinates.difference(self._rest, self._rows.value(at))
        return 0.5 * (self._stiffness * np.square(stretch)).sum(axis=-1)


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
        # A force of NaN would end a run far from here, as a divergence of the motion.
        parts = triple(kind.force, f"{self.name}: force"), triple(kind.torque, f"{self.name}: torque")
        if kind.axes not in ("world", "own"):
            raise InputError(f"{self.name}: axes '{kind.axes}': expected 'world' or 'own'")
        self._model, self._axes = robot.model, OWN_AXES if kind.axes == "own" else WORLD_AXES
        self._wrench = np.concatenate(parts)

    def force(self, at: VelocityKinematics) -> np.ndarray:
        wrenches = np.broadcast_to(self._wrench, (*at.v.shape[:-1], 6))
        return apply_transposed(at.jacobian(self._frame, self._axes), wrenches)

    def kernel_forces(self) -> list[tuple[KernelRow, KernelForce]]:
        form = Form.OWN if self._axes == OWN_AXES else Form.WORLD
        row = KernelRow(form, (attached(self._model, self._frame),), (), self._wrench.tolist())
        return [(row, KernelForce(constant=1.0))]

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        # Rates along unit velocities are the partial derivatives of J: the wrench is constant, J^T w turns.
        turned = np.einsum("jka,k->aj", along.jacobian_dot(self._frame, self._axes), self._wrench)
        return ForceGradient(turned, np.zeros_like(turned), 0.0)


@dataclass(frozen=True)
class ForceFunction:
    """Generalized force ``f(q, v)`` of a user: a nonlinear spring, an aerodynamic drag, a magnet.

    Its work counts as work done on the system, and its derivatives are finite differences. On a planar base it leaves
    the loads of wheels unknown, because f has no vertical force there.

    Args:
        function: ``function(q, v) -> (nv,)``, in the order and axes of v.
        name: name in messages.

    Raises:
        InputError: the function returns an array of wrong shape.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> drag = rnc.forces.ForceFunction(lambda q, v: -0.1 * np.abs(v) * v, name="drag")
        >>> reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names, forces=[drag]).reduce()
        >>> reduced.at(robot.configuration(), np.array([0.0, 0.0, 2.0, 0.0])).passive_force.round(3)
        array([ 0. ,  0. , -0.4,  0. ])
    """

    function: Callable[[np.ndarray, np.ndarray], np.ndarray]
    name: str = "force_function"

    def bind(self, robot: Robot) -> PassiveForce:
        return _ForceFunction(self, robot)


class _ForceFunction(PassiveForce):
    generalized = True

    def __init__(self, kind: ForceFunction, robot: Robot) -> None:
        self.name, self._model = kind.name, robot.model
        self._function = UserFunction(kind.function, (robot.nv,), f"function(q, v) of {self.name}")
        self._function(robot.configuration(), np.zeros(robot.nv))  # its shape

    def force(self, at: VelocityKinematics) -> np.ndarray:
        return self._function.over(at.q, at.v)

    def gradient(self, at: VelocityKinematics, along: VelocityKinematics) -> ForceGradient:
        # A function of the user has no closed form: differences, with an estimate of their error.
        by_q, one = gradient_with_error(self._model, lambda p: self._function(p, at.v), at.q)
        by_v, other = slopes_with_error(lambda by: self._function(at.q, at.v + by), len(at.v))
        return ForceGradient(by_q, by_v, max(one, other))
