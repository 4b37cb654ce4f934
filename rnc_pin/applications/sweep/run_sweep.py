"""Sweep: many runs with drawn values."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from rnc_pin._kernel import kernel
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import apply_options, find_scenario, read_yaml
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.applications.sweep.reports import write_reports
from rnc_pin.applications.sweep.results import SweepResults
from rnc_pin.applications.sweep.rows import (
    Draw,
    Kinds,
    Numbered,
    Row,
    Runs,
    common_kind,
    is_result_column,
    kind_of,
    kind_of_all,
    refused,
    results_of,
    save_trajectory,
)
from rnc_pin.applications.sweep.scenario_runs import Draws, ScenarioRuns, SeededDraws, draws_of
from rnc_pin.applications.sweep.sweep_folder import (
    BLOCK,
    RUNS,
    RunStore,
    block_rows,
    describe_function,
    describe_scenario,
    sweep_folder,
)
from rnc_pin.applications.sweep.worker_pool import finished_runs
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.extras import check_extra
from rnc_pin.interruption import uninterrupted
from rnc_pin.io import Json, to_json_mapping
from rnc_pin.simulation import Outcome, Summary, Trajectory, add_verdict, simulate, summarize
from rnc_pin.version import __version__

Build: TypeAlias = Callable[[dict[str, Any]], "Mapping[str, object] | Trajectory | Scenario"]
"""Function of drawn values that returns the arguments of ``simulate`` by name, or a finished run."""


class FunctionRuns:
    """Runs that a function builds from drawn values.

    Args:
        build: function of the drawn values.
        draws: seeded draws; None if every run gets its values.
        trajectories: folder of the sweep, for trajectories; None writes none.
    """

    def __init__(self, build: Build, draws: SeededDraws | None, trajectories: str | None = None) -> None:
        self._build, self._draws, self._trajectories = build, draws, trajectories

    def rows(self, batch: Sequence[Numbered]) -> list[Row]:
        """Simulate the runs one after the other and return their rows."""
        return [self._row(run, draw) for run, draw in batch]

    def _row(self, run: int, draw: Draw | None) -> Row:
        start = time.perf_counter()
        if draw is None:
            assert self._draws is not None
            draw = next(self._draws.of_run(run))
        check_names(draw)
        with np.errstate(over="ignore", invalid="ignore"):  # diverged values
            results = self._results(run, draw)
        return {"run": run, **canonical(draw), **results, "wall_time": time.perf_counter() - start}

    def _results(self, run: int, draw: Draw) -> Row:
        try:
            summary, trajectory = _simulated(self._build(dict(draw)))
        except RncError as error:
            if not isinstance(error.trajectory, Trajectory):
                return refused("refused", error)
            trajectory = error.trajectory
            summary = _judged(trajectory)
        if trajectory.outcome is Outcome.INTERRUPTED:
            raise KeyboardInterrupt
        save_trajectory(trajectory, self._trajectories, run)
        return results_of(summary)


def _simulated(built: object) -> tuple[Summary, Trajectory]:
    if isinstance(built, Scenario):
        result = execute(built)
        return result.summary, result.trajectory
    if isinstance(built, Mapping):
        built = simulate(**built)
    if not isinstance(built, Trajectory):
        raise TypeError(
            f"build returned {type(built).__name__}, expected the arguments of rnc.simulate by name, or a Trajectory"
        )
    return _judged(built), built


def _judged(run: Trajectory) -> Summary:
    """Summary of a run with its verdict."""
    summary = summarize(run)
    add_verdict(summary, run.verdict)
    return summary


def check_names(draw: Draw) -> None:
    """Raise an error if a drawn value has the name of a result."""
    for name in draw:
        if not isinstance(name, str) or is_result_column(name):
            raise ConfigurationError(f"draws: {name!r} is the name of a result; choose another one")


def canonical(draw: Draw) -> dict[str, object]:
    """Drawn values as JSON content: arrays become lists, and NumPy's numbers those of Python."""
    return {name: _plain(value) for name, value in draw.items()}


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value


