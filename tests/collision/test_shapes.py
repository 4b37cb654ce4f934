"""Hulls of meshes, obstacles (poses, motions, meshes from files, refusals), and pairs beside coal and closed forms."""

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection, load_mesh_shape
from rnc_pin.collision.shapes import LinkPair, PairMeasurement, hull_of
from rnc_pin.errors import SimulationError
from systems import with_shape
from urdf_parts import TETRAHEDRON

ANGLES = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
RING = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES])


def test_a_drum_of_many_corners_keeps_its_shape():
    """Its flat faces are fans about one corner at first."""
    hull = hull_of(np.vstack([RING, RING + np.array([0.0, 0.0, 2.0])]), "drum")
    assert hull.num_points == 800
    assert hull.computeVolume() == pytest.approx(2.0 * 200 * np.sin(2 * np.pi / 400), rel=1e-9)


def test_the_tip_of_a_fine_cone_gets_a_box_that_contains_it():
    hull = hull_of(np.vstack([RING, [[0.0, 0.0, 1.0]]]), "cone")
    assert (hull.num_points, hull.computeVolume()) == (8, pytest.approx(4.0))


def wheel_on_an_axle(shape, placement):
    """A shape on a revolute joint about an axis that is not one of the frame, 0.5 m beside a small ball."""
    model, axle = pin.Model(), pin.JointModelRevoluteUnaligned(np.array([0.0, 0.6, 0.8]))
    place = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1), np.array([0.0, 0.0, 1.0]))
    add_body(model, "axle", axle, 1.0, at=place, frame="wheel")
    robot = with_shape(rnc.Robot(model), "wheel", shape, placement)
    ball = Obstacle(coal.Sphere(0.1), position=(0.5, 0.4, 0.9), name="ball")
    return CollisionDistances(robot, [ball], PairSelection(links=False))


ALONG = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.6, 0.8])).toRotationMatrix()


@pytest.mark.parametrize(
    "shape", [coal.Cylinder(0.3, 0.1), coal.Capsule(0.1, 0.3), coal.Cone(0.3, 0.2), coal.Sphere(0.3)]
)
def test_a_wheel_keeps_its_distance_and_its_pose_without_spin(shape):
    distances = wheel_on_an_axle(shape, pin.SE3(ALONG, 0.05 * ALONG[:, 2]))
    assert distances.spinning.shapes.tolist() == [0]
    assert distances.spinning.wobble[0] < 1e-15
    placed = [distances.place(np.array([[angle]]), np.zeros(1)).still[0, 0] for angle in (0.0, 1.0, 2.0)]
    np.testing.assert_allclose(placed[1], placed[0], atol=1e-14)
    measured = [distances.smallest([angle], beyond=9.0)[0] for angle in np.linspace(-3.0, 3.0, 7)]
    assert np.ptp(measured) < 1e-7


def test_the_wobble_bounds_what_rounded_angles_change():
    """A wheel whose angles have five digits: its distances change, by less than twice the wobble."""
    tilted = ALONG @ pin.rpy.rpyToMatrix(4e-6, 0.0, 0.0)
    distances = wheel_on_an_axle(coal.Cylinder(0.3, 0.1), pin.SE3(tilted, np.zeros(3)))
    wobble = distances.spinning.wobble[0]
    assert 1e-6 < wobble < 2e-6
    measured = [distances.smallest([angle], beyond=9.0)[0] for angle in np.linspace(-3.0, 3.0, 40)]
    assert 1e-7 < np.ptp(measured) < 2.0 * wobble


@pytest.mark.parametrize(("shape", "placement"), [
    (coal.Cylinder(0.3, 0.1), pin.SE3(ALONG @ pin.rpy.rpyToMatrix(1e-3, 0.0, 0.0), np.zeros(3))),
    (coal.Cylinder(0.3, 0.1), pin.SE3(ALONG, np.array([1e-3, 0.0, 0.0]))),
    (coal.Sphere(0.3), pin.SE3(ALONG, np.array([1e-3, 0.0, 0.0]))),
    (coal.Box(0.3, 0.3, 0.1), pin.SE3(ALONG, np.zeros(3))),
], ids=["tilted", "eccentric", "eccentric ball", "box"])  # fmt: skip
def test_other_bodies_spin(shape, placement):
    assert not len(wheel_on_an_axle(shape, placement).spinning.shapes)


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


def test_a_failed_search_of_a_depth_is_an_error(monkeypatch):
    monkeypatch.setattr(coal, "distance", lambda *given: -np.finfo(float).max)
    measurement = PairMeasurement([coal.Sphere(0.3)] * 2, [LinkPair(0, 1, ("front", "rear"))])
    with pytest.raises(SimulationError, match="no penetration depth of front / rear"):
        measurement.measure(np.array([0]), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)))


def test_wheels_that_touch_have_distance_0_at_every_turn(generator):
    """Two wheels of 0.1 m whose axles are 0.2 m apart: coal fails with its finest tolerance in 1 of 100 poses."""
    measurement = PairMeasurement([coal.Cylinder(0.1, 0.04)] * 2, [LinkPair(0, 1, ("front", "rear"))])
    for _ in range(1000):
        turned = np.linalg.qr(generator.standard_normal((3, 3)))[0]
        turned[:, 0] *= np.linalg.det(turned)
        turns = ((np.cos(a), np.sin(a)) for a in generator.uniform(-3, 3, 2))
        rolled = [[[c, -s, 0], [s, c, 0], [0, 0, 1]] for c, s in turns]
        middle = generator.standard_normal(3)
        origins = np.array([middle, middle + 0.2 * turned[:, 0]])
        assert abs(measurement.measure(np.array([0]), turned @ rolled, origins)[0, 0]) < 1e-6
