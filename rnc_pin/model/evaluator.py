"""The door to evaluators, which fill the arrays of an evaluation, first for q, then for v.

``ConfigurationEvaluation``, ``ReducedKinematics`` and ``StateEvaluation`` hold each formula once. A quantity that is
marked here takes the array that the evaluator has filled by this name, and else its formula. So NumPy needs to fill
nothing: see ``numpy_evaluator``. The compiled evaluator declines states inside itself: see ``compiled``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import NamedTuple, Protocol, TypeVar, cast

from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.math.linear_algebra import Component
from rnc_pin.model.cached_property import cached_property
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.printing import printed


@printed()
@dataclass(frozen=True)
class ReducedTerms:
    """All matrices of the reduced system at a state; batch axes lead."""

    R: Float[Array, "*batch nv r"]
    """Null-space basis, ``v = R v2 + b``."""
    R_dot: Float[Array, "*batch nv r"]
    H: Float[Array, "*batch r r"]
    """Reduced inertia matrix."""
    V: Float[Array, "*batch r r"]
    """Reduced Coriolis matrix, with ``Hdot = V + V^T``."""
    G: Float[Array, "*batch r"]
    """Reduced gravity forces; affine constraints add forces of the motion b: ``R^T (g* + H* b_dot + C* b)``."""
    input_matrix: Float[Array, "*batch r p"]
    """``R^T B``, so that ``F = input_matrix @ T``."""
    A: Float[Array, "*batch m nv"]
    """Independent constraint rows."""
    A_dot: Float[Array, "*batch m nv"]
    A_star: Float[Array, "*batch k r"]
    """Kinematics of the vertical outputs, ``x1dot = A_star v2 + J1 b``."""
    A_star_dot: Float[Array, "*batch k r"]
    v: Float[Array, "*batch nv"]
    """Full velocity ``R v2 + b``."""
    b: Float[Array, "*batch nv"]
    """Velocity at ``v2 = 0``: zero unless constraints are affine."""
    b_dot: Float[Array, "*batch nv"]


@printed()
@dataclass(frozen=True)
class LagrangianTerms:
    """Matrices of the system before reduction, paper (1)."""

    H: Float[Array, "*batch nv nv"]
    C: Float[Array, "*batch nv nv"]
    g: Float[Array, "*batch nv"]
    B: Float[Array, "*batch nv p"]


@printed()
@dataclass(frozen=True)
class ReducedRegressor:
    """Columns of the reduced dynamics ``F = matrix @ p`` at states, for parameters p of the bodies.

    The multipliers of all constraints are absent, because ``A R = 0``: those of wheels and of closed loops alike.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> reduced = rnc.NonholonomicSystem(robot, (), robot.joint_names[1:]).reduce()
        >>> q, v2, v2_dot = robot.configuration({"joint_2": 1.0}), np.ones(4), np.zeros(4)
        >>> regressor = reduced.regressor(q, v2, v2_dot)
        >>> regressor.names[:2], regressor.matrix.shape
        (('m of platform', 'm x of platform'), (4, 40))
        >>> np.allclose(regressor.matrix @ regressor.parameters, reduced.inverse_dynamics(q, v2, v2_dot))
        True
    """

    matrix: Float[Array, "*batch r columns"]
    """Derivative of the reduced forces F with respect to the parameters."""
    names: tuple[str, ...]
    """Names of the columns: ten of each body, e.g. ``I_zz of joint_1``, then the motor inertias that the robot has.

    Moments are about the origin of the body's joint, in its axes. A motor inertia is Pinocchio's ``armature``.
    """
    parameters: Float[Array, " columns"]
    """Values of the parameters in the robot."""


@printed()
class StateDerivative(NamedTuple):
    """Time derivative of a state, with the power of all forces."""

    v: Array  # (..., nv), full velocity
    v2_dot: Array  # (..., r), reduced acceleration
    power: Array | float  # (...,), power of actuators, damping and moving constraints [W]


_Value = TypeVar("_Value")
_Method = TypeVar("_Method", bound=Callable[..., object])


class Configurations(Protocol):
    """Parts that evaluators read of an evaluation at configurations (..., nq) and times t (...)."""

    q: Array
    t: Component | None

    @property
    def position(self) -> PositionKinematics:
        """Kinematics at the configurations."""

    @property
    def mu(self) -> Array:
        """Right-hand side of the constraints (..., m)."""


class States(Configurations, Protocol):
    """Parts that evaluators read of an evaluation at states (..., nq), (..., nv)."""

    @property
    def v(self) -> Array:
        """Full velocities (..., nv)."""

    @property
    def motion(self) -> VelocityKinematics:
        """Kinematics at the states."""


class ArraysAtQ:
    """Arrays that an evaluator has filled for q; none here. Subclasses have attributes by the names of quantities."""

    def position_of(self, data: ReductionData, at: Configurations) -> PositionKinematics:
        """Kinematics at the configurations."""
        return data.kinematics.position(at.q, at.t)

    def output_values(self, data: ReductionData, at: Configurations) -> tuple[Array, Array]:
        """Values x1 (..., k) and x2 (..., r); zero for quasi-velocities."""
        return data.vertical.value(at.position), data.reducing.value(at.position)

    def allocated(self, at: Configurations, F: Array) -> Array | None:
        """Actuator inputs (..., p) for reduced forces (..., r), None without."""
        return None


class HasArraysAtQ(Protocol):
    """Evaluation whose arrays an evaluator has filled, or fills on first use."""

    @property
    def arrays_at_q(self) -> ArraysAtQ:
        """Arrays that the evaluator has filled for q."""


class ArraysAtV:
    """Arrays that an evaluator has filled for q and v; none here."""


class Evaluator(Protocol):
    """Source of the arrays of the evaluations in one reduction, ``data``; what it has filled is read-only."""

    data: ReductionData

    def fill_at_q(self, at: Configurations, same: HasArraysAtQ | None) -> ArraysAtQ:
        """Fill arrays for q, perhaps from those of the same configurations in another reduction."""

    def fill_at_v(self, at: States, filled: ArraysAtQ) -> ArraysAtV:
        """Fill arrays for v, from those for q."""


class _Filled(cached_property[_Value]):
    """Quantity of an evaluation: the array that an evaluator has filled by this name, or else a formula."""

    def __init__(self, formula: Callable[..., _Value], arrays: str) -> None:
        super().__init__(formula)
        self._arrays = arrays

    def __get__(self, owner: object | None, kind: type) -> object:  # type: ignore[override]  # as the base class
        if owner is None:
            return self
        value = getattr(getattr(owner, self._arrays), self._name, None)
        if value is None:
            value = self._compute(owner)
            if isinstance(value, Array):
                value.setflags(write=False)
        setattr(owner, self._name, value)
        return value


def filled_for_q(formula: Callable[..., _Value]) -> cached_property[_Value]:
    """Mark a quantity that depends on q."""
    return _Filled(formula, "arrays_at_q")


def filled_for_v(formula: Callable[..., _Value]) -> cached_property[_Value]:
    """Mark a quantity that depends on q and v."""
    return _Filled(formula, "arrays_at_v")


def solved_for_q(formula: _Method) -> _Method:
    """Mark a formula with one argument; the method of the arrays at q by this name comes first."""
    return _solved(formula, "arrays_at_q")


def solved_for_v(formula: _Method) -> _Method:
    """Mark a formula with one argument; the method of the arrays at q and v by this name comes first."""
    return _solved(formula, "arrays_at_v")


def _solved(formula: _Method, arrays: str) -> _Method:
    name = formula.__name__

    @wraps(formula)
    def call(owner: object, right: object) -> object:
        solve = getattr(getattr(owner, arrays), name, None)
        found = None if solve is None else solve(owner, right)
        return formula(owner, right) if found is None else found

    return cast(_Method, call)
