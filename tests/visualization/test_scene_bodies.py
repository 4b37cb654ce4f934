"""Drawn patches lie on their surfaces, under the motion."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.visualization import scene_bodies
from rnc_pin.visualization.drawn_state import DrawnModel, DrawnState, View, grounds_of
from rnc_pin.visualization.elements import SceneKinematics
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.scene_bodies import ground_patch, ground_pose, is_drawn

GROUNDS = {
    "plane": rnc.GroundPlane(normal=(0.2, -0.3, 1.0), point=(0.1, 0.2, 0.3)),
    "bowl": rnc.SphericalGround(2.0, (0.0, 0.0, 1.9)),
    "pipe": rnc.CylindricalGround(2.0, (0.2, 1.0, 0.3), (0.1, 0.2, 1.9)),
}


@pytest.mark.parametrize("name", GROUNDS)
def test_patches_are_on_the_surface_under_the_motion(name):
    ground, places = GROUNDS[name], np.array([[0.0, 0.0, 0.2], [0.6, 0.1, 0.4]])
    vertices, triangles = ground_patch(ground, places, 0.2)
    levels = (vertices - ground.point) @ ground.axes[2] if name == "plane" else ground.level(vertices)
    np.testing.assert_allclose(levels, 0.0, atol=1e-12)
    assert sorted(set(triangles.ravel().tolist())) == list(range(len(vertices)))
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    assert (sides[:, 0] != sides[:, 1]).all()
    assert len(np.unique(sides, axis=0)) == len(sides), "triangles overlap"
    feet = places[:, :2]
    assert (vertices[:, :2].min(axis=0) <= feet.min(axis=0)).all()
    assert (vertices[:, :2].max(axis=0) >= feet.max(axis=0)).all()


def test_ground_on_a_body_moves_with_it_and_is_drawn_if_the_body_is_not():
    plane = rnc.GroundPlane(frame="plate")
    robot = rnc.Robot.from_urdf("ball_on_plate.urdf")
    tilted = robot.configuration({"roll": 0.3, "free": [0.1, 0.0, 0.46, 0, 0, 0, 1]})
    assert not is_drawn(plane, robot)
    assert is_drawn(plane, rnc.Robot(robot.model))
    assert is_drawn(rnc.GroundPlane(), robot)
    kinematics = SceneKinematics(robot)
    place = kinematics.placement("plate", tilted)
    np.testing.assert_allclose(ground_pose(plane, kinematics, tilted).homogeneous, place.homogeneous, atol=1e-12)
    assert ground_pose(rnc.GroundPlane(), kinematics, tilted) == pin.SE3.Identity()
    system = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.06, plane)])
    bare, scene, moved = SceneKinematics(rnc.Robot(robot.model)), MeshcatScene(), {}
    scene.place = lambda name, matrix: moved.update({name: matrix})
    for sheet in scene_bodies.ground_elements(system.reduce(), bare, [tilted], 1.0):
        sheet.build(scene)
        sheet.update(scene, DrawnState(0.0, tilted, *(np.zeros(0),) * 6, 1.0))
    ((_, matrix),) = moved.items()
    np.testing.assert_allclose(matrix, place.homogeneous, atol=1e-12)


def test_other_ground_replaces_the_grid():
    robot = rnc.Robot.from_urdf("rolling_ball.urdf", base="free")
    for ground, count in ((None, 0), (GROUNDS["bowl"], 1)):
        reduced = rnc.NonholonomicSystem(robot, [rnc.RollingBall("ball", 0.2, ground)]).reduce()
        assert len(grounds_of(reduced)) == count
        assert DrawnModel.of(reduced).ground_height(View()) == (None if count else 0.0)
        assert DrawnModel.of(reduced).ground_height(View(ground=0.5)) == 0.5
