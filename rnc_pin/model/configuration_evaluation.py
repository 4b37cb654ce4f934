"""Evaluation of a reduced model at configurations: everything that depends on q alone.

With the square stack ``E = [A; J2]`` of constraint rows and reducing outputs,

    R = E^-1 [0; I],   H = R^T H* R,   v = R v2 + b,   b = E^-1 [mu; 0].

Paper (2)-(3), (6)-(7). All quantities have leading batch axes. Without a compiled kernel, and if it declines one state
of the evaluation, the formulas below give all quantities. Else those with ``filled_at_q`` are arrays of the kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConstraintError, DivergenceError, InputError, SingularityError
from rnc_pin.math.linear_algebra import Component, apply, apply_transposed, inverse, product, weakest_rows
from rnc_pin.model.cached_property import cached_property, filled_at_q
from rnc_pin.model.factorization import Factorization, factorize, row_lengths
from rnc_pin.model.filled_arrays import CompiledArraysAtQ, arrays_at_q
from rnc_pin.model.input_validation import ArrayInput, vector
from rnc_pin.model.kinematics import KnownKinematics, PositionKinematics
from rnc_pin.model.reduction_data import ReductionData
from rnc_pin.model.reduction_kernel import ReductionKernel
from rnc_pin.model.rows import RowStack, rheonomic_names
from rnc_pin.printing import ObjectSummary, SummaryMixin, counted, described


class ArraySource(Protocol):
    """Evaluator of one reduction, whose kernel fills arrays; formulas alone decide without one."""

    data: ReductionData
    kernel: ReductionKernel | None


class ConfigurationEvaluation(SummaryMixin):
    """Reduced model at configurations (..., nq). Each quantity is computed once, on first use, and is read-only.

    ``ReducedModel.at(q)`` returns one. It does not change when the model is evaluated at other states.

    Args:
        evaluator: evaluator of the model.
        q: admitted configurations (..., nq), which become read-only.
        same: evaluation of the same configurations, perhaps in another reduction, whose results are used.
        t: times (...) for rheonomic constraints [s]; None for other constraints.

    Raises:
        InputError: the rows of the constraints depend on time, and t is missing.
        SingularityError: of every quantity that needs R: the outputs do not parametrise the motion at q.
        DivergenceError: of every quantity that needs R: a row is not finite at q.
    """

    def __init__(
        self, evaluator: ArraySource, q: Array, same: ConfigurationEvaluation | None = None, t: Component | None = None
    ) -> None:
        if same is None:
            # Without a time, rows that turn over time would silently be those of time zero.
            if t is None and evaluator.data.turning:
                raise no_time(evaluator.data)
            if q.ndim > 1:
                q = np.ascontiguousarray(q)  # the kernel walks through states in memory
            q.setflags(write=False)
        self._evaluator, self._data, self.q, self._same_q, self.t = evaluator, evaluator.data, q, same, t
        # Of the same reduction, arrays and factors are equal; of another one, only the kinematics are.
        self._same_reduction = same if same is not None and same._evaluator is evaluator else None

    _of_velocity: ClassVar[set[str]] = set()  # names of subclasses that need one

    def __init_subclass__(cls) -> None:
        ConfigurationEvaluation._of_velocity |= vars(cls).keys()

    def __getstate__(self) -> dict[str, object]:  # the kernel's memory is filled again
        return {name: value for name, value in vars(self).items() if not name.startswith("arrays_at_")}

    def _summary(self) -> ObjectSummary:
        states = counted(prod(self.q.shape[:-1]), "state")
        title = f"{type(self).__name__} of '{self._data.robot.name}' at {states}"
        return ObjectSummary(title, [("q [rad or m]", described(self.q))])

    def in_reduction(self, evaluator: ArraySource) -> ConfigurationEvaluation:
        """The same configurations in another reduction of the same system.

        Args:
            evaluator: evaluator of the other reduction.
        """
        return ConfigurationEvaluation(evaluator, self.q, self, self.t)

    @cached_property
    def position(self) -> PositionKinematics:
        """Kinematics at the configurations."""
        if self._same_q is not None:
            return self._same_q.position
        # Rows that Python evaluates need the kinematics before the kernel fills arrays.
        filled: CompiledArraysAtQ | None = vars(self).get("arrays_at_q")
        kinematics = self._data.kinematics
        if filled is None or self.batch:
            # Of many configurations, Pinocchio's loop stores all quantities at once.
            return kinematics.position(self.q, self.t)
        return KnownKinematics(kinematics, self.q, kinematics.time_of(self.t), filled.kinematics)

    @cached_property
    def arrays_at_q(self) -> CompiledArraysAtQ | None:
        """Arrays that the compiled kernel has filled for q; None if there is no kernel, or if it declined a state."""
        if self._same_reduction is not None:
            return self._same_reduction.arrays_at_q
        if (kernel := self._evaluator.kernel) is None:
            return None
        # Rows of a user are evaluated by Python, whatever fills the rest.
        position = self.position if kernel.python_rows else None
        return arrays_at_q(kernel, self.q, position, None if self._same_q is None else self._same_q.arrays_at_q)

    @property
    def compiled_kinematics(self) -> Array | None:
        """Kinematics at q, as the compiled kernel has filled them; None if it has filled none."""
        return None if self.arrays_at_q is None else self.arrays_at_q.kinematics

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> None:
            # A quantity of a subclass exists, but not here: the remedy is a velocity, and not another name.
            if name in ConfigurationEvaluation._of_velocity:
                raise InputError(f"'{name}' needs a velocity: use at(q, v2), or at(q, v=v) with a measured velocity")
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")

    def _check_time(self) -> None:
        """Raise an error for a quantity that needs the time of rheonomic constraints, if it is unknown."""
        if self.t is None and self._data.rheonomic:
            raise no_time(self._data)

    @property
    def batch(self) -> tuple[int, ...]:
        """Leading axes."""
        return self.q.shape[:-1]

    # ------------------------------------------------------------------ matrices

    @filled_at_q
    def M(self) -> Float[Array, "*batch nv nv"]:
        """Inertia matrix H* before reduction."""
        return self.position.M

    @cached_property
    def B(self) -> Float[Array, "*batch nv p"]:
        """Actuation matrix: generalized force ``B T``."""
        constant = self._data.actuation.constant
        if constant is None:
            return self.varying_B
        return np.broadcast_to(constant, (*self.batch, *constant.shape)) if self.batch else constant

    @filled_at_q
    def varying_B(self) -> Float[Array, "*batch nv p"]:
        """Actuation matrix of actuators whose effect depends on q."""
        return self._data.actuation.matrix(self.position)

    @cached_property
    def all_rows(self) -> Float[Array, "*batch k nv"]:
        """All constraint rows, dropped ones included."""
        return self._data.rows.jacobian(self.position)

    @filled_at_q
    def factorization(self) -> Factorization:
        """Matrix E, its inverse and the constraint rows in it."""
        if self._same_reduction is not None:
            return self._same_reduction.factorization
        return factorize(self._data, self.position)

    @filled_at_q
    def E(self) -> Float[Array, "*batch nv nv"]:
        """Stack ``E = [A; J2]`` of constraint rows and reducing outputs; defined at singular configurations too."""
        return self.factorization.E

    @filled_at_q
    def E_inverse(self) -> Float[Array, "*batch nv nv"]:
        """Inverse ``E^-1``: the columns of the multipliers, then R."""
        found = self.factorization
        if found.regular is not True and not np.all(found.regular):
            raise self._singularity(np.asarray(found.regular))
        return found.E_inverse

    @cached_property
    def A(self) -> Float[Array, "*batch m nv"]:
        """Independent constraint rows."""
        return self.E[..., : self._data.m, :]

    @cached_property
    def J2(self) -> Float[Array, "*batch r nv"]:
        """Jacobian of the reducing outputs: ``v2 = J2 v``."""
        return self.E[..., self._data.m :, :]

    @filled_at_q
    def J1(self) -> Float[Array, "*batch k nv"]:
        """Jacobian of the vertical outputs."""
        return self._data.vertical.jacobian(self.position)

    @cached_property
    def R(self) -> Float[Array, "*batch nv r"]:
        """Null-space basis of A, ``v = R v2 + b``."""
        return self.E_inverse[..., self._data.m :]

    @filled_at_q
    def A_star(self) -> Float[Array, "*batch k r"]:
        """Kinematics of the vertical outputs, ``x1dot = A_star v2 + J1 b``."""
        return self.J1 @ self.R

    @cached_property
    def input_matrix(self) -> Float[Array, "*batch r p"]:
        """``R^T B``: reduced force for unit actuator inputs."""
        return product(self.R.mT, self.B)

    @filled_at_q
    def H(self) -> Float[Array, "*batch r r"]:
        """Reduced inertia matrix ``R^T H* R``."""
        R = self.R
        # Paper (2): v = R v2 has the kinetic energy v2^T R^T H* R v2 / 2.
        return product(R.mT, product(self.M, R))

    @cached_property
    def mu(self) -> Float[Array, "*batch m"]:
        """Right-hand side of the constraints, ``A v = mu``."""
        self._check_time()
        return self._of_kept_rows(lambda rows: rows.rate(self.position))

    def _of_kept_rows(self, of: Callable[[RowStack], Array]) -> Array:
        """Quantity (..., m) or (..., m, nv) of the rows in A: at some states, other rows than the default form A."""
        if self.factorization.kept is None:
            return of(self._data.constraints)
        found, kept = of(self._data.rows), self.kept
        return np.take_along_axis(found, kept if found.ndim == kept.ndim else kept[..., None], axis=kept.ndim - 1)

    @cached_property
    def b(self) -> Float[Array, "*batch nv"]:
        """Velocity at ``v2 = 0``: zero unless constraints are affine."""
        if not self._data.affine:
            return np.zeros((*self.batch, self._data.n))
        # E v = [mu; v2] at v2 = 0.
        return apply(self.E_inverse[..., : self._data.m], self.mu)

    # ------------------------------------------------------------------ rows and regularity

    @cached_property
    def kept(self) -> Array:
        """Indices of the constraint rows in A for each state, (..., m)."""
        found, default = self.factorization.kept, np.array(self._data.kept, dtype=int)
        return np.broadcast_to(default, (*self.batch, self._data.m)) if found is None else found

    @property
    def regular(self) -> Array:
        """True at states where the outputs parametrise the motion, (...,)."""
        return np.asarray(self.factorization.regular)

    @cached_property
    def scaled_stack(self) -> Float[Array, "*batch nv nv"]:
        """E with rows divided by the larger of their length and their typical length at other configurations."""
        # A row that vanishes here is short beside its typical length: divided by its own it would look regular. NaN is
        # left out.
        typical = row_lengths(self._data, self.factorization.kept, self.batch)
        lengths = np.fmax(np.linalg.norm(self.E, axis=-1), typical)
        return self.E / np.where(lengths > 0, lengths, 1.0)[..., None]

    @cached_property
    def _singular_values(self) -> Array:
        return np.linalg.svd(self.scaled_stack, compute_uv=False)

    @cached_property
    def condition(self) -> Array | float:
        """Condition number (...) of E with scaled rows; defined at singular configurations too."""
        values = self._singular_values
        with np.errstate(divide="ignore"):
            return values[..., 0] / values[..., -1]

    @cached_property
    def smallest_singular_value(self) -> Array | float:
        """Smallest singular value (...) of E with scaled rows; zero at a singular configuration."""
        return self._singular_values[..., -1]

    # ------------------------------------------------------------------ outputs and inputs

    def outputs(self, integrals: ArrayInput | None = None) -> tuple[Array, Array]:
        """Values x1 (..., k) and x2 (..., r); quasi-velocities take the given integrals, else zero.

        Args:
            integrals: integrals of v2 over time (..., r) [rad or m].
        """
        x1, x2 = self._values
        quasi = self._data.reducing.quasi
        if integrals is not None and self._data.reducing.has_quasi:
            # The values are kept and read-only, as all quantities are.
            x2 = x2.copy()
            x2[..., quasi] = vector(integrals, self._data.r, "integrals")[..., quasi]
        return x1, x2

    @cached_property
    def _values(self) -> tuple[Array, Array]:
        data, filled = self._data, self.arrays_at_q
        if filled is None:
            values = data.vertical.value(self.position), data.reducing.value(self.position)
        else:
            values = filled.output_values(self.position if any(filled.kernel.python_values) else None)
        for each in values:
            each.setflags(write=False)
        return values

    def velocity(self, v2: Array) -> Float[Array, "*batch nv"]:
        """Full velocity ``R v2 + b`` for reduced velocities (..., r).

        Args:
            v2: reduced velocities (..., r) [rad/s or m/s].
        """
        # The kernel takes one velocity for each configuration; NumPy broadcasts all others.
        if self.arrays_at_q is not None and v2.shape[:-1] == self.batch:
            return self.arrays_at_q.velocity(v2, self.mu if self._data.affine else None)
        v = apply(self.R, v2)
        return v + self.b if self._data.affine else v

    def allocate(self, F: ArrayInput) -> Float[Array, "*batch p"]:
        """Actuator inputs T with ``R^T B T = F``; those of least norm if they are not unique.

        Args:
            F: reduced forces (..., r) [N or N m].

        Raises:
            ConstraintError: the actuators cannot produce every F (rank of ``R^T B`` below r).
        """
        return self.allocated(vector(F, self._data.r, "F"))

    def allocated(self, F: Array) -> Float[Array, "*batch p"]:
        """As ``allocate``, for an array (..., r).

        Args:
            F: reduced forces (..., r), valid [N or N m].
        """
        if self.arrays_at_q is not None and (filled := self.arrays_at_q.allocated(F)) is not None:
            return filled
        data = self._data
        matrix = self.input_matrix
        if data.p == data.r:
            # As many actuators as velocities: the inputs are unique unless the actuators depend on each other.
            inverted = inverse(matrix)
            # This bound on the amplification of rounding does not depend on the units of the inputs.
            amplified = 1e10
            if np.isfinite(inverted).all() and product(np.abs(matrix), np.abs(inverted)).max(initial=0.0) < amplified:
                return apply(inverted, F)
        # The pseudoinverse gives the inputs of least norm where there are more than necessary.
        left, values, right = np.linalg.svd(matrix, full_matrices=False)
        least = 1e-10  # share of the largest singular value up to which one counts as zero
        above = values > least * values.max(axis=-1, keepdims=True, initial=0.0)
        rank = int(above.sum(axis=-1).min(initial=data.r))
        if rank < data.r:
            raise ConstraintError(
                f"actuators {', '.join(data.actuation.names) or '(none)'} reach rank {rank} of the {data.r} "
                "reduced forces: not every F can be realised"
            )
        return apply_transposed(right, apply_transposed(left, F) / values)

    # ------------------------------------------------------------------ singular configurations

    def _singularity(self, regular: Array) -> SingularityError | DivergenceError:
        """Error for the first state that is not regular."""
        # One state explains the error: the first.
        first = np.unravel_index(int(np.argmin(regular)), regular.shape) if regular.ndim else ()
        finite = np.isfinite(self.E[first]).all(axis=1)
        if not finite.all():
            return DivergenceError(f"row '{self._names(first)[int(finite.argmin())]}' is not finite")
        values, rows = self._singular_values[first], self.dependent_rows(first)
        condition = float(values[0] / max(values[-1], 1e-300))
        return SingularityError("singular configuration", q=self.q[first].copy(), condition=condition, rows=rows)

    def dependent_rows(self, state: int | tuple[np.intp, ...] = ()) -> tuple[str, ...]:
        """Names of the rows of E that take part in its smallest singular value.

        Args:
            state: index of the state, for many states.
        """
        # Of scaled rows: in metres and radians the longest rows would decide, and not the dependent ones.
        return weakest_rows(self.scaled_stack[state], self._names(state))

    def _names(self, state: int | tuple[np.intp, ...]) -> tuple[str, ...]:
        return *(self._data.rows.names[row] for row in self.kept[state]), *self._data.reducing.names


def no_time(data: ReductionData) -> InputError:
    """Error for an evaluation without the time that the constraints need.

    Args:
        data: the reduction.
    """
    return InputError(
        f"{', '.join(rheonomic_names(data.rows))}: the constraints depend on time; give it, as in "
        "reduced.at(q, v2, t=0.0), or use the model at one time, reduced.frozen(t=0.0)"
    )
