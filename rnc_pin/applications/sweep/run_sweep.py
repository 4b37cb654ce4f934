"""Sweep: many runs with drawn values, in this process, in local processes, or on a Dask cluster."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sized
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack, closing
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, cast

import cloudpickle
from joblib import Parallel, cpu_count, delayed, parallel_config

from rnc_pin._kernel import kernel
from rnc_pin.applications.sweep.results import SweepResults, read_rows, sweep_folder, write_reports
from rnc_pin.applications.sweep.runs import Build, Draw, Draws, Numbered, Row, Runs, check_names, drawn_values, runs_of
from rnc_pin.errors import ConfigurationError, InputError, SimulationError, check_extra
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.io import Json, to_json_mapping
from rnc_pin.version import __version__

SweepProgress = Callable[[int, int | None], object]
"""Callback that takes the number of finished runs, and of all runs if it is known."""


def sweep(
    build: Build | str | Path,
    draws: int | Draws | Iterable[Draw],
    *,
    out: str | Path,
    jobs: int | str = 1,
    options: Mapping[str, object] | None = None,
    progress: SweepProgress | None = None,
    force: bool = False,
) -> SweepResults:
    """Simulate many runs with drawn values, and write a row for each.

    If the process or a worker is killed, the same call continues: no recorded run is lost or repeated. Rows are equal
    to the bit on any number of processes, except ``wall_time``.

    Args:
        build: function that takes the drawn values as a dict and returns the arguments of ``simulate`` by name, or a
            Trajectory; or a scenario: a built-in name or a YAML file. Several processes need a function that can be
            pickled; functions in notebooks can.
        draws: number of runs with seeded draws, or ``Draws`` with distributions and a seed; or the values of each run,
            as an iterable of dicts. Values for a scenario are options by dotted key.
        out: folder of the results.
        jobs: processes; -1 for all cores. Or the address of a Dask scheduler to run on.
        options: options of a scenario that all runs share, by dotted key.
        progress: called with the number of finished runs, and the number of all runs or None.
        force: replace another sweep in the folder, and write beside other files.

    Returns:
        The results, like ``load_sweep``.

    Raises:
        ConfigurationError: the folder holds a different sweep or other files, the draws are invalid, or the package of
            the extra ``dask`` is not installed.
        SimulationError: a worker ended unexpectedly.

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
        # Before the folder is made: a missing package leaves nothing behind.
        check_extra("dask", f"--scheduler {jobs}")
    elif jobs == 0 or jobs < -1:
        raise ConfigurationError(f"--jobs {jobs}: expected a number of processes, or -1 for all cores")
    path = Path(out)
    if isinstance(draws, int):
        draws = Draws(draws)
    seeded = draws if isinstance(draws, Draws) else None
    count = seeded.runs if seeded is not None else len(draws) if isinstance(draws, Sized) else None
    runs = runs_of(build, seeded, options)
    specification: dict[str, Json] = {
        "rnc_pin": __version__,
        "kernel": kernel,
        **runs.describe(),
        "draws": {} if runs.draws is None else runs.draws.describe(),
        "runs": count,
    }
    # Ctrl-C counts between rows only: a row is written whole.
    with uninterrupted(), sweep_folder(path, specification, force) as file:
        finished = {row["run"]: drawn_values(row) for row in read_rows(path, specification)}
        missing: Iterator[Numbered]
        if isinstance(draws, Draws):
            # Without values: workers draw them by the number, so that results do not depend on who computes them.
            missing = ((run, None) for run in range(draws.runs) if run not in finished)
        else:
            missing = _missing(draws, finished, path, arrays=not isinstance(build, str | Path))
        tell = (lambda done, count: None) if progress is None else progress
        tell(len(finished), count)
        with closing(_rows(runs, missing, jobs)) as rows:
            for done, row in enumerate(rows, start=len(finished) + 1):
                # One write: a kill leaves whole lines, and at most one torn line, which is cut off later.
                file.write(json.dumps(row).encode() + b"\n")
                file.flush()
                tell(done, count)
        results = SweepResults(path)
        write_reports(results)
    return results


def _missing(draws: Iterable[Draw], finished: Mapping[int, Draw], folder: Path, arrays: bool) -> Iterator[Numbered]:
    """Numbers of the runs that are not finished, with their given values: as they are, or without arrays."""
    run = -1
    for run, draw in enumerate(draws):
        if not isinstance(draw, Mapping):
            raise ConfigurationError(f"draws: run {run} has {type(draw).__name__}, expected a dict of values")
        check_names(draw)
        values = to_json_mapping(draw, f"draws: run {run}")
        if run in finished:
            _check_recorded(run, values, finished[run], folder)
        else:
            yield run, draw if arrays else values
    if max(finished, default=-1) > run:
        raise ConfigurationError(f"{folder}: holds run {max(finished)}, and the draws end at run {run}")


