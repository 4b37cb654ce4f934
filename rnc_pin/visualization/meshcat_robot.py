"""Robot drawn by Pinocchio's Meshcat visualizer, with mirrored meshes and all formats that Pinocchio reads."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import pinocchio as pin

from rnc_pin.io.safe_read import read_bytes
from rnc_pin.robots.robot import Robot
from rnc_pin.visualization.meshcat_library import BaseVisualizer, DaeMeshGeometry, MeshcatVisualizer, mg
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.robot_meshes import check_drawable, drawn_scale, drawn_triangles, has_own_textures

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
