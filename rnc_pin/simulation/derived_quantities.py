"""Quantities of a run that follow from its states and inputs, in blocks of samples: forces, energy, residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.analysis import NormalForces
from rnc_pin.math.linear_algebra import apply, apply_transposed
from rnc_pin.model.cached_property import once_per_model
from rnc_pin.model.evaluator import Evaluator, evaluator_for
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.reduction_data import best_entries
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.simulation.ground_bodies import GroundBody, ground_poses

MATRICES = 8
"""Temporary (n, n) matrices for each sample."""
_BLOCK = 1000  # largest number of samples in a block
_ROOM = 16e6  # memory for the matrices of a block [bytes]
_MOST_REDUCTIONS = 16  # kept for each model


def blocks(samples: int, numbers: int) -> Iterator[slice]:
    """Yield blocks of samples, so that memory does not grow with the length of the run.

    Args:
        samples: number of samples.
        numbers: temporary numbers per sample.
    """
    length = max(1, min(_BLOCK, int(_ROOM / (8 * max(numbers, 1)))))
    for start in range(0, samples, length):
        yield slice(start, min(start + length, samples))


class RowNames(NamedTuple):
    """Names of the columns of forces.

    Attributes:
        multipliers, contact_forces: names of the kept rows and of all rows.
        normal_forces: names of the contacts with a normal force.
        switching: True if rows appear and vanish: they have zeros while they do not act.
    """

    multipliers: tuple[str, ...]
    contact_forces: tuple[str, ...]
    normal_forces: tuple[str, ...]
    switching: bool = False


class DerivedQuantities:
    """Outputs of the controller's model, and forces and energy of the plant, along a run.

    Args:
        reduced: model of the controller.
        rows: columns of the forces. If they switch, residuals are those of the plant.
        bodies: bodies that move on the ground.
    """

    def __init__(self, reduced: ReducedModel, rows: RowNames, bodies: Sequence[GroundBody]) -> None:
        self._reduced, self._rows, self._bodies = reduced, rows, bodies

    def empty(self, samples: int) -> dict[str, Array]:
        """Arrays of all quantities, without values."""
        rows = self._rows
        kept = len(rows.multipliers)
        sizes = {
            "F": (self._reduced.r,), "multipliers": (kept,), "contact_forces": (len(rows.contact_forces),),
            "normal_forces": (len(rows.normal_forces),), "slip": (kept,), "energy": (), "constraint_residual": (),
            "position_residual": (), "singular_value": (), "ground_poses": (3 * len(self._bodies),),
        }  # fmt: skip
        return {name: np.empty((samples, *size)) for name, size in sizes.items()}

    def of(
        self,
        plant: ReducedModel,
        normal: NormalForces | None,
        t: Array,
        q: Array,
        v: Array,
        T: Array,
        external: Array | None,
    ) -> dict[str, Array]:
        """Return all quantities of a block of states and inputs, (N, ...) each.

        Args:
            plant: model of the plant.
            normal: its normal forces; None without any.
            t, q, v: times (N,), configurations (N, nq) and velocities (N, nv).
            T: inputs (N, p).
            external: generalized forces (N, nv) in addition to the inputs; None for zero.
        """
        reduced, rows = self._reduced, self._rows
        seen = StateEvaluation.at(reduced.evaluator, q, v=v, t=t)
        # Contact forces do not depend on the choice of outputs, nor on their singularities.
        own = seen if plant is reduced else StateEvaluation.at(plant.evaluator, q, v=v, t=t)
        moved = own.in_reduction(_free_evaluator(plant, tuple(best_entries(own.A[0], plant.r))))
        regular = seen.regular
        F = np.full((len(q), reduced.r), np.nan)
        if regular.any():
            good = seen if regular.all() else reduced.at(q[regular], v=v[regular], t=t[regular])
            F[regular] = apply_transposed(good.R, apply(good.B, T[regular]))
        multipliers, contact_forces = moved.multipliers(T, external), moved.contact_forces(T, external)
        pushing = np.zeros((len(q), 0)) if normal is None else normal.at(moved, T, external)
        kinematic, assembly = (own, plant.assembly) if rows.switching else (seen, reduced.assembly)
        residual, kept, missing = kinematic.residual, plant.constraints.names, 0.0 if rows.switching else np.nan
        return {
            "F": F,
            "multipliers": by_name(rows.multipliers, kept, multipliers, missing),
            "contact_forces": by_name(rows.contact_forces, plant.all_constraints.names, contact_forces, missing),
            "normal_forces": by_name(rows.normal_forces, () if normal is None else normal.names, pushing, missing),
            "energy": np.asarray(own.energy),
            "slip": by_name(rows.multipliers, kept, residual, missing) if rows.switching else residual,
            "constraint_residual": np.abs(residual).max(axis=-1, initial=0.0),
            "position_residual": np.abs(assembly.residual(q, t)).max(axis=-1, initial=0.0),
            "singular_value": np.asarray(seen.smallest_singular_value),
            "ground_poses": ground_poses(self._bodies, seen.position),
        }


@once_per_model
def _free_evaluators(reduced: ReducedModel) -> dict[tuple[int, ...], Evaluator]:
    """Evaluators in the reductions to entries of v that were needed last."""
    return {}


def _free_evaluator(reduced: ReducedModel, entries: tuple[int, ...]) -> Evaluator:
    """Evaluator for entries of v, kept for the next runs; others are selected where these are dependent."""
    known = _free_evaluators(reduced)
    if entries not in known:
        while len(known) >= _MOST_REDUCTIONS:
            known.pop(next(iter(known)))
        data = reduced.reduction_data.in_entries(entries, free=True)
        known[entries] = evaluator_for(data, reduced.evaluator)
    return known[entries]


def by_name(wanted: Sequence[str], known: Sequence[str], values: Array, missing: float) -> Array:
    """Select columns of values (N, k) by name; those of unknown names have the value ``missing``."""
    if tuple(wanted) == tuple(known):
        return values
    columns = {name: column for column, name in enumerate(known)}
    found = np.full((len(values), len(wanted)), missing)
    for place, name in enumerate(wanted):
        if name in columns:
            found[:, place] = values[:, columns[name]]
    return found