def _check_recorded(run: int, values: Mapping[str, Json], recorded: Draw, folder: Path) -> None:
    """Raise an error if a finished run had other values."""
    for name, value in values.items():
        # As text: 1 and 1.0 are equal numbers, and draws of another type.
        if json.dumps(recorded.get(name)) != json.dumps(value):
            raise ConfigurationError(
                f"{folder}: holds another sweep: '{name}' of run {run} is {recorded.get(name)!r}, not {value!r}; "
                "choose another folder or force"
            )


# ------------------------------------------------------------------ processes

Rows: TypeAlias = Generator[Row, None, None]
_ANSWER = 10.0  # time in which a scheduler has to answer, and a worker has to be there [s]


def _rows(runs: Runs, numbered: Iterator[Numbered], jobs: int | str) -> Rows:
    """Yield rows as runs finish, in any order. Ctrl-C counts while this waits for a row.

    Raises:
        ConfigurationError: the scheduler cannot be reached, or a worker has another release or kernel.
        SimulationError: a worker ended unexpectedly.
    """
    # One process is this one: no workers have to start.
    alone = jobs == 1 or (jobs == -1 and cpu_count() == 1)
    with ExitStack() as stack:
        rows = (runs.row(*each) for each in numbered) if alone else _from_workers(runs, numbered, jobs, stack)
        stack.callback(_close, rows)
        while True:
            try:
                with interruptible():
                    row = next(rows)
            except StopIteration:
                return
            except Exception as error:
                # By name: only a sweep on a cluster imports Dask.
                if not isinstance(error, BrokenExecutor) and type(error).__name__ != "KilledWorker":  # of Dask
                    raise
                raise SimulationError(
                    "a worker process ended unexpectedly, perhaps for lack of memory; finished runs are kept, and the "
                    "same command continues"
                ) from error
            yield row


def _close(rows: Rows) -> None:
    """End the workers of rows that nobody reads further."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # joblib warns that runs were under way
        rows.close()


def _from_workers(runs: Runs, numbered: Iterator[Numbered], jobs: int | str, stack: ExitStack) -> Rows:
    """Rows from local processes, or from a Dask cluster until ``stack`` closes."""
    try:
        # Once for all runs: a task then has bytes, a number and at most a draw.
        pickled = cloudpickle.dumps(runs)
    except Exception as error:  # whatever the objects of a user raise
        raise InputError(f"build cannot be pickled for other processes: {error}") from error
    if isinstance(jobs, str):
        from dask.distributed import Client

        try:
            # Not as default: a session of the user may have a client of its own.
            client = stack.enter_context(cast("Any", Client)(jobs, timeout=_ANSWER, set_as_default=False))
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"--scheduler {jobs}: cannot be reached: {error}") from None
        stack.enter_context(parallel_config("dask", client=client, wait_for_workers_timeout=_ANSWER, pure=False))
        # All workers of the cluster; they end with their scheduler, and not with this process.
        parent, count = None, -1
    else:
        # One thread in each: processes use all cores already.
        stack.enter_context(parallel_config("loky", inner_max_num_threads=1))
        parent, count = os.getpid(), jobs
    work = _Work(pickled, (__version__, kernel), parent)
    try:
        tasks = (delayed(worker_row)(work, *each) for each in numbered)
        found: Rows = Parallel(count, return_as="generator_unordered", max_nbytes=None)(tasks)
    except TimeoutError:
        raise ConfigurationError(f"--scheduler {jobs}: it has no workers") from None
    return found


class _Work(NamedTuple):
    """Common part of the runs of a sweep: pickled source, versions, and process of local workers."""

    pickled: bytes
    versions: tuple[str, str]
    parent: int | None


_local = threading.local()


def worker_row(work: _Work, run: int, draw: Draw | None) -> Row:
    """Row of a run in a worker. Each thread of it unpickles the source of a sweep's runs once.

    Args:
        work: common part of the runs.
        run: number of the run.
        draw: its given values; None draws them.

    Raises:
        ConfigurationError: the worker has another release or kernel, whose results could differ.
    """
    if work.parent is not None:
        _follow(work.parent)
    # Equal to the bit is a promise: another kernel rounds otherwise.
    if work.versions != (__version__, kernel):
        raise ConfigurationError(
            f"a worker has rnc_pin {__version__} with kernel '{kernel}', the sweep {work.versions[0]} with "
            f"'{work.versions[1]}'"
        )
    # Equal and not the same: each task brings its own copy of the bytes.
    if getattr(_local, "pickled", None) != work.pickled:
        _local.pickled, _local.runs = work.pickled, cloudpickle.loads(work.pickled)
    row: Row = _local.runs.row(run, draw)
    return row


@cache
def _follow(parent: int) -> None:
    """End this process when its parent ends for any reason, and ignore Ctrl-C, which a terminal sends to both."""
    # Only the main thread may set a handler.
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    # At once: a run under way may take minutes, and nobody reads its row any more.
    os._exit(1)
