"""Obstacles of a scenario: from the file to the check before the run, the summary and the pictures."""

import re

import coal
import numpy as np
import pytest
import umsgpack
from matplotlib.figure import Figure

import rnc_pin as rnc
from places import ROOT
from rnc_pin.applications.scenario.execution import draw_pictures, execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.collision import CollisionDistances
from rnc_pin.visualization.plots import draw_obstacles
from rnc_pin.visualization.recording import Recording
from rnc_pin.visualization.scene_bodies import corners_over_time, outline, surface_points
from urdf_parts import TETRAHEDRON, write

SCENARIO = """
robot: {example: panda, lock: {panda_finger_joint1: 0, panda_finger_joint2: 0}}
actuators: [panda_joint1, panda_joint2, panda_joint3, panda_joint4, panda_joint5, panda_joint6, panda_joint7]
outputs:
  reducing: [{joint: panda_joint1}, {joint: panda_joint2}, {joint: panda_joint3}, {joint: panda_joint4},
    {joint: panda_joint5}, {joint: panda_joint6}, {joint: panda_joint7}]
initial: {q: {panda_joint2: -0.4, panda_joint4: -1.8, panda_joint6: 1.5}}
reference: {primary: {minimum_jerk: {by: [1.2, 0, 0, 0, 0, 0, 0], duration: 1}}}
controller: {type: reducing_outputs, tracker: computed_torque}
simulation: {duration: 1.2, dt: 0.01}
obstacles:
"""
BESIDE = """
  - box: {size: [0.2, 0.2, 1.0], position: [0.3, 0.55, 0.5], yaw: 0.4, name: post}
  - cylinder:
      {radius: 0.1, length: 0.5, position: [-1.0, 0.0, 0.5], motion: {minimum_jerk: {by: [0, 1, 0, 2], duration: 1}}}
"""


def prepared(tmp_path, obstacles, **options):
    return Scenario.load(str(write(tmp_path / "arm.yaml", SCENARIO + obstacles)), options).build()


def test_every_shape_is_built(tmp_path):
    (tmp_path / "rock.obj").write_text(TETRAHEDRON)
    text = """
  - box: {size: [1, 2, 3], position: [3, 0, 0], yaw: 0.5, roll: 0.1, pitch: 0.2}
  - sphere: {radius: 0.5, position: [0, 3, 0]}
  - capsule: {radius: 0.1, length: 0.4, name: person, position: [0, -3, 0]}
  - mesh: {file: rock.obj, scale: 0.1, position: [2, 2, 2]}
  - cylinder:
      {radius: 0.1, length: 0.5, position: [5, 0, 0], motion: {harmonic: {amplitude: [1, 0, 0, 0], frequency: 1}}}
  - ground: {position: [0, 0, -0.1], name: floor, ignored_links: [panda_link0]}
"""
    found = prepared(tmp_path, text).experiment.obstacles
    assert [each.name for each in found] == ["box 1", "sphere 2", "person", "mesh 4", "cylinder 5", "floor"]
    np.testing.assert_allclose(2 * np.ravel(found[0].shape.halfSide), [1, 2, 3])
    assert (found[2].shape.halfLength, found[3].shape.computeVolume()) == (0.2, pytest.approx(1e-3 / 6))
    assert found[5].unbounded
    assert found[5].ignored_links == ("panda_link0",)
    assert found[4].placement(1.25).translation[0] == pytest.approx(6.0)


@pytest.mark.parametrize(("text", "words"), [
    ("  - box: {size: [1, 2, 3], name: a}\n  - sphere: {radius: 1, name: a}", "two are named 'a'"),
    ("  - box: {size: [1, 2]}", "size"),
    ("  - sphere: {radius: -1}", "radius"),
    ("  - mesh: {file: none.stl}", "none.stl"),
    ("  - cone: {radius: 1}", "cone"),
    ("  - ground: {ignored_links: [panda_link_0]}", "ignored_links: no link 'panda_link_0'.*'panda_link0'"),
    ("  - sphere: {radius: 1, motion: {minimum_jerk: {by: [1, 2, 0], duration: 1}}}",
        r"3 values for 4 outputs \(x, y, z, yaw\); add a value of yaw"),
])  # fmt: skip
def test_unusable_obstacles_are_refused(tmp_path, text, words):
    with pytest.raises(rnc.RncError, match=words):
        prepared(tmp_path, text)


def test_reference_through_an_obstacle_is_reported(tmp_path):
    (warning,) = prepared(tmp_path, BESIDE).experiment.warnings
    assert warning.startswith("the reference passes through obstacle 'post': panda_")
    with pytest.raises(rnc.InfeasibleError, match="passes through obstacle 'post'"):
        prepared(tmp_path, BESIDE, preflight="refuse")
    assert prepared(tmp_path, "  - sphere: {radius: 0.1, position: [3, 0, 0]}").experiment.warnings == ()


