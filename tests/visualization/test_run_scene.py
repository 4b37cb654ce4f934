"""The drawn scene, without a browser: places, directions, keyframes, the null motion, and what any robot needs."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import scipy
from scipy.spatial.transform import Rotation

import rnc_pin as rnc
import systems
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.simulation import Columns, OutputNames
from rnc_pin.visualization.browser.scene_server import SceneWindow
from rnc_pin.visualization.drawn_state import DrawnModel, DrawnState, View, recorded_states
from rnc_pin.visualization.elements import Overlay, SceneKinematics
from rnc_pin.visualization.meshcat_scene import Keyframes, MeshcatScene
from rnc_pin.visualization.recording import Recording
from rnc_pin.visualization.run_scene import RunScene


@pytest.fixture(scope="module")
def truck():
    """Two seconds of the fire truck: its model and the run."""
    options = {"simulation.duration": 2.0, "simulation.dt": 0.01, "comparisons": {}}
    prepared = Scenario.load("fire-truck", options).build()
    return prepared.experiment.reduced, execute(prepared).trajectory


@pytest.fixture(scope="module")
def run():
    """Three seconds of the paper's figure 4."""
    options = {"simulation.duration": 3.0, "simulation.dt": 0.01, "comparisons": {}}
    return execute(Scenario.load("space-robot", options)).trajectory


def test_a_recording_has_even_frames_on_the_trajectory(robot, run):
    frames = np.array([state.q for state in recorded_states(robot, run)])
    # Every fourth sample of 0.01 s is a frame of 0.04 s.
    np.testing.assert_allclose(frames, run.q[::4], atol=1e-12)


def test_a_run_that_is_over_stands_still_beside_one_that_goes_on(robot, run):
    states = list(recorded_states(robot, run, others=[SimpleNamespace(time=run.time[:101], q=run.q[:101])]))
    np.testing.assert_allclose([state.time for state in states], np.arange(0, 3.001, 0.04))
    np.testing.assert_allclose(states[10].others[0], run.q[40], atol=1e-12)
    np.testing.assert_array_equal(states[-1].others[0], run.q[100])
    np.testing.assert_array_equal(states[-1].x1_desired, run.x1_desired[-1])


