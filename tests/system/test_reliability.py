"""The long forms of docs/reliability.md, in short: both plants, an hour of control, the campaign of faults."""

import gc
import sys
import tracemalloc

import pytest

from benchmarks import campaign, plants, soak
from benchmarks.faulty_runs import LARGEST, SCENARIOS, prepared
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario

BOTH = ["space-robot", "mobile-manipulator"]  # without wheels and with them
BOTH += [pytest.param(name, marks=pytest.mark.long) for name in ("wheels-uncertain", "snakeboard")]


@pytest.mark.parametrize("name", BOTH)
def test_errors_on_both_plants(name):
    """In MuJoCo at most twice those on our own plant."""
    pytest.importorskip("mujoco")
    ours, theirs = plants.on_both(name, {"simulation.duration": 0.5})
    assert theirs.outcome == "completed"
    assert plants.ratio(ours, theirs) < 2.0
    grips = name != "space-robot"
    assert (theirs.friction_used.shape[1] > 0) == grips
    if grips:  # by friction, not by decree
        assert 1e-9 < abs(theirs.slip[10:]).max() < 0.05
        assert 0 < theirs.friction_used[10:].max() < 1


def test_memory_stays_where_it_is():
    loop, plant = soak.setting()
    soak.turn(loop, plant, 0, 200)
    tracemalloc.start()
    try:
        soak.turn(loop, plant, 200, 250)  # what is kept has been made anew
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        soak.turn(loop, plant, 250, 400)
        gc.collect()
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 5_000  # 33 bytes a step


def test_faults_end_with_a_name(monkeypatch, capsys):
    """One run of each: whatever comes of it, no NaN, and whoever was not there says why."""
    prepared.cache_clear()
    monkeypatch.setitem(SCENARIOS, "unicycle", {"simulation.duration": 0.5, "simulation.dt": 0.01})
    monkeypatch.setattr(sys, "argv", ["campaign", "--runs", "1", "--scenarios", "unicycle"])
    assert campaign.main() == 0
    said = capsys.readouterr().out
    assert all(fault in said for fault in LARGEST)
    assert f"0 of {len(LARGEST)} runs with NaN" in said
    prepared.cache_clear()


def test_a_campaign_in_many_processes_has_the_bits_of_one(tmp_path, monkeypatch):
    def rows_of(jobs):
        rows = tmp_path / f"{jobs}.csv"
        options = ["--runs", "2", "--scenarios", "unicycle", "--faults", "counts", "--jobs", str(jobs)]
        monkeypatch.setattr(sys, "argv", ["campaign", *options, "--out", str(rows)])
        assert campaign.main() == 0
        return sorted(campaign.Kept(rows).rows.values())

    alone = rows_of(1)
    assert len(alone) == 2
    assert rows_of(2) == alone


def test_the_platform_arrives_on_a_ground_of_little_grip():
    """Of mu = 0.6, which gives 53 N m of yaw: the stabiliser's limits keep to less than half of it."""
    pytest.importorskip("mujoco")
    ground = {"plant": {"type": "mujoco", "friction": [0.6, 0.0, 0.0], "step": 0.001}, "comparisons": {}, "plots": {}}
    coarse = {"simulation.dt": 0.008, "simulation.duration": 7.0}
    run = execute(Scenario.load("mobile-manipulator-two-phase", {**ground, **coarse})).trajectory
    assert run.outcome == "completed"
    assert run.friction_used.max() < 0.6
    assert 1.0 < abs(run.T[:, 1]).max() < 30.0  # [N m], about the vertical
    assert abs(run.slip).max() < 1e-3
