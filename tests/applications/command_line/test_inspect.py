"""Effects of limits in ``rnc-pin inspect``: at the start, along a run, and for controllers that cannot be built."""

import json
import re

import numpy as np
import pytest

SCENARIO = """
robot: {urdf: mobile_manipulator.urdf, base: planar}
constraints: [{no_side_slip: {frame: axle}}]
actuators: [{force: {frame: base, axis: x}}, {torque: {frame: base, axis: z}}, joint_1, joint_2]
outputs: {reducing: [{frame_speed: {frame: base, axis: x}}, {frame_yaw: base}, {joint: joint_1}, {joint: joint_2}]}
initial: {q: {joint_1: 0.5, joint_2: -1.2}}
controller:
  type: qp
  tracker: computed_torque
  k: 40
  tasks: [{posture: {joints: {joint_1: 0.0, joint_2: 0.0}}}]
  limits: {joint_velocity: {joints: [joint_1, joint_2], limit: 0.7, margin: 0.0}}
simulation: {duration: 1.5, dt: 0.01}
"""


@pytest.fixture
def scenario(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "reach.yaml").write_text(SCENARIO)
    return "reach.yaml"


def inspected(call, *options):
    status, out, _ = call("inspect", *options, "--samples", 4, "--json")
    assert status == 0
    return json.loads(out)


def test_the_start_and_a_run_are_examined(call, scenario, tmp_path, no_pictures):
    found = inspected(call, scenario)
    (start,) = found["limit_effects"]
    assert found["limits_not_examined"] is None
    assert start["active"] == ["joint_2 velocity"]
    assert start["freedom"] == 3
    assert start["task_error"]["joint_2 posture"] == pytest.approx(0.7 - 1.2, abs=1e-6)
    accepted = ["--accept", "goal", "--accept", "effort"]  # there is no time to arrive, and the gain is high
    status, _, _ = call("run", scenario, "--out", "done", *accepted)
    assert status == 0
    along = inspected(call, scenario, "--run", "done")["limit_effects"]
    assert len(along) == 21
    run = np.load(tmp_path / "done" / "trajectory.npz", allow_pickle=False)
    q2 = np.interp([each["time"] for each in along], run["time"], run["q"][:, -1])
    # The velocity limit counts until the error is 0.7 rad.
    expected = -q2 > 0.7
    assert [bool(each["active"]) for each in along] == expected.tolist()
    assert 0 < expected.sum() < 21
    _, out, _ = call("inspect", scenario, "--samples", 4)
    assert "t = 0 s: joint_2 velocity [3 of 4 free]" in out


def test_a_controller_that_cannot_be_built_is_named(call, scenario):
    found = inspected(call, scenario, "--set", "controller.limits.joint_velocity.joints=[joint_9]")
    assert found["limit_effects"] == []
    assert re.search(r"the controller cannot be built: \S+: controller.limits: ", found["limits_not_examined"])
    assert "joint_9" in found["limits_not_examined"]
    _, out, _ = call("inspect", scenario, "--samples", 4, "--set", "controller.limits.joint_velocity.joints=[joint_9]")
    assert "limits: not examined, the controller cannot be built" in out


def test_a_run_for_a_controller_without_limits_is_refused(call, tmp_path):
    status, _, error = call("inspect", "space-robot", "--samples", 4, "--run", tmp_path)
    assert status == 2
    assert "--run: the controller of the scenario is no program with limits" in error
