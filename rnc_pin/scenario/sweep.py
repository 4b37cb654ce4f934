"""Many runs of one scenario with drawn values, in parallel."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.scenario.loading import find_scenario, read_yaml, validate, with_options
from rnc_pin.scenario.output import OutputFolder
from rnc_pin.scenario.run import execute, plan, write


def draw(scenario: str, options: dict[str, Any], runs: int) -> list[dict[str, Any]]:
    """Options of every run: what the scenario's ``sweep`` says is drawn uniformly, from a seed of its own each.

    Raises:
        ConfigurationError: the scenario has no ``sweep``, or a range runs backwards.
    """
    path = find_scenario(scenario)
    checked = validate(with_options(read_yaml(path), options), path.name)
    if not checked.sweep:
        raise ConfigurationError(
            f"{path.name}: sweep: is missing; give dotted keys and ranges, e.g. initial.q.joint: [0, 1]"
        )
    for key, (low, high) in checked.sweep.items():
        if low > high:
            raise ConfigurationError(f"{path.name}: sweep.{key}: range [{low:g}, {high:g}] runs backwards")
    drawn = []
    for run in range(runs):
        generator = np.random.default_rng([checked.seed, run])
        values = {key: float(generator.uniform(low, high)) for key, (low, high) in checked.sweep.items()}
        drawn.append({**options, "comparisons": {}, "seed": checked.seed, **values})
    return drawn


def one_run(scenario: str, options: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A row of the table: what was drawn, how the run ended, its errors. Results stand in a folder of its own."""
    drawn = {key: value for key, value in options.items() if isinstance(value, float)}
    try:
        prepared = plan(scenario, options)
        result = execute(prepared)
        write(prepared, result, OutputFolder(folder), pictures=False)
    except RncError as error:
        return {**drawn, "outcome": "refused", "message": str(error)}
    summary = result.summary
    errors = {f"final_error.{name}": value for name, value in summary["final_error"].items()}
    return {
        **drawn,
        "outcome": summary["outcome"],
        **errors,
        "min_singular_value": summary["min_singular_value"],
        "constraint_residual_max": summary["constraint_residual_max"],
        "message": summary.get("message", ""),
    }


def sweep(
    scenario: str, options: dict[str, Any], runs: int, out: OutputFolder, jobs: int = 1, scheduler: str | None = None
) -> Iterator[dict[str, Any]]:
    """Run a sweep, yielding rows in order as they are done.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values that all runs share.
        runs: how many.
        out: each run writes a folder in it.
        jobs: local processes; -1 for all cores.
        scheduler: address of a Dask scheduler to run on instead.

    Raises:
        ConfigurationError: nothing to draw, or the scheduler cannot be reached.
    """
    drawn = draw(scenario, options, runs)
    folders = [out.folder(f"run_{run:04d}") for run in range(runs)]
    calls = [joblib.delayed(one_run)(scenario, each, folder) for each, folder in zip(drawn, folders, strict=True)]
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


def write_table(rows: list[dict[str, Any]], path: Path) -> None:
    """Write rows as CSV; a column for every key that any row has."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        writer.writerows(rows)


def spread(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Outcomes counted, and median and largest final errors of the runs that completed."""
    outcomes: dict[str, int] = {}
    for row in rows:
        outcomes[row["outcome"]] = outcomes.get(row["outcome"], 0) + 1
    done = [row for row in rows if row["outcome"] == "completed"]
    names = [key for key in (done[0] if done else {}) if key.startswith("final_error.")]
    errors = {
        name.removeprefix("final_error."): {
            "median": float(np.median([row[name] for row in done])),
            "max": float(np.max([row[name] for row in done])),
        }
        for name in names
    }
    return {"runs": len(rows), "outcomes": outcomes, "final_error": errors}
