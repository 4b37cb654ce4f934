"""The robot itself, drawn by Pinocchio's visualizer for Meshcat."""

from __future__ import annotations

import numpy as np
from pinocchio.visualize import BaseVisualizer

from rnc_pin.errors import ModelError
from rnc_pin.robots.robot import Robot
from rnc_pin.visualization.meshes import MeshVisualizer
from rnc_pin.visualization.stage import Stage


def check_drawable(robot: Robot) -> None:
    """Refuse a robot that has nothing to draw.

    Raises:
        ModelError: it has no visual geometry.
    """
    visual = robot.visual_model
    if visual is None or not len(visual.geometryObjects):
        raise ModelError(f"robot '{robot.name}' has no visual geometry to draw")


class RobotView:
    """A robot on a stage.

    Args:
        robot: the robot.
        stage: where it is drawn.

    Attributes:
        parts: group of its parts.
    """

    def __init__(self, robot: Robot, stage: Stage) -> None:
        check_drawable(robot)
        self.visualizer: BaseVisualizer = MeshVisualizer(robot.model, robot.visual_model, robot.folders)
        self.visualizer.initViewer(viewer=stage.root)
        self.visualizer.loadViewerModel(rootNodeName="robot")
        self.visualizer.viewer = _Placer(stage)
        self.parts = "robot/visuals"

    def display(self, q: np.ndarray) -> None:
        """Show a configuration."""
        self.visualizer.display(q)


class _Placer:
    """Stands where the visualizer has Meshcat's tree, so that the stage hears of every movement."""

    def __init__(self, stage: Stage, name: str = "") -> None:
        self._stage, self._name = stage, name

    def __getitem__(self, name: str) -> _Placer:
        return _Placer(self._stage, name)

    def set_transform(self, matrix: np.ndarray) -> None:
        self._stage.place(self._name, np.asarray(matrix))
