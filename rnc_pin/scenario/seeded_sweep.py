"""Parallel runs of one scenario with random values."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path

import joblib
import numpy as np
from joblib.externals.loky import get_reusable_executor

from rnc_pin.errors import ConfigurationError, InfeasibleError, RncError, SingularityError
from rnc_pin.io.json import Json
from rnc_pin.scenario.execution import data_names, execute, plan, write
from rnc_pin.scenario.files import apply_options, find_scenario, read_yaml
from rnc_pin.scenario.loading import validate
from rnc_pin.scenario.sweep_table import Row
from rnc_pin.scenario.sweep_worker import exit_with_parent

_MOST_DRAWS = 20  # largest number of draws for one run; then its outcome is "infeasible"


def drawn_keys(scenario: str, options: Mapping[str, Json]) -> tuple[dict[str, list[float]], int]:
    """Return the ranges of the scenario's ``sweep`` (dotted key to range) and its seed.

    Raises:
        ConfigurationError: the scenario has no ``sweep``, or a minimum is greater than its maximum.
    """
    path = find_scenario(scenario)
    checked = validate(apply_options(read_yaml(path), options), path.name)
    if not checked.sweep:
        raise ConfigurationError(
            f"{path.name}: sweep: is missing; give dotted keys and ranges, e.g. initial.q.joint: [0, 1]"
        )
    for key, (low, high) in checked.sweep.items():
        if low > high:
            raise ConfigurationError(f"{path.name}: sweep.{key}: minimum {low:g} is greater than maximum {high:g}")
        validate(apply_options(read_yaml(path), {**options, key: low}), f"{path.name}: sweep.{key}")
    return checked.sweep, checked.seed


def draw_options(scenario: str, options: Mapping[str, Json], run: int) -> Iterator[dict[str, Json]]:
    """Yield random options for one run of a sweep, then replacements for it. Each run has its own random stream.

    Raises:
        ConfigurationError: the scenario has no ``sweep``, or a minimum is greater than its maximum.
    """
    ranges, seed = drawn_keys(scenario, options)
    generator = np.random.default_rng([seed, run])
    while True:
        values = {key: float(generator.uniform(low, high)) for key, (low, high) in ranges.items()}
        yield {"preflight": "refuse", **options, "comparisons": {}, "seed": seed, **values}


def one_run(scenario: str, options: Mapping[str, Json], run: int, folder: Path, parent: int | None = None) -> Row:
    """Return the table row of one run: drawn values, outcome and errors. Results are written to its own folder.

    A task is drawn again if preflight refuses it or no gains fit. ``redrawn`` counts these draws.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values that all runs share.
        run: number of the run.
        folder: folder for the results, which is created.
        parent: id of the main process; this process ends with it.
    """
    if parent is not None:
        exit_with_parent(parent)
    for redrawn, candidate in enumerate(islice(draw_options(scenario, options, run), _MOST_DRAWS)):
        row = {"run": run, **{key: value for key, value in candidate.items() if isinstance(value, float)}}
        try:
            prepared = plan(scenario, candidate)
        except (InfeasibleError, SingularityError) as error:
            failure: RncError = error
            continue
        except RncError as error:
            return {**row, "outcome": "refused", "redrawn": redrawn, "message": str(error)}
        try:
            result = execute(prepared)
            if result.interrupted:
                raise KeyboardInterrupt
            folder.mkdir(parents=True, exist_ok=True)
            write(prepared, result, folder)
        except (RncError, OSError) as error:
            return {**row, "outcome": "refused", "redrawn": redrawn, "message": str(error)}
        summary = result.summary
        return {
            **row,
            "outcome": summary["outcome"],
            "redrawn": redrawn,
            **{f"final_error.{name}": value for name, value in summary["final_error"].items()},
            "min_singular_value": summary["min_singular_value"],
            "constraint_residual_max": summary["constraint_residual_max"],
            **{key: summary[key] for key in ("off_tracking_max",) if key in summary},
            "message": summary.get("message", ""),
        }
    return {**row, "outcome": "infeasible", "redrawn": redrawn, "message": str(failure)}


def run_folders(runs: int) -> list[str]:
    """Return the folder names of a sweep's runs."""
    return [f"run_{run:04d}" for run in range(runs)]


def run_files(runs: int) -> list[str]:
    """Return the names of all files in the folders of a sweep's runs."""
    return [f"{folder}/{name}" for folder in run_folders(runs) for name in data_names(planned=True)]


def sweep(
    scenario: str,
    options: Mapping[str, Json],
    runs: int,
    folder: Path,
    jobs: int = 1,
    scheduler: str | None = None,
) -> Iterator[Row]:
    """Run a sweep of tasks that pass preflight. Yield the rows in order as runs finish.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values that all runs share; ``preflight: warn`` keeps tasks with warnings.
        runs: number of runs.
        folder: folder of the sweep; each run makes a folder in it.
        jobs: local processes; -1 for all cores.
        scheduler: address of a Dask scheduler to run on instead.

    Raises:
        ConfigurationError: ``drawn_keys`` refuses the scenario, or the scheduler cannot be reached.
    """
    drawn_keys(scenario, options)
    folders = [folder / name for name in run_folders(runs)]
    parent = os.getpid() if scheduler is None else None
    calls = [joblib.delayed(one_run)(scenario, options, run, each, parent) for run, each in enumerate(folders)]
    with _backend(scheduler, jobs) as parallel:
        yield from parallel(calls)


class _backend:
    """joblib on local processes, or on a Dask scheduler."""

    def __init__(self, scheduler: str | None, jobs: int) -> None:
        self._scheduler, self._jobs, self._client = scheduler, jobs, None

    def __enter__(self) -> joblib.Parallel:
        if self._scheduler is None:
            return joblib.Parallel(n_jobs=self._jobs, return_as="generator")
        try:
            from dask.distributed import Client
        except ImportError:
            raise ConfigurationError("--scheduler needs Dask: pip install 'rnc_pin[dask]'") from None
        try:
            self._client = Client(self._scheduler, timeout=10)
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"--scheduler {self._scheduler}: cannot be reached: {error}") from None
        joblib.parallel_backend("dask")
        return joblib.Parallel(return_as="generator")

    def __exit__(self, *error: object) -> None:
        if self._client is not None:
            self._client.close()
        elif error[0] is not None and self._jobs != 1:
            # Otherwise this process waits until the workers finish their runs.
            get_reusable_executor().shutdown(wait=False, kill_workers=True)
