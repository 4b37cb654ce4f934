"""The door to evaluators, which fill the arrays of an evaluation, first for q, then for v.

``ConfigurationEvaluation``, ``ReducedKinematics`` and ``StateEvaluation`` hold each formula once. The quantities below
are those that an evaluator may fill, and each formula begins with the array that it has filled. NumPy fills nothing:
see ``numpy_evaluator``. The compiled evaluator declines states inside itself: see ``compiled``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.math.linear_algebra import Component
from rnc_pin.model.factorization import Factorization
from rnc_pin.model.kinematics import PositionKinematics, VelocityKinematics
from rnc_pin.model.passive_forces import ForceSums
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


class RecordEntry:
    """Array of a record, by the name of the attribute; None without the record."""

    def __init__(self, record: str) -> None:
        self._record = record

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, owner: object, kind: type) -> Array | None:
        record: Array | None = getattr(owner, self._record)
        return None if record is None else record[self._name]


class ArraysAtQ:
    """Arrays that an evaluator has filled for q; None where the formula of ``ConfigurationEvaluation`` decides.

    NumPy's evaluator fills none. Records of the kernel have the fields of ``ReductionKernel``.
    """

    kinematics: Array | None = None
    inverse: Array | None = None

    @property
    def vertical(self) -> Array | None:
        """Record of J1 and A_star."""
        return None

    M = RecordEntry("kinematics")
    E, E_inverse = RecordEntry("inverse"), RecordEntry("inverse")
    J1, A_star = RecordEntry("vertical"), RecordEntry("vertical")

    @property
    def factorization(self) -> Factorization | None:
        """E and its inverse."""
        return None

    @property
    def H(self) -> Array | None:
        """Reduced inertia matrix (..., r, r)."""
        return None

    @property
    def varying_B(self) -> Array | None:
        """Actuation matrix (..., nv, p)."""
        return None

    def position_of(self, data: ReductionData, at: Configurations) -> PositionKinematics:
        """Kinematics at the configurations."""
        return data.kinematics.position(at.q, at.t)

    def output_values(self, data: ReductionData, at: Configurations) -> tuple[Array, Array]:
        """Values x1 (..., k) and x2 (..., r); zero for quasi-velocities."""
        return data.vertical.value(at.position), data.reducing.value(at.position)

    def velocity(self, at: Configurations, v2: Array) -> Array | None:
        """Full velocity (..., nv) for reduced velocities (..., r)."""
        return None

    def allocated(self, F: Array) -> Array | None:
        """Actuator inputs (..., p) for reduced forces (..., r)."""
        return None

    def output_slopes(self, along: Sequence[int] | Array) -> Array | None:
        """Rates (s, ..., k, r) of A_star in motions of single reducing outputs, by their indices (s,)."""
        return None


class HasArraysAtQ(Protocol):
    """Evaluation whose arrays an evaluator has filled, or fills on first use."""

    @property
    def arrays_at_q(self) -> ArraysAtQ:
        """Arrays that the evaluator has filled for q."""


class ArraysAtV:
    """Arrays that an evaluator has filled for q and v; None where the formula of ``StateEvaluation`` decides."""

    @property
    def biases(self) -> Array | None:
        """Record of the forces and accelerations at zero inputs."""
        return None

    @property
    def rates(self) -> Array | None:
        """Record of rates along v."""
        return None

    nonlinear_effects, gamma = RecordEntry("biases"), RecordEntry("biases")
    E_inverse_gamma, motion_force = RecordEntry("biases"), RecordEntry("biases")
    E_dot, R_dot = RecordEntry("rates"), RecordEntry("rates")
    J1_dot, A_star, A_star_dot = RecordEntry("rates"), RecordEntry("rates"), RecordEntry("rates")

    @property
    def row_velocities(self) -> Array | None:
        """Rates ``E v`` of the constraint rows and of the reducing outputs, (..., nv)."""
        return None

    @property
    def v1(self) -> Array | None:
        """Rates ``J1 v`` of the vertical outputs, (..., k)."""
        return None

    @property
    def passive_sums(self) -> ForceSums | None:
        """Sums of the passive forces."""
        return None

    def accelerated(self, force: Array) -> Array | None:
        """Reduced acceleration (..., r) under generalized forces (..., nv), passive ones included."""
        return None


class Evaluator(Protocol):
    """Source of the arrays of the evaluations in one reduction, ``data``; what it has filled is read-only."""

    data: ReductionData

    def fill_at_q(self, at: Configurations, same: HasArraysAtQ | None) -> ArraysAtQ:
        """Fill arrays for q, perhaps from those of the same configurations in another reduction."""

    def fill_at_v(self, at: States, filled: ArraysAtQ) -> ArraysAtV:
        """Fill arrays for v, from those for q."""
