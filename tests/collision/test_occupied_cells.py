"""Cubes around clouds and surfaces, and maps of ROS navigation: what they cover, beside distances and map_server."""

import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter

import rnc_pin as rnc
from rnc_pin.applications.scenario.schema.world import ObstacleItem, build_obstacles
from rnc_pin.collision import CollisionDistances, cells_around, load_cells, load_map
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


@pytest.mark.parametrize("shape", [(7, 9, 11), (17, 23)])
@pytest.mark.parametrize("seed", range(3))
def test_boxes_cover_each_cell_of_a_grid_once(seed, shape):
    filled = np.random.default_rng(seed).random(shape) < 0.6
    count = np.zeros(shape, dtype=int)
    for first, size in (np.split(box, 2) for box in merged_boxes(filled)):
        count[tuple(map(slice, first, first + size))] += 1
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
    start = robot.configuration({"root_joint": [-1.0, 0.0, 0.0]})
    goal = robot.configuration({"root_joint": [4.0, 0, 0]})
    way = find_way(system.reduce(), start, goal, gate, settings=WaySettings(shortcuts=0))
    distances = CollisionDistances(robot, gate, rnc.collision.PairSelection(links=False))
    replay = way.at(np.linspace(0.0, way.duration, 200))
    assert min(distances.smallest(q, 0.0, 0.2).min() for q in replay) >= 0.01


@pytest.mark.parametrize(("name", "content", "side", "message"), [
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
])  # fmt: skip
def test_bad_files_are_one_line(tmp_path, name, content, side, message):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(rnc.ModelError, match=message) as caught:
        load_cells(tmp_path / name, side)
    assert "\n" not in str(caught.value)


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


YAML = """
image: {image}
resolution: 0.5
origin: [{x}, {y}, {yaw}]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.196
"""


def written_map(folder, pixels, image="lot.pgm", x=-1.0, y=2.0, yaw=0.0, negate=0):
    """A map: brightness of the pixels, the top row first."""
    rows = np.asarray(pixels, dtype=np.uint8)
    if image.endswith(".pgm"):
        (folder / image).write_bytes(b"P5\n# made by a test\n%d %d\n255\n" % rows.shape[::-1] + rows.tobytes())
    else:
        from PIL import Image

        Image.fromarray(rows).save(folder / image)
    path = folder / "lot.yaml"
    path.write_text(YAML.format(image=image, x=x, y=y, yaw=yaw, negate=negate))
    return path


@pytest.mark.parametrize("image", ["lot.pgm", "lot.png"])
def test_thresholds_are_those_of_map_server(tmp_path, image):
    found = load_map(written_map(tmp_path, [[254, 205, 0], [89, 90, 206]], image))
    # Occupancy (255 - c) / 255: 0.004, 0.196, 1; 0.651, 0.647, 0.192. Row 0 is the lowest one of the image.
    assert found.occupied.tolist() == [[True, False, False], [False, False, True]]
    assert found.unknown.tolist() == [[False, True, False], [False, True, False]]
    turned = load_map(written_map(tmp_path, [[0, 255]], image, negate=1))
    assert turned.occupied.tolist() == [[False, True]]


def test_boxes_are_where_the_cells_are(tmp_path):
    yaw = 0.7
    box, other = load_map(written_map(tmp_path, [[0, 254, 254], [254, 254, 0]], yaw=yaw)).obstacles(height=1.2)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    # The lowest row comes first: its third cell, then the first cell of the row above.
    np.testing.assert_allclose(box.position, [*(turn @ [1.25, 0.25] + [-1.0, 2.0]), 0.6])
    np.testing.assert_allclose(other.position, [*(turn @ [0.25, 0.75] + [-1.0, 2.0]), 0.6])
    assert np.ravel(box.shape.halfSide).tolist() == [0.25, 0.25, 0.6]
    assert box.yaw == yaw
    assert [box.name, other.name] == ["map 1", "map 2"]


def test_a_wall_is_one_box_and_coarser_cells_cover_finer_ones(tmp_path):
    pixels = np.full((20, 30), 254)
    pixels[4, 3:25] = 0
    grid = load_map(written_map(tmp_path, pixels))
    (wall,) = grid.obstacles()
    assert np.ravel(wall.shape.halfSide)[:2].tolist() == [5.5, 0.25]
    (coarse,) = grid.obstacles(cells=4)
    halves = np.ravel(coarse.shape.halfSide)[:2]
    assert (np.abs(coarse.position[:2] - wall.position[:2]) <= halves - [5.5, 0.25] + 1e-12).all()


def test_unknown_cells_are_obstacles_if_asked(tmp_path):
    grid = load_map(written_map(tmp_path, [[254, 150, 0]]))
    assert len(grid.obstacles()) == 1
    assert np.ravel(grid.obstacles(unknown=True)[0].shape.halfSide)[0] == 0.5  # both cells are one box


def test_a_robot_keeps_its_distance_from_a_map(tmp_path):
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    pixels = np.full((10, 20), 254)
    pixels[:, 12] = 0  # x from 5 to 5.5
    obstacles = load_map(written_map(tmp_path, pixels, y=-2.5)).obstacles()
    distances = CollisionDistances(robot, obstacles)
    here, ahead = (distances.smallest(robot.configuration({"root_joint": [x, 0, 0]}), 0.0, 9.0).min() for x in (0, 1))
    assert here - ahead == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("change", "message"), [
    (("resolution: 0.5", "resolution: -1"), "resolution: expected greater than 0"),
    (("free_thresh: 0.196", ""), "free_thresh: is missing"),
    (("free_thresh: 0.196", "free_thresh: 0.65"), "free_thresh: expected less than occupied_thresh"),
    (("negate: 0", "negat: 0"), "'negat' is not known; did you mean 'negate'"),
    (("negate: 0", "negate: [0"), "while parsing a flow sequence"),
    (("negate: 0", "negate: 2"), "negate: expected 0 or 1"),
    (("origin: [-1.0, 2.0, 0.0]", "origin: [1, 2]"), "origin: expected at least 3 items"),
    (("image: lot.pgm", "image: ../lot.pgm"), "not in the folder of the map"),
    (("image: lot.pgm", "image: none.pgm"), "No such file"),
    (("image: lot.pgm", "image: lot.yaml"), "neither PGM nor PNG"),
    (("negate: 0", "negate: 0\nmode: raw"), "mode: expected 'trinary' or 'scale'"),
])  # fmt: skip
def test_bad_maps_are_one_line(tmp_path, change, message):
    path = written_map(tmp_path, [[0, 254]])
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(rnc.ModelError, match=message) as caught:
        load_map(path)
    assert "\n" not in str(caught.value)


def test_a_damaged_image_and_too_many_boxes_are_refused(tmp_path):
    path = written_map(tmp_path, np.random.default_rng(0).integers(0, 255, (30, 30)), "lot.png")
    image = tmp_path / "lot.png"
    image.write_bytes(image.read_bytes()[:200])
    with pytest.raises(rnc.ModelError, match=r"image 'lot\.png'"):
        load_map(path)
    checks = np.indices((100, 100)).sum(axis=0) % 2 * 254
    with pytest.raises(rnc.ModelError, match="5000 boxes, expected at most 2000: give more 'cells'"):
        load_map(written_map(tmp_path, checks)).obstacles()
