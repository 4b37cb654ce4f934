"""Execution of a scenario: the run, its comparisons, and their result files."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias, cast

import numpy as np
import yaml

from rnc_pin.applications.scenario.builder import Experiment, build_experiment
from rnc_pin.applications.scenario.files import apply_options, find_scenario, is_built_in, read_yaml, with_options
from rnc_pin.applications.scenario.loading import validate
from rnc_pin.applications.scenario.model_warnings import collected_model_warnings
from rnc_pin.applications.scenario.phase_builder import build_phased
from rnc_pin.applications.scenario.planner_builder import Plans
from rnc_pin.applications.scenario.run_verdict import judged_summary, run_summary
from rnc_pin.applications.scenario.schema import Scenario
from rnc_pin.applications.scenario.shared_tasks import Report, SharedTasks
from rnc_pin.control import State
from rnc_pin.control.whole_body import report_within
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.io import Json, dump_json
from rnc_pin.model import ReducedModel
from rnc_pin.simulation import (
    LimitReplay,
    Observer,
    Outcome,
    Sample,
    SimulationOptions,
    Summary,
    Trajectory,
    simulate,
    simulate_phases,
)
from rnc_pin.simulation.summary import Compared

_PLAN = "plan.npz"
_REPORTS = 400  # progress reports of a run

_Run: TypeAlias = tuple[Trajectory, RncError | None, dict[str, float]]
"""Motion of a run, the error that ended it early, and the largest amounts by which limits gave way."""


@dataclass(frozen=True)
class Plan:
    """Validated scenario, ready to run. No file is written yet.

    Attributes:
        name: name of the scenario.
        raw: mapping of the scenario file, with options.
        folder: base of relative paths in the scenario.
        experiment: objects of the run.
        comparisons: objects of the other runs, by label.
        built_in: True for a scenario of the package; its record contains no folder of this computer.
    """

    name: str
    raw: dict[str, Json]
    folder: Path
    experiment: Experiment
    comparisons: dict[str, Experiment]
    built_in: bool

    @property
    def duration(self) -> float:
        """Simulated time of the run itself [s]."""
        return self.experiment.simulation.duration

    @property
    def total_duration(self) -> float:
        """Simulated time of the run and its comparisons [s]."""
        return self.duration + sum(each.simulation.duration for each in self.comparisons.values())


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


def plan(scenario: str, options: Mapping[str, Json] | None = None) -> Plan:
    """Read a scenario and build its objects.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values to replace.

    Raises:
        RncError: the scenario is invalid.
    """
    path = find_scenario(scenario).resolve()
    raw = apply_options(read_yaml(path), options or {})
    source = path.name if scenario != path.stem else scenario
    checked = validate(raw, source)
    plans = Plans()
    experiment = located_experiment(source, checked, path.parent, plans)
    comparisons: dict[str, Experiment] = {}
    slugs: dict[str, str] = {}
    for label, changes in checked.comparisons.items():
        # Comparisons may fail on purpose, to show the difference. Their preflight therefore only warns.
        other = validate(with_options(raw, {"preflight": "warn", **changes}), f"{source}: comparisons.{label}")
        if slugs.setdefault(slug(label), label) != label:
            raise ConfigurationError(f"{source}: comparisons: '{label}' and '{slugs[slug(label)]}' give one file name")
        comparisons[label] = located_experiment(f"{source}: comparisons.{label}", other, path.parent, plans)
    return Plan(path.stem, raw, path.parent, experiment, comparisons, is_built_in(path))


def located_experiment(
    source: str,
    scenario: Scenario,
    folder: Path,
    plans: Plans,
    reduced: ReducedModel | None = None,
    show: bool = True,
) -> Experiment:
    """Build an experiment and prepend the source file to errors.

    Args:
        source: name of the scenario in errors.
        scenario: a validated scenario.
        folder: base of relative paths.
        plans: optimal motions of other runs.
        reduced: model of the scenario; runs with phases build their own.
        show: True to show warnings about the model, beside keeping them.
    """
    try:
        with collected_model_warnings(show) as told:
            if scenario.phases:
                experiment = build_phased(scenario, folder)
            else:
                experiment = build_experiment(scenario, folder, plans, reduced)
        return replace(experiment, model_warnings=tuple(told))
    except RncError as error:
        raise error.within(source) from None


def execute(
    plan: Plan,
    observer: Observer | None = None,
    progress: Callable[[float, str], None] | None = None,
    *,
    processes: int = 1,
) -> Result:
    """Run a plan.

    Args:
        plan: what to run.
        observer: called with every ``Sample`` of the run itself.
        progress: called with the simulated time so far [s], of all runs together, and the name of the one under way.
        processes: largest number of processes. With more than one, comparisons run beside the run; results are equal
            to the bit.

    Returns:
        The result; a run that failed keeps what it reached, with ``error`` set.
    """
    with np.errstate(over="ignore", invalid="ignore"), _Runs(plan, progress, processes) as runs:  # diverged values
        return _executed(plan, runs, observer)


class _Runs:
    """The runs of a plan and their progress. Its comparisons start at once if there are processors for them."""

    def __init__(self, plan: Plan, progress: Callable[[float, str], None] | None, processes: int) -> None:
        self._plan, self._progress = plan, progress
        self._experiments = [plan.experiment, *plan.comparisons.values()]
        self._names = [plan.name, *(f"{plan.name}: {label}" for label in plan.comparisons)]
        self._times = [0.0] * len(self._names)
        self._others: SharedTasks[None, _Run] = SharedTasks(
            self._other, range(1, len(self._names)), processes - 1, ended_early=_interrupted
        )
        self._others.begin(None)

    def main(self, observer: Observer | None) -> _Run:
        """The run itself."""
        return self._simulated(0, observer, self._others.with_helpers(self._show))

    def others(self) -> dict[str, _Run]:
        """The comparisons by label. Those after an interruption are missing."""
        found = self._others.results(self._show)
        return {label: found[k] for k, label in enumerate(self._plan.comparisons, start=1) if k in found}

    def _other(self, number: int, _: None, report: Report) -> _Run:
        return self._simulated(number, None, report)

    def _simulated(self, number: int, observer: Observer | None, report: Report) -> _Run:
        experiment = self._experiments[number]
        last = experiment.simulation.duration * (1.0 - 1e-9)
        state: State = None
        shown = 0.0

        def watch(sample: Sample) -> None:
            nonlocal shown, state
            state = sample.state
            if sample.time >= min(shown, last):
                shown = sample.time + last / _REPORTS
                report(number, sample.time)
            if observer is not None:
                observer(sample)

        trajectory, error = _simulate(self._plan, experiment, watch)
        return trajectory, error, _gave_way(experiment, state)

    def _show(self, number: int, time: float) -> None:
        self._times[number] = time
        if self._progress is not None:
            self._progress(sum(self._times), self._names[number])

    def __enter__(self) -> _Runs:
        return self

    def __exit__(self, *error: object) -> None:
        self._others.close()


def _interrupted(run: _Run) -> bool:
    return run[0].outcome is Outcome.INTERRUPTED


def _executed(plan: Plan, runs: _Runs, observer: Observer | None) -> Result:
    # The wall time of the summary is that of the simulation, without building and drawing.
    start = time.perf_counter()
    trajectory, error, gave_way = runs.main(observer)
    summary, limits = judged_summary(plan.experiment, trajectory, gave_way, time.perf_counter() - start)
    others: dict[str, Trajectory] = {}
    if error is None and trajectory.outcome is Outcome.COMPLETED:
        for label, (other, failure, _) in runs.others().items():
            others[label] = other
            compared = _compared(run_summary(plan.comparisons[label], other))
            if failure is not None:
                compared["message"] = str(failure)
            summary.setdefault("comparisons", {})[label] = compared
    return Result(trajectory, summary, error, others, limits)


def _compared(summary: Summary) -> Compared:
    """Return the part of a comparison's summary that the run's summary contains."""
    return cast(Compared, {key: value for key, value in summary.items() if key in Compared.__annotations__})


def _gave_way(experiment: Experiment, state: State) -> dict[str, float]:
    """Largest amounts by which limits of a whole-body program gave way, by name."""
    report = report_within(experiment.controller, state)
    return {} if report is None else dict(report.worst)


def run_options(plan: Plan, experiment: Experiment, observer: Observer | None = None) -> SimulationOptions:
    """Options of one of the runs of a plan, with its provenance."""
    provenance = replace(
        experiment.provenance,
        scenario=plan.name,
        seed=experiment.scenario.seed,
        config=plan.raw,
        folder=None if plan.built_in else str(plan.folder),
    )
    stop = experiment.simulation.stop
    return SimulationOptions(stop=stop, loop=experiment.loop, observer=observer, meta=provenance)


def _simulate(plan: Plan, experiment: Experiment, observer: Observer) -> tuple[Trajectory, RncError | None]:
    settings, options = experiment.simulation, run_options(plan, experiment, observer)
    try:
        if experiment.phases:
            start = experiment.q0, settings.dt
            return simulate_phases(experiment.phases, *start, v2_0=experiment.v2_0, options=options), None
        return simulate(
            experiment.reduced,
            experiment.controller,
            experiment.q0,
            settings.duration,
            settings.dt,
            v2_0=experiment.v2_0,
            plant=experiment.plant,
            options=options,
        ), None
    except RncError as error:
        if not isinstance(error.trajectory, Trajectory):
            raise
        return error.trajectory, error


def write(plan: Plan, result: Result, folder: Path) -> list[str]:
    """Write the data of a result: trajectories, summary and scenario. Return the names of the files.

    Raises:
        OSError: a file cannot be written.
    """
    result.trajectory.save(folder / "trajectory.npz")
    for label, other in result.comparisons.items():
        other.save(folder / _comparison_file(label))
    if plan.experiment.plan is not None:
        plan.experiment.plan.save(folder / _PLAN)
    (folder / "summary.json").write_text(dump_json(result.summary) + "\n", encoding="utf-8")
    text = yaml.safe_dump(_portable(plan), sort_keys=False)
    (folder / "scenario.yaml").write_text(text, encoding="utf-8")
    return data_names(result.comparisons, plan.experiment.plan is not None)


def data_names(comparisons: Iterable[str] = (), planned: bool = False) -> list[str]:
    """Names of the files that ``write`` writes for a run with these comparisons, and with a plan if it is planned."""
    plans = [_PLAN] if planned else []
    return ["trajectory.npz", *map(_comparison_file, comparisons), *plans, "summary.json", "scenario.yaml"]


def _comparison_file(label: str) -> str:
    return f"trajectory_{slug(label)}.npz"


def _portable(plan: Plan) -> dict[str, Json]:
    """Return the scenario with an absolute path of its robot, to run from any folder of this computer."""
    source = plan.raw.get("robot")
    if not isinstance(source, Mapping):
        return plan.raw
    beside = plan.folder / str(source.get("urdf"))
    if not beside.is_file():
        return plan.raw
    return {**plan.raw, "robot": {**source, "urdf": str(beside.resolve())}}


def slug(label: str) -> str:
    """Return a label in the form of a part of a file name."""
    return "".join(letter if letter.isalnum() else "_" for letter in label)
