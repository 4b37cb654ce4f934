"""Meshes as they are drawn: mirrored ones with their faces outward, and formats that Meshcat does not know.

A file may scale a mesh by a negative factor, so that one mesh draws both arms. No placement does that, so the mesh
itself is mirrored and only the sizes of the factors are left to the placement.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import meshcat.geometry as mg
import numpy as np
import pinocchio as pin
from pinocchio.visualize.meshcat_visualizer import DaeMeshGeometry, MeshcatVisualizer

from rnc_pin.regular_files import read_bytes
from rnc_pin.visualization.textures import has_own_textures

_RAW = {".stl": mg.StlMeshGeometry, ".obj": mg.ObjMeshGeometry}


def drawn_scale(shape: pin.GeometryObject) -> np.ndarray:
    """What the placement of a shape scales it by, (3,), without the signs."""
    return np.abs(np.asarray(shape.meshScale, dtype=float))


def drawn_triangles(shape: pin.GeometryObject) -> np.ndarray:
    """Corners (N, 3, 3) of a mesh's triangles as drawn, before ``drawn_scale``: counterclockwise from outside."""
    mesh, scale = shape.geometry, np.asarray(shape.meshScale, dtype=float)
    indices = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    triangles = np.array(mesh.vertices())[np.array([(each[0], each[1], each[2]) for each in indices])]
    if scale.prod() < 0:  # a mirror turns every triangle round
        triangles = triangles[:, ::-1]
    return np.asarray(triangles / np.abs(scale))


class MeshVisualizer(MeshcatVisualizer):  # type: ignore[misc]
    """Pinocchio's visualizer for Meshcat, which also draws mirrored meshes and all formats that Pinocchio reads.

    Args:
        model: of the robot.
        visual_model: what is drawn.
        folders: whose files a page may take along as textures.
    """

    def __init__(self, model: pin.Model, visual_model: pin.GeometryModel, folders: Sequence[Path] = ()) -> None:
        self._folders = tuple(folders)
        self._shapes = {shape.name: shape for shape in visual_model.geometryObjects}
        drawn = visual_model.copy()
        for shape in drawn.geometryObjects:
            shape.meshScale = drawn_scale(shape)
        # Without collision geometry: nobody sees it, and meshes would be in the page twice.
        super().__init__(model, None, drawn)

    def loadMeshFromFile(self, geometry_object: pin.GeometryObject) -> mg.Geometry | mg.ReferenceSceneElement:
        """What Meshcat is sent of a mesh: its file as it is where that does."""
        shape = self._shapes[geometry_object.name]
        signs = np.sign(np.asarray(shape.meshScale, dtype=float))
        path = shape.meshPath
        ending = path[path.rfind(".") :].lower()
        try:
            if ending == ".dae" and has_own_textures(
                Path(path), self._folders
            ):  # has colours of its own, so that it stays a file
                collada = DaeMeshGeometry(path)
                collada.set_scale(signs)
                return collada
            if ending in _RAW and (signs > 0).all():
                return _RAW[ending].from_stream(BytesIO(read_bytes(Path(path))))
        except Exception:  # a texture that is not there, say: Pinocchio has read the triangles
            pass
        corners = drawn_triangles(shape).reshape(-1, 3)
        return mg.TriangularMeshGeometry(corners, np.arange(len(corners)).reshape(-1, 3))
