"""Collision shapes of the package's robot files against their visual shapes, point by point."""

from itertools import product
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc

FIXED = {"ball_on_plate", "space_robot", "disk_on_slope", "shaken_pendulum"}  # with a stand, or a base without mass
APART = {"rattleback"}  # a stone that a mesh draws, with nothing to collide
FILES = sorted(file for file in (Path(__file__).parents[2] / "urdf").glob("*.urdf") if file.stem not in APART)
MARKS = {"ball_on_plate": 0.006, "rolling_ball": 0.015, "rolling_hoop": 0.01, "chaplygin_ball": 0.021}
"""Marks that show the turning of a wheel extend beyond its rolling surface [m]. They are drawn only."""


def load(file):
    return rnc.Robot.from_urdf(file, base="fixed" if file.stem in FIXED else "planar")


def surface(geometry):
    """Points (n, 3) of a primitive's surface."""
    if isinstance(geometry, coal.Box):
        return np.array(list(product((-1, 0, 1), repeat=3))) * geometry.halfSide
    angle = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    if isinstance(geometry, coal.Cylinder):
        ends = [[0.0, 0.0, height] for height in np.linspace(-geometry.halfLength, geometry.halfLength, 5)]
        return np.concatenate([geometry.radius * circle + end for end in ends])
    assert isinstance(geometry, coal.Sphere)
    polar = np.linspace(0.0, np.pi, 13)
    return geometry.radius * np.concatenate([np.sin(p) * circle + [0.0, 0.0, np.cos(p)] for p in polar])


def placed_points(shapes):
    return np.concatenate([surface(each.geometry) @ each.placement.rotation.T + each.placement.translation
                           for each in shapes])  # fmt: skip


def depth_outside(shapes, points):
    """Largest distance of a point from the union of shapes [m]; zero inside."""
    dot, request, worst = coal.Sphere(1e-9), coal.DistanceRequest(), 0.0
    for point in points:
        at = coal.Transform3s(np.eye(3), point)
        gaps = []
        for shape in shapes:
            pose = coal.Transform3s(shape.placement.rotation, shape.placement.translation)
            gaps.append(coal.distance(shape.geometry, pose, dot, at, request, coal.DistanceResult()))
        worst = max(worst, min(gaps))
    return worst


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_collision_shapes_contain_what_is_drawn_and_little_else(file):
    robot = load(file)
    drawn, solid = ([*geometry.geometryObjects] for geometry in (robot.visual_model, robot.collision_model))
    links = {each.parentFrame for each in drawn}
    assert links == {each.parentFrame for each in solid}
    allowed = MARKS.get(file.stem, 0.0) + 2e-3
    for link in links:
        shown, kept = ([each for each in shapes if each.parentFrame == link] for shapes in (drawn, solid))
        assert len(kept) <= len(shown)
        assert depth_outside(kept, placed_points(shown)) < allowed
        here, there = placed_points(shown), placed_points(kept)
        assert (here.min(axis=0) - there.min(axis=0) < allowed).all()
        assert (there.max(axis=0) - here.max(axis=0) < allowed).all()


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_links_that_are_not_adjacent_are_apart_at_the_neutral_configuration(file):
    distances = rnc.collision.CollisionDistances(load(file))
    assert {each.reason for each in distances.omitted} <= {"adjacent links"}
    robot = distances.robot
    data, placed = robot.model.createData(), robot.collision_model.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.collision_model, placed, robot.configuration())
    shapes = robot.collision_model.geometryObjects
    for pair in distances.pairs:  # coal itself, on the shapes of the file
        poses = [coal.Transform3s(placed.oMg[k].rotation, placed.oMg[k].translation) for k in pair[:2]]
        first, second = (shapes[k].geometry for k in pair[:2])
        assert coal.distance(first, poses[0], second, poses[1], coal.DistanceRequest(), coal.DistanceResult()) > 0.01
