"""Optimal plans from a scenario file: the run plans and tracks, and mistakes are refused."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import forklifts
import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute, write
from rnc_pin.applications.scenario.output_folder import is_result
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.simulated_run import judged_summary
from telescopes import telescope

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
    prepared = Scenario.load(written(tmp_path)).build()
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
    largest = {"sleigh_speed_x": 0.7, "sleigh_yaw": np.inf}
    assert again.info.bounds == tuple(("velocity", name, -np.inf, limit) for name, limit in largest.items())


def test_existing_trackers_follow_the_outputs_of_the_plan_and_equal_plans_are_shared(tmp_path):
    tracker = {"type": "reducing_outputs", "tracker": "computed_torque", "state_cost": None}
    damper = {"damper": {"output": {"frame_yaw": "sleigh"}, "damping": 1.0}}
    others = {"plan": {"controller": {"type": "plan_feedback"}}, "damped": {"forces": [damper]}}
    prepared = Scenario.load(written(tmp_path, controller=tracker, comparisons=others)).build()
    assert prepared.comparisons["plan"].experiment.plan is prepared.experiment.plan
    assert prepared.comparisons["damped"].experiment.plan is not prepared.experiment.plan
    run = execute(prepared)
    np.testing.assert_allclose(run.trajectory.q[-1, :2], [1.0, 0.0], atol=1e-2)
    np.testing.assert_allclose(run.comparisons["plan"].q[-1, :2], [1.0, 0.0], atol=1e-2)


@pytest.mark.parametrize("duration", [{}, {"duration": "plan"}])
def test_a_run_lasts_as_long_as_its_plan(tmp_path, duration):
    raw = {**yaml.safe_load(SCENARIO), "simulation": {"dt": 0.03, **duration}}
    free = {"planner.duration": [1.0, 2.0], "planner.time_weight": 3.0}
    made = Scenario.load(written(tmp_path, yaml.safe_dump(raw)), free)
    assert 0.0 <= made.duration - made.experiment.plan.duration < 0.03
    assert execute(made).trajectory.time[-1] == pytest.approx(made.duration)
    alone = {"planner": None, "controller": {"type": "reducing_outputs", "tracker": "computed_torque"}}
    with pytest.raises(rnc.ConfigurationError, match=r"simulation\.duration: is missing"):
        Scenario.load(written(tmp_path, yaml.safe_dump({**raw, **alone}))).build()


@pytest.mark.parametrize(("moved", "word"), [("sleigh_yaw", "succeeded"), ("sleigh_x", "failed")])
def test_a_goal_is_what_the_planner_names(tmp_path, moved, word):
    """Other outputs are tracked: one that ends 0.1 away from its plan misses no goal."""
    made = Scenario.load(written(tmp_path), {"planner.goal": {"sleigh_x": 1, "sleigh_y": 0}}).build()
    run = execute(made).trajectory
    kind = "x2" if moved in run.info.outputs.x2.names else "x1"
    place = run.info.outputs.of(kind).names.index(moved)
    aside, desired = (np.array(getattr(run, each)) for each in (kind, f"{kind}_desired"))
    aside[-1, place] = desired[-1, place] + 0.1
    assert judged_summary(made.experiment, replace(run, **{kind: aside}))[1]["verdict"] == word


ROLLS = {"minimum_jerk": {"to": [4.5, 0, 0.3, 0], "duration": 10}}
ROLLING = {"sphere": {"name": "ball", "radius": 0.2, "position": [4.5, 3, 0.3], "motion": ROLLS}}


@pytest.mark.parametrize(("changes", "message"), [
    ({"planner": {"goal": {"sleigh_z": 1.0}}}, "planner: goal: no output 'sleigh_z'; did you mean 'sleigh_[xy]'"),
    ({"planner": {"bounds": {"input": {"T": [0, 1]}}}}, "planner: bound: no 'T'"),
    ({"planner": {"goal": {"sleigh_x": 9.0}, "seeds": 0, "iterations": 20}}, "planner: no plan in 2 s"),
    ({"planner": {"guess": {"path": {}, "reducing": {}}}}, "planner.guess.path"),
    ({"planner": {"goal": {"sleigh_speed_x": 1.0}}}, "is a speed: it has no value"),
    ({"controller": {"gains": "plan"}}, "controller.state_cost: belongs to gains 'tvlqr'"),
    ({"planner": {"type": "global"}, "obstacles": [ROLLING]}, "planner: obstacle 'ball' moves, and type 'global'"),
    ({"planner": None}, "controller.type: 'plan_feedback' requires a plan: set 'planner'"),
])  # fmt: skip
def test_mistakes_are_refused(tmp_path, changes, message):
    with pytest.raises(rnc.RncError, match=message):
        Scenario.load(written(tmp_path, **changes)).build()


FORKLIFT = """
robot: {urdf: forklift.urdf, base: planar}
constraints: [{no_side_slip: {frame: base}}]
actuators: [{force: {frame: base, axis: x}}, {torque: {frame: base, axis: z}}, lift_joint]
outputs:
  reducing: [{frame_speed: {frame: base, axis: x}}, {frame_yaw: base}, {joint: lift_joint}]
  vertical: [{frame_position: {frame: base, axes: xy}}]