SweepProgress = Callable[[int, int | None], object]
"""Callback that takes the number of finished runs, and that of all runs if it is known."""


class _Sweep(NamedTuple):
    """Source of the runs of a sweep, its description, and its draws: seeded or given."""

    runs: Runs
    description: dict[str, Json]
    seeded: SeededDraws | None
    given: Iterable[Draw] | None
    runs_known: int | None


def sweep(
    build: Build | str | Path,
    draws: int | Draws | Iterable[Draw],
    *,
    out: str | Path,
    jobs: int | str = 1,
    options: Mapping[str, object] | None = None,
    trajectories: bool = False,
    progress: SweepProgress | None = None,
    force: bool = False,
) -> SweepResults:
    """Simulate many runs with drawn values, and write a data set with one row a run.

    Memory does not grow with the number of runs. If the process or a worker is killed, the same call continues: no
    recorded run is lost or repeated. Rows are equal to the bit on any number of processes, except ``wall_time``.

    Args:
        build: function that takes the drawn values as a dict and returns the arguments of ``simulate`` by name, or a
            Trajectory; or a scenario: a built-in name or a YAML file. Several processes need a function that can be
            pickled; functions in notebooks can.
        draws: number of runs with seeded draws, or ``Draws`` with distributions and a seed; or the values of each run,
            as an iterable of dicts. Values for a scenario are options by dotted key.
        out: folder of the results.
        jobs: processes; -1 for all cores. Or the address of a Dask scheduler to run on.
        options: options of a scenario that all runs share, by dotted key.
        trajectories: write the trajectory of each run too.
        progress: called with the number of finished runs, and the number of all runs or None.
        force: replace another sweep in the folder, and write beside other files.

    Returns:
        The results, like ``load_sweep``.

    Raises:
        ConfigurationError: the folder holds a different sweep or other files, the draws are invalid, or a package of
            the extra ``sweep`` or ``dask`` is not installed.
        SimulationError: workers ended again and again while the same runs were under way.

    Example:
        >>> import tempfile
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> def build(draw):
        ...     return rnc.free_motion(reduced, robot.configuration(), [draw["speed"], 0.5], duration=0.1)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     results = rnc.sweep(build, rnc.Draws(20, {"speed": [0.5, 1.5]}), out=folder)
        ...     print(len(results), results.outcomes, bool(results["speed"].max() < 1.5))
        20 {'completed': 20} True
    """
    if isinstance(jobs, str):
        check_extra("dask", f"--scheduler {jobs}")  # it contains the packages of the extra sweep
    elif jobs == 0 or jobs < -1:
        raise ConfigurationError(f"--jobs {jobs}: expected a number of processes, or -1 for all cores")
    check_extra("sweep", "sweep")
    path, draws = Path(out), Draws(draws) if isinstance(draws, int) else draws
    folder = os.path.abspath(path) if trajectories else None
    if isinstance(build, str | Path):
        whole = _scenario_sweep(str(build), draws, options, folder)
    else:
        whole = _function_sweep(build, draws, options, folder)
    kinds = _kinds(whole.seeded)
    specification: dict[str, Json] = {
        "rnc_pin": __version__,
        "kernel": kernel,
        **whole.description,
        "draws": {} if whole.seeded is None else whole.seeded.describe(),
        "trajectories": trajectories,
        "runs": whole.runs_known,
        "kinds": dict(kinds),
    }
    with uninterrupted(), sweep_folder(path, specification, force):
        store = RunStore(path / RUNS, kinds)
        if progress is not None:
            progress(len(store), whole.runs_known)
        for rows in finished_runs(whole.runs, _missing(whole, store, path / RUNS), jobs):
            store.add(rows)
            if progress is not None:
                progress(len(store), whole.runs_known)
        store.finish()
        results = SweepResults(path)
        write_reports(results)
    return results


