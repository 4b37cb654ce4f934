"""Cubes around clouds and surfaces: what they cover, beside exact distances; files that other programs write."""

import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter

import rnc_pin as rnc
from rnc_pin.applications.scenario.schema.world import ObstacleItem, build_obstacles
from rnc_pin.collision import CollisionDistances, cells_around, load_cells
from rnc_pin.collision.occupied_cells import merged_boxes
from rnc_pin.planning import WaySettings, find_way

PCD = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS intensity normal x y z
SIZE 1 8 4 4 4
TYPE U F F F F
COUNT 1 3 1 1 1
WIDTH {n}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {n}
DATA {data}
"""


def cloud(count=400, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3)).astype(np.float32).astype(float)


def contains(boxes, points):
    """True for points that a box contains."""
    found = np.zeros(len(points), dtype=bool)
    for box in boxes:
        inside = (box.placement(0.0).inverse().homogeneous @ np.c_[points, np.ones(len(points))].T)[:3].T
        found |= (np.abs(inside) <= np.ravel(box.shape.halfSide) + 1e-9).all(axis=1)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_boxes_cover_each_cell_of_a_grid_once(seed):
    filled = np.random.default_rng(seed).random((7, 9, 11)) < 0.6
    count = np.zeros(filled.shape, dtype=int)
    for box in merged_boxes(filled):
        count[tuple(slice(at, at + size) for at, size in zip(box[:3], box[3:], strict=True))] += 1
    assert np.array_equal(count, filled)


def test_cells_contain_their_points_wherever_they_are_and_nothing_far_from_them():
    points = cloud()
    place = {"position": (1.0, -2.0, 0.5), "yaw": 0.7, "roll": 0.2, "pitch": -0.4}
    boxes = cells_around(points, 0.2).obstacles(**place)
    frame = boxes[0].placement(0.0)
    rotation = frame.rotation
    assert contains(boxes, points @ rotation.T + place["position"]).all()
    others = cloud(3000, 1)
    away = np.linalg.norm(others[:, None] - points, axis=2).min(axis=1)
    covered = contains(boxes, others @ rotation.T + place["position"])
    assert covered.any()
    assert away[covered].max() <= 0.2 * np.sqrt(3)


def written(path, points):
    """A file with points; trimesh writes PLY, the others follow the formats' descriptions."""
    n = len(points)
    if path.suffix == ".ply":
        path.write_bytes(trimesh.PointCloud(points).export(file_type="ply"))
    elif path.suffix == ".xyz":
        path.write_text("# x, y, z, intensity\n" + "".join(f"{x!r}, {y!r}, {z!r}, 7\n" for x, y, z in points.tolist()))
    elif path.stem == "text":
        rows = "".join(f"3 0 0 1 {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())
        path.write_text(PCD.format(n=n, data="ascii") + rows)
    else:
        kind = np.dtype([("intensity", "u1"), ("normal", "<f8", 3), ("place", "<f4", 3)])
        rows = np.zeros(n, dtype=kind)
        rows["place"] = points
        path.write_bytes(PCD.format(n=n, data="binary").encode() + rows.tobytes())
    return path


@pytest.mark.parametrize("name", ["a.ply", "a.xyz", "text.pcd", "binary.pcd"])
def test_all_formats_give_the_same_cells(tmp_path, name):
    points = cloud()
    wanted, found = cells_around(points, 0.25), load_cells(written(tmp_path / name, points), 0.25)
    assert np.array_equal(wanted.occupied, found.occupied)
    np.testing.assert_array_equal(wanted.origin, found.origin)


def test_no_returns_are_left_out():
    points = np.array([[0.1, 0.1, 0.1], [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]])
    assert cells_around(points, 0.2).occupied.shape == (1, 1, 1)


def test_a_hollow_stays_open_and_the_surface_is_covered(tmp_path):
    ring = trimesh.creation.torus(1.0, 0.2)
    ring.export(tmp_path / "ring.stl")
    side = 0.15
    boxes = load_cells(tmp_path / "ring.stl", side).obstacles()
    on_it, _ = trimesh.sample.sample_surface(ring, 2000, seed=0)
    assert contains(boxes, on_it).all()
    near = np.random.default_rng(0).uniform([-1.5, -1.5, -0.5], [1.5, 1.5, 0.5], (4000, 3))
    covered = near[contains(boxes, near)]
    tube = np.hypot(np.linalg.norm(covered[:, :2], axis=1) - 1.0, covered[:, 2])  # distance from the circle inside
    assert np.abs(tube - 0.2).max() <= side * (np.sqrt(3) + 0.25) + 0.01
    assert not contains(boxes, np.zeros((1, 3))).any()  # its hull is closed there


def test_a_way_leads_through_a_mesh_with_an_opening(tmp_path):
    walls = [trimesh.creation.box((0.1, 2.0, 1.0)) for _ in range(2)]
    for wall, y in zip(walls, (-1.6, 1.6), strict=True):
        wall.apply_translation((1.5, y, 0.0))
    beam = trimesh.creation.box((0.1, 1.4, 0.2))
    beam.apply_translation((1.5, 0.0, 1.0))
    trimesh.util.concatenate([*walls, beam]).export(tmp_path / "gate.stl")
    gate = load_cells(tmp_path / "gate.stl", 0.1).obstacles()
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")])
    start, goal = (
        robot.configuration({"root_joint": [-1.0, 0.0, 0.0]}),
        robot.configuration({"root_joint": [4.0, 0, 0]}),
    )
    way = find_way(system.reduce(), start, goal, gate, settings=WaySettings(shortcuts=0))
    distances = CollisionDistances(robot, gate, rnc.collision.PairSelection(links=False))
    replay = way.at(np.linspace(0.0, way.duration, 200))
    assert min(distances.smallest(q, 0.0, 0.2).min() for q in replay) >= 0.01


@pytest.mark.parametrize(
    ("name", "content", "side", "message"),
    [
        ("a.pcd", "VERSION 0.7\n", 0.1, "has no line 'DATA'"),
        ("a.pcd", PCD.format(n=2, data="ascii") + "3 0 0 1 1 2 3\n", 0.1, "has 1 points, its header says 2"),
        ("a.pcd", PCD.format(n=2, data="binary"), 0.1, "ends before its last point"),
        ("a.pcd", PCD.format(n=2, data="binary_compressed"), 0.1, "expected 'ascii' or 'binary'"),
        ("a.pcd", PCD.format(n=2, data="ascii").replace(" x ", " u "), 0.1, "FIELDS, with x, y and z"),
        ("a.xyz", "1 2\n", 0.1, "a.xyz"),
        ("a.xyz", "nan 0 0\n", 0.1, "there are no points"),
        ("a.xyz", "0 0 0\n1000 1000 1000\n", 0.1, "give a larger 'side'"),
        ("a.las", "", 0.1, r"expected one of \.pcd, \.ply, \.xyz"),
        ("none.xyz", None, 0.1, "No such file"),
    ],
)
def test_bad_files_are_one_line(tmp_path, name, content, side, message):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(rnc.ModelError, match=message) as caught:
        load_cells(tmp_path / name, side)
    assert "\n" not in str(caught.value)


def test_bad_arguments_are_one_line(tmp_path):
    with pytest.raises(rnc.InputError, match=r"points have shape \(3,\), expected \(n, 3\)"):
        cells_around([1.0, 2.0, 3.0], 0.1)
    with pytest.raises(rnc.InputError, match="side: expected a positive number, found 0"):
        cells_around([[1.0, 2.0, 3.0]], 0.0)
    scattered = 10.0 * cloud(4000)
    with pytest.raises(rnc.ModelError, match="boxes, expected at most 2000: give a larger 'side'"):
        cells_around(scattered, 0.3).obstacles()


def test_a_scenario_file_names_a_cloud(tmp_path):
    points = cloud()
    written(tmp_path / "scan.pcd", points)
    place = {"position": [1.0, 0.0, 0.5], "yaw": 0.3}
    item = TypeAdapter(ObstacleItem).validate_python({"cells": {"file": "scan.pcd", "side": 0.25, **place}})
    found, wanted = build_obstacles([item], tmp_path), cells_around(points, 0.25).obstacles(**place)
    for a, b in zip(found, wanted, strict=True):
        np.testing.assert_allclose(a.placement(0.0).homogeneous, b.placement(0.0).homogeneous)
    assert found[0].name == "cells 1 1"
    with pytest.raises(rnc.ConfigurationError, match=r"obstacle 'cells 1': .*none\.xyz.*No such file"):
        build_obstacles(
            [TypeAdapter(ObstacleItem).validate_python({"cells": {"file": "none.xyz", "side": 1}})], tmp_path
        )