planner:
  type: optimal
  goal: {base_x: 1, base_y: 0, base_yaw: 0, lift_joint: 2.6}
  duration: 8
  nodes: 20
  seeds: 0
controller: {type: plan_feedback, state_cost: 10}
simulation: {duration: 8, dt: 0.01}
"""


@pytest.fixture
def warehouse(tmp_path):
    forklifts.forklift(tmp_path)  # writes its file
    return tmp_path


def test_a_goal_beyond_a_limit_of_the_file_is_refused(warehouse, call):
    status, _, error = call("run", written(warehouse, FORKLIFT), "--out", warehouse / "out")
    assert status == 2
    assert "planner: goal: value of lift_joint = 2.6 is above the limit 1.4 of the robot's file" in error
    assert "limits: {position: null}" in error


@pytest.mark.parametrize("settings", [
    {"limits": None},
    {"limits": {"position": None}},
    {"bounds": {"output": {"lift_joint": [0, 3]}}},
    {"bounds": {"output": {"lift_joint": [None, None]}}},
])  # fmt: skip
def test_limits_of_the_file_are_removed_or_replaced(warehouse, settings):
    found = Scenario.load(written(warehouse, FORKLIFT, planner=settings)).experiment.plan
    assert found.q[-1, 4] == pytest.approx(2.6, abs=1e-4)
    assert found.verdict.succeeded


def test_plans_are_judged_with_the_gains_of_the_run(warehouse):
    """Without gains the loop that will run moves as the inputs alone do, which another integrator moves."""
    near = {"goal": {"lift_joint": 0.5, "base_x": 1.0, "base_y": 0.3, "base_yaw": 0.3}, "seeds": 6}
    zero = {"state_cost": 0.0, "input_cost": 1.0}
    idle = Scenario.load(written(warehouse, FORKLIFT, planner=near, controller=zero)).experiment.plan.info.verification
    stiff = {"state_cost": 1000.0}
    firm = Scenario.load(written(warehouse, FORKLIFT, planner=near, controller=stiff)).experiment.plan.info.verification
    assert idle.feedback.violation == pytest.approx(idle.inputs.violation, rel=5e-3)
    assert firm.feedback.violation < 0.8 * firm.inputs.violation
    assert firm.inputs == idle.inputs


TELESCOPE = """
robot: {urdf: telescope.urdf, base: fixed}
actuators: [one, two]
outputs: {reducing: [{joint: one}, {joint: two}]}
obstacles: [{sphere: {name: ball, radius: 0.1, position: [0, 3, 0]}}]
initial: {q: {two: 1.5}}
planner: {type: optimal, goal: {two: 0.9}, duration: 2, nodes: 10, seeds: 0}
controller: {type: plan_feedback}
simulation: {duration: 2, dt: 0.01}
"""


@pytest.mark.parametrize("kind", ["optimal", "global"])
def test_a_plan_keeps_links_from_each_other_as_the_verdict_checks_them(tmp_path, kind):
    (tmp_path / "telescope.urdf").write_text(telescope(3.0))
    path = written(tmp_path, TELESCOPE, planner={"type": kind})
    with pytest.raises(rnc.InfeasibleError, match=r"rail (and|/) tool|distance \(nearest\)"):
        Scenario.load(path).build()
    assert execute(Scenario.load(path, {"planner.goal.two": 1.1}).build()).trajectory.verdict.succeeded
    unchecked = Scenario.load(path, {"planner.links": False, "planner.type": "optimal"}).build()
    assert execute(unchecked).trajectory.verdict.first.where == "rail / tool"


CAR = """
robot: {urdf: car.urdf, base: planar}
constraints: [{no_side_slip: {frame: front_axle}}, {no_side_slip: {frame: rear_axle}}]
actuators: [{force: {frame: rear_axle, axis: x}}, front_steering]
outputs:
  reducing: [{frame_speed: {frame: rear_axle, axis: x}}, {joint: front_steering}]
  vertical: [{frame_position: {frame: rear_axle, axes: xy}}]
