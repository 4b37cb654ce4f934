"""Meshes for Meshcat: mirrored meshes with outward faces, and formats that Meshcat cannot read.

A file may scale a mesh by negative factors, for example to draw both arms from one mesh. A placement cannot mirror, so
the mesh itself is mirrored. The placement contains only the absolute values of the factors.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import meshcat.geometry as mg
import numpy as np
import pinocchio as pin
from pinocchio.visualize.meshcat_visualizer import DaeMeshGeometry, MeshcatVisualizer

from rnc_pin.io.safe_read import read_bytes
from rnc_pin.visualization.textures import has_own_textures

_RAW = {".stl": mg.StlMeshGeometry, ".obj": mg.ObjMeshGeometry}


def drawn_scale(shape: pin.GeometryObject) -> np.ndarray:
    """Absolute scale factors (3,) in the placement of a shape."""
    return np.abs(np.asarray(shape.meshScale, dtype=float))


def drawn_triangles(shape: pin.GeometryObject) -> np.ndarray:
    """Triangles (N, 3, 3) of a mesh as drawn, before ``drawn_scale``; corners counterclockwise seen from outside."""
    mesh, scale = shape.geometry, np.asarray(shape.meshScale, dtype=float)
    indices = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    triangles = np.array(mesh.vertices())[np.array([(each[0], each[1], each[2]) for each in indices])]
    if scale.prod() < 0:  # mirroring reverses the orientation of every triangle
        triangles = triangles[:, ::-1]
    return np.asarray(triangles / np.abs(scale))


class MeshVisualizer(MeshcatVisualizer):  # type: ignore[misc]
    """Pinocchio's Meshcat visualizer, extended to mirrored meshes and to all formats that Pinocchio reads.

    Args:
        model: Pinocchio model of the robot.
        visual_model: shapes to draw.
        folders: folders from which a page may include textures.
    """

    def __init__(self, model: pin.Model, visual_model: pin.GeometryModel, folders: Sequence[Path] = ()) -> None:
        self._folders = tuple(folders)
        self._shapes = {shape.name: shape for shape in visual_model.geometryObjects}
        drawn = visual_model.copy()
        for shape in drawn.geometryObjects:
            shape.meshScale = drawn_scale(shape)
        # No collision geometry: it is invisible, and the page would contain its meshes too.
        super().__init__(model, None, drawn)

    def loadMeshFromFile(self, geometry_object: pin.GeometryObject) -> mg.Geometry | mg.ReferenceSceneElement:
        """Meshcat geometry of a mesh: its file where Meshcat can use it, otherwise its triangles."""
        shape = self._shapes[geometry_object.name]
        signs = np.sign(np.asarray(shape.meshScale, dtype=float))
        path = shape.meshPath
        ending = path[path.rfind(".") :].lower()
        try:
            if ending == ".dae" and has_own_textures(Path(path), self._folders):  # the file contains colours
                collada = DaeMeshGeometry(path)
                collada.set_scale(signs)
                return collada
            if ending in _RAW and (signs > 0).all():
                return _RAW[ending].from_stream(BytesIO(read_bytes(Path(path))))
        except Exception:  # for example a missing texture; Pinocchio has already read the triangles
            pass
        corners = drawn_triangles(shape).reshape(-1, 3)
        return mg.TriangularMeshGeometry(corners, np.arange(len(corners)).reshape(-1, 3))
