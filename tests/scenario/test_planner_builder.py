"""Optimal plans from a scenario file: the run plans and tracks, and mistakes are refused."""

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.io.manifest import is_result
from rnc_pin.scenario.execution import execute, plan, write

SCENARIO = """
robot: {urdf: chaplygin_sleigh.urdf, base: planar}
constraints: [{no_side_slip: {frame: sleigh}}]
actuators: [{force: {frame: sleigh, axis: x}}, {torque: {frame: sleigh, axis: z}}]
outputs:
  reducing: [{frame_speed: {frame: sleigh, axis: x}}, {frame_yaw: sleigh}]
  vertical: [{frame_position: {frame: sleigh, axes: xy}}]
planner:
  type: optimal
  goal: {sleigh_x: 1, sleigh_y: 0, sleigh_yaw: 0}
  duration: 2
  bounds: {velocity: {sleigh_speed_x: [null, 0.7]}}
  nodes: 20
controller: {type: plan_feedback, state_cost: 10}
simulation: {duration: 2.2, dt: 0.01}
"""


def written(folder, text=SCENARIO, **changes):
    raw = yaml.safe_load(text)
    for key, value in changes.items():
        raw[key] = {**raw.get(key, {}), **value} if isinstance(value, dict) else value
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(raw))
    return str(path)


def test_a_run_plans_and_tracks_its_plan(tmp_path):
    prepared = plan(written(tmp_path))
    run = execute(prepared)
    assert run.error is None
    np.testing.assert_allclose(run.trajectory.q[-1, :2], [1.0, 0.0], atol=1e-3)
    assert run.trajectory.v2[:, 0].max() == pytest.approx(0.7, abs=5e-3)  # at its bound, but not beyond
    # Bang-free optimum under a bound of the speed v: d = v (t - 2 t_r / 3), with a parabola of the speed for t_r.
    ramp = 3 / 2 * (2.0 - 1.0 / 0.7)
    assert run.trajectory.v2[np.searchsorted(run.trajectory.time, ramp + 0.1), 0] == pytest.approx(0.7, abs=1e-2)
    assert max(run.summary["final_error"].values()) < 1e-3
    path = prepared.experiment.provenance.path
    assert path.frame == "sleigh"
    np.testing.assert_allclose(path.poses[-1], [1.0, 0.0, 0.0], atol=1e-3)
    names = write(prepared, run, tmp_path)
    assert "plan.npz" in names
    assert all(map(is_result, names))  # only these leave the fresh folder of a run
    again = rnc.optimal.MotionPlan.load(tmp_path / "plan.npz")
    assert again.info.bounds == (
        ("velocity", "sleigh_speed_x", -np.inf, 0.7),
        ("velocity", "sleigh_yaw", -np.inf, np.inf),
    )


def test_existing_trackers_follow_the_outputs_of_the_plan_and_equal_plans_are_shared(tmp_path):
    tracker = {"type": "reducing_outputs", "tracker": "computed_torque", "state_cost": None}
    damper = {"damper": {"output": {"frame_yaw": "sleigh"}, "damping": 1.0}}
    others = {"plan": {"controller": {"type": "plan_feedback"}}, "damped": {"forces": [damper]}}
    path = written(tmp_path, controller=tracker, comparisons=others)
    prepared = plan(path)
    assert prepared.comparisons["plan"].plan is prepared.experiment.plan
    assert prepared.comparisons["damped"].plan is not prepared.experiment.plan
    run = execute(prepared)
    np.testing.assert_allclose(run.trajectory.q[-1, :2], [1.0, 0.0], atol=1e-2)
    np.testing.assert_allclose(run.comparisons["plan"].q[-1, :2], [1.0, 0.0], atol=1e-2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"planner": {"goal": {"sleigh_z": 1.0}}}, "planner: goal: no output 'sleigh_z'; did you mean 'sleigh_[xy]'"),
        ({"planner": {"bounds": {"input": {"T": [0, 1]}}}}, "planner: bound: no 'T'"),
        ({"planner": {"goal": {"sleigh_x": 9.0}, "seeds": 0, "iterations": 20}}, "planner: no plan in 2 s"),
        ({"planner": {"guess": {"path": {}, "reducing": {}}}}, "planner.guess.path"),
        ({"planner": {"goal": {"sleigh_speed_x": 1.0}}}, "is a speed: it has no value"),
        ({"controller": {"gains": "plan"}}, "controller.state_cost: belongs to gains 'tvlqr'"),
        ({"planner": None}, "controller.type: 'plan_feedback' requires a plan: set 'planner'"),
    ],
)
def test_mistakes_are_refused(tmp_path, changes, message):
    with pytest.raises(rnc.RncError, match=message):
        plan(written(tmp_path, **changes))
