"""Scenario files whose constraints appear and vanish."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.phase_builder import build_phased
from rnc_pin.applications.scenario.saved_run import drawn_run
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.simulation import simulate_phases
from rnc_pin.visualization.drawn_state import recorded_states
from rnc_pin.visualization.scene_kinematics import SwitchingForces

DROP = 0.2
AXES = [{"frame": "ball", "axis": axis} for axis in "xyz"]
BALL = {
    "robot": {"urdf": "rolling_ball.urdf", "base": "free"},
    "outputs": {"reducing": [{kind: each} for kind in ("frame_speed", "frame_angular_velocity") for each in AXES]},
    "initial": {"q": {"root_joint": [0, 0, DROP, 0, 0, 0, 1]}},
    "simulation": {"duration": 1.0, "dt": 0.01},
}
GROUND = {"rolling_ball": {"frame": "ball", "radius": 0.1}}


@pytest.fixture(scope="module")
def grasp():
    prepared = Scenario.load("grasp", {"simulation.dt": 0.01, "plots": {}}).build()
    result = execute(prepared)
    assert result.error is None
    return prepared, result


def test_grasp_conserves_momentum_and_reaches_its_goal(grasp):
    prepared, result = grasp
    run, model = result.trajectory, prepared.experiment.reduced.robot.model
    data = model.createData()
    for q, v in zip(run.q[::20], run.v[::20], strict=True):
        pin.computeCentroidalMomentum(model, data, q, v)
        center = pin.centerOfMass(model, data, q)
        turning = data.hg.angular + np.cross(center, data.hg.linear)
        np.testing.assert_allclose([*data.hg.linear[:2], turning[2]], [-3.0, 0.6, 2.6112], atol=1e-9)
    before, after = run.info.phases
    assert before.end == "distance_hand_handle = 0.03"
    assert after.controller["type"] == "VelocityTracker"
    assert result.summary["impacts"][0]["energy_loss"] > 0.1
    assert max(result.summary["final_error"].values()) < 0.02
    assert result.summary["energy_drift"] < 1e-6
    held = [name for name in run.info.outputs.multipliers if name.startswith("closure")]
    columns = [run.info.outputs.multipliers.index(name) for name in held]
    assert not run.multipliers[run.phase == 0][:, columns].any()
    assert run.multipliers[run.phase == 1][:, columns].any()


def test_pages_of_phases_know_the_constraints_while_they_act(grasp):
    """A closure of the capture has the names of the run. Ground carries a ball of 1 kg after the fall, not before."""
    prepared, result = grasp
    drawn = drawn_run(prepared.experiment.drawn_model, prepared.experiment.scenario, result.trajectory)
    names = result.trajectory.info.outputs.multipliers
    assert len(SwitchingForces(drawn.robot, drawn.switching, names).columns) == len(names) == 6
    fall = {"crossing": {"output": {"frame_position": {"frame": "ball", "axes": "z"}}, "value": 0.1}}
    turning = {"reducing": [{"frame_angular_velocity": each} for each in AXES]}
    roll = {"constraints": [GROUND], "outputs": turning, "duration": 0.1}
    scenario = validate({**BALL, "phases": [{"until": fall}, roll]}, "ball.yaml")
    built = build_phased(scenario, Path())
    run = simulate_phases(built.phases, built.q0, 0.01, v2_0=built.v2_0)
    drawn = drawn_run(built.drawn_model, scenario, run)
    forces = SwitchingForces(drawn.robot, drawn.switching, run.info.outputs.multipliers)
    states = list(recorded_states(drawn.robot, run))
    total = [sum(forces.force(k, state)[1] for k in range(len(forces.columns))) for state in (states[0], states[-1])]
    np.testing.assert_allclose(total, [[0, 0, 0], [0, 0, 9.81]], atol=1e-9)


def test_bounce_from_a_file():
    """A contact that acts only at the impact: half of the speed remains."""
    fall = {"crossing": {"output": {"frame_position": {"frame": "ball", "axes": "z"}}, "value": 0.1}}
    bounce = {
        "until": fall, "impact": [GROUND],
        "restitution": {"vertical(ball)": 0.5},
    }  # fmt: skip
    raw = {**BALL, "phases": [{"until": fall}, bounce, {**bounce, "until": None, "duration": 0.01, "name": "again"}]}
    built = build_phased(validate(raw, "ball.yaml"), Path())
    run = simulate_phases(built.phases, built.q0, 0.01, v2_0=built.v2_0)
    starts = [phase.start for phase in run.info.phases]
    time = np.sqrt(2 * (DROP - 0.1) / 9.81)
    np.testing.assert_allclose(starts, [0.0, time, 2 * time], rtol=1e-9)
    assert run.info.phases[2].name == "again"


def test_motions_of_the_scenario_continue_and_those_of_a_phase_start_with_it():
    """Heading of a sleigh that turns to and fro, over the time of the run or of the phase."""
    place = {"frame_position": {"frame": "sleigh", "axes": "xy"}}
    motion = {"start": [0.0], "reference": {"harmonic": {"amplitude": [0.2], "frequency": 3.0}}}
    turn = {"prescribed_motion": {"output": {"frame_yaw": "sleigh"}, "motion": motion}}
    raw = {
        "robot": {"urdf": "chaplygin_sleigh.urdf", "base": "planar"},
        "outputs": {"reducing": [place]},
        "constraints": [turn], "simulation": {"duration": 0.4, "dt": 0.01},
    }  # fmt: skip
    yaw = rnc.planning.Harmonic([0.0], [0.2], 3.0)
    for phases, heading in (
        ([{"duration": 0.3}, {"duration": 0.4}], yaw.at(0.7).position[0]),
        ([{"duration": 0.3, "constraints": [turn]}, {"duration": 0.4}], yaw.at(0.7).position[0]),
    ):
        built = build_phased(validate({**raw, "phases": phases}, "sleigh.yaml"), Path())
        run = simulate_phases(built.phases, built.q0, 0.01, v2_0=built.v2_0)
        assert np.arctan2(run.q[-1, 3], run.q[-1, 2]) == pytest.approx(heading, abs=1e-12)
    free = {"duration": 0.3, "constraints": [], "outputs": {"reducing": [place, {"frame_yaw": "sleigh"}]}}
    own = {"duration": 0.4, "constraints": [turn]}
    built = build_phased(validate({**raw, "constraints": [], "phases": [free, own]}, "sleigh.yaml"), Path())
    run = simulate_phases(built.phases, built.q0, 0.01, v2_0=built.v2_0)
    assert np.arctan2(run.q[-1, 3], run.q[-1, 2]) == pytest.approx(yaw.at(0.4).position[0], abs=1e-12)


@pytest.mark.parametrize(("changes", "message"), [
    ({"plant": "mujoco"}, "plant: 'mujoco' does not support phases"),
    ({"faults": {"masses": 0.1}}, "faults: does not support phases"),
    ({"contacts": [{"constraint": GROUND}]}, "contacts: does not support phases"),
    ({"simulation": {"duration": 1.0, "on_lift_off": "stop"}}, "simulation.on_lift_off: set it in the phases"),
    ({"phases": [{"impact": [GROUND]}]}, "first phase has no impact"),
    ({"phases": [{}, {"constraints": [{"no_side_slip": {"frame": "bal"}}]}]}, r"phases\[1\]: .*'bal'"),
    ({"plots": {"some": {"outputs": ["speed"]}}, "phases": [{}]}, "plots.some.outputs: no output 'speed'"),
])  # fmt: skip
def test_refusals(changes, message):
    with pytest.raises(rnc.RncError, match=message):
        build_phased(validate({"phases": [{}], **BALL, **changes}, "ball.yaml"), Path())


def test_files_refuse_wrong_keys():
    for phase, message in (
        ({"until": {"crosing": {}}}, r"phases\[0\]\.until: .*'crosing' is not known; did you mean 'crossing'"),
        ({"restitution": 0.5, "on_lift_of": "stop"}, "'on_lift_of' is not known; did you mean 'on_lift_off'"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=message):
            validate({**BALL, "phases": [phase]}, "ball.yaml")


def test_frames_out_of_reach_are_not_joined():
    options = {"simulation.dt": 0.05, "phases.1.capture_distance": 0.02, "plots": {}}
    result = execute(Scenario.load("grasp", options))
    assert "phases[1]: capture_distance: 'hand' and 'handle' are 0.03 m apart, limit 0.02 m" in str(result.error)
    assert result.trajectory.phase.max() == 0