def test_summary_has_the_smallest_distance_and_the_worst_limits(tmp_path, monkeypatch):
    ready = prepared(tmp_path, BESIDE)
    result = execute(ready)
    robot, run = ready.experiment.reduced.robot, result.trajectory
    nearest = result.summary["smallest_distance"]
    check = CollisionDistances(robot, ready.experiment.obstacles, q0=run.q[0])
    at = int(np.abs(run.time - nearest["time"]).argmin())
    found = check.at(run.q[at], float(run.time[at]))
    assert nearest["distance"] == pytest.approx(found.distance.min(), abs=5e-3)
    assert nearest["distance"] < -0.01
    assert nearest["bodies"] == list(check.pairs[found.pairs[found.distance.argmin()]].names)
    # The first joint alone moves, so that links that are near each other keep their distance.
    assert result.summary["smallest_own_distance"] is None
    assert any(not each.obstacle for each in result.limits.clearances)
    velocity = result.summary["joint_limits"]["velocity"]
    share = np.abs(run.v) / robot.model.upperVelocityLimit
    assert velocity["excess"] == pytest.approx(share.max() - 1.0)
    assert velocity["joint"] == robot.joint_names[int(share.max(axis=0).argmax())]
    monkeypatch.setattr(rnc.simulation, "plot_run", lambda *_: Figure(figsize=(1, 1)))
    drawn = draw_pictures(ready, result, tmp_path)
    assert not drawn.failures
    assert {"limits.png", "animation.html"} <= {*drawn.written}


def test_pages_and_pictures_have_the_obstacles_their_motion_and_a_floor_that_takes_no_room(tmp_path):
    text = BESIDE + "  - ground: {name: floor, ignored_links: [panda_link0]}"
    ready = prepared(tmp_path, text, **{"simulation.duration": 0.1})
    run, drawn = execute(ready).trajectory, ready.experiment.drawn_model
    commands = Recording(drawn, run)._scene.window.latest
    assert {(f"meshcat/obstacles/{name}", "set_object") for name in ("floor", "post")} <= {*commands}
    placed = umsgpack.unpackb(commands["meshcat/obstacles/post", "set_transform"])
    np.testing.assert_allclose(placed["matrix"][12:15], [0.3, 0.55, 0.5])
    animation = umsgpack.unpackb(commands["", "set_animation"])
    assert "/meshcat/obstacles/cylinder 2" in {each["path"] for each in animation["animations"]}
    (floor,) = (each for each in drawn.obstacles if each.unbounded)
    assert surface_points(floor.shape)[:, 2].max() == 0.0
    assert np.ptp(corners_over_time(drawn.obstacles, [0.0]), axis=0).max() < 3.0
    figure = Figure()
    assert len(draw_obstacles(figure.subplots(), drawn.obstacles, run.time)) == 1
    assert np.ptp(figure.axes[0].dataLim.get_points(), axis=0).max() < 3.0


def test_obstacles_without_collision_geometry_are_reported(tmp_path):
    text = (ROOT / "urdf" / "unicycle.urdf").read_text()
    (tmp_path / "bare.urdf").write_text(re.sub("<collision>.*</collision>", "", text))
    given = {"robot.urdf": str(tmp_path / "bare.urdf"), "obstacles": [{"sphere": {"radius": 0.1}}], "comparisons": {}}
    ready = Scenario.load("unicycle", given).build()
    assert any("no collision geometry" in each for each in ready.experiment.warnings)


@pytest.mark.parametrize("shape", [coal.Box(1, 2, 3), coal.Sphere(0.5), coal.Cylinder(0.3, 1), coal.Capsule(0.2, 0.6)])
def test_drawn_points_are_on_the_shape(shape):
    points = surface_points(shape)
    for direction in np.eye(3):
        shape.computeLocalAABB()
        assert (points @ direction).max() == pytest.approx(shape.aabb_local.max_ @ direction, abs=1e-9)


def test_a_map_is_boxes(tmp_path):
    (tmp_path / "lot.pgm").write_bytes(b"P5 3 2 255\n" + bytes([0, 254, 254, 254, 254, 0]))
    keys = "resolution: 0.5\norigin: [2, 1, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    (tmp_path / "lot.yaml").write_text(f"image: lot.pgm\n{keys}")
    text = "  - box: {size: [0.1, 0.1, 0.1], position: [3, 0, 0]}\n  - map: {file: lot.yaml, height: 1.0}\n"
    box, first, second = prepared(tmp_path, text).experiment.obstacles
    assert [each.name for each in (box, first, second)] == ["box 1", "map 2 1", "map 2 2"]
    assert (first.position.tolist(), second.position.tolist()) == ([3.25, 1.25, 0.5], [2.25, 1.75, 0.5])
    with pytest.raises(rnc.ModelError, match=r"obstacle 'map 2': map 'lott\.yaml'"):
        prepared(tmp_path, text.replace("lot", "lott"))


def test_a_map_of_the_package_is_found_by_its_name_and_one_beside_the_file_comes_first(tmp_path):
    text = "  - map: {file: warehouse.yaml, name: rack}\n"
    shipped = prepared(tmp_path, text).experiment.obstacles
    spans = {tuple(np.ptp(outline(each, 0.0), axis=0).round(9).tolist()) for each in shipped}
    assert (4.0, 0.8) in spans  # a rack
    (tmp_path / "warehouse.yaml").write_text((ROOT / "urdf" / "warehouse.yaml").read_text())
    (tmp_path / "warehouse.pgm").write_bytes(b"P5 1 1 255\n" + bytes([0]))
    assert len(prepared(tmp_path, text).experiment.obstacles) == 1
