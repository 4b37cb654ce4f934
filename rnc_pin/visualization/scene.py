"""A robot on a stage: Pinocchio's visualizer, a camera, and the paths of frames."""

from __future__ import annotations

from collections.abc import Sequence

import meshcat
import meshcat.geometry as mg
import numpy as np
import pinocchio as pin
from meshcat.animation import Animation
from pinocchio.visualize import BaseVisualizer, MeshcatVisualizer

from rnc_pin.errors import ModelError
from rnc_pin.robot import Robot
from rnc_pin.visualization.scene_server import SceneWindow

_MOST_DOTS = 2000
ACTUAL = 0xD55E00  # vermillion of Okabe and Ito


class Scene:
    """A robot in Meshcat.

    Args:
        robot: what to draw.
        window: where to; a window that nothing listens to by default.
        camera: position of the camera in the world [m].
        target: what it looks at [m].
        ground: height of the grid [m]; None for no grid.

    Raises:
        ModelError: the robot has no geometry to draw, or a mesh cannot be read.
    """

    def __init__(
        self,
        robot: Robot,
        window: SceneWindow | None = None,
        camera: Sequence[float] | None = None,
        target: Sequence[float] = (0.0, 0.0, 0.0),
        ground: float | None = 0.0,
    ) -> None:
        self.robot = robot
        self.window = window or SceneWindow()
        visual = robot.visual_model
        if visual is None or not len(visual.geometryObjects):
            raise ModelError(f"robot '{robot.name}' has no visual geometry to draw")
        self.visualizer: BaseVisualizer = MeshcatVisualizer(robot.model, robot.collision_model, visual)
        self.visualizer.initViewer(viewer=meshcat.Visualizer(window=self.window))
        self.visualizer.loadViewerModel(rootNodeName="robot")
        self.root = self.visualizer.viewer
        self.root["/Background"].set_property("top_color", [0.93, 0.95, 0.98])
        self.root["/Background"].set_property("bottom_color", [0.80, 0.84, 0.90])
        self.root["/Axes"].set_property("visible", False)
        self.root["/Grid"].set_property("visible", False)
        if ground is not None:
            self.root["ground"].set_object(_grid(ground))
        self._look(np.array([2.5, -4.5, 4.5] if camera is None else camera), np.array(target, dtype=float))
        self._data = robot.model.createData()

    def _look(self, camera: np.ndarray, target: np.ndarray) -> None:
        # Meshcat's camera always looks at its origin, whatever it is told: so the stage moves, not the gaze.
        stage = np.eye(4)
        stage[:3, 3] = -target
        self.root.set_transform(stage)
        x, y, z = camera - target
        # It sits in axes of its own, whose y points up.
        self.root["/Cameras/default/rotated/<object>"].set_property("position", [float(x), float(z), float(-y)])

    def display(self, q: np.ndarray) -> None:
        """Show a configuration."""
        self.visualizer.display(q)

    def paths(self, configurations: np.ndarray, frames: Sequence[str]) -> dict[str, np.ndarray]:
        """World positions (N, 3) of frames along configurations (N, nq)."""
        ids = [self.robot.frame_id(frame) for frame in frames]
        points = np.empty((len(ids), len(configurations), 3))
        for k, q in enumerate(configurations):
            pin.framesForwardKinematics(self.robot.model, self._data, q)
            for row, frame in enumerate(ids):
                points[row, k] = self._data.oMf[frame].translation
        return dict(zip(frames, points, strict=True))

    def draw_path(self, name: str, points: np.ndarray, color: int, width: float = 0.025) -> None:
        """Draw a path through points (N, 3) [m]; a name with slashes groups paths in Meshcat's controls."""
        # WebGL draws every line one pixel wide, so a path is a row of dots, close enough to touch.
        length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        dots = max(2, min(_MOST_DOTS, int(length[-1] / (0.4 * width)) + 1))
        along = np.linspace(0.0, length[-1], dots)
        vertices = np.stack([np.interp(along, length, column) for column in points.T]).astype(np.float32)
        shade = np.array([color >> 16 & 255, color >> 8 & 255, color & 255], dtype=np.float32) / 255
        colors = np.tile(shade[:, None], (1, dots))
        self.root[name].set_object(mg.PointCloud(vertices, colors, size=width))

    def animate(self, configurations: np.ndarray, rate: float, trail: Sequence[str] = ()) -> None:
        """Put an animation on the stage, with trails that grow as it plays.

        Args:
            configurations: (frames, nq), evenly spaced in time.
            rate: frames per second.
            trail: frames whose paths are drawn.
        """
        animation = Animation(default_framerate=rate)
        viewer, count = self.visualizer.viewer, len(configurations)
        pieces = min(40, count - 1)
        ends = np.linspace(0, count - 1, pieces + 1).round().astype(int) if pieces > 0 else np.zeros(0, dtype=int)
        for name, points in self.paths(configurations, trail).items():
            for piece in range(pieces):
                first, last = ends[piece], ends[piece + 1]
                node = f"trail/{name}/{piece:02d}"
                self.draw_path(node, points[first : last + 1], ACTUAL)
                for frame, visible in ((0, piece == 0), (int(last), True)):
                    with animation.at_frame(self.root, frame) as at:
                        at[node].set_property("visible", "boolean", visible)
        try:
            for frame, q in enumerate(configurations):
                self.visualizer.viewer = animation.at_frame(viewer, frame)
                self.visualizer.display(q)
        finally:
            self.visualizer.viewer = viewer
        self.visualizer.display(configurations[0])
        self.root.set_animation(animation, play=True, repetitions=1)


def _grid(height: float, half: float = 10.0, pitch: float = 0.5) -> mg.LineSegments:
    """A grid of short segments: renderers may drop a line that passes behind the camera, as Meshcat's own grid does."""
    ticks = np.arange(-half, half + pitch / 2, pitch, dtype=np.float32)
    along, across = np.meshgrid(ticks[:-1], ticks, indexing="ij")
    starts, ends = along.ravel(), along.ravel() + np.float32(pitch)
    lines, level = across.ravel(), np.full(along.size, height, dtype=np.float32)
    parallel = np.stack([np.stack([starts, lines, level]), np.stack([ends, lines, level])], axis=-1)
    crossing = parallel[[1, 0, 2]]
    points = np.concatenate([parallel, crossing], axis=1).reshape(3, -1)
    return mg.LineSegments(mg.PointsGeometry(points), mg.LineBasicMaterial(color=0x9AA3AD))
