"""Folder of a sweep: its specification, and a line of JSON for each finished run.

The specification is all that decides the results. A folder continues only the sweep that it holds. A kill can cut off
the last line: it counts as no run.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from io import BufferedRandom
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard

from rnc_pin.applications.scenario.files import find_scenario, is_built_in, read_yaml
from rnc_pin.applications.scenario.output_folder import lock_folder, one_line_errors
from rnc_pin.applications.sweep.runs import MOST_DRAWS, TEXTS, Row, SeededDraws, is_number_column
from rnc_pin.errors import ConfigurationError, short_text
from rnc_pin.io import LARGEST, TEMPORARY_PREFIX, Json, atomic_file, open_regular, read_bytes

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
    path, runs, draws = folder / RUNS, specification["runs"], specification.get("draws")
    seeded = SeededDraws.of(draws["distributions"], draws["seed"]) if draws else None
    number, seen = 0, set()
    try:
        with open_regular(path) as file:
            for line in iter(partial(file.readline, LARGEST), b""):
                number += 1
                if line.endswith(b"\n"):
                    row = json.loads(line)
                    _check_row(row, _MOST if runs is None else runs)
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


def _check_row(row: object, runs: int) -> None:
    """Raise ValueError unless JSON content is the row of one of so many runs."""
    if not isinstance(row, dict):
        raise ValueError(f"expected a mapping, found {short_text(row)}")
    run = row.get("run")
    if type(run) is not int or not 0 <= run < runs:
        raise ValueError(f"run: expected a number from 0 to {runs - 1}, found {short_text(run)}")
    for name in TEXTS:
        if not isinstance(row.get(name), str):
            raise ValueError(f"{name}: expected text, found {short_text(row.get(name))}")
    for name, value in row.items():
        if type(value) is int and abs(value) >= _MOST:
            raise ValueError(f"{name}: {short_text(value)} is too large")
        if is_number_column(name) and type(value) not in (int, float, type(None)):
            raise ValueError(f"{name}: expected a number, found {short_text(value)}")


def _check_draw(row: Row, draws: SeededDraws) -> None:
    """Raise ValueError unless the draws of the run are the drawn values of a row."""
    redrawn = row.get("redrawn", 0)
    if type(redrawn) is not int or not 0 <= redrawn < MOST_DRAWS:
        raise ValueError(f"redrawn: expected a number from 0 to {MOST_DRAWS - 1}, found {short_text(redrawn)}")
    for name, value in next(islice(draws.of_run(row["run"]), redrawn, None)).items():
        if row.get(name) != value:
            raise ValueError(f"{name}: run {row['run']} of this sweep draws {value}, found {short_text(row.get(name))}")


def append_row(file: BufferedRandom, row: Row) -> None:
    """Append the row of a finished run, which a kill of this process does not undo.

    Args:
        file: file of the finished runs, at its end.
        row: the row.
    """
    # One write: a kill leaves whole lines, and at most one torn line, which is cut off later.
    file.write(json.dumps(row).encode() + b"\n")
    file.flush()


def _cut_off_torn_line(file: BufferedRandom) -> None:
    """Cut off an incomplete last line, so that the next one begins on a line of its own."""
    size = file.seek(0, os.SEEK_END)
    start = file.seek(max(0, size - LARGEST))
    file.truncate(start + file.read().rfind(b"\n") + 1)
    file.seek(0, os.SEEK_END)


# ------------------------------------------------------------------ specification


def describe_scenario(scenario: str, options: Mapping[str, Json], read: Collection[Path]) -> dict[str, Json]:
    """Name, options and digests of a scenario and of the files that were read for it.

    Args:
        scenario: a built-in name or a file.
        options: dotted keys and values that all runs share.
        read: files from which robots and obstacles are read.
    """
    path = find_scenario(scenario).resolve()
    name = scenario if is_built_in(path) else str(path)
    content = _digest(json.dumps(read_yaml(path), default=repr).encode())
    files: dict[str, Json] = {}
    for each in sorted(read):  # files of other folders by name: a package may be elsewhere on another computer
        place = str(each.relative_to(path.parent)) if each.is_relative_to(path.parent) else each.name
        with open_regular(each) as file:
            files[place] = str(files.get(place, "")) + hashlib.file_digest(file, "sha256").hexdigest()[:16]
    return {"scenario": name, "options": dict(options), "content": content, "files": files}


def describe_function(build: Callable[..., object]) -> dict[str, Json]:
    """Name of a function and digest of its source, if it has one.

    Args:
        build: the function of the drawn values.
    """
    name = f"{getattr(build, '__module__', '?')}.{getattr(build, '__qualname__', type(build).__qualname__)}"
    try:
        source = _digest(inspect.getsource(build).encode())
    except (OSError, TypeError):
        source = ""
    return {"build": name, "source": source}


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


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
    draws = content.get("draws") or {"seed": 0, "distributions": {}}
    if (
        not isinstance(draws, dict)
        or type(draws.get("seed")) is not int
        or type(draws.get("distributions")) is not dict
    ):
        return False
    of_scenario = isinstance(content.get("scenario"), str) and isinstance(content.get("options"), dict)
    return of_scenario or isinstance(content.get("build"), str)


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
        if path.exists() and not path.is_dir():
            raise ConfigurationError(f"--out {path}: is a file, expected a folder")
        path.mkdir(parents=True, exist_ok=True)
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
        (path / RUNS).touch()
        file = stack.enter_context((path / RUNS).open("r+b"))
        _cut_off_torn_line(file)
        yield file


def _check_same(path: Path, earlier: Specification, now: Specification) -> None:
    """Raise an error unless a folder holds the same sweep, with at most as many runs."""
    for key in dict.fromkeys([*now, *earlier]):
        # More runs continue a sweep: each run has its own stream, so the first ones stay as they are.
        if key != "runs" and earlier.get(key) != now.get(key):
            place, old, new = _difference(key, earlier.get(key), now.get(key))
            raise ConfigurationError(
                f"--out {path}: holds another sweep: its {place} is {short_text(old)}, not {short_text(new)}; choose "
                "another folder or add --force"
            )
    if earlier["runs"] is not None and now["runs"] is not None and now["runs"] < earlier["runs"]:
        raise ConfigurationError(
            f"--out {path}: holds a sweep of {earlier['runs']} runs, more than {now['runs']}; choose another folder or "
            "add --force"
        )


def _difference(place: str, old: object, new: object) -> tuple[str, object, object]:
    """First difference of two contents: its place, and both values."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in dict.fromkeys([*new, *old]):
            if old.get(key) != new.get(key):
                return _difference(f"{place}.{key}", old.get(key), new.get(key))
    return place, old, new


def _clean(path: Path, everything: bool) -> None:
    """Delete files of killed sweeps, and with ``everything`` files of an earlier sweep."""
    runs = path / RUNS
    if runs.is_symlink() or (runs.exists() and not runs.is_file()):
        raise ConfigurationError(f"--out {path}: '{RUNS}' is not a sweep's own; choose another folder")
    old = [*path.glob(f"{TEMPORARY_PREFIX}*")]
    if everything:
        old += [runs, *(path / name for name in REPORTS)]
    for each in old:
        if each.is_file() or each.is_symlink():
            each.unlink()
