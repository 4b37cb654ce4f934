"""Impacts: the jump of the velocity when constraints appear at a configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConstraintError, InputError, place_of
from rnc_pin.math.linear_algebra import apply, apply_transposed, solve_positive_definite
from rnc_pin.model.evaluator import evaluator_for
from rnc_pin.model.input_validation import ArrayInput, is_number, numbers_of
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.reduction_data import best_entries
from rnc_pin.model.rows import ConstraintKind, RowStack
from rnc_pin.model.state_evaluation import StateEvaluation, least_norm_forces
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin

Restitution = float | Mapping[str, float]
"""Newton's coefficient of restitution of all rows, or of rows by name (zero for the others)."""


@dataclass(frozen=True, repr=False)
class Impact(SummaryMixin):
    """Jump of the velocity at a configuration; its arrays are read-only.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])  # the blade drops on the ice
        >>> jump = rnc.impact(system, robot.configuration(), [1.0, 0.5, 0.0])
        >>> list(jump.impulses), jump.loss > 0
        (['no_side_slip(sleigh.y)'], True)
    """

    v_before: Float[Array, " nv"]
    """Velocity before the impact."""
    v: Float[Array, " nv"]
    """Velocity after the impact; it satisfies the constraints unless rows rebound."""
    impulses: Mapping[str, float]
    """Impulse of each constraint row on the robot [N s or N m s]; those of least norm if they are not unique.

    Momentum rows have none. The sign is that of the row's velocity, as that of ``contact_forces``.
    """
    energy_before: float
    """Kinetic energy before the impact [J]."""
    energy_after: float
    """Kinetic energy after the impact [J]."""

    @property
    def loss(self) -> float:
        """Lost kinetic energy [J]."""
        return self.energy_before - self.energy_after

    def __reduce__(self) -> tuple[object, ...]:
        return _read_only, (self.v_before, self.v, dict(self.impulses), self.energy_before, self.energy_after)

    def _summary(self) -> ObjectSummary:
        title = f"Impact: {self.loss:.4g} J of {self.energy_before:.4g} J are lost"
        impulses = [Item(name, f"{value:.4g}") for name, value in self.impulses.items()]
        return ObjectSummary(title, [("impulses [N s or N m s]", impulses)])


def impact(
    system: NonholonomicSystem | ReducedModel,
    q: ArrayInput,
    v: ArrayInput,
    restitution: Restitution = 0.0,
    t: float | None = None,
    appearing: Sequence[ConstraintKind] = (),
) -> Impact:
    """Velocity after constraints appear or vanish, with the impulses that cause the jump.

    Forces that stay finite have no effect during an impact. The constraints of the system act by impulses Lambda, and
    Newton's law of restitution gives the velocity of each row after the impact:

        H* (v+ - v-) = A^T Lambda,   A v+ = mu - e (A v- - mu).

    Rows that hold before the impact hold after it. Constraints that vanish change no velocity. Momentum rows have no
    impulse, so the velocity before the impact has to satisfy them.

    Args:
        system: system or reduced model with the constraints that hold after the impact.
        q: configuration (nq,); it has to satisfy the holonomic rows.
        v: velocity (nv,) before the impact.
        restitution: coefficient of all rows, or row name to coefficient, from 0 (no rebound) to 1 (elastic).
        t: time of rheonomic constraints [s].
        appearing: constraints that appear in addition to those of a system. They may stop it: a system itself has to
            leave some motion.

    Raises:
        InputError: wrong shapes, the configuration violates a holonomic row, or ``appearing`` with a reduced model.
        ConstraintError: an unknown row or a coefficient outside 0 to 1; coefficients of dependent rows contradict each
            other; coefficients that create energy; or the velocity before the impact violates a conserved momentum.
        SingularityError: the constraints lose rank at q.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")])
        >>> jump = rnc.impact(system, robot.configuration(), [1.0, 0.5, 0.2], restitution=1.0)
        >>> bool(abs(jump.loss) < 1e-12), jump.v_before.tolist()
        (True, [1.0, 0.5, 0.2])
    """
    if len(appearing):
        if not isinstance(system, NonholonomicSystem):
            raise InputError(f"appearing: expected a NonholonomicSystem before the impact, found {system!r}")
        system = system.with_constraints(appearing, may_stop=True)
    # Which velocities parametrise the motion does not matter: the jump is the same in all.
    reduced = system.reduce() if isinstance(system, NonholonomicSystem) else system
    reduced = reduced if t is None else reduced.frozen(t)
    state = _regular_state(reduced, q, v)
    rows, kept = reduced.all_constraints, state.kept
    coefficients, conserved = _coefficients(rows, restitution), rows.conserved_rows()
    mu = rows.rate(state.position)
    slip = apply(state.all_rows, state.v) - mu
    sizes = np.linalg.norm(state.all_rows, axis=-1) * np.linalg.norm(state.v)  # largest rates at this speed
    _check_momenta(rows, sizes, mu, slip, conserved)
    after = mu - coefficients * slip  # rates of all rows
    # Velocities are X A v + R w, with E^-1 = [X, R] in a reduction to entries w of v.
    X, R = state.E_inverse[:, : reduced.m], state.R
    fixed = apply(X, after[kept])
    # R^T M (v+ - v-) = 0: impulses of the rows have no component along motions that the rows allow.
    w = solve_positive_definite(state.H, apply_transposed(R, apply(state.M, state.v - fixed)))
    v_after = fixed + apply(R, w)
    _check_dependent(rows, sizes, apply(state.all_rows, v_after), after)
    M, rank = np.asarray(state.M), reduced.m - int(conserved[kept].sum())
    impulses = np.zeros(rows.size)
    impulses[~conserved] = least_norm_forces(state.all_rows[~conserved], apply(M, v_after - state.v), rank)
    reacting = zip(rows.names, impulses.tolist(), conserved.tolist(), strict=True)
    named = {name: impulse for name, impulse, is_conserved in reacting if not is_conserved}
    found = _read_only(state.v, v_after, named, *(float(0.5 * each @ M @ each) for each in (state.v, v_after)))
    rounding = 1e-9  # share of the kinetic energy
    # Rows that move do work on the robot: only beside rows at rest must the energy not grow.
    if not rows.affine and -found.loss > rounding * found.energy_before:
        raise ConstraintError(
            f"restitution: these coefficients create energy, {-found.loss:.3g} J of {found.energy_before:.3g} J: "
            "choose smaller coefficients, or the same for all rows"
        )
    return found


