"""Execution of a scenario: the run beside its comparisons, and their result files."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np

from rnc_pin.applications.scenario.scenario import Scenario, slug
from rnc_pin.applications.scenario.shared_tasks import Report, SharedTasks
from rnc_pin.applications.scenario.simulated_run import Simulated, judged_summary, run_summary
from rnc_pin.errors import RncError
from rnc_pin.io import dump_json
from rnc_pin.simulation import Compared, LimitReplay, Observer, Outcome, Sample, Summary, Trajectory

_PLAN = "plan.npz"
_REPORTS = 400  # progress reports of a run


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


def execute(
    scenario: Scenario,
    observer: Observer | None = None,
    progress: Callable[[float, str], None] | None = None,
    *,
    processes: int = 1,
) -> Result:
    """Run a scenario.

    Args:
        plan: what to run.
        observer: called with every ``Sample`` of the run itself.
        progress: called with the simulated time so far [s], of all runs together, and the name of the one under way.
        processes: largest number of processes. With more than one, comparisons run beside the run; results are equal
            to the bit.

    Returns:
        The result; a run that failed keeps what it reached, with ``error`` set.
    """
    runs = _Runs(scenario, progress, processes)
    with closing(runs), np.errstate(over="ignore", invalid="ignore"):  # diverged values
        return _executed(scenario, runs, observer)


class _Runs:
    """The runs of a scenario and their progress. Its comparisons start at once if there are processors for them."""

    def __init__(self, scenario: Scenario, progress: Callable[[float, str], None] | None, processes: int) -> None:
        self._scenario, self._progress = scenario, progress
        self._experiments = [scenario.experiment, *scenario.comparisons.values()]
        self._names = [scenario.name, *(f"{scenario.name}: {label}" for label in scenario.comparisons)]
        self._times = [0.0] * len(self._names)
        self._others: SharedTasks[None, Simulated] = SharedTasks(
            self._other, range(1, len(self._names)), processes - 1, ended_early=_interrupted
        )
        self._others.begin(None)

    def main(self, observer: Observer | None) -> Simulated:
        """The run itself."""
        return self._simulated(0, observer, self._others.with_helpers(self._show))

    def others(self) -> dict[str, Simulated]:
        """The comparisons by label. Those after an interruption are missing."""
        found = self._others.results(self._show)
        return {label: found[k] for k, label in enumerate(self._scenario.comparisons, start=1) if k in found}

    def _other(self, number: int, _: None, report: Report) -> Simulated:
        return self._simulated(number, None, report)

    def _simulated(self, number: int, observer: Observer | None, report: Report) -> Simulated:
        experiment = self._experiments[number]
        last = experiment.simulation.duration * (1.0 - 1e-9)
        shown = 0.0

        def watch(sample: Sample) -> None:
            nonlocal shown
            if sample.time >= min(shown, last):
                shown = sample.time + last / _REPORTS
                report(number, sample.time)
            if observer is not None:
                observer(sample)

        return self._scenario.simulated(experiment, watch)

    def _show(self, number: int, time: float) -> None:
        self._times[number] = time
        if self._progress is not None:
            self._progress(sum(self._times), self._names[number])

    def close(self) -> None:
        """End the processes of the comparisons."""
        self._others.close()


def _interrupted(run: Simulated) -> bool:
    return run.trajectory.outcome is Outcome.INTERRUPTED


def _executed(scenario: Scenario, runs: _Runs, observer: Observer | None) -> Result:
    # The wall time of the summary is that of the simulation, without building and drawing.
    start = time.perf_counter()
    trajectory, error, gave_way = runs.main(observer)
    summary, limits = judged_summary(scenario.experiment, trajectory, gave_way, time.perf_counter() - start)
    others: dict[str, Trajectory] = {}
    if error is None and trajectory.outcome is Outcome.COMPLETED:
        for label, (other, failure, _) in runs.others().items():
            others[label] = other
            compared = _compared(run_summary(scenario.comparisons[label], other))
            if failure is not None:
                compared["message"] = str(failure)
            summary.setdefault("comparisons", {})[label] = compared
    return Result(trajectory, summary, error, others, limits)


def _compared(summary: Summary) -> Compared:
    """Return the part of a comparison's summary that the run's summary contains."""
    return cast(Compared, {key: value for key, value in summary.items() if key in Compared.__annotations__})


def write(scenario: Scenario, result: Result, folder: Path) -> list[str]:
    """Write the data of a result: trajectories, summary and scenario. Return the names of the files.

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
    """Names of the files that ``write`` writes for a run with these comparisons, and with a plan if it is planned."""
    plans = [_PLAN] if planned else []
    return ["trajectory.npz", *map(_comparison_file, comparisons), *plans, "summary.json", "scenario.yaml"]


def _comparison_file(label: str) -> str:
    return f"trajectory_{slug(label)}.npz"
