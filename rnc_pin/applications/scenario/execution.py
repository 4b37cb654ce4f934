"""Execution of a scenario: the run, its comparisons, and their result files."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np

from rnc_pin.applications.scenario.scenario import Scenario, slug
from rnc_pin.applications.scenario.simulated_run import judged_summary, run_summary
from rnc_pin.errors import RncError
from rnc_pin.io import dump_json
from rnc_pin.simulation import Compared, LimitReplay, Observer, Outcome, Sample, Summary, Trajectory

_PLAN = "plan.npz"
_REPORTS = 400  # progress reports of a run
ShowProgress = Callable[[float, str], None]
"""Callback that takes the progress so far, and the name of what is under way."""


@dataclass(frozen=True)
class Result:
    """Result of a run. ``trajectory.verdict`` tells whether it succeeded."""

    trajectory: Trajectory
    summary: Summary
    error: RncError | None = None
    comparisons: dict[str, Trajectory] = field(default_factory=dict)
    limits: LimitReplay | None = None
    """Use of joint limits and distances over time; None for a run without samples."""

    @property
    def interrupted(self) -> bool:
        """True if the user interrupted the run or one of its comparisons."""
        return any(each.outcome is Outcome.INTERRUPTED for each in (self.trajectory, *self.comparisons.values()))


def execute(scenario: Scenario, observer: Observer | None = None, progress: ShowProgress | None = None) -> Result:
    """Run a scenario, and then its comparisons.

    Args:
        scenario: what to run.
        observer: called with every ``Sample`` of the run itself.
        progress: called with the simulated time so far [s], of all runs together, and the name of the one under way.

    Returns:
        The result; a run that failed keeps what it reached, with ``error`` set, and has no comparisons. Those after an
        interruption are missing.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # diverged values
        # The wall time of the summary is that of the simulation, without building and drawing.
        start = time.perf_counter()
        trajectory, error = scenario.simulated(_watched(scenario, observer, progress, 0.0, scenario.name))
        trajectory, summary, limits = judged_summary(scenario.experiment, trajectory, time.perf_counter() - start)
        others: dict[str, Trajectory] = {}
        if error is None and trajectory.outcome is Outcome.COMPLETED:
            others = _comparisons(scenario, summary, progress)  # beside a failed run they would show nothing
    return Result(trajectory, summary, error, others, limits)


def _comparisons(scenario: Scenario, summary: Summary, progress: ShowProgress | None) -> dict[str, Trajectory]:
    """Run the comparisons by label, up to one that is interrupted, and add their part of the summary."""
    found: dict[str, Trajectory] = {}
    before = scenario.duration
    for label, other in scenario.comparisons.items():
        run, failure = other.simulated(_watched(other, None, progress, before, f"{scenario.name}: {label}"))
        before += other.duration
        whole = run_summary(other.experiment, run)
        # Of a comparison the errors count; its limits and its verdict are not those of the run.
        compared = cast(Compared, {key: value for key, value in whole.items() if key in Compared.__annotations__})
        if failure is not None:
            compared["message"] = str(failure)
        summary.setdefault("comparisons", {})[label] = compared
        found[label] = run
        if run.outcome is Outcome.INTERRUPTED:
            break
    return found


def _watched(
    scenario: Scenario, observer: Observer | None, progress: ShowProgress | None, before: float, name: str
) -> Observer:
    """Observer of a run that reports its progress, from the time of all runs before it [s]."""
    last = scenario.duration * (1.0 - 1e-9)
    due = 0.0

    def watch(sample: Sample) -> None:
        nonlocal due
        # Reports at all samples would slow the run down; the last one always counts.
        if sample.time >= min(due, last):
            due = sample.time + last / _REPORTS
            if progress is not None:
                progress(before + sample.time, name)
        if observer is not None:
            observer(sample)

    return watch


def write(scenario: Scenario, result: Result, folder: Path) -> list[str]:
    """Write the data of a result: trajectories, summary and scenario. Return the names of the files.

    Args:
        scenario: the scenario.
        result: its result.
        folder: folder of the files.

    Raises:
        OSError: a file cannot be written.
    """
    result.trajectory.save(folder / "trajectory.npz")
    for label, other in result.comparisons.items():
        other.save(folder / _comparison_file(label))
    if scenario.experiment.plan is not None:
        scenario.experiment.plan.save(folder / _PLAN)
    (folder / "summary.json").write_text(dump_json(result.summary) + "\n", encoding="utf-8")
    scenario.save(folder / "scenario.yaml")
    return data_names(result.comparisons, scenario.experiment.plan is not None)


def data_names(comparisons: Iterable[str] = (), planned: bool = False) -> list[str]:
    """Names of the files that ``write`` writes for a run with these comparisons, and with a plan if it is planned.

    Args:
        comparisons: names of the comparisons.
        planned: True for a run with a planner.
    """
    plans = [_PLAN] if planned else []
    return ["trajectory.npz", *map(_comparison_file, comparisons), *plans, "summary.json", "scenario.yaml"]


def _comparison_file(label: str) -> str:
    return f"trajectory_{slug(label)}.npz"
