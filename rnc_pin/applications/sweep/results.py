"""Results of a sweep: its rows by column, and its reports."""

from __future__ import annotations

import csv
import json
import shlex
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypedDict, cast

import numpy as np

from rnc_pin.applications.scenario.files import one_line_yaml
from rnc_pin.applications.sweep.runs import Row, drawn_values, is_result_column, with_options_of_sweeps
from rnc_pin.applications.sweep.sweep_folder import Specification, read_rows, read_specification
from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.io import Json, atomic_file, dump_json
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin, counted

SUCCESSFUL = ("succeeded", "degraded")
"""Verdicts of runs that did not fail."""


class SweepResults(SummaryMixin):
    """Results of a sweep, with one row a run, in the order of the runs.

    ``results["final_error.tip_x"]`` is a column as an array, with NaN for missing numbers. An unfinished sweep has the
    rows of its finished runs.

    Args:
        path: folder of the sweep.

    Attributes:
        path: folder of the sweep.
        specification: all that decides the results, as JSON content.
        columns: names of the columns: number of the run, drawn values, results.

    Raises:
        ConfigurationError: the folder holds no sweep, or what is no run.

    Example:
        >>> import tempfile
        >>> folder = tempfile.TemporaryDirectory()
        >>> draws = [{"initial.q.joint_2": angle} for angle in (1.6, 1.7)]
        >>> quick = {"simulation.duration": 0.01}
        >>> results = rnc.sweep("space-robot", draws, out=folder.name, options=quick)
        >>> isinstance(results, rnc.SweepResults), results.columns[:2]
        (True, ['run', 'initial.q.joint_2'])
        >>> results["initial.q.joint_2"]
        array([1.6, 1.7])
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        found = read_specification(self.path)
        if found is None:
            raise ConfigurationError(f"{self.path}: holds no sweep")
        self.specification: Specification = found
        rows = {row["run"]: row for row in read_rows(self.path, found)}
        ordered = [rows[run] for run in sorted(rows)]
        self.columns = list(dict.fromkeys(name for row in ordered for name in row))
        self._values: dict[str, list[Any]] = {name: [row.get(name) for row in ordered] for name in self.columns}

    def __len__(self) -> int:
        return len(self._values.get("run", ()))

    @property
    def complete(self) -> bool:
        """True if no run is missing."""
        return len(self) == self.specification["runs"]

    @property
    def of(self) -> str:
        """Scenario or function of the runs."""
        return str(self.specification.get("scenario") or self.specification.get("build"))

    @property
    def drawn(self) -> list[str]:
        """Names of the drawn values."""
        return [name for name in self.columns if not is_result_column(name)]

    def __getitem__(self, column: str) -> np.ndarray:
        if column not in self._values:
            raise InputError(f"no column '{column}'{nearest(column, self.columns)}")
        values = self._values[column]
        kinds = {type(value) for value in values}
        if kinds in ({int}, {bool}):
            return np.array(values)
        # A missing number is NaN; a column of texts or mixed values stays as it is.
        if kinds - {type(None)} and kinds <= {int, float, type(None)}:
            return np.array(values, dtype=float)
        return np.fromiter(values, dtype=object, count=len(values))

    def rows(self) -> Iterator[Row]:
        """Yield runs as mappings by column; missing values are None."""
        return (self._row(place) for place in range(len(self)))

    def _row(self, place: int) -> Row:
        return {name: values[place] for name, values in self._values.items()}

    def failures(self) -> Iterator[Row]:
        """Runs that did not succeed."""
        return (row for row in self.rows() if row["verdict"] == "failed")

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of runs by outcome, such as "completed"."""
        return dict(sorted(Counter(self._values.get("outcome", ())).items()))

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of runs by verdict: "succeeded", "degraded", and of the others by the kind of their first failure."""
        pairs = zip(self._values.get("verdict", ()), self._values.get("finding", ()), strict=True)
        found = Counter(finding if verdict == "failed" else verdict for verdict, finding in pairs)
        first = [name for name in SUCCESSFUL if name in found]
        return {name: found[name] for name in (*first, *sorted(set(found) - set(first)))}

    def row(self, run: int) -> Row:
        """Return a run as a mapping by column; columns without a value are missing.

        Args:
            run: number of the run.

        Raises:
            InputError: the run is not finished, or there is no such run.
        """
        numbers = self._values.get("run", [])
        if run not in numbers:
            raise InputError(f"no finished run {run} in {self.path}")
        return {name: value for name, value in self._row(numbers.index(run)).items() if value is not None}

    def draw(self, run: int) -> dict[str, Json]:
        """Return the drawn values of a run.

        Args:
            run: number of the run.
        """
        return drawn_values(self.row(run))

    def command(self, run: int | Row) -> str:
        """Return the command that repeats a run of a scenario.

        Args:
            run: number of the run, or its row.

        Raises:
            InputError: the sweep is one of a function; call it with ``draw(run)``.
        """
        if "scenario" not in self.specification:
            raise InputError(f"{self.specification['build']} built the runs; call it with draw(run)")
        row = self.row(run) if isinstance(run, int) else run
        shared = {key: value for key, value in self.specification["options"].items() if key not in ("sweep", "seed")}
        options = {**with_options_of_sweeps(shared), **drawn_values(row)}
        words = [f"--set {shlex.quote(f'{key}={one_line_yaml(value)}')}" for key, value in options.items()]
        return f"rnc-pin run {shlex.quote(self.specification['scenario'])} {' '.join(words)}"

    def to_csv(self, path: str | Path) -> None:
        """Write all rows as CSV; numbers have all their digits.

        Args:
            path: the file.
        """
        with atomic_file(Path(path)) as partial, partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            writer.writerows(zip(*self._values.values(), strict=True))

    def _summary(self) -> ObjectSummary:
        found = sweep_statistics(self)
        verdicts = [
            Item(f"{count} {name if name in SUCCESSFUL else f'failed: {name}'}")
            for name, count in found["verdicts"].items()
        ]
        lines = [("verdicts", verdicts), ("drawn", [Item(name) for name in self.drawn])]
        if found["redrawn"]:
            lines.append(("infeasible draws", [Item(f"{found['redrawn']} were drawn again")]))
        for name, error in found["final_error"].items():
            figures = [Item(f"{kind} {value:.2e}") for kind, value in cast("dict[str, float]", error).items()]
            lines.append((f"final error of {name}", figures))
        failed = sum(count for name, count in found["verdicts"].items() if name not in SUCCESSFUL)
        headline = f"{failed} failed of {counted(len(self), 'run')}" if failed else counted(len(self), "run")
        return ObjectSummary(f"SweepResults: {headline} of {self.of}", lines)


def load_sweep(path: str | Path) -> SweepResults:
    """Read the results of a sweep, finished or not, with one row a run.

    Args:
        path: folder of the sweep.

    Raises:
        ConfigurationError: the folder holds no sweep, or what is no run.

    Example:
        >>> try:
        ...     rnc.load_sweep("nowhere")
        ... except rnc.ConfigurationError as error:
        ...     print(error)
        nowhere: holds no sweep
    """
    return SweepResults(path)


# ------------------------------------------------------------------ reports


ErrorStatistics = TypedDict("ErrorStatistics", {"median": float, "95 %": float, "max": float})
"""Statistics of the final errors of one output."""


class SweepStatistics(TypedDict):
    """Outcomes and verdicts of a sweep, and final errors of the completed runs by output."""

    runs: int
    redrawn: int
    outcomes: dict[str, int]
    verdicts: dict[str, int]
    final_error: dict[str, ErrorStatistics]


def sweep_statistics(results: SweepResults) -> SweepStatistics:
    """Return counts of outcomes, verdicts and redraws, and quantiles of the final errors of completed runs.

    Args:
        results: the sweep, finished or not.
    """
    errors: dict[str, ErrorStatistics] = {}
    for name in results.columns:
        if name.startswith("final_error."):
            values = _numbers(results, name)[results["outcome"] == "completed"]
            values = values[~np.isnan(values)]
            if len(values):
                median, high, largest = np.quantile(values, (0.5, 0.95, 1.0)).tolist()
                errors[name.removeprefix("final_error.")] = {"median": median, "95 %": high, "max": largest}
    return {
        "runs": len(results),
        "redrawn": int(np.nansum(_numbers(results, "redrawn"))) if "redrawn" in results.columns else 0,
        "outcomes": results.outcomes,
        "verdicts": results.verdicts,
        "final_error": errors,
    }


def _numbers(results: SweepResults, column: str) -> np.ndarray:
    """Column of results that are numbers; a column without any is NaN."""
    return np.asarray(results[column], dtype=float)


def failure_lines(results: SweepResults, row: Row) -> Iterator[str]:
    """Two lines about a run that did not succeed: finding and message, and the command that repeats it.

    Args:
        results: the sweep.
        row: row of the run.
    """
    yield f"# run {row['run']}: {row['finding']}: {row['message']}"
    if "scenario" in results.specification:
        yield results.command(row)
    else:
        yield f"{results.of}({json.dumps(drawn_values(row))})"


def write_reports(results: SweepResults) -> None:
    """Write ``sweep.json`` and ``failures.txt`` into the folder of a sweep.

    Args:
        results: the sweep.
    """
    if not len(results):
        return
    with atomic_file(results.path / "sweep.json") as partial:
        content = {"scenario": results.of, **sweep_statistics(results)}
        partial.write_text(dump_json(content) + "\n", encoding="utf-8")
    failures = results.path / "failures.txt"
    lines = [f"{line}\n" for row in results.failures() for line in failure_lines(results, row)]
    if lines:
        with atomic_file(failures) as partial:
            partial.write_text("".join(lines), encoding="utf-8")
    else:
        failures.unlink(missing_ok=True)
