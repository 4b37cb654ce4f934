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

ACTUAL, DESIRED = 0xD55E00, 0x0072B2  # vermillion and blue of Okabe and Ito


class Scene:
    """A robot in Meshcat.

    Args:
        robot: what to draw.
        window: where to; a window that nothing listens to by default.
        camera: position of the camera in the world [m].
        target: what it looks at [m].

    Raises:
        ModelError: the robot has no geometry to draw, or a mesh cannot be read.
    """

    def __init__(
        self,
        robot: Robot,
        window: SceneWindow | None = None,
        camera: Sequence[float] | None = None,
        target: Sequence[float] = (0.0, 0.0, 0.0),
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
        self._look(np.array([2.5, -4.5, 4.5] if camera is None else camera), np.array(target, dtype=float))
        self._data = robot.model.createData()

    def _look(self, camera: np.ndarray, target: np.ndarray) -> None:
        x, y, z = camera - target
        place = np.eye(4)
        place[:3, 3] = target
        self.root["/Cameras/default"].set_transform(place)
        # Meshcat's camera sits in axes of its own, whose y points up.
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

    def draw_line(self, name: str, points: np.ndarray, color: int, width: float = 3.0) -> None:
        """Draw a line through points (N, 3) [m]; a path with slashes groups lines in Meshcat's controls."""
        vertices = np.ascontiguousarray(points.T, dtype=np.float32)
        self.root[name].set_object(mg.Line(mg.PointsGeometry(vertices), mg.LineBasicMaterial(color=color, linewidth=width)))

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
                self.draw_line(node, points[first : last + 1], ACTUAL)
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
