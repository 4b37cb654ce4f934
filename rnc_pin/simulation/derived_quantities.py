"""Quantities of a run that follow from its states and inputs, in blocks of samples: forces, energy, residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.analysis import NormalForces
from rnc_pin.errors import RncError
from rnc_pin.math.linear_algebra import apply, apply_transposed
from rnc_pin.model.compiled import evaluator_for
from rnc_pin.model.numpy_evaluator import NumPyEvaluator
from rnc_pin.model.once_per_model import once_per_model
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.reduction_data import best_entries
from rnc_pin.model.state_evaluation import StateEvaluation
from rnc_pin.simulation.ground_bodies import GroundBody, ground_poses

MATRICES = 8
"""Temporary (n, n) matrices for each sample."""
_BLOCK = 1000  # largest number of samples in a block
_ROOM = 16e6  # memory for the matrices of a block [bytes]
_MOST_REDUCTIONS = 16  # kept for each model


class StatesOfRun(NamedTuple):
    """States and inputs of a run."""

    t: Array
    """(N,) [s]"""
    q: Array
    """(N, nq)"""
    v: Array
    """(N, nv)"""
    T: Array
    """(N, p)"""


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
        switching: True if rows appear and vanish: they have zeros while they do not act.
    """

    multipliers: tuple[str, ...]
    contact_forces: tuple[str, ...]
    switching: bool = False

    @classmethod
    def of(cls, reduced: ReducedModel) -> RowNames:
        """Names of the rows of a model."""
        return cls(reduced.constraints.names, reduced.all_constraints.names)


def empty_quantities(
    reduced: ReducedModel, samples: int, normal_forces: int, bodies: int, rows: RowNames | None = None
) -> dict[str, Array]:
    """Arrays of the derived quantities of a run.

    Args:
        reduced: model of the controller.
        samples, normal_forces, bodies: numbers of samples, of contacts with a normal force, and of ground bodies.
        rows: columns of the forces; those of the model by default.
    """
    rows = RowNames.of(reduced) if rows is None else rows
    kept, every = len(rows.multipliers), len(rows.contact_forces)
    sizes = {
        "F": (reduced.r,), "multipliers": (kept,), "contact_forces": (every,),
        "normal_forces": (normal_forces,), "slip": (kept,), "energy": (), "constraint_residual": (),
        "position_residual": (), "singular_value": (), "ground_poses": (3 * bodies,),
    }  # fmt: skip
    return {name: np.empty((samples, *size)) for name, size in sizes.items()}


class BlockOfStates:
    """States of a run, in the models of the controller and of the plant.

    Args:
        reduced, plant: the models.
        t, q, v: times (N,), configurations (N, nq) and velocities (N, nv).
    """

    def __init__(self, reduced: ReducedModel, plant: ReducedModel, t: Array, q: Array, v: Array) -> None:
        self._reduced, self._plant, self._at = reduced, plant, (t, q, v)
        self.seen = StateEvaluation.at(reduced.evaluator, q, v=v, t=t)
        # Contact forces do not depend on the choice of outputs, nor on their singularities.
        self.own = self.seen if plant is reduced else StateEvaluation.at(plant.evaluator, q, v=v, t=t)

    def entries(self, sample: int = 0) -> tuple[int, ...]:
        """Entries of v that parametrize the motion at a sample best."""
        return tuple(best_entries(self.own.A[sample], self._plant.r))

    def quantities(
        self,
        entries: tuple[int, ...],
        normal: NormalForces | None,
        T: Array,
        external: Array | None,
        bodies: Sequence[GroundBody],
        one_by_one: bool = False,
        rows: RowNames | None = None,
    ) -> dict[str, Array] | None:
        """Derived quantities: outputs of the controller's model, forces and energy of the plant.

        Args:
            entries: entries of v that parametrize the motion.
            normal: normal forces of the plant; None without any.
            T: inputs (N, p).
            external: generalized forces (N, nv) in addition to the inputs; None for zero.
            bodies: bodies that move on the ground.
            one_by_one: return None unless the evaluators give each state the bits that it has alone.
            rows: columns of the forces; those of the controller's model by default. If they switch, residuals are those
                of the plant.
        """
        reduced, plant, seen, own, (t, q, v) = self._reduced, self._plant, self.seen, self.own, self._at
        rows = RowNames.of(reduced) if rows is None else rows
        moved = own.in_reduction(_free_evaluator(plant, entries))
        if one_by_one and not (seen.arrays_at_q.one_by_one and moved.arrays_at_q.one_by_one):
            return None
        regular = seen.regular
        F = np.full((len(q), reduced.r), np.nan)
        if regular.any():
            good = seen if regular.all() else reduced.at(q[regular], v=v[regular], t=t[regular])
            F[regular] = apply_transposed(good.R, apply(good.B, T[regular]))
        multipliers, contact_forces = moved.multipliers(T, external), moved.contact_forces(T, external)
        kept, missing = plant.constraints.names, 0.0 if rows.switching else np.nan
        kinematic, assembly = (own, plant.assembly) if rows.switching else (seen, reduced.assembly)
        residual = kinematic.residual
        return {
            "F": F,
            "multipliers": by_name(rows.multipliers, kept, multipliers, missing),
            "contact_forces": by_name(rows.contact_forces, plant.all_constraints.names, contact_forces, missing),
            "normal_forces": np.zeros((len(q), 0)) if normal is None else normal.at(moved, T, external),
            "energy": np.asarray(own.energy),
            "slip": by_name(rows.multipliers, kept, residual, missing) if rows.switching else residual,
            "constraint_residual": np.abs(residual).max(axis=-1, initial=0.0),
            "position_residual": np.abs(assembly.residual(q, t)).max(axis=-1, initial=0.0),
            "singular_value": np.asarray(seen.smallest_singular_value),
            "ground_poses": ground_poses(bodies, seen.position),
        }


