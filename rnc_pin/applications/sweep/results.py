"""Folder of a sweep, and its results: rows by column, and reports.

A folder holds the specification, and a line of JSON for each finished run. The specification is all that decides the
results. A folder continues only the sweep that it holds. A kill can cut off the last line: it counts as no run.
"""

from __future__ import annotations

import csv
import json
import os
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from io import BufferedRandom
from itertools import islice
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias, TypedDict, TypeGuard

import numpy as np

from rnc_pin.applications.scenario.files import one_line_yaml
from rnc_pin.applications.scenario.output_folder import lock_folder, one_line_errors
from rnc_pin.applications.sweep import runs
from rnc_pin.applications.sweep.runs import Row, SeededDraws
from rnc_pin.errors import ConfigurationError, InputError, place_of, short_text
from rnc_pin.io import LARGEST, TEMPORARY_PREFIX, Json, atomic_file, dump_json, open_regular, read_bytes
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin, counted

SPECIFICATION = "specification.json"
"""File of the specification in the folder of a sweep."""
RUNS = "runs.jsonl"
"""File of the finished runs, in the order in which they finished."""
REPORTS = ("sweep.json", "failures.txt")
"""Files that a sweep writes when it is complete."""
_MOST = 2**63  # beyond, NumPy has no integers

# ------------------------------------------------------------------ finished runs


def read_rows(folder: Path, specification: Specification) -> Iterator[Row]:
    """Yield the rows of the finished runs. A line that a kill cut off is left out.

    Args:
        folder: folder of the sweep.
        specification: its specification.

    Raises:
        ConfigurationError: the file cannot be read, or a line is not the row of a run of this sweep, with its draw.
    """
    path, count, draws = folder / RUNS, specification["runs"], specification.get("draws")
    seeded = SeededDraws.of(draws["distributions"], draws["seed"]) if draws else None
    number, seen = 0, set()
    try:
        with open_regular(path) as file:
            # Bounded: a file may be larger than the memory, and a damaged line too.
            for line in iter(partial(file.readline, LARGEST), b""):
                number += 1
                if line.endswith(b"\n"):
                    row = json.loads(line)
                    _check_row(row, _MOST if count is None else count)
                    if seeded is not None:
                        _check_draw(row, seeded)
                    if row["run"] in seen:
                        raise ValueError(f"run: {row['run']} is there twice")
                    seen.add(row["run"])
                    yield row
    except FileNotFoundError:
        return
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: line {number} is not the row of a run: {error}") from None


def _check_row(row: object, count: int) -> None:
    """Raise ValueError unless JSON content is the row of one of so many runs."""
    if not isinstance(row, dict):
        raise ValueError(f"expected a mapping, found {short_text(row)}")
    run = row.get("run")
    # Not isinstance: True is an integer for Python.
    if type(run) is not int or not 0 <= run < count:
        raise ValueError(f"run: expected a number from 0 to {count - 1}, found {short_text(run)}")
    for name in runs.TEXTS:
        if not isinstance(row.get(name), str):
            raise ValueError(f"{name}: expected text, found {short_text(row.get(name))}")
    for name, value in row.items():
        if type(value) is int and abs(value) >= _MOST:
            raise ValueError(f"{name}: {short_text(value)} is too large")
        if runs.is_number_column(name) and type(value) not in (int, float, type(None)):
            raise ValueError(f"{name}: expected a number, found {short_text(value)}")


def _check_draw(row: Row, draws: SeededDraws) -> None:
    """Raise ValueError unless the draws of the run are the drawn values of a row."""
    redrawn = row.get("redrawn", 0)
    if type(redrawn) is not int or not 0 <= redrawn < runs.MOST_DRAWS:
        raise ValueError(f"redrawn: expected a number from 0 to {runs.MOST_DRAWS - 1}, found {short_text(redrawn)}")
    for name, value in next(islice(draws.of_run(row["run"]), redrawn, None)).items():
        if row.get(name) != value:
            raise ValueError(f"{name}: run {row['run']} of this sweep draws {value}, found {short_text(row.get(name))}")


# ------------------------------------------------------------------ specification


Specification: TypeAlias = dict[str, Any]
"""Specification of a sweep as JSON content: its runs, their source and distributions."""


def read_specification(folder: Path) -> Specification | None:
    """Specification of the sweep in a folder; None if there is none.

    Args:
        folder: folder of the sweep.

    Raises:
        ConfigurationError: it cannot be read.
    """
    path = folder / SPECIFICATION
    if not os.path.lexists(path):
        return None
    try:
        content = json.loads(read_bytes(path))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from None
    if not _is_specification(content):
        raise ConfigurationError(f"{path}: is not the specification of a sweep")
    return content


