"""Sweeps have the same rows on every path: by hand, on any number of processes, after a kill, in any order."""

import itertools
import json
import os
import signal
import threading

import joblib
import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.applications.sweep import run_sweep
from systems import sleigh

LAWS = {"speed": [0.5, 1.5], "spin": {"normal": {"mean": 0.5, "std": 0.1}}, "kind": {"choice": ["a", "b"]}}


class Sleighs:
    """Free motion of a sleigh, which counts its calls in this process."""

    def __init__(self, calls=None, ends_at=None):
        self.calls, self.ends_at = calls, ends_at
        self.reduced = sleigh()

    def __call__(self, draw):
        if self.calls is not None:
            self.calls.append(draw)
            if len(self.calls) == self.ends_at:
                raise KeyboardInterrupt
        q0, v2 = self.reduced.robot.configuration(), [draw["speed"], draw["spin"]]
        return rnc.free_motion(self.reduced, q0, v2, duration=0.05, dt=0.01)


def rows_of(results):
    return [{**row, "wall_time": None} for row in results.rows()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return rnc.sweep(Sleighs(), rnc.Draws(12, LAWS, 4), out=tmp_path_factory.mktemp("whole") / "out")


def test_a_row_is_the_run_of_its_draw(whole):
    assert len(whole) == 12
    assert whole.complete
    assert whole.outcomes == {"completed": 12}
    for run in (0, 11):
        draw = whole.draw(run)
        assert set(draw) == {"speed", "spin", "kind"}
        figures, row = rnc.summarize(Sleighs()(draw)), whole.row(run)
        assert row["constraint_residual_max"] == figures["constraint_residual_max"]
        assert row["energy_drift"] == figures["energy_drift"]
    np.testing.assert_array_equal(whole["run"], np.arange(12))


def test_an_interrupted_sweep_continues_where_it_was(whole, tmp_path):
    calls = []
    with pytest.raises(KeyboardInterrupt):
        rnc.sweep(Sleighs(calls, ends_at=6), rnc.Draws(12, LAWS, 4), out=tmp_path / "out")
    part = rnc.load_sweep(tmp_path / "out")
    assert (len(part), part.complete) == (5, False)
    assert rows_of(part) == rows_of(whole)[:5]
    again = []
    results = rnc.sweep(Sleighs(again), rnc.Draws(12, LAWS, 4), out=tmp_path / "out")
    assert (len(again), rows_of(results)) == (7, rows_of(whole))
    rnc.sweep(Sleighs(again), rnc.Draws(12, LAWS, 4), out=tmp_path / "out")
    assert len(again) == 7  # nothing is left to do


def test_a_line_that_was_cut_off_is_repeated_and_more_runs_are_added(whole, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        rnc.sweep(Sleighs([], ends_at=9), rnc.Draws(12, LAWS, 4), out=out)
    with (out / "runs.jsonl").open("a") as file:
        file.write('{"run": 8, "spe')
    calls = []
    assert rows_of(rnc.sweep(Sleighs(calls), rnc.Draws(12, LAWS, 4), out=out)) == rows_of(whole)
    assert len(calls) == 4
    more = rnc.sweep(Sleighs(calls), rnc.Draws(14, LAWS, 4), out=out)
    assert len(calls) == 6  # two more than before
    assert (rows_of(more)[:12], more.row(13)["run"]) == (rows_of(whole), 13)


class Deadly(Sleighs):
    """The same motion in a process that is killed at its first run of a given number."""

    def __init__(self, marker):
        super().__init__()
        self.marker, self.parent = marker, os.getpid()

    def __call__(self, draw):
        assert os.getpid() != self.parent
        if draw["speed"] > 1.2 and not self.marker.exists():
            self.marker.write_text("")
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__(draw)


def test_a_killed_worker_ends_the_sweep_in_one_error_and_the_same_call_continues(whole, tmp_path):
    arguments = Deadly(tmp_path / "killed"), rnc.Draws(12, LAWS, 4)
    with pytest.raises(rnc.SimulationError, match=r"^a worker process ended unexpectedly.*the same command continues$"):
        rnc.sweep(*arguments, jobs=2, out=tmp_path / "out")
    part = rnc.load_sweep(tmp_path / "out")
    assert rows_of(part) == [rows_of(whole)[run] for run in part["run"]] if len(part) else True
    assert rows_of(rnc.sweep(*arguments, jobs=2, out=tmp_path / "out")) == rows_of(whole)
    beside = joblib.Parallel(2)(map(joblib.delayed(abs), (-1, 2)))  # processes of the user
    assert beside == [1, 2]


def test_workers_of_another_release_and_what_cannot_be_pickled_are_refused(tmp_path):
    work, lock = run_sweep._Work(b"", ("0.0", "numpy"), None), threading.Lock()
    with pytest.raises(rnc.ConfigurationError, match=r"the sweep 0\.0 with 'numpy'"):
        run_sweep.worker_row(work, 0, None)
    with pytest.raises(rnc.InputError, match="build cannot be pickled"):
        rnc.sweep(lambda draw: lock, [{}], jobs=2, out=tmp_path / "out")


def test_given_draws_are_read_as_they_are_needed_and_checked_when_it_continues(tmp_path):
    read = []

    def draws(spin=0.5):
        for k in itertools.count():
            read.append(k)
            if k == 9:
                return
            yield {"speed": 1.0 + 0.01 * k, "spin": spin, "start": np.array([0.0, k]), "n": k, "note": {"a": k}}

    def build(draw):
        assert isinstance(draw["start"], np.ndarray)
        assert max(read) == draw["n"]  # nothing is read ahead
        return Sleighs()(draw)

    results = rnc.sweep(build, draws(), out=tmp_path)
    assert results["n"].tolist() == list(range(9))
    assert results.draw(3) == {"speed": 1.03, "spin": 0.5, "start": [0.0, 3.0], "n": 3, "note": {"a": 3}}
    with pytest.raises(rnc.ConfigurationError, match=r"'spin' of run 0 is 0\.5, not 0\.6"):
        rnc.sweep(build, draws(0.6), out=tmp_path)
    with pytest.raises(rnc.ConfigurationError, match="the draws end at run 1"):
        rnc.sweep(build, itertools.islice(draws(), 2), out=tmp_path)


def test_another_sweep_in_the_folder_is_refused(whole, tmp_path):
    def refusal(**changes):
        draws = rnc.Draws(changes.pop("runs", 12), changes.pop("laws", LAWS), changes.pop("seed", 4))
        with pytest.raises(rnc.ConfigurationError) as caught:
            rnc.sweep(Sleighs(), draws, **{"out": whole.path, **changes})
        return str(caught.value)

    before = {path: path.read_bytes() for path in whole.path.rglob("*") if path.is_file()}
    assert "its draws.seed is 4, not 5" in refusal(seed=5)
    assert "its draws.distributions.speed is [0.5, 1.5], not [0.5, 1.6]" in refusal(laws={**LAWS, "speed": [0.5, 1.6]})
    assert "holds a sweep of 12 runs, more than 11" in refusal(runs=11)
    (tmp_path / "notes.txt").write_text("mine")
    assert "exists and holds no sweep" in refusal(out=tmp_path)
    assert before == {path: path.read_bytes() for path in whole.path.rglob("*") if path.is_file()}
    results = rnc.sweep(Sleighs(), rnc.Draws(2, LAWS), out=tmp_path, force=True)
    assert (len(results), (tmp_path / "notes.txt").read_text()) == (2, "mine")


REFUSED = {
    "runs without distributions": ({"draws": 3}, "need distributions"),
    "name of a result": ({"draws": [{"outcome": 1}]}, "'outcome' is the name of a result"),
    "no dict": ({"draws": [3]}, "run 0 has int, expected a dict"),
    "object": ({"draws": [{"speed": object()}]}, "is of type object"),
    "no processes": ({"draws": [{}], "jobs": 0}, "--jobs 0"),
    "options": ({"draws": [{}], "options": {"a": 1}}, "options: those of a scenario"),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "words"), REFUSED.values(), ids=REFUSED)
def test_wrong_arguments_are_refused(arguments, words, tmp_path):
    with pytest.raises(rnc.RncError) as caught:
        rnc.sweep(Sleighs(), **arguments, out=tmp_path / "out")
    assert words in str(caught.value)


def test_runs_that_fail_have_rows_too(tmp_path):
    reduced = sleigh()

    def build(draw):
        if draw["n"] == 0:
            raise rnc.ModelError("no such robot")
        stop = rnc.Stop(speed=0.1 if draw["n"] == 1 else 50.0)
        q0, options = reduced.robot.configuration(), rnc.SimulationOptions(stop=stop)
        return {
            "reduced": reduced, "controller": rnc.control.ZeroInput(reduced), "q0": q0, "v2_0": [1.0, 0.5],
            "duration": 0.1, "dt": 0.01, "options": options,
        }  # fmt: skip

    results = rnc.sweep(build, [{"n": n} for n in range(3)], out=tmp_path)
    assert [row["outcome"] for row in results.rows()] == ["refused", "diverged", "completed"]
    assert results.row(0)["message"] == "no such robot"
    assert "test_run_sweep" in (tmp_path / "failures.txt").read_text()
    table = json.loads((tmp_path / "sweep.json").read_text())
    assert (table["runs"], table["outcomes"]) == (3, {"completed": 1, "diverged": 1, "refused": 1})