def quantities_of_runs(
    reduced: ReducedModel, runs: Sequence[StatesOfRun], normal: NormalForces | None, bodies: Sequence[GroundBody]
) -> list[dict[str, Array] | None]:
    """Derived quantities of many runs of a ``ReducedPlant`` of the model; None for a run that has to be alone.

    Each run has the bits of a run alone: its blocks are the same, and the kernel evaluates state by state.
    """
    found: list[dict[str, Array] | None] = [
        empty_quantities(reduced, len(run.t), 0 if normal is None else len(normal.names), len(bodies)) for run in runs
    ]
    numbers = MATRICES * reduced.n**2
    parts = [(number, block) for number, run in enumerate(runs) for block in blocks(len(run.t), numbers)]
    try:
        for entries, some in _alike(reduced, runs, parts).items():
            for group in _groups(some, next(blocks(_BLOCK, numbers)).stop):
                stacked = [np.concatenate([runs[k][field][block] for k, block in group]) for field in range(4)]
                states = BlockOfStates(reduced, reduced, *stacked[:3])
                values = states.quantities(entries, normal, stacked[3], None, bodies, one_by_one=True)
                _distribute(values, group, found)
    except RncError:  # of one of the runs, which is not known
        return [None] * len(runs)
    return found


_Part = tuple[int, slice]  # run, and a block of its samples


def _alike(
    reduced: ReducedModel, runs: Sequence[StatesOfRun], parts: Sequence[_Part]
) -> dict[tuple[int, ...], list[_Part]]:
    """Blocks by the entries of v that parametrize the motion at their first sample."""
    starts = [np.array([runs[k][field][block.start] for k, block in parts]) for field in range(3)]
    first = BlockOfStates(reduced, reduced, *starts)
    alike: dict[tuple[int, ...], list[_Part]] = {}
    for place, part in enumerate(parts):
        alike.setdefault(first.entries(place), []).append(part)
    return alike


def _groups(parts: Sequence[_Part], most: int) -> Iterator[list[_Part]]:
    """Yield consecutive blocks with at most so many samples together."""
    group: list[_Part] = []
    samples = 0
    for part in parts:
        length = part[1].stop - part[1].start
        if group and samples + length > most:
            yield group
            group, samples = [], 0
        group.append(part)
        samples += length
    if group:
        yield group


def _distribute(values: dict[str, Array] | None, group: Sequence[_Part], found: list[dict[str, Array] | None]) -> None:
    """Write stacked values to their runs."""
    begin = 0
    for run, block in group:
        end, own = begin + block.stop - block.start, found[run]
        if values is None:
            found[run] = None
        elif own is not None:
            for name, array in values.items():
                own[name][block] = array[begin:end]
        begin = end


@once_per_model
def _free_evaluators(reduced: ReducedModel) -> dict[tuple[int, ...], NumPyEvaluator]:
    """Evaluators in the reductions to entries of v that were needed last."""
    return {}


def _free_evaluator(reduced: ReducedModel, entries: tuple[int, ...]) -> NumPyEvaluator:
    """Evaluator for entries of v, kept for the next runs; others are selected where these are dependent."""
    known = _free_evaluators(reduced)
    if entries not in known:
        while len(known) >= _MOST_REDUCTIONS:
            known.pop(next(iter(known)))
        data = reduced.reduction_data.in_entries(entries, free=True)
        known[entries] = evaluator_for(data, reduced.evaluator)
    return known[entries]


def by_name(wanted: tuple[str, ...], known: tuple[str, ...], values: Array, missing: float = np.nan) -> Array:
    """Select columns of values (N, k) by name; ``missing`` for unknown names."""
    if wanted == known:
        return values
    columns = {name: column for column, name in enumerate(known)}
    found = np.full((len(values), len(wanted)), missing)
    for place, name in enumerate(wanted):
        if name in columns:
            found[:, place] = values[:, columns[name]]
    return found
