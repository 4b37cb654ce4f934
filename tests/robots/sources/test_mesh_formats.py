# ruff: noqa: E501
"""Meshes: what is read, what is refused, and that nothing else is given a stranger's file."""

import json
import os
import struct
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import mesh_solid as solid
import rnc_pin as rnc
from patience import ending_within
from rnc_pin.robots import robot_files
from rnc_pin.robots.sources import mesh_formats
from rnc_pin.robots.sources import mesh_readers as readers
from rnc_pin.robots.sources.mesh_formats import read_mesh
from rnc_pin.robots.sources.mesh_readers import convex_hull, read_collada
from urdf_parts import write

SINGLE = 1e-7  # [m], of vertices kept in single precision
PLY = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n{}end_header\n"
LIST = "property list uchar int vertex_indices\n"


def corners_of(found):
    """Triangles (k, 3, 3) in an order that does not depend on how vertices are numbered."""
    triangles = found.vertices[found.triangles]
    return triangles[np.lexsort(np.round(triangles, 5).reshape(len(triangles), 9).T)]


WHOLE = [(name, content) for name, contents in solid.MESHES.values() for content in contents]


@pytest.mark.parametrize(("name", "content"), WHOLE, ids=[f"{name}-{k}" for k, (name, _) in enumerate(WHOLE)])
def test_one_solid_is_the_same_in_every_format(name, content, tmp_path):
    found = read_mesh(write(tmp_path / name, content))
    expected = readers.Mesh(solid.VERTICES, solid.TRIANGLES)
    np.testing.assert_allclose(corners_of(found), corners_of(expected), atol=SINGLE)


@pytest.mark.parametrize(
    ("name", "kind"), [("panda", "visual"), ("ur5_robot", "collision"), ("tiago_no_hand", "collision")]
)
def test_the_geometry_of_robots_is_that_of_pinocchios_own_loader(name, kind):
    path, packages = robot_files.find_example(name)
    robot = rnc.Robot.from_example(name, snap=False)
    geometry = robot.visual_model if kind == "visual" else robot.collision_model
    kind, folders = getattr(pin.GeometryType, kind.upper()), [str(packages), str(path.parent)]
    assert_same_shapes(geometry, pin.buildGeomFromUrdf(robot.model, str(path), kind, None, folders))


def assert_same_shapes(geometry, theirs):
    assert [shape.name for shape in geometry.geometryObjects] == [shape.name for shape in theirs.geometryObjects]
    for ours, other in zip(geometry.geometryObjects, theirs.geometryObjects, strict=True):
        assert type(ours.geometry) is type(other.geometry)
        assert ours.parentJoint == other.parentJoint
        assert ours.placement.isApprox(other.placement, 1e-12)
        assert Path(ours.meshPath).resolve() == Path(other.meshPath).resolve()
        np.testing.assert_array_equal(ours.meshScale, other.meshScale)
        np.testing.assert_array_equal(ours.meshColor, other.meshColor)
        assert (ours.overrideMaterial, ours.meshTexturePath) == (other.overrideMaterial, other.meshTexturePath)
        for shape in (ours, other):
            shape.geometry.computeLocalAABB()
        boxes = [(each.geometry.aabb_local.min_, each.geometry.aabb_local.max_) for each in (ours, other)]
        np.testing.assert_allclose(*boxes, rtol=0, atol=3e-6 * np.abs(boxes[1]).max())


def glb(change):
    document = json.loads(solid.gltf(inside=True))
    change(document)
    return json.dumps(document)


def collada(old, new):
    text = solid.collada().decode()
    assert old in text
    return text.replace(old, new)


def nodes(count, width=10):
    """Nodes, each of which is ten times the next: ten to the power of ``count`` meshes."""
    link = '<instance_node url="#n{}"/>'
    inner = "".join(f'<node id="n{k}">{link.format(k + 1) * width}</node>' for k in range(count))
    return f'<node id="inner"><instance_node url="#n0"/></node>{inner}<node id="n{count}"><instance_geometry url="#g"/></node>'


