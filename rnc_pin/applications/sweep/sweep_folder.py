"""Folder of a sweep: its specification, and its finished runs, such that a kill loses none of them.

The specification is all that decides the results. A folder continues only the sweep that it holds.

Runs with consecutive numbers form a block. Each finished run adds a line to the journal of its block; when the block is
complete, it is written as one Parquet file and its journal is deleted. Memory holds only the numbers of runs in open
blocks.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any, TypeAlias

from rnc_pin.applications.scenario.files import find_scenario, is_built_in, read_yaml
from rnc_pin.applications.scenario.output_folder import lock_folder, one_line_errors
from rnc_pin.applications.sweep.rows import Row, plain_rows, read_part, schema_of, table_of, write_part
from rnc_pin.errors import ConfigurationError, short_text
from rnc_pin.io import TEMPORARY_PREFIX, Json, atomic_file, read_bytes

BLOCK = 5000
"""Runs of a block."""
_PART, _JOURNAL = re.compile(r"part_(\d{7,})\.parquet"), re.compile(r"journal_(\d{7,})\.jsonl")


def part_file(folder: Path, block: int) -> Path:
    """Parquet file of a block."""
    return folder / f"part_{block:07d}.parquet"


def journal_file(folder: Path, block: int) -> Path:
    """Journal of a block."""
    return folder / f"journal_{block:07d}.jsonl"


def blocks_of(folder: Path) -> tuple[set[int], set[int]]:
    """Blocks with a Parquet file, and blocks with a journal."""
    found: tuple[set[int], set[int]] = (set(), set())
    for path in folder.iterdir() if folder.is_dir() else ():
        for blocks, pattern in zip(found, (_PART, _JOURNAL), strict=True):
            match = pattern.fullmatch(path.name)
            if match is not None:
                blocks.add(int(match[1]))
    return found


def journal_rows(folder: Path, block: int) -> list[Row]:
    """Rows of a journal in order. A line that a kill cut off is left out.

    Raises:
        ConfigurationError: the journal cannot be read.
    """
    path = journal_file(folder, block)
    try:
        lines = path.read_bytes().split(b"\n")[:-1]  # what follows the last line break was cut off
        rows = {row["run"]: row for row in map(json.loads, lines)}
    except FileNotFoundError:
        return []
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from None
    return [rows[run] for run in sorted(rows)]


def block_rows(folder: Path, block: int) -> list[Row]:
    """Rows of a block in order, from its Parquet file and its journal."""
    path = part_file(folder, block)
    rows = {row["run"]: row for row in plain_rows(read_part(path))} if path.exists() else {}
    rows |= {row["run"]: row for row in journal_rows(folder, block)}
    return [rows[run] for run in sorted(rows)]


class RunStore:
    """Finished runs of a sweep in a folder, which it may complete.

    Args:
        folder: folder of the Parquet files.
        kinds: kinds of drawn values.
    """

    def __init__(self, folder: Path, kinds: Mapping[str, str]) -> None:
        self._folder, self.kinds = folder, dict(kinds)
        self._complete: set[int] = set()
        self._open: dict[int, set[int]] = {}
        self._unsealed: set[int] = set()  # open blocks with a journal
        folder.mkdir(parents=True, exist_ok=True)
        for leftover in folder.glob(f"{TEMPORARY_PREFIX}*"):
            leftover.unlink()
        parts, journals = blocks_of(folder)
        for block in parts:
            if schema_of(part_file(folder, block))[1] == BLOCK:
                self._complete.add(block)
                journal_file(folder, block).unlink(missing_ok=True)
            else:
                self._open[block] = set(read_part(part_file(folder, block), ["run"])["run"].to_pylist())
        for block in journals - self._complete:
            self._repair(block)
            self._open.setdefault(block, set()).update(row["run"] for row in journal_rows(folder, block))
            self._unsealed.add(block)
            self._seal_if_complete(block)

    def _repair(self, block: int) -> None:
        """Cut off an incomplete line, so that the next one begins on a line of its own."""
        with journal_file(self._folder, block).open("r+b") as file:
            content = file.read()
            file.truncate(content.rfind(b"\n") + 1)

    def __len__(self) -> int:
        return BLOCK * len(self._complete) + sum(map(len, self._open.values()))

    def __contains__(self, run: int) -> bool:
        return run // BLOCK in self._complete or run in self._open.get(run // BLOCK, ())

    def last(self) -> int:
        """Largest number of a finished run; -1 without any."""
        ends = [BLOCK * (block + 1) - 1 for block in self._complete]
        return max([*ends, *(run for runs in self._open.values() for run in runs)], default=-1)

    def add(self, rows: Iterable[Row]) -> None:
        """Record finished runs."""
        for block, group in groupby(rows, key=lambda row: int(row["run"]) // BLOCK):
            some = list(group)
            text = "".join(f"{json.dumps(row)}\n" for row in some)
            with journal_file(self._folder, block).open("a", encoding="utf-8") as file:
                file.write(text)
            self._open.setdefault(block, set()).update(row["run"] for row in some)
            self._unsealed.add(block)
            self._seal_if_complete(block)

    def finish(self) -> None:
        """Write the open blocks as Parquet files too: there are no further runs."""
        for block in sorted(self._unsealed):
            self._seal(block)

    def _seal_if_complete(self, block: int) -> None:
        if len(self._open[block]) == BLOCK:
            self._seal(block)
            self._complete.add(block)
            del self._open[block]

    def _seal(self, block: int) -> None:
        write_part(table_of(block_rows(self._folder, block), self.kinds), part_file(self._folder, block))
        journal_file(self._folder, block).unlink(missing_ok=True)
        self._unsealed.discard(block)


# ------------------------------------------------------------------ specification

SPECIFICATION = "specification.json"
"""File of the specification in the folder of a sweep."""
RUNS = "runs"
"""Folder of the data set in the folder of a sweep."""
REPORTS = ("sweep.json", "failures.txt", "distributions.png")
"""Files that a sweep writes when it is complete."""
_FREE = ("runs", "kinds")  # parts that may differ when a sweep continues


def describe_scenario(scenario: str, options: Mapping[str, Json]) -> dict[str, Json]:
    """Name, options and digests of a scenario and its robot's file."""
    path = find_scenario(scenario).resolve()
    raw = read_yaml(path)
    name = scenario if is_built_in(path) else str(path)
    robot = raw.get("robot")
    files = [robot.get(key) for key in ("urdf", "mjcf")] if isinstance(robot, Mapping) else []
    digests = [
        _digest(read_bytes(path.parent / str(each))) for each in files if each and (path.parent / str(each)).is_file()
    ]
    content = _digest(json.dumps(raw, default=repr).encode())
    return {"scenario": name, "options": dict(options), "content": [content, *digests]}


