"""Cubes around points, and maps of ROS navigation: what they cover, beside distances and map_server."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.collision import cells_around, load_map
from rnc_pin.collision.occupied_cells import merged_boxes


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


def test_cells_contain_their_points_and_nothing_far_from_them():
    points = cloud()
    boxes = cells_around(np.vstack([points, [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]]), 0.2, "scan")
    assert boxes[1].name == "scan 2"
    assert contains(boxes, points).all()
    others = cloud(3000, 1)
    away = np.linalg.norm(others[:, None] - points, axis=2).min(axis=1)
    covered = contains(boxes, others)
    assert covered.any()
    assert away[covered].max() <= 0.2 * np.sqrt(3)


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
    assert load_map(written_map(tmp_path, [[0, 255]], image, negate=1)).occupied.tolist() == [[False, True]]


def test_boxes_are_where_the_cells_are(tmp_path):
    yaw = 0.7
    box, other = load_map(written_map(tmp_path, [[0, 254, 254], [254, 254, 0]], yaw=yaw)).obstacles(height=1.2)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    # The lowest row comes first: its third cell, then the first cell of the row above.
    np.testing.assert_allclose(box.position, [*(turn @ [1.25, 0.25] + [-1.0, 2.0]), 0.6])
    np.testing.assert_allclose(other.position, [*(turn @ [0.25, 0.75] + [-1.0, 2.0]), 0.6])
    assert (np.ravel(box.shape.halfSide).tolist(), box.yaw) == ([0.25, 0.25, 0.6], yaw)
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