def _scenario_sweep(
    scenario: str, draws: Draws | Iterable[Draw], options: Mapping[str, object] | None, folder: str | None
) -> _Sweep:
    shared = to_json_mapping(options or {}, "options")
    if not isinstance(draws, Draws):
        path = find_scenario(scenario)
        own = validate(apply_options(read_yaml(path), shared), path.name).seed
        runs = ScenarioRuns(scenario, shared, None, own, folder)
        return _Sweep(runs, describe_scenario(scenario, shared), None, draws, _length(draws))
    if draws.distributions is not None:
        shared["sweep"] = to_json_mapping(draws.distributions, "distributions")
    if draws.seed is not None:
        shared["seed"] = draws.seed
    description, seeded = describe_scenario(scenario, shared), draws_of(scenario, shared)
    return _Sweep(ScenarioRuns(scenario, shared, seeded, seeded.seed, folder), description, seeded, None, draws.runs)


def _function_sweep(
    build: Build, draws: Draws | Iterable[Draw], options: Mapping[str, object] | None, folder: str | None
) -> _Sweep:
    if options:
        raise ConfigurationError("options: those of a scenario; a function takes values from its draws")
    description = describe_function(build)
    if not isinstance(draws, Draws):
        return _Sweep(FunctionRuns(build, None, folder), description, None, draws, _length(draws))
    if not draws.distributions:
        example = f"rnc.Draws({draws.runs}, {{'mass': [1, 2]}})"
        raise ConfigurationError(f"draws: {draws.runs} runs of a function need distributions, e.g. {example}")
    seeded = SeededDraws.of(draws.distributions, draws.seed or 0)
    check_names(seeded.distributions)
    return _Sweep(FunctionRuns(build, seeded, folder), description, seeded, None, draws.runs)


def _length(draws: Iterable[Draw]) -> int | None:
    try:
        return len(draws)  # type: ignore[arg-type]
    except TypeError:
        return None


def _kinds(seeded: SeededDraws | None) -> Kinds:
    """Kinds of seeded values."""
    found = {} if seeded is None else {name: kind_of_all(seeded.examples(name)) for name in seeded.distributions}
    return {name: kind for name, kind in found.items() if kind is not None}


def _missing(whole: _Sweep, store: RunStore, folder: Path) -> Iterator[Numbered]:
    """Numbers of the runs that are not finished, with their given values."""
    if whole.given is None:
        assert whole.runs_known is not None
        if store.last() >= whole.runs_known:
            raise ConfigurationError(f"{folder}: holds run {store.last()}, more than {whole.runs_known} runs")
        yield from ((run, None) for run in range(whole.runs_known) if run not in store)
        return
    recorded: dict[int, Row] = {}
    run = -1
    for run, draw in enumerate(whole.given):
        if not isinstance(draw, Mapping):
            raise ConfigurationError(f"draws: run {run} has {type(draw).__name__}, expected a dict of values")
        check_names(draw)
        values = to_json_mapping(canonical(draw), f"draws: run {run}")
        _note_kinds(run, values, store.kinds)
        if run % BLOCK == 0:
            recorded = {row["run"]: row for row in block_rows(folder, run // BLOCK)}
        if run in store:
            _check_recorded(run, values, recorded[run], folder)
        else:
            yield run, values if "scenario" in whole.description else draw
    if store.last() > run:
        raise ConfigurationError(f"{folder}: holds run {store.last()}, and the draws end at run {run}")


def _note_kinds(run: int, values: Mapping[str, Json], kinds: Kinds) -> None:
    """Raise an error if a value is of another kind than in earlier runs."""
    for name, value in values.items():
        kind = kind_of(value)
        common = common_kind(kinds.get(name), kind)
        if common == "json" and "json" not in (kinds.get(name), kind):
            raise ConfigurationError(f"draws: run {run}: '{name}' is of kind {kind}, in earlier runs {kinds[name]}")
        if common is not None:
            kinds[name] = common


def _check_recorded(run: int, values: Mapping[str, Json], row: Row, folder: Path) -> None:
    """Raise an error if a finished run had other values."""
    for name, value in values.items():
        if row.get(name) != value and repr(row.get(name)) != repr(value):
            raise ConfigurationError(
                f"{folder}: holds another sweep: '{name}' of run {run} is {row.get(name)!r}, not {value!r}; choose "
                "another folder or force"
            )
