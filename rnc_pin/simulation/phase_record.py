"""One trajectory of several phases, with the columns of all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.row_stack import OutputStack
from rnc_pin.model.rows import OutputRows
from rnc_pin.simulation.derived_quantities import columns_by_name
from rnc_pin.simulation.judgement import judged_by
from rnc_pin.simulation.record import columns_of
from rnc_pin.simulation.run_info import (
    BrakingUse,
    FallbackUse,
    IntegrationAccuracy,
    MissedUpdates,
    Outcome,
    OutputNames,
    PhaseInfo,
    RunInfo,
)
from rnc_pin.simulation.trajectory import Trajectory

_EQUAL = ("time", "q", "v", "energy", "constraint_residual", "position_residual", "singular_value")
_BY_NAME = ("T", "multipliers", "contact_forces", "normal_forces")
_OUTPUTS = ("x1", "x2")
_Part = TypeVar("_Part")


class PhasePart(NamedTuple):
    """Phase of a run with its own recording."""

    reduced: ReducedModel
    trajectory: Trajectory
    info: PhaseInfo
    work: float
    """Work before the phase, minus the energy that impacts have removed [J]."""


def joined(parts: Sequence[PhasePart], dt: float, outcome: Outcome, message: str | None) -> Trajectory:
    """Join the recordings of phases.

    An output is in x2 if it is a reducing output of some phase, else in x1. Its values are those of the motion in all
    phases; its goals are NaN in phases without it. Integrals of quasi-velocities and turned angles continue.

    Args:
        parts: phases in order, at least one.
        dt: sampling period [s].
        outcome: outcome of the whole run.
        message: reason of an early end, if any.
    """
    runs = [part.trajectory for part in parts]
    arrays = {name: np.concatenate([getattr(run, name) for run in runs]) for name in _EQUAL}
    arrays["work"] = np.concatenate([part.trajectory.work + part.work for part in parts])
    x2, x1 = _blocks(parts)
    stacks = {"x1": OutputStack(x1), "x2": OutputStack(x2)}
    for kind, stack in stacks.items():
        arrays |= _outputs(parts, kind, stack)
    arrays["F"] = _columns(runs, stacks["x2"].names, [run.info.outputs.x2.names for run in runs], "F")
    names = {each: _union(getattr(run.info.outputs, each) for run in runs) for each in (*_BY_NAME, "ground_poses")}
    for each in _BY_NAME:
        arrays[each] = _columns(runs, names[each], [getattr(run.info.outputs, each) for run in runs], each)
    arrays["slip"] = _columns(runs, names["multipliers"], [run.info.outputs.multipliers for run in runs], "slip")
    common = tuple(each for each in names["ground_poses"] if all(each in run.info.outputs.ground_poses for run in runs))
    arrays["ground_poses"] = np.concatenate([_poses(run, common) for run in runs])
    for each in ("estimates", "prediction_error", "v_measured", "friction_used"):
        found = [getattr(run, each) for run in runs]
        same = len({array.shape[1] for array in found}) == 1
        arrays[each] = np.concatenate([array if same else np.zeros((len(array), 0)) for array in found])
    first = runs[0].info
    units = {f"{each}_units": _units(runs, each, names[each]) for each in ("T", "multipliers", "contact_forces")}
    outputs = OutputNames(
        x1=columns_of(stacks["x1"]),
        x2=columns_of(stacks["x2"]),
        q=first.outputs.q,
        q_units=first.outputs.q_units,
        v=first.outputs.v,
        v_units=first.outputs.v_units,
        ground_poses=common,
        **units,
        **{each: names[each] for each in _BY_NAME},
    )
    goals = tuple(
        name
        for kind, stack in stacks.items()
        for name, column in zip(stack.names, arrays[f"{kind}_desired"].T, strict=True)
        if not np.isnan(column).all()
    )

    def fallback(uses: list[FallbackUse]) -> FallbackUse:
        last = runs[-1].info.fallback
        at_the_end = last is not None and last.at_the_end
        return replace(uses[0], samples=sum(each.samples for each in uses), at_the_end=at_the_end)

    info = RunInfo(
        outputs,
        goals,
        dt,
        first.versions,
        first.provenance,
        outcome,
        message,
        tuple(part.info for part in parts),
        _part(runs, "fallback", fallback),
        _part(runs, "missed_updates", _missed_updates),
        _part(runs, "braking", _braking),
        IntegrationAccuracy.together([run.info.integration for run in runs]),
    )
    return judged_by(Trajectory(**arrays, info=info), parts[0].reduced)


def _units(runs: Sequence[Trajectory], array: str, names: Sequence[str]) -> tuple[str, ...]:
    """Units of the columns of an array by their names."""
    known: dict[str, str] = {}
    for run in runs:
        outputs = run.info.outputs
        known |= zip(getattr(outputs, array), getattr(outputs, f"{array}_units"), strict=True)
    return tuple(known[name] for name in names)


def _part(runs: Sequence[Trajectory], name: str, combine: Callable[[list[_Part]], _Part]) -> _Part | None:
    """Part of the info over all phases that have it; None if none has."""
    found = [part for run in runs if (part := getattr(run.info, name)) is not None]
    return combine(found) if found else None


def _missed_updates(counts: list[MissedUpdates]) -> MissedUpdates:
    """Missed updates of predictive controllers in all phases that missed some."""
    return MissedUpdates(sum(each.missed for each in counts), sum(each.updates for each in counts))


def _braking(found: list[BrakingUse]) -> BrakingUse:
    """Braking motions in all phases: the sums, and what was first."""
    braked = next((each for each in found if each.samples), found[0])
    unverified = next((each for each in found if each.unverified), found[0])
    exceeded: dict[str, float] = {}
    for each in found:
        exceeded |= {name: max(amount, exceeded.get(name, 0.0)) for name, amount in each.exceeded.items()}
    return BrakingUse(
        sum(each.samples for each in found),
        braked.first,
        braked.reason,
        sum(each.unverified for each in found),
        unverified.unverified_first,
        unverified.problem,
        exceeded,
    )


def _blocks(parts: Sequence[PhasePart]) -> tuple[list[OutputRows], list[OutputRows]]:
    """Outputs of all phases without repetition: those that are reducing in some phase, and the others."""
    found: tuple[list[OutputRows], list[OutputRows]] = ([], [])
    known: set[str] = set()
    for blocks, stacks in (
        (found[0], [part.reduced.reducing for part in parts]),
        (found[1], [part.reduced.vertical for part in parts]),
    ):
        for place in (place for stack in stacks for place in stack.places):
            block = place.block
            assert isinstance(block, OutputRows)
            if not known & set(block.names):
                blocks.append(block)
                known |= set(block.names)
    return found


def _outputs(parts: Sequence[PhasePart], kind: str, stack: OutputStack) -> dict[str, np.ndarray]:
    """Arrays of the outputs of a kind over all phases: values, rates and goals."""
    rate = f"v{kind[1:]}"
    found: dict[str, list[np.ndarray]] = {name: [] for name in (kind, rate, f"{kind}_desired", f"{rate}_desired")}
    last: np.ndarray | None = None
    for part in parts:
        x, v = _evaluated(part, stack)
        goal, goal_rate = (np.full_like(x, np.nan) for _ in range(2))
        for own in _OUTPUTS:
            names = part.trajectory.info.outputs.of(own).names
            for column, name in enumerate(stack.names):
                if name in names:
                    x[:, column] = getattr(part.trajectory, own)[:, names.index(name)]
                    goal[:, column] = getattr(part.trajectory, f"{own}_desired")[:, names.index(name)]
                    if own == "x2":
                        goal_rate[:, column] = part.trajectory.v2_desired[:, names.index(name)]
        if last is not None and len(x):
            shift = _shift(stack, last, x[0])
            x, goal = x + shift, goal + shift
        last = x[-1] if len(x) else last
        for arrays, array in zip(found.values(), (x, v, goal, goal_rate), strict=True):
            arrays.append(array)
    return {name: np.concatenate(each) for name, each in found.items() if name != "v1_desired"}


def _evaluated(part: PhasePart, stack: OutputStack) -> tuple[np.ndarray, np.ndarray]:
    """Values and rates (N, k) of outputs along a phase; a quasi-velocity has its integral since the start."""
    run = part.trajectory
    position = Kinematics(part.reduced.robot).position(run.q)
    rates = apply(stack.jacobian(position), run.v)
    values = stack.value(position)
    steps = 0.5 * np.diff(run.time)[:, None] * (rates[1:] + rates[:-1])
    integrals = np.concatenate([np.zeros((min(len(run.time), 1), stack.size)), np.cumsum(steps, axis=0)])
    values[:, stack.quasi] = integrals[:, stack.quasi]
    return stack.coordinates.unwrap(values, values[:1] + integrals), rates


def _shift(stack: OutputStack, last: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Shift (k,) that continues integrals, and angles by whole turns."""
    gap = last - first
    turns = 2.0 * np.pi * np.round(gap / (2.0 * np.pi))
    return np.where(stack.quasi, gap, np.where(stack.angular, turns, 0.0))


def _columns(
    runs: Sequence[Trajectory], wanted: Sequence[str], known: Sequence[Sequence[str]], array: str
) -> np.ndarray:
    """Columns of an array by name over all runs; zeros where a run does not have them."""
    each = (columns_by_name(wanted, own, getattr(run, array), 0.0) for run, own in zip(runs, known, strict=True))
    return np.concatenate(list(each))


def _poses(run: Trajectory, names: Sequence[str]) -> np.ndarray:
    own = run.info.outputs.ground_poses
    found = [run.ground_poses[:, 3 * own.index(name) : 3 * own.index(name) + 3] for name in names]
    return np.concatenate([np.zeros((len(run.time), 0)), *found], axis=1)


def _union(names: Iterable[Sequence[str]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for each in names for name in each))
