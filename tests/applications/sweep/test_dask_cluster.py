"""Sweeps on a Dask scheduler with two workers on loopback, one of which is killed."""

import json
import os
import signal
import subprocess
import sys
from contextlib import ExitStack, contextmanager

import pytest

import rnc_pin as rnc
from patience import PATIENCE, eventually
from processes import alive
from terminal import results

pytest.importorskip("distributed", reason="Dask is an extra: pip install '.[dask]'")
RUNS = 60


@contextmanager
def process(*arguments):
    started = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    try:
        yield started
    finally:
        started.kill()
        started.wait()


@pytest.fixture
def cluster(tmp_path):
    """Address of a scheduler, and its two workers."""
    file = tmp_path / "scheduler.json"
    with ExitStack() as stack:
        options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file)
        stack.enter_context(process("scheduler", *options))
        assert eventually(file.exists)
        common = ["--scheduler-file", file, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
        workers = [
            stack.enter_context(process("worker", *common, "--local-directory", tmp_path / name)) for name in "ab"
        ]
        yield json.loads(file.read_text())["address"], workers


def rows_of(found):
    return [{**row, "wall_time": None} for row in found.rows()]


@pytest.mark.long
def test_a_cluster_has_the_rows_of_one_process_although_a_worker_is_killed(cluster, call, tmp_path):
    address, workers = cluster
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=PATIENCE)
    killed = []

    def progress(done, total):
        if not killed and done >= RUNS // 4:
            workers[0].send_signal(signal.SIGKILL)
            workers[0].wait()
            killed.append(done)

    arguments = {"options": {"simulation.duration": 0.1}}
    there = rnc.sweep("space-robot", RUNS, jobs=address, progress=progress, out=tmp_path / "there", **arguments)
    assert killed
    assert killed[0] < RUNS
    assert not alive(workers[0].pid)
    assert rows_of(rnc.sweep("space-robot", RUNS, out=tmp_path / "here", **arguments)) == rows_of(there)
    options = ["--set", "simulation.duration=0.1", "--runs", RUNS + 2, "--scheduler", address]
    status, out, error = call("sweep", "space-robot", *options, "--out", tmp_path / "there")
    assert (status, error) == (0, "")  # the command adds two runs to the sweep
    assert f"{RUNS + 2} succeeded" in results(out)


def test_a_scheduler_that_does_not_answer_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("rnc_pin.applications.sweep.run_sweep._ANSWER", 0.2)
    with pytest.raises(rnc.ConfigurationError, match="cannot be reached"):
        rnc.sweep("space-robot", 2, jobs="tcp://127.0.0.1:9", out=tmp_path / "out")