def test_keyframes_are_the_transforms_that_went_in(generator):
    frames = Keyframes(25.0)
    wanted = []
    for frame in range(20):
        matrix = np.eye(4)
        # Turning on and on: quaternions must not jump to the other sign.
        matrix[:3, :3] = Rotation.from_rotvec([0, 0, 0.5 * frame]).as_matrix() * generator.uniform(0.1, 3.0, 3)
        matrix[:3, 3] = generator.normal(size=3)
        wanted.append(matrix)
        frames.place("a", frame, matrix)
        frames.place("rests", frame, wanted[0])
    clips = {clip["path"]: {track["name"]: track for track in clip["clip"]["tracks"]} for clip in
             frames.command()["animations"]}  # fmt: skip
    values = {name: np.frombuffer(track["values"].data, "<f4").reshape(20, -1) for name, track in clips["a"].items()}
    rebuilt = Rotation.from_quat(values[".quaternion"]).as_matrix() * values[".scale"][:, None, :]
    np.testing.assert_allclose(rebuilt, np.stack(wanted)[:, :3, :3], atol=1e-6)
    np.testing.assert_allclose(values[".position"], np.stack(wanted)[:, :3, 3], atol=1e-6)
    assert (np.sum(values[".quaternion"][1:] * values[".quaternion"][:-1], axis=1) > 0).all()
    assert [len(track["times"].data) // 4 for track in clips["rests"].values()] == [2, 2, 2]


@pytest.mark.parametrize("kind", [rnc.RollingBall, rnc.Caster], ids=["ball", "caster"])
def test_a_force_on_a_ball_acts_where_it_touches_the_ground(kind):
    """One state or many: at the lowest point, whose velocity the rows are, whatever the attitude."""
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    system = rnc.NonholonomicSystem(robot, [kind("ball", 0.3)])
    generator, kinematics = np.random.default_rng(2), Kinematics(robot)
    q = np.stack([system.assembled(robot.random_configuration(generator)) for _ in range(4)])
    for state in (q, q[1]):
        position = kinematics.position(state)
        points, directions = system.rows.lines_of_action(position)
        center = position.placement(robot.frame_id("ball")).translation
        np.testing.assert_allclose(points[..., 2], 0, atol=1e-9)
        np.testing.assert_allclose(points[..., :2] - center[..., None, :2], 0, atol=1e-12)
        J = position.jacobian(robot.frame_id("ball"))
        arms = np.broadcast_to(points - center[..., None, :], directions.shape)
        moments = np.cross(arms, directions)
        rows = np.concatenate([directions, moments], axis=-1) @ J
        np.testing.assert_allclose(rows, system.rows.jacobian(position), atol=1e-9)


def test_a_momentum_acts_on_no_point():
    reduced = systems.space_robot()
    position = Kinematics(reduced.robot).position(reduced.robot.configuration())
    points, directions = reduced.constraints.lines_of_action(position)
    assert np.isnan(points).all()
    assert np.isnan(directions).all()


def test_an_axle_without_drawn_wheels_leaves_a_track_itself(truck):
    reduced, run = truck
    first = next(recorded_states(reduced.robot, run))
    tracks = SceneKinematics(rnc.Robot(reduced.robot.model), reduced.constraints).wheels(first, 0.0)
    np.testing.assert_allclose(np.sort([track(first)[0] for track in tracks.values()]), [-9, -8, -7], atol=1e-9)


def test_motions_that_leave_the_primary_outputs_alone_are_arrows_with_names(robot, run):
    """Beside the null space of the rows of momentum and hand, by Pinocchio alone."""
    shown = DrawnModel.of(systems.space_robot()), run.info
    state, views = list(recorded_states(robot, run))[9], (View(redundancy=True), View())
    scene, other = (RunScene(*shown, view, MeshcatScene(SceneWindow("motions"), 25.0), state, run) for view in views)
    (arrows,), none = ([each for each in of.elements if "motion of" in each.entry.label] for of in (scene, other))
    assert (arrows.entry.label, none) == ("motion of joint 1", [])
    (points, vectors), model, data = arrows.vectors(state), robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, state.q)
    pin.updateFramePlacements(model, data)
    J = [pin.getFrameJacobian(model, data, k, pin.LOCAL_WORLD_ALIGNED)[:3] for k in range(model.nframes)]
    rows = np.vstack([pin.crba(model, data, state.q)[:1], J[model.getFrameId("tip")][:2]])  # momentum and hand
    motion = scipy.linalg.null_space(rows)[:, 0]
    away = np.linalg.norm([place.translation - points for place in data.oMf], axis=2)  # of each frame from each arrow
    expected = np.array([J[k] @ motion for k in away.argmin(axis=0)])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1).max(), 0.4 * scene.size)
    np.testing.assert_allclose(vectors * np.sum(expected**2), expected * np.sum(vectors * expected), atol=1e-9)


def test_the_board_measures_attitudes_on_the_sphere():
    robot = rnc.Robot.from_example("panda", base="free")
    attitude = Columns(tuple(f"panda_hand_orientation_{axis}" for axis in "xyz"), ("rad",) * 3, (False,) * 3, (0,))
    overlay = Overlay(OutputNames(x2=attitude), attitude.names, SceneKinematics(robot), margin=False)
    state = DrawnState(0.0, robot.configuration(), *np.zeros((6, 3)), 0.0)
    state = state._replace(x2=np.array([0.0, 0.0, 3.0]), x2_desired=np.array([0.0, 0.0, -3.0]), x1=np.empty(0))
    assert [each["label"] for each in overlay.labels()] == ["time", "error of panda hand orientation"]
    np.testing.assert_allclose(overlay.values(state)[0][1], 2 * np.pi - 6.0)


def test_an_unknown_frame_or_layer_and_a_run_of_another_robot_are_refused(robot, run):
    with pytest.raises(rnc.ModelError, match="did you mean 'tip'"):
        Recording(robot, run, View(trail=["tpi"]))
    with pytest.raises(rnc.ConfigurationError, match="no layer 'gaol'; did you mean 'goal'"):
        View(hide=["gaol"])
    with pytest.raises(rnc.InputError, match="q has 4 entries, but nq of the robot is 7"):
        Recording(rnc.Robot.from_urdf("fire_truck.urdf", base="planar"), run)
