"""Obstacles: poses, motions, meshes from files, and what is refused."""

import coal
import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.collision import Obstacle, ground_shape, load_mesh_shape

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_pose_turns_by_roll_pitch_and_yaw():
    pose = Obstacle(coal.Box(1, 2, 3), position=(1, 2, 3), yaw=np.pi / 2, roll=np.pi / 2).placement(0.0)
    np.testing.assert_allclose(pose.rotation @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(pose.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_twist_is_the_derivative_of_the_pose():
    motion = rnc.planning.Harmonic([1.0, 2.0, 0.5, 0.2], [0.3, -0.2, 0.1, 0.7], 0.4)
    obstacle = Obstacle(coal.Sphere(0.1), motion=motion, name="ball")
    t, h = 1.3, 1e-6
    ahead, behind = obstacle.placement(t + h), obstacle.placement(t - h)
    twist = obstacle.twist(t)
    np.testing.assert_allclose((ahead.translation - behind.translation) / (2 * h), twist[:3], atol=1e-8)
    turning = (ahead.rotation - behind.rotation) / (2 * h) @ obstacle.placement(t).rotation.T
    np.testing.assert_allclose([turning[2, 1], turning[0, 2], turning[1, 0]], twist[3:], atol=1e-8)


def test_mesh_becomes_its_hull(tmp_path):
    file = tmp_path / "rock.obj"
    file.write_text(TETRAHEDRON)
    shape = load_mesh_shape(file, scale=(2.0, 1.0, 1.0))
    assert shape.computeVolume() == pytest.approx(2.0 / 6.0)
    assert Obstacle(shape, name="rock").shape is shape


def test_flat_mesh_gets_a_thickness(tmp_path):
    file = tmp_path / "sheet.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n")
    assert 0.0 < load_mesh_shape(file).computeVolume() < 2e-3


def test_floor_is_a_half_space():
    floor = Obstacle(ground_shape(), position=(0, 0, 0.2), name="floor", ignored_links=["wheel"])
    assert floor.unbounded
    assert floor.ignored_links == ("wheel",)
    assert not Obstacle(coal.Sphere(1)).unbounded


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"shape": coal.Box(1, 0, 1)}, "sizes have to be positive"),
        ({"shape": coal.Sphere(-1)}, "sizes have to be positive"),
        ({"shape": coal.Sphere(np.inf)}, "sizes have to be positive and finite"),
        ({"shape": coal.Sphere(1), "position": (0, 0)}, "three finite numbers"),
        ({"shape": coal.Sphere(1), "position": (0, 0, np.nan)}, "three finite numbers"),
        ({"shape": coal.Sphere(1), "yaw": "left"}, "have to be numbers"),
        ({"shape": coal.Sphere(1), "motion": rnc.planning.Hold([0, 0, 0])}, "motion has 3 numbers"),
        ({"shape": coal.Plane(np.array([0.0, 0.0, 1.0]), 0.0)}, "is a Plane"),
        ({"shape": "box"}, "expected a coal shape"),
        ({"shape": coal.Box(1, 1, 1), "ignored_links": "wheel"}, "takes names of links, found 'wheel'"),
    ],
)
def test_unusable_obstacles_are_refused(arguments, words):
    with pytest.raises(rnc.RncError, match=words):
        Obstacle(name="it", **arguments)


def test_unusable_meshes_are_refused(tmp_path):
    with pytest.raises(rnc.ModelError, match="rock"):
        load_mesh_shape(tmp_path / "rock.obj")
    bad = tmp_path / "bad.stl"
    bad.write_bytes(b"\xff" * 90)
    with pytest.raises(rnc.ModelError, match=r"bad\.stl"):
        load_mesh_shape(bad)
    good = tmp_path / "rock.obj"
    good.write_text(TETRAHEDRON)
    with pytest.raises(rnc.ModelError, match="scale"):
        load_mesh_shape(good, 0.0)