def describe_function(build: Callable[..., object]) -> dict[str, Json]:
    """Name of a function and digest of its source, if it has one."""
    name = f"{getattr(build, '__module__', '?')}.{getattr(build, '__qualname__', type(build).__qualname__)}"
    try:
        source = _digest(inspect.getsource(build).encode())
    except (OSError, TypeError):
        source = ""
    return {"build": name, "source": source}


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


Specification: TypeAlias = dict[str, Any]
"""Specification of a sweep as JSON content: its runs, their source, distributions and kinds of values."""


def read_specification(folder: Path) -> Specification | None:
    """Specification of the sweep in a folder; None if there is none.

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
    if not isinstance(content, dict) or "runs" not in content:
        raise ConfigurationError(f"{path}: is not the specification of a sweep")
    return content


@contextmanager
def sweep_folder(path: Path, specification: Mapping[str, Json], force: bool) -> Iterator[bool]:
    """Lock the folder of a sweep and write the specification into it. Yield True if it continues an earlier sweep.

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
        stack.callback(os.close, lock_folder(path))
        content = json.dumps(specification, indent=2)
        earlier = None if force else read_specification(path)
        if earlier is None and not force and any(path.iterdir()):
            raise ConfigurationError(f"--out {path}: exists and holds no sweep; choose another folder or add --force")
        if earlier is not None:
            _check_same(path, earlier, json.loads(content))
        if (path / RUNS).is_symlink():
            raise ConfigurationError(f"--out {path}: '{RUNS}' is a link; choose another folder")
        _clean(path, everything=earlier is None)
        with atomic_file(path / SPECIFICATION) as partial:
            partial.write_text(content + "\n", encoding="utf-8")
        yield earlier is not None


def _check_same(path: Path, earlier: Specification, now: Specification) -> None:
    """Raise an error unless a folder holds the same sweep, with at most as many runs."""
    for key in dict.fromkeys([*now, *earlier]):
        if key not in _FREE and earlier.get(key) != now.get(key):
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
    """Delete files of killed sweeps, and with ``everything`` those of an earlier sweep."""
    for folder in (path, path / "trajectories"):  # the run store cleans its own
        for leftover in folder.glob(f"{TEMPORARY_PREFIX}*"):
            if leftover.is_file() or leftover.is_symlink():
                leftover.unlink()
    if not everything:
        return
    parts, journals = blocks_of(path / RUNS)
    for block in parts:
        part_file(path / RUNS, block).unlink()
    for block in journals:
        journal_file(path / RUNS, block).unlink()
    for trajectory in (path / "trajectories").glob("run_" + "[0-9]" * 7 + "*.npz"):
        trajectory.unlink()
    for name in REPORTS:
        (path / name).unlink(missing_ok=True)
