"""Robot drawn by Pinocchio's Meshcat visualizer."""

from __future__ import annotations

import numpy as np
from pinocchio.visualize import BaseVisualizer

from rnc_pin.errors import ModelError
from rnc_pin.robots.robot import Robot
from rnc_pin.visualization.meshes import MeshVisualizer
from rnc_pin.visualization.stage import Stage


def check_drawable(robot: Robot) -> None:
    """Check that a robot has visual geometry.

    Raises:
        ModelError: the robot has no visual geometry.
    """
    visual = robot.visual_model
    if visual is None or not len(visual.geometryObjects):
        raise ModelError(f"robot '{robot.name}' has no visual geometry to draw")


class RobotView:
    """Robot in a scene.

    Args:
        robot: robot to draw.
        stage: scene to draw in.

    Attributes:
        parts: path of the group of its shapes.
    """

    def __init__(self, robot: Robot, stage: Stage) -> None:
        check_drawable(robot)
        self.visualizer: BaseVisualizer = MeshVisualizer(robot.model, robot.visual_model, robot.folders)
        self.visualizer.initViewer(viewer=stage.root)
        self.visualizer.loadViewerModel(rootNodeName="robot")
        self.visualizer.viewer = _TransformSink(stage)
        self.parts = "robot/visuals"

    def display(self, q: np.ndarray) -> None:
        """Show a configuration."""
        self.visualizer.display(q)


class _TransformSink:
    """Replacement of Meshcat's tree in the visualizer, so that the stage receives every transform."""

    def __init__(self, stage: Stage, name: str = "") -> None:
        self._stage, self._name = stage, name

    def __getitem__(self, name: str) -> _TransformSink:
        return _TransformSink(self._stage, name)

    def set_transform(self, matrix: np.ndarray) -> None:
        self._stage.place(self._name, np.asarray(matrix))
