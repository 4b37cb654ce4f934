"""Robot drawn by Pinocchio's Meshcat visualizer, with mirrored meshes and all formats that Pinocchio reads.

A file may scale a mesh by negative factors, for example to draw both arms from one mesh. A placement cannot mirror, so
the mesh itself is mirrored. The placement contains only the absolute values of the factors.

A page includes the textures of Collada meshes, so each texture must be an image in a folder of the robot.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, ModelWarning
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.robots.robot import Robot
from rnc_pin.robots.sources.description_files import is_below
from rnc_pin.visualization.browser.page import BaseVisualizer, DaeMeshGeometry, MeshcatVisualizer, mg
from rnc_pin.visualization.meshcat_scene import MeshcatScene

_BEGINNINGS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"GIF8", b"BM", b"RIFF", b"II*\0", b"MM\0*", b"DDS ")
_TARGA = (1, 2, 3, 9, 10, 11)  # image types in the third byte of a Targa file, which has no magic number


def check_drawable(robot: Robot) -> None:
    """Check that a robot has visual geometry.

    Raises:
        ModelError: the robot has no visual geometry.
    """
    visual = robot.visual_model
    if visual is None or not len(visual.geometryObjects):
        raise ModelError(f"robot '{robot.name}' has no visual geometry to draw")


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


def has_own_textures(mesh: Path, folders: Sequence[Path]) -> bool:
    """True if all images that a Collada file names are allowed; a ``ModelWarning`` names the first that is not.

    Args:
        mesh: path of the Collada file.
        folders: folders whose files the robot's description may name.

    Raises:
        OSError: the file cannot be read.
        xml.etree.ElementTree.ParseError: the file is not valid XML.
    """
    roots = [mesh.resolve().parent, *folders]
    for name in _names(ElementTree.fromstring(read_bytes(mesh))):
        places = [mesh.parent / each for each in {name, unquote(name)}]
        if not any(_is_image(place) for place in places if is_below(place, roots)):
            text = f"{mesh.name}: texture '{name[:120]}' is not an image below the robot's own folders and is left out"
            warnings.warn(text, ModelWarning, stacklevel=2)
            return False
    return True


def _names(root: ElementTree.Element) -> Iterator[str]:
    for library in root.iter():
        if str(library.tag).endswith("library_images"):
            for element in library.iter():
                if "init_from" in str(element.tag):
                    yield from ([element.text] if element.text and element.text.strip() else [])
                elif str(element.tag).endswith("ref") and element.text:
                    yield element.text


def _is_image(path: Path) -> bool:
    try:
        content = read_bytes(path)
    except (OSError, ValueError):
        return False
    targa = path.suffix.lower() == ".tga" and len(content) > 18 and content[2] in _TARGA
    return content.startswith(_BEGINNINGS) or targa


_RAW = {".stl": mg.StlMeshGeometry, ".obj": mg.ObjMeshGeometry}


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


class MeshcatRobot:
    """Robot in a scene.

    Args:
        robot: robot to draw.
        scene: scene to draw in.

    Attributes:
        group: path of the group of its shapes.
    """

    def __init__(self, robot: Robot, scene: MeshcatScene) -> None:
        check_drawable(robot)
        self.visualizer: BaseVisualizer = MeshVisualizer(robot.model, robot.visual_model, robot.folders)
        self.visualizer.initViewer(viewer=scene.root)
        self.visualizer.loadViewerModel(rootNodeName="robot")
        self.visualizer.viewer = _TransformSink(scene)
        self.group = "robot/visuals"

    def display(self, q: np.ndarray) -> None:
        """Show a configuration."""
        self.visualizer.display(q)


class _TransformSink:
    """Replacement of Meshcat's tree in the visualizer, so that the scene receives every transform."""

    def __init__(self, scene: MeshcatScene, name: str = "") -> None:
        self._scene, self._name = scene, name

    def __getitem__(self, name: str) -> _TransformSink:
        return _TransformSink(self._scene, name)

    def set_transform(self, matrix: np.ndarray) -> None:
        self._scene.place(self._name, np.asarray(matrix))
