"""Every built-in scenario, to its end where it has one: within 0.02 of every goal, with its invariants."""

from pathlib import Path

import numpy as np
import pytest

from bodies import frame_placement
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.files import built_in_names
from rnc_pin.applications.scenario.scenario import Scenario

PAPER = {  # largest errors with the paper's gains, as in docs/paper.md, and a tenth more
    "space-robot": {"tip_x": 0.26, "tip_y": 0.08, "platform": 0.03},
    "space-robot-fixed-platform": {"tip_x": 0.07, "tip_y": 0.03},
    "space-robot-uncertain": {"tip_x": 0.16, "tip_y": 0.06, "platform": 0.16},
    "mobile-manipulator": {"tip_x": 0.35, "tip_y": 0.05, "base_yaw": 0.06, "distance_base_tip": 0.17},
    "mobile-manipulator-two-phase": {"tip_x": 0.03, "tip_y": 0.05, "base_x": 0.35, "base_y": 0.45, "base_yaw": 1.68},
    "fire-truck": {
        "tractor_speed_x": 1.07, "front_steering": 0.03, "tractor_x": 0.94, "tractor_y": 1.59, "trailer_yaw": 0.002,
    },
}  # fmt: skip

LONG = ("space-robot-uncertain", "mobile-manipulator-two-phase")  # of a minute, whose errors are largest at first
FREE = (  # which have no goals
    "rattleback", "ball-in-bowl", "ball-on-turntable", "roller-racer", "disk-on-slope", "chaplygin-ball",
    "shaken-pendulum", "dropped-disk", "skidding-robot",
)  # fmt: skip
ELSEWHERE = ("fire-truck", "park", "tiago-rooms", *FREE)  # tests of their own below
# Durations [s] of scenarios that go on and on, after which nothing new happens.
ENOUGH = {"space-robot-uncertain": 12.0, "wheels-uncertain": 12.0}
PERIODS = {
    "free-flying-arm": 0.0035, "tiago": 0.004, "unicycle": 0.0055,  # whose gains do not suit a slower one
    # Whose samples cost most.
    "ball-on-plate": 0.016, "docking": 0.04, "doorway": 0.04, "forklift-pallet": 0.08,
    "free-flying-arm-limits": 0.04, "free-flying-truss": 0.08, "mecanum-crowd": 0.08,
    "mobile-manipulator-two-phase": 0.016, "parallel-parking": 0.04, "snakeboard-point": 0.04,
    "tiago-doorway": 0.02, "tiago-shelf": 0.05, "tiago-two-phase": 0.012, "trailer-lot": 0.1,
    "wheels-uncertain": 0.012,
}  # fmt: skip
"""Sampling periods [s] other than 0.008."""


def summary_of(name, compared=False, **options):
    options = {**({} if compared else {"comparisons": {}}), **options, "plots": {}}
    prepared = Scenario.load(name, options).build()
    assert "controller.preset" in options or prepared.experiment.warnings == ()
    result = execute(prepared)
    assert result.error is None
    assert result.summary["outcome"] == "completed"
    assert result.summary["constraint_residual_max"] < 1e-8
    return result.summary


def ends_at_its_goals(summary):
    assert summary["final_error"]
    assert max(summary["final_error"].values()) < 0.02, summary["final_error"]


def respects_its_limits(summary):
    """Joint limits of the robot's file, and distances between links by coal on hulls of the meshes."""
    assert {kind: worst for kind, worst in summary["joint_limits"].items() if worst["excess"] > 1e-6} == {}
    # A ball that rolls on a plate touches it.
    assert [pair for pair in summary.get("touching_at_start", []) if not pair.startswith("ball / plate")] == []
    for key in ("smallest_distance", "smallest_own_distance"):
        nearest = summary[key]
        assert nearest is None or nearest["distance"] > 0.0, nearest


@pytest.mark.parametrize("name", [name for name in built_in_names() if name not in ELSEWHERE])
def test_scaled_gains_end_within_two_hundredths_of_every_goal(name):
    """At four times their period where gains suit that, for a quarter of the time."""
    options = {"simulation.dt": PERIODS.get(name, 0.008)}
    options |= {"simulation.duration": ENOUGH[name]} if name in ENOUGH else {}
    summary = summary_of(name, **options)
    ends_at_its_goals(summary)
    respects_its_limits(summary)


