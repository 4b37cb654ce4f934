"""Factorization of ``E = [A; J2]``; if the default constraint rows become dependent, other rows replace them.

R is the last r columns of ``E^-1``. A state is singular if E stays singular with the best rows: the outputs do not
parametrise the motion there. This is no error yet. ``ConfigurationEvaluation.E_inverse`` raises ``SingularityError``
for whoever needs R. Others raise it too: ``rows.check_defined`` at once for undefined rows, a control loop below its
``min_singular_value``, ``control.redundancy`` where A4 is singular, and ``control.slithering`` where the driven path
bends too tightly. The compiled kernel declines singular and doubtful states.

``simulation/sampled_run.complete_run`` tells how such a run ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.array_shapes import Array, Bool, Float, Int
from rnc_pin.math.linear_algebra import inverse, pivot_columns
from rnc_pin.model.kinematics import PositionKinematics
from rnc_pin.model.reduction_data import ReductionData, best_entries


class Factorization(NamedTuple):
    """Matrix E at states (...,), its inverse, and the mask of regular states."""

    E: Float[Array, "*batch nv nv"]
    E_inverse: Float[Array, "*batch nv nv"]
    """Not finite, or meaningless, at states where E is singular."""
    regular: Bool[Array, "*batch"] | bool
    kept: Int[Array, "*batch m"] | None = None
    """Indices of the constraint rows in A; None if all states have the default rows."""


def factorize(data: ReductionData, position: PositionKinematics) -> Factorization:
    """Evaluate E at configurations (..., nq) and invert it.

    Args:
        data: constraint rows, outputs and their scales.
        position: kinematics at the configurations.
    """
    batch = position.q.shape[:-1]
    # Constant rows are copied from the template, and only the others are evaluated.
    template = data.stack.template(data.n)
    E = np.array(np.broadcast_to(template, (*batch, *template.shape))) if batch else template.copy("F")
    data.stack.write_jacobian(position, E)
    # A singular E gives NaN here and no error: the test below decides.
    E_inverse = inverse(E)
    if not batch:
        # The product of the Frobenius norms bounds the dependence of every row: one cheap test on the hot path. Below
        # ``fast_limit`` the default rows are far from dependent, and nothing is asked again.
        rows, columns = E.ravel("K"), E_inverse.ravel("K")
        if (float(rows.dot(rows)) + data.fast_length) * float(columns.dot(columns)) < data.fast_limit:
            return Factorization(E, E_inverse, True)
    with np.errstate(invalid="ignore", over="ignore"):
        kept = None
        # Many states, or one that fails the cheap test: the dependence of each row by itself.
        worst = dependences(E, E_inverse, data.lengths).max(axis=-1)
        if data.has_alternatives:
            # Written so that NaN, of a row that is not finite, is in doubt too.
            doubtful = ~(worst**2 < data.fast_limit)
            kept = _reselect_rows(data, position, np.argwhere(doubtful), E, E_inverse)
            worst = dependences(E, E_inverse, row_lengths(data, kept, batch)).max(axis=-1)
    return Factorization(E, E_inverse, worst < data.singularity_limit, kept)


def constraint_rows(data: ReductionData, position: PositionKinematics) -> Float[Array, "m nv"]:
    """Independent constraint rows A at one configuration; the default rows where there are too few.

    Args:
        data: the reduction.
        position: kinematics at one configuration (nq,).
    """
    if data.rows.size == data.m:
        return data.constraints.jacobian(position)
    rows = data.rows.jacobian(position)
    kept = _best_rows(data, rows)
    return rows[list(data.kept) if kept is None else kept]


def row_lengths(data: ReductionData, kept: Array | None, batch: tuple[int, ...]) -> Float[Array, "*batch nv"]:
    """Typical length of each row of E at other configurations.

    Args:
        data: the reduction.
        kept: indices of the constraint rows in A (..., m); None for the default rows.
        batch: leading axes of the states.
    """
    if kept is None:
        return data.lengths
    outputs = np.broadcast_to(data.output_scales, (*batch, data.r))
    return np.concatenate([data.constraint_scales[kept], outputs], axis=-1)


def dependences(E: Array, E_inverse: Array, lengths: Array) -> Float[Array, "*batch nv"]:
    """One over the sine of the angle between each row and the span of the others.

    A row that vanishes depends on all of them. Therefore its typical length at other configurations is used.

    Args:
        E: rows (..., nv, nv).
        E_inverse: their inverse (..., nv, nv).
        lengths: typical lengths of the rows, (nv,) or (..., nv).
    """
    rows = np.linalg.norm(E, axis=-1)
    columns = np.linalg.norm(E_inverse, axis=-2)
    return np.fmax(rows, lengths) * columns


def _reselect_rows(
    data: ReductionData, position: PositionKinematics, states: Array, E: Array, E_inverse: Array
) -> Array | None:
    """Write the best rows into E and its inverse at some states (count, axes); return all rows kept, if any changed."""
    kept: Array | None = None
    default = np.array(data.kept, dtype=int)
    all_rows = data.rows.jacobian(position) if len(states) else np.zeros((*position.q.shape[:-1], 0, data.n))
    for index in states:
        i = tuple(index)
        chosen = _best_rows(data, all_rows[i])
        if chosen is None:
            continue
        if kept is None:
            kept = np.array(np.broadcast_to(default, (*position.q.shape[:-1], data.m)))
        kept[i] = chosen
        # The outputs stay, unless none was named: then the entries of v that suit the new rows best.
        rows, outputs = all_rows[i][chosen], E[i][data.m :]
        if data.free:
            outputs = np.eye(data.n)[best_entries(rows, data.r)]
        E[i] = np.vstack([rows, outputs])
        E_inverse[i] = inverse(np.asfortranarray(E[i]))
    return kept


def _best_rows(data: ReductionData, rows: Array) -> Int[Array, " m"] | None:
    """Indices of independent constraint rows (k, nv) of one state; None where there are too few."""
    if not np.isfinite(rows).all():
        return None
    # Beside their usual length: a row that happens to be short here is nearly dependent, and not just small.
    natural = np.fmax(np.linalg.norm(rows, axis=-1), data.constraint_scales)
    natural = np.where(data.constraint_scales > 0, natural, np.inf)[:, None]  # rows of typical length 0 are rounding
    # Pivoted QR of A^T takes the most independent rows first; rows count relative to their usual length.
    order, sizes = pivot_columns((rows / natural).T, data.m)
    # Both limits are those by which ``independence`` chooses the default rows.
    dependent = 1e-8  # sine of the angle below which constraint rows count as dependent
    if data.m and not sizes[-1] > dependent:
        return None  # the constraints themselves lose rank
    kept = np.array(data.kept, dtype=int)
    # Rows that change between neighbouring states make the multipliers jump: the default rows stay while they are well
    # independent, and others replace them only where they are not.
    well = 1e-3  # smallest singular value of unit rows
    if np.linalg.svd((rows / natural)[kept], compute_uv=False).min(initial=1.0) < well:
        kept = np.sort(order)
    return kept
