"""Pairs that DistanceBounds leaves out, against the distances of all pairs, and corners of contacts, against scipy."""

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import HalfspaceIntersection

import rnc_pin as rnc
from rnc_pin.collision import CollisionDistances, Obstacle
from rnc_pin.collision.distance_bounds import FlatParts, common_corners

WITHIN = 0.15


def test_pairs_that_approach_along_a_path_are_measured_in_time():
    """Steps of all sizes, a person who walks by, and kinematics from an evaluation of the model or from q."""
    robot = rnc.Robot.from_example("panda")
    reduced = rnc.NonholonomicSystem(robot).reduce()
    walk = rnc.planning.MinimumJerk([0.5, -2.0, 0.8, 0.0], [0.5, 2.0, 0.8, 3.0], duration=6.0)
    person = Obstacle(coal.Box(0.2, 0.6, 1.2), roll=0.3, name="person", motion=walk)
    post = Obstacle(coal.Cylinder(0.1, 1.0), position=(0.7, 0.5, 0.5), name="post")
    used, every = CollisionDistances(robot, [person, post]), CollisionDistances(robot, [person, post])
    generator = np.random.default_rng(3)
    q, direction, counts = robot.configuration(), generator.standard_normal(robot.nv), []
    for sample in range(40):
        if sample % 12 == 0:
            direction = generator.standard_normal(robot.nv)
        q = pin.integrate(robot.model, q, (0.5 if sample % 20 == 19 else 0.03) * direction)
        t = 0.1 * sample
        near = used.at(reduced.at(q) if sample % 3 else q, t, within=WITHIN)
        whole = every.at(q, t)
        inside = whole.distance < WITHIN
        np.testing.assert_array_equal(near.pairs, whole.pairs[inside])
        for key in ("distance", "drift"):
            np.testing.assert_allclose(getattr(near, key), getattr(whole, key)[inside], atol=1e-6)
        separate = inside & (whole.distance > 1e-3)  # the normal of a penetration may jump
        mine = whole.distance[inside] > 1e-3
        fixed = near.point_b[mine] - near.point_a[mine] - near.distance[mine, None] * near.normal[mine]
        assert np.abs(fixed).max(initial=0.0) < 1e-6
        np.testing.assert_allclose(near.jacobian[mine], whole.jacobian[separate], atol=1e-4)
        counts.append(len(near.pairs))
    assert len(set(counts)) > 5


UP = np.array([0.0, 0.0, 1.0])


def half_planes(sides, yaw, middle):
    """Rows (4, 3) of ``a x + b y + c <= 0`` for a rectangle."""
    axes = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    both = np.vstack([axes, -axes])
    return np.column_stack([both, -both @ middle - 0.5 * np.tile(sides, 2)])


@pytest.mark.parametrize("seed", range(6))
def test_two_boxes_face_to_face(seed):
    generator = np.random.default_rng(seed)
    sides, yaws = generator.uniform(0.3, 1.0, (2, 3)), generator.uniform(-2.0, 2.0, 2)
    middle = generator.uniform(-0.2, 0.2, 2)
    centers = np.array([[0.0, 0.0, -0.5 * sides[0, 2]], [*middle, 0.07 + 0.5 * sides[1, 2]]])
    faces = []
    for k, direction in enumerate((UP, -UP)):
        turned = pin.rpy.rpyToMatrix(0.0, 0.0, yaws[k])
        corners = FlatParts(coal.Box(*sides[k])).towards(turned.T @ direction)
        assert len(corners) == 4
        faces.append(corners @ turned.T + centers[k])
    found = common_corners(*faces, UP)
    rows = np.vstack([half_planes(sides[0, :2], yaws[0], np.zeros(2)), half_planes(sides[1, :2], yaws[1], middle)])
    expected = HalfspaceIntersection(rows, 0.5 * middle).intersections
    assert len(found) == len(np.unique(expected.round(9), axis=0)) >= 4
    for corner in expected:
        assert np.linalg.norm(found[:, 1:3] - corner, axis=1).min() < 1e-9
    np.testing.assert_allclose(found[:, 0], 0.07, atol=1e-12)
    np.testing.assert_allclose(found[:, 4:7] - found[:, 1:4], 0.07 * UP[None] + 0 * found[:, :3], atol=1e-12)


def test_a_face_that_is_nearly_parallel_has_the_gap_of_each_corner():
    tilt = pin.rpy.rpyToMatrix(0.0, 0.004, 0.0)
    top = FlatParts(coal.Box(2.0, 2.0, 1.0)).towards(UP)
    bottom = FlatParts(coal.Box(0.4, 0.3, 0.2)).towards(tilt.T @ -UP) @ tilt.T + [0.0, 0.0, 0.8]
    found = common_corners(top, bottom, UP)
    assert len(found) == 4
    np.testing.assert_allclose(np.sort(found[:, 0]), np.sort(bottom[:, 2]) - 0.5, atol=1e-12)
    steep = pin.rpy.rpyToMatrix(0.0, 0.4, 0.0)
    edge = FlatParts(coal.Box(0.4, 0.3, 0.2)).towards(steep.T @ -UP)
    assert len(edge) == 2
    assert len(common_corners(top, edge @ steep.T + [0.0, 0.0, 0.9], UP)) == 2


def test_cylinders_and_capsules_have_their_lines_and_ends():
    lying = pin.rpy.rpyToMatrix(0.0, 0.5 * np.pi, 0.0)
    for shape in (coal.Cylinder(0.2, 0.6), coal.Capsule(0.2, 0.6)):
        line = FlatParts(shape).towards(lying.T @ -UP) @ lying.T
        np.testing.assert_allclose(line[np.argsort(line[:, 0])], [[-0.3, 0, -0.2], [0.3, 0, -0.2]], atol=1e-12)
    disk = FlatParts(coal.Cylinder(0.2, 0.6)).towards(-UP)
    np.testing.assert_allclose(disk[:, 2], -0.3)
    directions = np.stack([np.cos(np.linspace(0, 6, 50)), np.sin(np.linspace(0, 6, 50))])
    assert ((disk[:, :2] @ directions).max(axis=0) >= 0.2 - 1e-12).all()  # the disk is inside
    # Crossing lines meet at a point, as a ball does with anything.
    crossing = np.array([[0.0, -0.3, 0.5], [0.0, 0.3, 0.5]])
    line = np.array([[-0.3, 0.0, 0.2], [0.3, 0.0, 0.2]])
    assert not len(common_corners(line, crossing, UP))
    assert len(common_corners(line, line * 0.5 + [0.1, 0.0, 0.4], UP)) == 2
    assert not len(common_corners(FlatParts(coal.Sphere(0.2)).towards(UP), line, UP))
