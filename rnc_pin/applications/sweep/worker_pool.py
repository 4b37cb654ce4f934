"""Execution of the runs of a sweep: in this process, in local processes, or on a Dask cluster.

Workers get batches of runs. If a worker ends unexpectedly, its batches go to another one.
"""

from __future__ import annotations

import hashlib
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any, NamedTuple, cast

import cloudpickle
from joblib import cpu_count
from joblib.executor import (
    MemmappingExecutor,
    get_memmapping_executor,
)  # the pool of joblib.Parallel, which fails beside another kind

from rnc_pin._kernel import kernel
from rnc_pin.applications.sweep.rows import Numbered, Row, Runs
from rnc_pin.errors import ConfigurationError, InputError, SimulationError
from rnc_pin.extras import missing_extra
from rnc_pin.interruption import interruptible
from rnc_pin.version import __version__

_BATCH_TIME, _LARGEST_BATCH = 0.2, 200  # time that a batch should take [s], and its largest number of runs
_AHEAD = 3  # batches per worker that are handed out at a time
_MOST_ENDS = 4  # times that a batch may see its worker end
_ANSWER = 10.0  # time in which a scheduler has to answer [s]
_THREADS = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
_local = threading.local()


class _Batch(NamedTuple):
    """Runs that a worker gets at a time, and the number of workers that ended meanwhile."""

    runs: list[Numbered]
    ends: int = 0


class _Pool(NamedTuple):
    """Functions that return the executor, a new one if the last one broke, and the number of its workers."""

    executor: Callable[[], Executor]
    workers: Callable[[], int]


def run_batch(
    pickled: bytes, key: str, versions: tuple[str, str], batch: list[Numbered], parent: int | None
) -> list[Row]:
    """Rows of a batch of runs, in a worker. Each thread of it unpickles the source of a sweep's runs once.

    Args:
        pickled: source of the runs.
        key: digest of ``pickled``.
        versions: release and kernel of the process that asks.
        batch: the runs.
        parent: process with which a local worker ends.

    Raises:
        ConfigurationError: the worker has another release or kernel, whose results could differ.
    """
    if parent is not None:
        exit_with_parent(parent)
    if versions != (__version__, kernel):
        raise ConfigurationError(
            f"a worker has rnc_pin {__version__} with kernel '{kernel}', the sweep {versions[0]} with '{versions[1]}'"
        )
    if getattr(_local, "key", None) != key:
        _local.key, _local.runs = key, cloudpickle.loads(pickled)
    rows: list[Row] = _local.runs.rows(batch)
    return rows


def finished_runs(runs: Runs, numbered: Iterator[Numbered], jobs: int | str) -> Iterator[list[Row]]:
    """Yield rows as runs finish, in any order.

    Args:
        runs: source of the rows.
        numbered: numbers of the runs, and their given values; read as workers become free.
        jobs: local processes; -1 for all cores; with one, this process computes. Or the address of a Dask scheduler.

    Raises:
        ConfigurationError: the scheduler cannot be reached.
        SimulationError: workers that got the same runs ended again and again.
    """
    if jobs == 1 or (jobs == -1 and cpu_count() == 1):
        for each in numbered:
            with interruptible():
                rows = runs.rows([each])
            yield rows
        return
    try:
        pickled = cloudpickle.dumps(runs)
    except Exception as error:  # whatever the objects of a user raise
        raise InputError(f"build cannot be pickled for other processes: {error}") from error
    pool = _dask_pool(jobs) if isinstance(jobs, str) else _local_pool(cpu_count() if jobs == -1 else jobs)
    parent = None if isinstance(jobs, str) else os.getpid()
    with pool as ready:
        yield from _dispatched(numbered, pickled, ready, parent)