def _is_specification(content: object) -> TypeGuard[Specification]:
    if not isinstance(content, dict) or type(content.get("runs", "")) not in (int, type(None)):
        return False
    # Without distributions: the values of each run were given.
    draws = content.get("draws") or {"seed": 0, "distributions": {}}
    given = [type(draws.get(key)) for key in ("seed", "distributions")] if isinstance(draws, dict) else []
    of_scenario = isinstance(content.get("scenario"), str) and isinstance(content.get("options"), dict)
    return given == [int, dict] and (of_scenario or isinstance(content.get("build"), str))


# ------------------------------------------------------------------ folder


@contextmanager
def sweep_folder(path: Path, specification: Specification, force: bool) -> Iterator[BufferedRandom]:
    """Lock the folder of a sweep, write the specification into it, and yield the file of its finished runs.

    Args:
        path: the folder, created with its parents.
        specification: specification of the sweep.
        force: replace another sweep, and write beside other files.

    Raises:
        ConfigurationError: the folder holds another sweep or other files, another process writes there, or it cannot
            be written.
    """
    with one_line_errors(f"--out {path}"), ExitStack() as stack:
        # Before anything is read: another process could write between a look and the lock.
        stack.callback(os.close, lock_folder(path))
        earlier = None if force else read_specification(path)
        if earlier is None and not force and any(path.iterdir()):
            raise ConfigurationError(f"--out {path}: exists and holds no sweep; choose another folder or add --force")
        content = json.dumps(specification, indent=2)
        if earlier is not None:
            _check_same(path, earlier, json.loads(content))
        _clean(path, everything=earlier is None)
        # After the old runs are gone: a kill in between leaves a folder without runs, and not runs of another sweep.
        with atomic_file(path / SPECIFICATION) as partial:
            partial.write_text(content + "\n", encoding="utf-8")
        # To read its last line and to append: this mode needs a file.
        (path / RUNS).touch()
        file = stack.enter_context((path / RUNS).open("r+b"))
        size = file.seek(0, os.SEEK_END)
        # An incomplete last line is cut off, so that the next one begins on a line of its own. The end alone is read:
        # no row is longer than ``LARGEST``.
        start = file.seek(max(0, size - LARGEST))
        file.truncate(start + file.read().rfind(b"\n") + 1)
        file.seek(0, os.SEEK_END)
        yield file


def _check_same(path: Path, earlier: Specification, now: Specification) -> None:
    """Raise an error unless a folder holds the same sweep, with at most as many runs."""
    hint = "choose another folder or add --force"
    # More runs continue a sweep: each run has its own stream, so the first ones stay as they are.
    for place, old, new in _differences("", {**earlier, "runs": None}, {**now, "runs": None}):
        # One place and not both files: that is what a user has to change back.
        found = f"its {place} is {short_text(old)}, not {short_text(new)}"
        raise ConfigurationError(f"--out {path}: holds another sweep: {found}; {hint}")
    if earlier["runs"] is not None and now["runs"] is not None and now["runs"] < earlier["runs"]:
        raise ConfigurationError(
            f"--out {path}: holds a sweep of {earlier['runs']} runs, more than {now['runs']}; {hint}"
        )


