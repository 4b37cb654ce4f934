"""Start values of joints: within limits, and where the loops of the file close."""

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.init import DraftOptions, draft, scenario_candidate
from rnc_pin.applications.init.joint_properties import joint_limits
from rnc_pin.applications.init.start_values import start_values

pytest.importorskip("mujoco", reason="mujoco is an optional extra and not installed")

FINGER = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="crank"><joint name="crank" axis="0 1 0" {crank}/><geom type="capsule" fromto="0 0 0 0 0 .3" size=".02"/>
    <body name="coupler" pos="0 0 .3"><joint name="coupler" axis="0 1 0" {coupler}/>
      <geom type="capsule" fromto="0 0 0 1 0 0" size=".02"/></body></body>
  <body name="rocker" pos="1 0 0"><joint name="rocker" axis="0 1 0" {rocker}/>
    <geom type="capsule" fromto="0 0 0 0 0 .3" size=".02"/>
    <body name="tip" pos="0 0 .3"><joint name="tip" axis="0 1 0" range="0.2 0.6"/><geom size=".05"/></body></body>
  </worldbody><equality><connect body1="coupler" body2="rocker" anchor="1 0 0"/></equality>
  <actuator><motor joint="crank"/><motor joint="tip"/></actuator></mujoco>"""
"""Opposite sides have equal lengths: crank and rocker stay parallel, and the coupler turns back by their angle."""


def finger(folder, **joints):
    path = folder / "finger.xml"
    path.write_text(FINGER.format(**joints))
    return path


def gap(robot, values):
    """Largest distance of the two ends of the loop [m]."""
    system = rnc.NonholonomicSystem(robot, [rnc.LoopClosure(*each) for each in robot.closures])
    return np.abs(system.assembly.residual(robot.configuration(values))).max()


CLOSED = {
    "zero, on limits": (
        {"crank": 'range="0 0.8"', "coupler": 'range="-0.9 0"', "rocker": 'range="0 1"'},
        {"crank": 0, "coupler": 0, "rocker": 0},
    ),
    "as the file draws it": (  # zero is no longer upright, so that it closes nothing
        {"crank": 'range="0.4 0.8" ref="0.5"', "coupler": 'ref="0.1"', "rocker": 'range="-0.5 0.5" ref="-0.2"'},
        {"crank": 0.5, "coupler": 0.1, "rocker": -0.2},
    ),
    "nearest the middle": (  # (0.6 + 0.5 + 0.4) / 3 for the angle of the crank
        {"crank": 'range="0.2 1"', "coupler": 'range="-0.7 -0.3"', "rocker": 'range="0.2 0.6"'},
        {"crank": 0.5, "coupler": -0.5, "rocker": 0.5},
    ),
    "nearest the middle, at a limit": (
        {"crank": 'range="0.2 1.8"', "coupler": 'range="-1.8 -0.2"', "rocker": 'range="0.1 0.3"'},
        {"crank": 0.3, "coupler": -0.3, "rocker": 0.3},
    ),
}


@pytest.mark.parametrize("case", CLOSED)
def test_joints_of_a_loop_start_where_it_closes_within_their_limits(case, tmp_path):
    joints, expected = CLOSED[case]
    robot = rnc.Robot.from_mjcf(finger(tmp_path, **joints))
    start = start_values(robot)
    assert start == pytest.approx({**expected, "tip": 0.4}, abs=1e-6)
    assert gap(robot, start) < 1e-8
    for name, value in start.items():
        low, high = joint_limits(robot, name)
        assert low - 1e-8 <= value <= high + 1e-8


@pytest.mark.parametrize("case", ["zero, on limits", "nearest the middle"])
def test_a_closed_gripper_is_drafted_and_starts_closed(case, tmp_path, monkeypatch):
    """It started in the middle of the limits of each joint, and its own loop refused that."""
    monkeypatch.setattr(scenario_candidate, "_PATIENCE", 0.0)
    joints, expected = CLOSED[case]
    text = draft(str(finger(tmp_path, **joints)), tmp_path, DraftOptions())
    content = yaml.safe_load(text)
    start = {**dict.fromkeys(expected, 0), **content["initial"]["q"]}
    assert start == pytest.approx({**expected, "tip": 0.4}, abs=1e-6)
    assert "loops start closed" in text
    assert content["actuators"] == ["crank", "tip"]


def test_joints_outside_a_loop_start_as_before_and_a_loop_that_no_limit_admits_is_refused(tmp_path):
    robot = rnc.Robot.from_mjcf(finger(tmp_path, crank='range="0.5 1"', coupler='range="0.1 1"', rocker=""))
    assert start_values(robot) == {"crank": 0.75, "coupler": 0.55, "rocker": 0, "tip": 0.4}
    with pytest.raises(rnc.RncError, match="no configuration near q satisfies closure"):
        draft(str(tmp_path / "finger.xml"), tmp_path, DraftOptions())