def _dispatched(numbered: Iterator[Numbered], pickled: bytes, pool: _Pool, parent: int | None) -> Iterator[list[Row]]:
    """Hand batches out to workers, and yield their rows as they come."""
    common = pickled, hashlib.sha256(pickled).hexdigest(), (__version__, kernel)
    pending: dict[Future[list[Row]], _Batch] = {}
    waiting: list[_Batch] = []
    size, more = 1, True
    while more or waiting or pending:
        while len(pending) < _AHEAD * pool.workers() and (more or waiting):
            batch = waiting.pop() if waiting else _Batch(list(islice(numbered, size)))
            more = more and bool(batch.runs)
            if not batch.runs:
                break
            try:
                pending[pool.executor().submit(run_batch, *common, batch.runs, parent)] = batch
            except BrokenExecutor:  # the batches on their way bring the news too
                waiting.append(batch)
                break
        if not pending:
            continue
        with interruptible():
            done = wait(pending, timeout=1.0, return_when=FIRST_COMPLETED).done
        for future in done:
            batch = pending.pop(future)
            try:
                found = future.result()
            except BrokenExecutor:
                waiting.append(_once_more(batch))
            except Exception as error:
                if type(error).__name__ != "KilledWorker":  # of Dask, which need not be installed
                    raise
                waiting.append(_once_more(batch._replace(ends=batch.ends + 1)))
            else:
                size = _next_size(size, found)
                yield found


def _next_size(size: int, rows: Sequence[Row]) -> int:
    """Size of the next batches: it grows at most twofold at a time, until they take long enough."""
    mean = sum(float(row["wall_time"]) for row in rows) / len(rows)
    return max(1, min(int(_BATCH_TIME / max(mean, 1e-6)), 2 * size, _LARGEST_BATCH))


def _once_more(batch: _Batch) -> _Batch:
    if batch.ends + 1 >= _MOST_ENDS:
        numbers = f"{batch.runs[0][0]}" + (f" to {batch.runs[-1][0]}" if len(batch.runs) > 1 else "")
        raise SimulationError(
            f"{_MOST_ENDS} workers ended unexpectedly while run {numbers} waited or was under way, perhaps for lack of "
            "memory; finished runs are kept, and the same command continues"
        )
    return _Batch(batch.runs, batch.ends + 1)


@contextmanager
def _local_pool(jobs: int) -> Iterator[_Pool]:
    def executor() -> MemmappingExecutor:
        return get_memmapping_executor(jobs, timeout=300, env=_THREADS)  # a new one if the last one broke

    try:
        yield _Pool(executor, lambda: jobs)
    except BaseException:
        # Otherwise this process waits until the workers finish their runs.
        pool = executor()
        # Loky forgets waiting batches here, but not their numbers: its thread would end in a KeyError on the terminal.
        with suppress(queue.Empty):
            while True:
                pool._work_ids.get_nowait()
        pool.shutdown(wait=False, kill_workers=True)
        raise


@contextmanager
def _dask_pool(scheduler: str) -> Iterator[_Pool]:
    try:
        from dask.distributed import Client
    except ImportError:
        raise ConfigurationError(f"--scheduler {scheduler}: {missing_extra('dask')}") from None
    try:
        client = cast(Any, Client)(scheduler, timeout=_ANSWER, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"--scheduler {scheduler}: cannot be reached: {error}") from None
    counted, count = -1.0, 1

    def workers() -> int:  # they come and go
        nonlocal counted, count
        if time.monotonic() - counted > 2.0:
            counted, count = time.monotonic(), max(1, sum(client.nthreads().values()))
        return count

    executor = client.get_executor(pure=False)
    try:
        yield _Pool(lambda: executor, workers)
    finally:
        executor.shutdown(wait=False)
        client.close()


# ------------------------------------------------------------------ worker processes

_PERIOD = 0.5  # [s]
_watched: set[int] = set()


def exit_with_parent(parent: int) -> None:
    """End this process when its parent ends for any reason, and ignore Ctrl-C.

    Args:
        parent: id of the parent process; in that process itself this function does nothing.
    """
    if os.getpid() == parent or parent in _watched:
        return
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to both processes
    _watched.add(parent)
    threading.Thread(target=_watch, args=(parent,), name="parent", daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_PERIOD)
    os._exit(1)