planner: {type: optimal, goal: {rear_axle_x: 2, rear_axle_y: 0.5}, duration: 3, nodes: 12, form: kinematic}
controller: {type: plan_feedback}
simulation: {duration: 3, dt: 0.05}
"""


@pytest.mark.parametrize("guess", [
    {"path": {"to": [2, 0.5, 0], "wheelbase": 0.5, "frame": "rear_axle"}}, {"through": [{"root_joint": [1, 0.2, 0.1]}]},
])  # fmt: skip
def test_a_guess_of_the_file_leads_to_the_plan_and_costs_of_outputs_to_their_target(tmp_path, guess):
    costs = {"outputs": [{"outputs": ["front_steering"], "target": [0.1], "weight": 100.0, "phase": "terminal"}]}
    plan = Scenario.load(written(tmp_path, CAR, planner={"guess": guess, "costs": costs})).experiment.plan
    assert (plan.info.guess, plan.q[-1, :2].tolist()) == ("given", pytest.approx([2.0, 0.5], abs=1e-2))
    assert plan.q[-1, -1] == pytest.approx(0.1, abs=0.02)


BEHIND_A_WALL = """
robot: {urdf: unicycle.urdf, base: planar}
constraints: [{rolling_wheel: {frame: wheel, radius: 0.25}}]
actuators: [{force: {frame: fork, axis: x}}, {torque: {frame: fork, axis: z}}]
outputs:
  reducing: [{frame_speed: {frame: fork, axis: x}}, {frame_yaw: fork}]
  vertical: [{frame_position: {frame: fork, axes: xy}}]
obstacles:
  - box: {name: wall, size: [0.1, 6.0, 1.0], position: [1.5, 2.1, 0.0]}
  - box: {name: other wall, size: [0.1, 6.0, 1.0], position: [3.0, -2.1, 0.0]}
planner:
  type: global
  goal: {fork_x: 4.5, fork_y: 0, fork_yaw: 0}
  duration: 14
  clearance: 0.05
  nodes: 60
  seeds: 0
controller: {type: plan_feedback, state_cost: 10}
simulation: {duration: 14.5, dt: 0.01}
"""


def test_a_run_finds_its_way_around_walls_and_tracks_it(tmp_path):
    run = execute(Scenario.load(written(tmp_path, BEHIND_A_WALL)).build())
    assert run.error is None
    assert run.summary["verdict"] == "succeeded", run.summary
    np.testing.assert_allclose(run.trajectory.q[-1, :2], [4.5, 0.0], atol=1e-2)
    x, y = run.trajectory.q[:, :2].T
    for wall, low, high in ((1.5, -0.9, 5.1), (3.0, -5.1, 0.9)):
        crossed = y[np.flatnonzero(np.diff(np.sign(x - wall)))]
        assert ((crossed < low) | (crossed > high)).all()


def test_a_goal_that_no_way_reaches_is_refused_at_the_planner(tmp_path):
    inside = {"goal": {"fork_x": 1.5, "fork_y": 0.6, "fork_yaw": 0}}
    with pytest.raises(rnc.InfeasibleError, match=r"planner: find_way: the goal is too near: .*wall"):
        Scenario.load(written(tmp_path, BEHIND_A_WALL, planner=inside)).build()
    for change, message in (({"guess": {"through": []}}, "type 'global' searches the guess"), ({"goal": None}, "goal")):
        with pytest.raises(rnc.ConfigurationError, match=message):
            Scenario.load(written(tmp_path, BEHIND_A_WALL, planner=change)).build()