def _differences(place: str, old: object, new: object) -> Iterator[tuple[str, object, object]]:
    """Differences of two contents: place, and both values."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in dict.fromkeys([*new, *old]):
            yield from _differences(f"{place}.{key}" if place else key, old.get(key), new.get(key))
    elif old != new:
        yield place, old, new


def _clean(path: Path, everything: bool) -> None:
    """Delete files of killed sweeps, and with ``everything`` files of an earlier sweep."""
    finished = path / RUNS
    if finished.is_symlink() or (finished.exists() and not finished.is_file()):
        raise ConfigurationError(f"--out {path}: '{RUNS}' is not a sweep's own; choose another folder")
    old = [*path.glob(f"{TEMPORARY_PREFIX}*")]
    if everything:
        old += [finished, *(path / name for name in REPORTS)]
    for each in old:
        # A link itself, and not what it points to.
        if each.is_file() or each.is_symlink():
            each.unlink()


# ---------------------------------------------------------------------- results


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
        # Runs finish in any order, and a sweep that continues appends: readers want the order of the runs.
        self._rows = sorted(read_rows(self.path, found), key=itemgetter("run"))
        self.columns = list(dict.fromkeys(name for row in self._rows for name in row))

    def __len__(self) -> int:
        return len(self._rows)

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
        return [name for name in self.columns if not runs.is_result_column(name)]

    def __getitem__(self, column: str) -> np.ndarray:
        place_of(column, self.columns, "no column", InputError)
        values = [row.get(column) for row in self._rows]
        kinds = {type(value) for value in values}
        if kinds in ({int}, {bool}):
            return np.array(values)
        # A missing number is NaN; a column of texts or mixed values stays as it is.
        if kinds <= {int, float, type(None)}:
            return np.array(values, dtype=float)
        return np.fromiter(values, dtype=object, count=len(values))

    def rows(self) -> Iterator[Row]:
        """Yield runs as mappings by column; missing values are None."""
        return ({name: row.get(name) for name in self.columns} for row in self._rows)

    def failures(self) -> Iterator[Row]:
        """Runs that did not succeed."""
        return (row for row in self.rows() if row["verdict"] == "failed")

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of runs by outcome, such as "completed"."""
        return dict(sorted(Counter(row["outcome"] for row in self._rows).items()))

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of runs by verdict: "succeeded", "degraded", and of the others by the kind of their first failure."""
        found = Counter(row["finding"] if row["verdict"] == "failed" else row["verdict"] for row in self._rows)
        first = [name for name in SUCCESSFUL if name in found]
        return {name: found[name] for name in (*first, *sorted(set(found) - set(first)))}

    def row(self, run: int) -> Row:
        """Return a run as a mapping by column; columns without a value are missing.

        Args:
            run: number of the run.

        Raises:
            InputError: the run is not finished, or there is no such run.
        """
        found = next((row for row in self._rows if row["run"] == run), None)
        if found is None:
            raise InputError(f"no finished run {run} in {self.path}")
        return {name: value for name, value in found.items() if value is not None}

    def draw(self, run: int) -> dict[str, Json]:
        """Return the drawn values of a run.

        Args:
            run: number of the run.
        """
        return runs.drawn_values(self.row(run))

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
        # The row has its draw and its seed: with these, ``rnc-pin run`` repeats the run alone.
        shared = {key: value for key, value in self.specification["options"].items() if key not in ("sweep", "seed")}
        options = {**runs.with_options_of_sweeps(shared), **runs.drawn_values(row)}
        words = [f"--set {shlex.quote(f'{key}={one_line_yaml(value)}')}" for key, value in options.items()]
        return f"rnc-pin run {shlex.quote(self.specification['scenario'])} {' '.join(words)}"

    def to_csv(self, path: str | Path) -> None:
        """Write all rows as CSV; numbers have all their digits.

        Args:
            path: the file.
        """
        with atomic_file(Path(path)) as partial, partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, self.columns)
            writer.writeheader()
            writer.writerows(self._rows)

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
            lines.append((f"final error of {name}", [Item(f"{kind} {value:.2e}") for kind, value in error.items()]))
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


class SweepStatistics(TypedDict):
    """Outcomes and verdicts of a sweep, and final errors of the completed runs by output."""

    runs: int
    redrawn: int
    outcomes: dict[str, int]
    verdicts: dict[str, int]
    final_error: dict[str, dict[str, float]]
    """By output: median, 95 % and max."""


def sweep_statistics(results: SweepResults) -> SweepStatistics:
    """Return counts of outcomes, verdicts and redraws, and quantiles of the final errors of completed runs.

    Args:
        results: the sweep, finished or not.
    """
    errors: dict[str, dict[str, float]] = {}
    for name in results.columns:
        if name.startswith("final_error."):
            # Errors of a run that ended early are those of a moment on the way.
            values = results[name][results["outcome"] == "completed"]
            values = values[~np.isnan(values)]
            if len(values):
                median, high, largest = np.quantile(values, (0.5, 0.95, 1.0)).tolist()
                errors[name.removeprefix("final_error.")] = {"median": median, "95 %": high, "max": largest}
    return {
        "runs": len(results),
        "redrawn": int(np.nansum(results["redrawn"])) if "redrawn" in results.columns else 0,
        "outcomes": results.outcomes,
        "verdicts": results.verdicts,
        "final_error": errors,
    }


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
        yield f"{results.of}({json.dumps(runs.drawn_values(row))})"


def write_reports(results: SweepResults) -> None:
    """Write ``sweep.json`` and ``failures.txt`` into the folder of a sweep.

    Args:
        results: the sweep.
    """
    if not len(results):
        return
    with atomic_file(results.path / "sweep.json") as partial:
        partial.write_text(dump_json({"scenario": results.of, **sweep_statistics(results)}) + "\n", encoding="utf-8")
    lines = [f"{line}\n" for row in results.failures() for line in failure_lines(results, row)]
    if lines:
        with atomic_file(results.path / "failures.txt") as partial:
            partial.write_text("".join(lines), encoding="utf-8")
