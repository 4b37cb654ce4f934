"""Batches of runs on an executor whose workers end. tests/applications/command_line/test_cli.py has real workers."""

import threading
from concurrent.futures import BrokenExecutor, Executor, Future

import pytest

import rnc_pin as rnc
from rnc_pin._kernel import kernel
from rnc_pin.applications.sweep import worker_pool
from rnc_pin.version import __version__


class Numbers:
    """Runs whose row is their number."""

    def row(self, run, draw=None):
        return {"run": run, "wall_time": 0.01}

    def rows(self, batch):
        return [self.row(*each) for each in batch]


class Workers(Executor):
    """Executor that computes at once, and breaks at given batches. Each batch is recorded."""

    def __init__(self, breaks):
        self.breaks, self.batches, self.ends = breaks, [], 0

    def submit(self, function, *arguments):
        future = Future()
        batch = arguments[3]
        self.batches.append([run for run, _ in batch])
        if self.breaks(self, batch):
            self.ends += 1
            future.set_exception(BrokenExecutor())
        else:
            future.set_result(function(*arguments))
        return future


def rows_on(monkeypatch, breaks, runs=50):
    workers = Workers(breaks)

    class Pool:
        def __enter__(self):
            return worker_pool._Pool(lambda: workers, lambda: 2)

        def __exit__(self, *error):
            pass

    monkeypatch.setattr(worker_pool, "_local_pool", lambda jobs: Pool())
    numbered = ((run, None) for run in range(runs))
    found = [row["run"] for rows in worker_pool.finished_runs(Numbers(), numbered, 2) for row in rows]
    return workers, found


def test_each_run_comes_once_although_workers_end(monkeypatch):
    workers, found = rows_on(monkeypatch, lambda workers, batch: len(workers.batches) in (1, 4, 5, 9))
    assert workers.ends == 4
    assert sorted(found) == list(range(50))
    assert max(map(len, workers.batches)) > 4  # batches grow until they take long enough
    assert max(map(len, workers.batches)) <= 20


def test_a_run_that_ends_every_worker_ends_the_sweep(monkeypatch):
    with pytest.raises(rnc.SimulationError, match="4 workers ended unexpectedly while run"):
        rows_on(monkeypatch, lambda workers, batch: any(run == 7 for run, _ in batch))


def test_a_worker_of_another_release_is_refused():
    with pytest.raises(rnc.ConfigurationError, match=r"the sweep 0\.0 with 'numpy'"):
        worker_pool.run_batch(b"", "", ("0.0", "numpy"), [], None)
    assert worker_pool.run_batch(worker_pool.cloudpickle.dumps(Numbers()), "x", (__version__, kernel), [], None) == []


def test_what_cannot_be_pickled_is_refused(tmp_path):
    lock = threading.Lock()
    with pytest.raises(rnc.InputError, match="build cannot be pickled"):
        rnc.sweep(lambda draw: lock, [{}], jobs=2, out=tmp_path / "out")
