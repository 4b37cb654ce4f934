"""Specification of a sweep: all that decides its results. A folder continues only the sweep that it holds."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from rnc_pin._kernel import kernel
from rnc_pin.applications.scenario.files import find_scenario, is_built_in, read_yaml
from rnc_pin.applications.scenario.output_folder import lock_folder
from rnc_pin.applications.sweep.row_tables import Kinds
from rnc_pin.applications.sweep.run_store import blocks_of, journal_file, part_file
from rnc_pin.errors import ConfigurationError, short_text
from rnc_pin.io import TEMPORARY_PREFIX, Json, atomic_file, read_bytes
from rnc_pin.version import __version__

SPECIFICATION = "specification.json"
"""File of the specification in the folder of a sweep."""
RUNS = "runs"
"""Folder of the data set in the folder of a sweep."""
REPORTS = ("sweep.json", "failures.txt", "distributions.png")
"""Files that a sweep writes when it is complete."""
_FREE = ("runs", "kinds")  # parts that may differ when a sweep continues


def specification_of(
    what: Mapping[str, Json], draws: Mapping[str, Json], runs: int | None, trajectories: bool, kinds: Kinds
) -> dict[str, Json]:
    """Specification of a sweep as JSON content.

    Args:
        what: description of what is simulated.
        draws: description of seeded draws; empty if values are given.
        runs: number of runs; None if it is not known.
        trajectories: True if trajectories are written.
        kinds: kinds of the drawn values.
    """
    versions = {"rnc_pin": __version__, "kernel": kernel}
    common: dict[str, Json] = {"draws": dict(draws), "trajectories": trajectories, "runs": runs, "kinds": dict(kinds)}
    return {**versions, **what, **common}


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
    lock: int | None = None
    try:
        if path.exists() and not path.is_dir():
            raise ConfigurationError(f"--out {path}: is a file, expected a folder")
        path.mkdir(parents=True, exist_ok=True)
        lock = lock_folder(path)
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
    except OSError as error:
        raise ConfigurationError(f"--out {path}: cannot be written: {error.strerror}") from None
    finally:
        if lock is not None:
            os.close(lock)


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
