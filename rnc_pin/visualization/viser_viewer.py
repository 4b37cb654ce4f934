"""Live view in viser with the robot, its paths and the overlay; selected by ``PINOCCHIO_VIEWER=viser``."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import RunInfo
from rnc_pin.visualization.browser.access import RequestFilter, viser_request_filter
from rnc_pin.visualization.camera import VIEW_DIRECTION, Follower, fitting_camera, with_plan
from rnc_pin.visualization.drawn_ground import carrier_placement, ground_patch, grounds_of, is_drawn, seen_from
from rnc_pin.visualization.drawn_model import DrawnModel
from rnc_pin.visualization.drawn_state import DrawnState
from rnc_pin.visualization.meshcat_library import BaseVisualizer, ViserVisualizer
from rnc_pin.visualization.robot_meshes import check_drawable, drawn_scale, drawn_triangles, has_own_textures
from rnc_pin.visualization.scene_kinematics import SceneKinematics
from rnc_pin.visualization.view import View

_PIECE = 15  # frames per piece of a path
_SURFACE = (0, 158, 115)
_COLORS = ((213, 94, 0), (0, 114, 178), (0, 158, 115), (204, 121, 167))


class _Visualizer(ViserVisualizer):  # type: ignore[misc]
    """Pinocchio's viser visualizer, which opens only Collada meshes whose textures are in the robot's folders.

    It draws other meshes from the triangles that Pinocchio has read: viser's reader would open all textures and
    materials that a mesh names.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot.model, pin.GeometryModel(), robot.visual_model)
        self._folders = robot.folders

    def loadViewerGeometryObject(
        self, geometry_object: pin.GeometryObject, prefix: str = "", color: Sequence[float] | None = None
    ) -> None:
        """Draw a shape."""
        if not hasattr(geometry_object.geometry, "num_tris"):
            super().loadViewerGeometryObject(geometry_object, prefix, color)
            return
        try:
            path = Path(geometry_object.meshPath)
            if path.suffix.lower() != ".dae" or not has_own_textures(path, self._folders):
                raise ValueError
            super().loadViewerGeometryObject(geometry_object, prefix, color)
        except Exception:  # no reader of the format is installed, or a texture is missing
            corners = (drawn_triangles(geometry_object) * drawn_scale(geometry_object)).reshape(-1, 3)
            faces, shade = np.arange(len(corners)).reshape(-1, 3), color or geometry_object.meshColor
            name = f"{prefix}/{geometry_object.name}" if prefix else geometry_object.name
            self.frames[name] = self.viewer.scene.add_mesh_simple(
                name, corners, faces, color=tuple(shade[:3]), opacity=float(shade[3])
            )


class ViserViewer:
    """Viser page served by this process; see ``MeshcatViewer``.

    Raises:
        ConfigurationError: viser is not installed, or its server does not support the access check.
    """

    def __init__(self, drawn_model: DrawnModel, view: View, info: RunInfo, host: str, title: str) -> None:
        try:
            import viser
        except ImportError:
            raise ConfigurationError(
                "PINOCCHIO_VIEWER=viser: viser is not installed; pip install 'rnc_pin[viser]'"
            ) from None
        robot = drawn_model.robot
        check_drawable(robot)
        with viser_request_filter(RequestFilter(host)):
            self._server = viser.ViserServer(host=host, port=8080, label=title, verbose=False)
        self.url = f"http://{host}:{self._server.get_port()}"
        self._visualizer: BaseVisualizer = _Visualizer(robot)
        self._visualizer.initViewer(viewer=self._server)
        self._visualizer.loadViewerModel(rootNodeName="robot")
        self._ground = drawn_model.ground_height(view)
        self._surfaces = [each for each in grounds_of(drawn_model.reduced) if is_drawn(each, robot)]
        self._carried: list[tuple[Any, Callable[[DrawnState], pin.SE3]]] = []
        self._follower: Follower | None = None
        self._kinematics, self._view, self._plan = SceneKinematics(robot), view, info.provenance.path
        self._trails = {frame: self._kinematics.point(frame) for frame in view.trail}
        self._points: dict[str, list[np.ndarray]] = {frame: [] for frame in view.trail}
        self._pieces = 0
        self._figures = self._server.gui.add_markdown(title)
        self._placed = False

    @property
    def browsers(self) -> int:
        """Number of connected browsers."""
        return len(self._server.get_clients())

    def open(self) -> None:
        """Show the page in the user's browser."""
        webbrowser.open(self.url, new=2)

    def draw(self, state: DrawnState) -> None:
        """Draw a state; the first state places the camera."""
        if not self._placed:
            self._place(state)
        self._visualizer.display(state.q)
        for drawn, placement in self._carried:
            place = placement(state)
            drawn.position, drawn.wxyz = place.translation.copy(), np.roll(pin.Quaternion(place.rotation).coeffs(), 1)
        self._follow(state)
        self._figures.content = f"time {state.time:.2f} s, singularity margin {state.margin:.3f}"
        for (frame, point), color in zip(self._trails.items(), _COLORS * len(self._trails), strict=False):
            points = self._points[frame]
            points.append(np.array(point(state)))
            if len(points) > _PIECE:
                segments = np.stack([points[:-1], points[1:]], axis=1)
                self._server.scene.add_line_segments(f"path/{frame}/{self._pieces}", segments, color)
                self._points[frame] = points[-1:]
                self._pieces += 1

    def _place(self, state: DrawnState) -> None:
        view = self._view
        points = with_plan(self._kinematics.corners(state.q), self._plan, self._ground or 0.0)
        camera, target = fitting_camera(points, np.array(VIEW_DIRECTION))
        if view.camera is not None:
            camera, target = np.array(view.camera, dtype=float), np.array(view.target, dtype=float)
        self._server.initial_camera.position = camera
        self._server.initial_camera.look_at = target
        if self._ground is not None:
            height = (float(target[0]), float(target[1]), self._ground)
            self._server.scene.add_grid("ground", 20.0, 20.0, position=height)
        size = float(np.linalg.norm(np.ptp(points, axis=0))) / 2
        for k, surface in enumerate(self._surfaces):
            patch = ground_patch(surface, seen_from(surface, self._kinematics, state.q)[None], size)
            drawn = self._server.scene.add_mesh_simple(f"surface/{k}", *patch, color=_SURFACE, opacity=0.35)
            placement = carrier_placement(surface, self._kinematics)
            if placement is not None:
                self._carried.append((drawn, placement))
        close = view.camera is None and self._plan is None
        self._follower = Follower(camera, target, self._kinematics.center_of_mass(state.q), close)
        self._placed = True

    def _follow(self, state: DrawnState) -> None:
        """Move the cameras with the robot; movements by the users remain."""
        if self._follower is None:
            return
        before = self._follower.offset
        step = self._follower.follow(self._kinematics.center_of_mass(state.q)) - before
        if not step.any():
            return
        first = self._server.initial_camera
        first.position, first.look_at = np.array(first.position) + step, np.array(first.look_at) + step
        for client in self._server.get_clients().values():
            client.camera.position = client.camera.position + step  # viser moves the target too

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()