INNER = '<node id="inner"><rotate>0 0 1 90</rotate><rotate>0 0 1 -90</rotate><instance_geometry url="#g"/></node>'
TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"
BROKEN = {
    "empty": ("m.stl", "", "0 bytes"),
    "an index out of range": ("m.ply", PLY.format("ascii", 3, 2, LIST) + TRIANGLE + "3 0 1 2\n3 0 1 9000000\n", "triangle 1 has a vertex"),
    "a negative index": ("m.ply", PLY.format("ascii", 3, 1, LIST) + TRIANGLE + "3 0 1 -1\n", "triangle 0 has a vertex"),
    "faces of nothing": ("m.ply", "ply\nformat ascii 1.0\nelement face 3000000000\nend_header\n", "says 3,000,000,000 elements"),
    "vertices of text": ("m.ply", PLY.format("ascii", 10**12, 1, LIST) + TRIANGLE, "says 1,000,000,000,001"),
    "vertices of bytes": ("m.ply", PLY.format("binary_little_endian", 10**12, 1, LIST) + TRIANGLE, "says 1,000,000,000,001"),
    "rows that are not there": ("m.ply", PLY.format("ascii", 30, 1, LIST) + TRIANGLE, "ends before its last"),
    "a long list": ("m.ply", PLY.format("binary_little_endian", 0, 1, LIST.replace("uchar", "int")).encode() + b"\xff\xff\xff\x7f", "not well-formed PLY"),
    "no number": ("m.ply", PLY.format("ascii", 3, 1, LIST) + TRIANGLE.replace("1", "x") + "3 0 1 2\n", "not well-formed PLY"),
    "too many facets": ("m.stl", b"\0" * 80 + struct.pack("<I", 10**9) + b"\0" * 50, "room for 1 triangles"),
    "half a facet": ("m.stl", "solid s\nvertex 0 0 0\nvertex 1 0 0\n", "three vertices"),
    "not finite": ("m.stl", solid.text_stl().replace(b"0.3", b"nan"), "not finite"),
    "far away": ("m.obj", "v 0 0 0\nv 1e16 0 0\nv 0 1 0\nf 1 2 3\n", "beyond 1e\\+15"),
    "zero as an index": ("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "has a vertex"),
    "no faces": ("m.obj", "v 0 0 0\nv 1 0 0\n", "no triangles"),
    "one place": ("m.obj", "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "no triangles"),
    "a weight of zero": ("m.obj", "v 0 0 0 0\nf 1 1 1\n", "not well-formed OBJ"),
    "one line": ("m.obj", "f " + "1 " * 100_000, "a line of more than"),
    "half a line": ("m.obj", "v 0 0 \\\n0\n", "continues on the next one"),
    "nodes in a ring": ("m.dae", collada('<instance_geometry url="#g"/></node>', '<instance_node url="#inner"/></node>'), "nodes are more than"),
    "nodes without end": ("m.dae", collada(INNER, nodes(9)), "nodes are more than"),
    "another file": ("m.dae", collada('<instance_node url="#inner"/>', '<instance_node url="file:///etc/x.dae#inner"/>'), "not in the file"),
    "an accessor": ("m.dae", collada('count="5" stride', 'count="2000000" stride'), "an accessor of 2,000,000"),
    "a stride": ("m.dae", collada('stride="3"', 'stride="99999999999999999999"'), "an accessor of 5"),
    "entities": ("m.dae", '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;"><!ENTITY x SYSTEM "/etc/passwd">]><COLLADA>&b;&x;</COLLADA>', "not well-formed|no scene"),
    "deep elements": ("m.dae", "<a>" * 1000 + "</a>" * 1000, "400 deep"),
    "a file elsewhere": ("m.gltf", glb(lambda d: d["buffers"][0].update(uri="../secret.bin")), "data in another file, '../secret.bin'"),
    "a web address": ("m.gltf", glb(lambda d: d["buffers"][0].update(uri="http://localhost/x")), "data in another file"),
    "children in a ring": ("m.gltf", glb(lambda d: d["nodes"][1].update(children=[0])), "not well-formed GLTF"),
    "items that are not there": ("m.gltf", glb(lambda d: d["accessors"][0].update(count=10**12)), "at most 12,000,000"),
    "items repeated": ("m.gltf", glb(lambda d: d.update(accessors=[d["accessors"][0] | {"count": 5 * 10**6}] * 3)), "at most 12,000,000"),
    "views of all of it": ("m.gltf", glb(lambda d: d.update(bufferViews=[d["bufferViews"][0] | {"byteLength": 1000}] * 9)), "items in"),
    "meshes repeated": ("m.gltf", glb(lambda d: d["nodes"].extend([{"mesh": 0}] * 170_000)), "more than 100,000 nodes"),
    "positions of integers": ("m.gltf", glb(lambda d: d["accessors"][0].update(componentType=5122)), "not floats"),
    "a buffer of another file": ("m.gltf", glb(lambda d: d["buffers"].append({"uri": "file:///etc/passwd", "byteLength": 9})), "data in another file"),
    "lines without numbers": ("m.ply", PLY.format("ascii", 3, 1, LIST) + "\f" * 4_100_000, "ends before|lines"),
    "items beyond": ("m.gltf", glb(lambda d: d["accessors"][0].update(count=10**5)), "not well-formed GLTF"),
    "a sparse accessor": ("m.gltf", glb(lambda d: d["accessors"][0].update(sparse={"count": 10**9})), "sparse or compressed"),
    "a fraction": ("m.gltf", glb(lambda d: d["accessors"][0].update(count=4.5)), "not a whole number|not well-formed"),
    "brackets": ("m.gltf", "[" * 1_000_000, "not well-formed"),
    "many brackets": ("m.gltf", "[" + "[]," * 1_000_000 + "[]]", "JSON of more than"),
    "a chunk": ("m.glb", solid.gltf()[:12] + struct.pack("<II", 2**32 - 1, 0x4E4F534A), "a chunk of 4,294,967,295"),
    "MSH": ("m.msh", struct.pack("<4i", 3, 0, 0, 1), "format '.msh', expected one of .dae, .glb"),
    "a pointer": ("m.stl", "version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
    "X3D": ("m.x3d", "<X3D/>", "format '.x3d', expected one of .dae, .glb"),
    "3MF": ("m.3mf", "PK", "format '.3mf'"),
    "binary of assimp": ("m.assbin", "ASSIMP.binary", "format '.assbin'"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "content", "says"), BROKEN.values(), ids=BROKEN)
def test_broken_meshes_are_refused_soon_and_by_name(name, content, says, tmp_path):
    path = write(tmp_path / name, content)
    with ending_within(5), pytest.raises(rnc.ModelError, match=says):
        read_mesh(path)
    robot = rnc.Robot.from_urdf(write(tmp_path / "r.urdf", solid.urdf([name])))
    with ending_within(5), pytest.warns(rnc.ModelWarning, match=f"1 mesh was not readable: {name} \\(.*({says})"):
        assert robot.stand_ins == {"b_stand_in"}
    assert not robot.collision_model.ngeoms


@pytest.mark.parametrize(("limit", "most", "content"), [
    ("_MAX_NODES", 13, collada(INNER, nodes(1))), ("_MAX_DEPTH", 9, collada(INNER, nodes(7, width=1))),
], ids=["visits", "depth"])  # fmt: skip
def test_nodes_of_a_collada_file_are_counted_before_they_are_visited(limit, most, content, monkeypatch):
    """The outer node, the inner one, and each instance below it."""
    monkeypatch.setattr(readers, limit, most)
    read_collada(content.encode())
    monkeypatch.setattr(readers, limit, most - 1)
    with pytest.raises(rnc.ModelError, match="nodes are more than"):
        read_collada(content.encode())


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "m.stl")
    with pytest.raises(rnc.ModelError, match="Not a regular file"):
        read_mesh(tmp_path / "m.stl")


@pytest.mark.parametrize("scale", ["0 1 1", "1e300 1 1", "1e17 1 1"])
def test_a_scale_that_leaves_no_solid_is_refused(scale, tmp_path):
    write(tmp_path / "m.obj", solid.obj())
    robot = rnc.Robot.from_urdf(write(tmp_path / "r.urdf", solid.urdf(["m.obj"]).replace("1 1 -2", scale)))
    with pytest.warns(rnc.ModelWarning, match=r"m\.obj \(.*scale"):
        assert robot.stand_ins == {"b_stand_in"}


def test_all_meshes_together_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_formats, "MOST_TOGETHER", 3 * len(solid.TRIANGLES))
    write(tmp_path / "m.obj", solid.obj())
    (tmp_path / "r.urdf").write_text(solid.urdf(["m.obj"] * 3))
    assert rnc.Robot.from_urdf(tmp_path / "r.urdf").visual_model.ngeoms == 3
    (tmp_path / "r.urdf").write_text(solid.urdf(["m.obj"] * 4))
    with pytest.warns(rnc.ModelWarning, match="more than 18 triangles in the meshes of the robot"):
        assert rnc.Robot.from_urdf(tmp_path / "r.urdf").visual_model.ngeoms == 3


def test_pinocchio_and_mujoco_are_given_no_files_of_meshes(tmp_path, monkeypatch):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is an optional extra and not installed")
    given = []
    build, read = pin.buildGeomFromUrdfString, mujoco.MjSpec.from_string
    kept = lambda model, text, *more: given.append(text) or build(model, text, *more)  # noqa: E731
    monkeypatch.setattr(pin, "buildGeomFromUrdfString", kept)
    monkeypatch.setattr(mujoco.MjSpec, "from_string", lambda text, *more: given.append(text) or read(text, *more))
    write(tmp_path / "m.stl", solid.binary_stl())
    (tmp_path / "r.urdf").write_text(solid.urdf(["m.stl"]))
    (tmp_path / "r.xml").write_text(solid.mjcf("m.stl"))
    for robot in (rnc.Robot.from_urdf(tmp_path / "r.urdf"), rnc.Robot.from_mjcf(tmp_path / "r.xml")):
        (shape,) = robot.visual_model.geometryObjects
        assert (shape.geometry.num_tris, shape.meshPath) == (len(solid.TRIANGLES), str(tmp_path / "m.stl"))
    assert len(given) == 2
    assert not any("m.stl" in text for text in given)


def mjcf(asset, geom='<geom type="mesh" mesh="m"/>', inertial='<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'):
    return (
        f'<mujoco><compiler meshdir="parts"/><asset>{asset}</asset><worldbody><body name="a"><joint name="j" axis="0 1 0"/>{inertial}'
        f"{geom}</body></worldbody></mujoco>"
    )


def test_mjcf_shapes_are_those_of_pinocchios_own_parser(tmp_path):
    (tmp_path / "parts").mkdir()
    write(tmp_path / "parts/m.obj", solid.obj())
    geoms = (
        '<geom type="mesh" mesh="m" rgba="1 1 0 0.5" pos="1 2 3" quat="0.5 0.5 0.5 0.5" contype="0" conaffinity="0"/>'
        '<geom type="box" size="1 1 1" rgba="0.1 0.2 0.3 1"/>'
        '<geom name="named" type="mesh" mesh="n" rgba="1 0 0 1"/><geom type="mesh" mesh="n" group="3" rgba="0 1 0 1"/>'
    )
    text = mjcf('<mesh file="m.obj"/><mesh name="n" file="m.obj" scale="1 -2 3"/>', geoms)
    robot = rnc.Robot.from_mjcf(write(tmp_path / "r.xml", text))
    for kind, geometry in ((pin.VISUAL, robot.visual_model), (pin.COLLISION, robot.collision_model)):
        assert_same_shapes(geometry, pin.buildGeomFromMJCF(robot.model, str(tmp_path / "r.xml"), kind))


TETRAHEDRON = "0 0 0 1 0 0 0 1 0 0 0 1"


def test_a_hull_looks_outward():
    points = np.random.default_rng(0).normal(size=(50, 3)) + 5.0
    hull = convex_hull(points)
    first, second, third = np.moveaxis(hull.vertices[hull.triangles], 1, 0)
    outward = np.cross(second - first, third - first)
    assert (np.einsum("ki,ki->k", outward, first - points.mean(axis=0)) > 0).all()


FLAT = {
    "four points in a plane": ('vertex="0 0 0 1 0 0 0 1 0 1 1 0"', "in a plane"),
    "three points": ('vertex="0 0 0 1 0 0 0 1 0"', "four points"),
    "almost in a plane": ('vertex="0 0 0 1 0 0 0 1 0 1 1 1e-9"', "in a plane"),
    "one point": ('vertex="1 1 1 1 1 1 1 1 1 1 1 1"', "in a plane"),
    "nothing": ("", "neither a file nor vertices"),
    "seven numbers": ('vertex="0 0 0 1 0 0 0"', "take three numbers"),
    "words": ('vertex="0 0 0 a"', "take three numbers"),
    "an index out of range": (f'vertex="{TETRAHEDRON}" face="0 1 2 0 1 9"', "has a vertex"),
    "an index of 1e300": (f'vertex="{TETRAHEDRON}" face="0 1 1e300"', "a face has an unknown vertex"),
    "half an index": (f'vertex="{TETRAHEDRON}" face="0 1 2.5"', "take three numbers"),
    "far away": ('vertex="0 0 0 1e17 0 0 0 1 0 0 0 1"', "beyond"),
    "a scale of words": (f'vertex="{TETRAHEDRON}" scale="a"', "scale takes three numbers"),
}


@pytest.mark.parametrize("weighed", [False, True], ids=["drawn", "weighed"])
@pytest.mark.parametrize(("attributes", "says"), FLAT.values(), ids=FLAT)
def test_meshes_inside_an_mjcf_are_checked(attributes, says, weighed, tmp_path):
    if weighed:
        pytest.importorskip("mujoco", reason="MuJoCo is an optional extra and not installed")
    text = mjcf(f'<mesh name="m" {attributes}/>', **({"inertial": ""} if weighed else {}))
    with pytest.raises(rnc.ModelError, match=f"r.xml: mesh 'm': .*{says}"):
        _ = rnc.Robot.from_mjcf(write(tmp_path / "r.xml", text)).visual_model


def test_a_mesh_that_an_mjcf_does_not_have_is_named(tmp_path):
    path = write(tmp_path / "r.xml", mjcf(f'<mesh name="n" vertex="{TETRAHEDRON}"/>'))
    with pytest.raises(rnc.ModelError, match="mesh 'm' not found in geom 0; expected one of: a, j, main, n"):
        _ = rnc.Robot.from_mjcf(path).visual_model


@pytest.mark.parametrize("collides", ["", 'contype="0" conaffinity="0"'], ids=["collides", "seen"])
def test_a_flat_shell_weighs_without_a_hull(collides, tmp_path):
    """A screen, say: MuJoCo cannot make the hull of a shape that collides."""
    pytest.importorskip("mujoco", reason="MuJoCo is an optional extra and not installed")
    asset = '<mesh name="m" vertex="0 0 0 2 0 0 0 1 0 2 1 0" face="0 1 2 1 3 2" inertia="shell"/>'
    geom = f'<geom type="mesh" mesh="m" {collides} density="10"/>'
    robot = rnc.Robot.from_mjcf(write(tmp_path / "r.xml", mjcf(asset, geom, "")))
    assert robot.model.inertias[1].mass == pytest.approx(10 * 2.0)
    assert robot.visual_model.geometryObjects[0].geometry.num_tris == 2


@pytest.mark.filterwarnings("error")
def test_a_mesh_weighs_the_same_inside_and_as_a_file_of_any_format(tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo is an optional extra and not installed")
    (tmp_path / "parts").mkdir()
    numbers, indices = (" ".join(map(str, each.ravel())) for each in (solid.VERTICES, solid.TRIANGLES))
    assets = [f'<mesh name="m" vertex="{numbers}" face="{indices}"/>']
    for name, content in {name: contents[0] for name, contents in solid.MESHES.values()}.items():
        write(tmp_path / "parts" / name, content)
        assets.append(f'<mesh file="{name}"/>')
    robots = [rnc.Robot.from_mjcf(write(tmp_path / "r.xml", mjcf(asset, inertial=""))) for asset in assets]
    first, second, third = np.moveaxis(solid.VERTICES[solid.TRIANGLES], 1, 0)
    volume = np.einsum("ki,ki->", first, np.cross(second, third)) / 6
    for robot in robots:
        assert robot.model.inertias[1].mass == pytest.approx(1000 * volume, rel=1e-5)
        assert robot.visual_model.ngeoms == 1
        assert robot.visual_model.geometryObjects[0].geometry.num_tris == len(solid.TRIANGLES)


def test_without_trimesh_one_line_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    words = r"trimesh is not installed: pip install '\.\[meshes\]' in the folder of rnc_pin's source"
    for name in ("m.glb", "m.gltf", "m.ply"):
        with pytest.raises(rnc.ModelError, match=words):
            read_mesh(write(tmp_path / name, b""))
    (tmp_path / "r.urdf").write_text(solid.urdf(["m.glb"]))
    with pytest.warns(rnc.ModelWarning, match=rf"1 mesh was not readable: m\.glb \({words}"):
        assert rnc.Robot.from_urdf(tmp_path / "r.urdf").stand_ins == {"b_stand_in"}