def _one(values: ArrayInput, name: str) -> Array:
    found = numbers_of(values, name)
    if found.ndim != 1:
        raise InputError(f"impact: expected one state, found {name} of shape {found.shape}")
    return found


def _read_only(v_before: Array, v: Array, impulses: dict[str, float], before: float, after: float) -> Impact:
    """Impact whose arrays and mapping cannot be changed."""
    for each in (v_before, v):
        each.setflags(write=False)
    return Impact(v_before, v, MappingProxyType(impulses), before, after)


def _regular_state(reduced: ReducedModel, q: ArrayInput, v: ArrayInput) -> StateEvaluation:
    """State in a reduction that is regular wherever the constraints have full rank."""
    state = reduced.at(_one(q, "q"), v=_one(v, "v"))
    rounding = 1e-4  # [m or rad]: numbers of a file have a few digits
    if np.abs(reduced.assembly.residual(state.q)).max(initial=0.0) > rounding:
        name, residual = reduced.assembly.worst(state.q)
        raise InputError(
            f"impact: the configuration violates {name} by {residual:.3g} [m or rad]: constraints appear only where "
            "they are satisfied; reduced.assembled(q) returns such a configuration"
        )
    # The given outputs may be singular at q although the constraints are not.
    data = reduced.reduction_data.in_entries(best_entries(state.A, reduced.r), free=True)
    return state.in_reduction(evaluator_for(data, reduced.evaluator))


def _coefficients(rows: RowStack, restitution: Restitution) -> Array:
    """Coefficient of each row, (k,)."""
    named = restitution if isinstance(restitution, Mapping) else dict.fromkeys(rows.names, restitution)
    for name, value in named.items():
        place_of(name, rows.names, "restitution: no constraint row", ConstraintError)
        if not (is_number(value) and 0.0 <= value <= 1.0):
            raise ConstraintError(f"restitution of row '{name}': expected a number from 0 to 1, found {value!r}")
    return np.array([float(named.get(name, 0.0)) for name in rows.names])


def _check_momenta(rows: RowStack, sizes: Array, mu: Array, slip: Array, conserved: Array) -> None:
    contradiction = 1e-6  # relative: less is the integration error of the motion before
    limits = contradiction * (sizes + np.abs(mu))
    for row in np.flatnonzero(conserved & (np.abs(slip) > limits)):
        raise ConstraintError(
            f"{rows.names[row]} is {mu[row] + slip[row]:.8g} before the impact, and the constraint requires "
            f"{mu[row]:.8g}: an impact does not change a conserved momentum"
        )


def _check_dependent(rows: RowStack, sizes: Array, rates: Array, wanted: Array) -> None:
    """Raise an error if a dependent row does not get its velocity."""
    rounded = 1e-4  # rows that depend on others to the rounding of a file's numbers differ by that rounding
    excess = np.abs(rates - wanted) - rounded * (sizes + np.abs(wanted))
    for row in np.flatnonzero(excess > 0)[:1]:
        raise ConstraintError(
            f"restitution: row '{rows.names[row]}' has to move at {wanted[row]:.4g} after the impact, the rows that it "
            f"depends on require {rates[row]:.4g}: give dependent rows the same coefficient"
        )
