"""Forces conjugate to outputs: ``f = J^T u(y, ydot)`` with the value y, the rate ``ydot = J v`` and a law u."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConstraintError, InputError
from rnc_pin.math.linear_algebra import apply, apply_transposed
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.kernel_rows import FORMS_OF_FORCES, KernelForce, KernelRow, Value
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics, over_states
from rnc_pin.model.parameter_types import Numbers, Positive
from rnc_pin.model.passive_forces import ForceGradient, PassiveForce, admit_coefficients
from rnc_pin.model.rows import ConstantRows, OutputKind, admit_rows
from rnc_pin.model.user_functions import vector_gradient_with_error
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


# ------------------------------------------------------------------ kinds


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
        return _Element("spring", self.output, robot, stiffness=self.stiffness, rest=self.rest)


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
        return _Element("damper", self.output, robot, damping=self.damping)


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
        return _Element("friction", self.output, robot, self.speed, limit=self.limit)


class _Element(OutputForceLaw):
    """``stiffness (rest - y) - damping ydot - limit tanh(ydot / speed)``, as of the kernel's ``KernelForce``."""

    def __init__(
        self, word: str, output: OutputKind, robot: Robot, speed: float = 1.0, **given: float | Numbers
    ) -> None:
        super().__init__(word, output, robot)
        rows, size = self.rows, len(self.rows.names)
        self.conservative = "stiffness" in given
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

    def law(self, y: np.ndarray, rate: np.ndarray) -> np.ndarray:
        spring = self._stiffness * self._coordinates.difference(self._rest, y)
        return spring - self._damping * rate - self._limit * np.tanh(rate / self._speed)

    def slopes(self, y: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        friction = self._limit / self._speed * (1.0 - np.square(np.tanh(rate / self._speed)))
        return -np.diag(self._stiffness), -np.diag(self._damping + friction), 0.0

    def kernel_laws(self) -> list[KernelForce]:
        turns = self._coordinates.kinds * self.conservative
        columns = self._stiffness, self._rest, turns, self._damping, self._limit
        return [KernelForce._make([0.0, *row, self._speed]) for row in np.stack(columns, axis=1).tolist()]

    def energy(self, y: np.ndarray) -> np.ndarray:
        return 0.5 * (self._stiffness * np.square(self._coordinates.difference(self._rest, y))).sum(axis=-1)


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
