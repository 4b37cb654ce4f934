# ruff: noqa: E501
"""One solid in every format of meshes that is read, and robots that are made of it."""

from __future__ import annotations

import base64
import json
import struct
from importlib.util import find_spec

import numpy as np
import trimesh

from urdf_parts import INERTIAL

VERTICES = np.array([[0.02, 0.05, 0.0], [0.3, 0.05, 0.0], [0.02, 0.25, 0.0], [0.02, 0.05, 0.1], [0.3, 0.25, 0.1]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 4]])


def binary_stl() -> bytes:
    facets = b"".join(struct.pack("<12fH", *np.zeros(3), *VERTICES[each].ravel(), 0) for each in TRIANGLES)
    return b"binary".ljust(80) + struct.pack("<I", len(TRIANGLES)) + facets


def text_stl() -> bytes:
    corners = ("".join(f"vertex {x} {y} {z}\n" for x, y, z in VERTICES[each]) for each in TRIANGLES)
    facets = "".join(f"facet normal 0 0 0\nouter loop\n{each}endloop\nendfacet\n" for each in corners)
    return f"solid s\n{facets}endsolid s\n".encode()


def obj() -> bytes:
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in VERTICES)
    faces = "".join(f"f {a + 1}//1 {b + 1}//1 {c + 1}//1\n" for a, b, c in TRIANGLES[:3])
    backward = "".join("f " + " ".join(str(k - len(VERTICES)) for k in each) + "\n" for each in TRIANGLES[3:])
    return f"mtllib none.mtl\no solid\n{vertices}vn 0 0 1\n{faces}{backward}".encode()


def ply(encoding: str) -> bytes:
    return trimesh.Trimesh(VERTICES, TRIANGLES, process=False).export(file_type="ply", encoding=encoding)


def collada() -> bytes:
    numbers, indices = (" ".join(map(str, each.ravel())) for each in (VERTICES, np.repeat(TRIANGLES, 2)))
    return f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="f" count="{VERTICES.size}">{numbers}</float_array><technique_common><accessor source="#f" count="{len(VERTICES)}" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><polylist count="{len(TRIANGLES)}"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#p" offset="1"/><vcount>{"3 " * len(TRIANGLES)}</vcount><p>{indices}</p></polylist></mesh></geometry></library_geometries>
<library_nodes><node id="inner"><rotate>0 0 1 90</rotate><rotate>0 0 1 -90</rotate><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s"><node id="outer"><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix><translate>0 0 0</translate><scale>1 1 1</scale>
<instance_node url="#inner"/></node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


def gltf(inside: bool = False) -> bytes:
    points, corners = VERTICES.astype("<f4").tobytes(), TRIANGLES.astype("<u2").tobytes()
    buffer: dict[str, object] = {"byteLength": len(points) + len(corners)}
    if inside:
        buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(points + corners).decode()
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "buffers": [buffer],
        "nodes": [{"children": [1], "rotation": [0, 0, 0, 1]}, {"mesh": 0, "scale": [1, 1, 1], "translation": [0, 0, 0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(VERTICES), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": TRIANGLES.size, "type": "SCALAR", "byteOffset": 0},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
        ],
    }  # fmt: skip
    text = json.dumps(document).encode()
    if inside:
        return text
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(points + corners), 0x004E4942) + points + corners
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


MESHES = {
    "STL": ("m.stl", [binary_stl(), text_stl()]),
    "OBJ": ("m.obj", [obj()]),
    "PLY": ("m.ply", [ply("ascii"), ply("binary")]),
    "DAE": ("m.dae", [collada()]),
    "GLB": ("m.glb", [gltf()]),
    "glTF": ("m.gltf", [gltf(inside=True)]),
}
"""Kinds: the name of a file, and its content as it is."""


def urdf(files: list[str]) -> str:
    """A robot on a hinge whose links have these meshes, mirrored where they are seen."""
    shapes = "".join(
        f'<visual><geometry><mesh filename="{file}" scale="1 1 -2"/></geometry></visual>'
        f'<collision><geometry><mesh filename="{file}"/></geometry></collision>'
        for file in files
    )
    return (
        f'<robot name="r"><link name="a"/><link name="b">{INERTIAL}{shapes}</link><joint name="j" type="continuous"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 1 0"/></joint></robot>'
    )


def mjcf(file: str) -> str:
    """A robot on a hinge that is a mesh, and weighs what MuJoCo takes it for."""
    inertial = "" if find_spec("mujoco") else '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    return (
        f'<mujoco><asset><mesh name="m" file="{file}" scale="1 2 1"/></asset><worldbody><body name="a"><joint name="j" axis="0 1 0"/>{inertial}'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