def test_the_car_parks_where_its_controller_has_its_goal():
    """It has no reference, so no errors of outputs; ``succeeded`` needs the goal."""
    result = execute(Scenario.load("park", {"plots": {}, "simulation.dt": 0.04}))
    assert result.trajectory.verdict.succeeded
    x, y, cosine, sine = result.trajectory.q[-1, :4]
    np.testing.assert_allclose([x, y, np.arctan2(sine, cosine)], 0.0, atol=0.02)
    respects_its_limits(result.summary)


def test_the_hand_reaches_from_one_room_into_a_shelf_in_another():
    prepared = Scenario.load("tiago-rooms", {"plots": {}}).build()
    result, robot = execute(prepared), prepared.model.reduced.robot
    run = result.trajectory
    assert run.verdict.succeeded
    hand = frame_placement(robot, run.q[-1], "arm_tool_link").translation
    np.testing.assert_allclose(hand, [2.05, 1.0, 0.92], atol=0.02)
    assert abs(run.q[np.argmin(np.abs(run.q[:, 0]))][1]) < 0.6  # of the door, which is 1.2 m wide
    respects_its_limits(result.summary)


@pytest.mark.parametrize("name", FREE)
def test_what_moves_freely_keeps_its_rows_and_accounts_for_its_energy(name):
    """Motions themselves are those of benchmarks/validation."""
    run = execute(Scenario.load(name, {"comparisons": {}, "plots": {}, "simulation.duration": 0.3})).trajectory
    assert run.outcome == "completed"
    assert run.constraint_residual.max() < 1e-8
    assert np.ptp(run.q, axis=0).max() > 0.005
    if name not in ("dropped-disk", "skidding-robot"):  # which land and slide
        assert np.ptp(run.energy - run.work) < 1e-4 * np.abs(run.energy).max()


def test_figure_8():
    """The trailer's axle strays from the driven path by at most a tenth of what it does with the rear axle locked."""
    summary = summary_of("fire-truck", compared=True, **{"simulation.dt": 0.005})
    locked = summary["comparisons"]["rear axle locked"]
    ends_at_its_goals(summary)
    respects_its_limits(summary)
    assert summary["off_tracking_max"] < 0.1 * locked["off_tracking_max"]
    assert summary["off_tracking_max"] < 1e-3
    assert max(abs(summary["final_output"][name]) for name in ("tractor_x", "tractor_y", "tractor_yaw")) < 0.02


@pytest.mark.parametrize(
    ("name", "coordinate"), [("mobile-manipulator", "base_x"), ("fire-truck", "tractor_yaw")], ids=["z1", "theta1"]
)
def test_the_papers_own_coordinates_do_where_they_are_regular(name, coordinate):
    """Section 4.2's z1 and figure 8's theta1 in place of the forward speed."""
    options = {"variant": "paper-coordinates", "comparisons": {}, "plots": {}, "simulation.dt": 0.008}
    prepared = Scenario.load(name, options).build()
    assert coordinate in prepared.experiment.reduced.reducing.names
    assert not any("speed" in each for each in prepared.experiment.reduced.reducing.names)
    result = execute(prepared)
    ends_at_its_goals(result.summary)
    assert result.summary["min_singular_value"] > 0.1


@pytest.mark.parametrize("name", PAPER)
def test_the_papers_gains_run_every_scenario_of_the_paper(name):
    """Bounded, as the lemmas promise; how well they track, and whether they fail, is in docs/paper.md."""
    options = {"controller.preset": "paper", "simulation.dt": 0.01}  # its loops are slow
    summary = summary_of(name, **options, **({"simulation.duration": 20.0} if name in LONG else {}))
    errors = summary["max_error"]
    page = (Path(__file__).parents[2] / "docs" / "paper.md").read_text()
    row = next(line for line in page.splitlines() if f"| `{name}`" in line)
    assert name in LONG or ("fails by" in row) == (summary["verdict"] == "failed")
    assert errors.keys() == PAPER[name].keys()
    assert {each: error for each, error in errors.items() if error > PAPER[name][each]} == {}
