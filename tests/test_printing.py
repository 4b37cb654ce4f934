"""Things print themselves: in one line, or in a few."""

import re
from dataclasses import is_dataclass
from importlib.metadata import version
from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin import analysis, control
from rnc_pin.simulation.summary import add_verdict
from systems import space_robot


@pytest.fixture(scope="module")
def system():
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    edges = [rnc.NoSideSlip("axle"), rnc.NoSideSlip("base")]
    return rnc.NonholonomicSystem(robot, edges, [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z")])


def test_a_system_says_which_rows_it_dropped_and_why(system):
    assert str(system).splitlines() == [
        "NonholonomicSystem of 'mobile_manipulator': 5 degrees of freedom less 1 independent row leave 4",
        "  rows kept: no_side_slip(axle.y)",
        "  rows dropped: no_side_slip(base.y) [a combination of no_side_slip(axle.y)]",
        "  actuators: force(base.x), torque(base.z)",
    ]


def test_a_run_that_failed_says_why(system):
    reduced = system.reduce()
    with pytest.raises(rnc.DivergenceError) as caught:
        rnc.free_motion(reduced, reduced.robot.configuration(), [1.0, 0.0, 0.0, 0.0], 1.0, 0.1, np.array([1e5, 0.0]))
    headline, run, message, *_ = str(caught.value.trajectory).splitlines()
    assert headline.startswith(f"Trajectory: failed: {str(caught.value)[:80]}")
    assert re.fullmatch(r"  run: diverged, [\d.]+ s in \d+ samples", run)
    assert message == f"  message: {caught.value}"


def test_what_prints_a_run_begins_with_its_verdict_and_the_finding_that_decides(system):
    """A run that came to its end, but not to its goal."""
    reduced = system.reduce()
    run = rnc.free_motion(reduced, reduced.robot.configuration(), [1.0, 0.0, 0.0, 0.0], 0.2, 0.1)
    run = run.with_verdict(rnc.simulation.judge(run, goal_errors={"hand": 0.3}))
    summary = rnc.summarize(run)
    add_verdict(summary, run.verdict)
    why = "failed: the goal of hand is missed by 0.3, allowed is 0.02"
    assert repr(run) == f"Trajectory: {why}, 0.2 s in 3 samples"
    assert str(summary).startswith(f"Summary: {why}, 0.2 s in 3 samples\n  run: completed, 0.2 s in 3 samples")
    for thing, start in ((run, "Trajectory: "), (run.verdict, "")):
        shown = []
        thing._repr_pretty_(SimpleNamespace(text=shown.append), cycle=False)
        assert shown[0] == str(thing)
        assert shown[0].startswith(start + why)


def test_a_controller_says_its_settings_and_parts():
    reduced = space_robot()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    target = control.RedundancyController(task, rnc.planning.Hold(np.zeros(2)), rnc.planning.Hold(np.zeros(1)), k3=1.5)
    tracker = control.VelocityTracker(target, control.VelocityGains(k=np.array([1.0, 2.5, 3.0]), beta=10.0, sigma=0.1))
    assert repr(target) in repr(tracker)
    assert repr(task) in repr(target)
    assert "k=[1.  2.5 3. ], beta=10, sigma=0.1" in repr(tracker)


def test_every_controller_and_every_record_of_an_analysis_prints_itself():
    kinds, found = ([getattr(room, name) for name in dir(room)] for room in (control, analysis))
    acting = [kind for kind in kinds if hasattr(kind, "step") and not getattr(kind, "_is_protocol", False)]
    assert len(acting) > 9
    assert [kind for kind in acting if kind.__repr__ is object.__repr__] == []
    records = [kind for kind in found if hasattr(kind, "_fields") or is_dataclass(kind)]
    assert [kind for kind in records if not hasattr(kind, "_repr_pretty_")] == [analysis.Use]  # a row of a record


def test_the_version_is_the_installed_one():
    assert rnc.__version__ == version("rnc_pin")
