"""Meshcat scene of a robot, live or recorded as keyframes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rnc_pin.visualization.browser.drawing_commands import SceneWindow
from rnc_pin.visualization.camera import FIELD_OF_VIEW
from rnc_pin.visualization.keyframes import Keyframes
from rnc_pin.visualization.meshcat_library import meshcat, mg

_MOST_DOTS = 2000


class MeshcatScene:
    """Meshcat scene. Nodes of a live scene move immediately; those of a recording move by keyframes.

    Args:
        window: window to draw in; by default a window that is not served.
        rate: frames per second of a recording; None for a live scene.
    """

    def __init__(self, window: SceneWindow | None = None, rate: float | None = None) -> None:
        self.window = window or SceneWindow()
        self.root = meshcat.Visualizer(window=self.window)
        self.root["/Background"].set_property("top_color", [0.96, 0.975, 0.99])
        self.root["/Background"].set_property("bottom_color", [0.85, 0.885, 0.925])
        for name in ("/Axes", "/Grid"):
            self.root[name].set_property("visible", False)
        self.keyframes = None if rate is None else Keyframes(rate)
        self.frame = 0
        self._offset = np.zeros(3)
        self._offsets: list[list[float]] = []
        self._pitch = 1.0

    # ------------------------------------------------------------------ motion

    def place(self, name: str, matrix: np.ndarray) -> None:
        """Set the transform (4, 4) of a node, which may include a scale."""
        path = f"/meshcat/{name}"
        if self.keyframes is None or self.frame == 0:
            self.window.place(path, matrix)
        if self.keyframes is not None:
            self.keyframes.place(path, self.frame, matrix)

    def paint(self, name: str, color: np.ndarray) -> None:
        """Set the colour of a node, (3,) in [0, 1]."""
        if self.keyframes is None:
            self.root[name].set_property("color", [*map(float, color), 1.0])
        else:
            self.keyframes.paint(f"/meshcat/{name}", self.frame, color)

    def appear(self, name: str) -> None:
        """Show a node from the current frame on; a live scene shows it anyway."""
        if self.keyframes is not None:
            self.keyframes.appear(f"/meshcat/{name}", self.frame)

    def play(self) -> None:
        """Add the recorded motion to the scene."""
        if self.keyframes is not None:
            if self._offset.any():
                track = {"offsets": self._offsets, "rate": self.keyframes.rate}
                self.window.post({"type": "track", "path": "/Cameras", **track}, single=True)
            self.window.post_packed("", "set_animation", self.keyframes.packed(single=True))

    # ------------------------------------------------------------------ content

    def set_camera(self, camera: np.ndarray, target: np.ndarray) -> None:
        """Set position and target of the camera in the world, (3,) each [m]."""
        far = max(100.0, 10.0 * float(np.linalg.norm(camera - target)))
        gaze = {"position": camera.tolist(), "target": target.tolist(), "fov": FIELD_OF_VIEW, "far": far}
        self.window.post({"type": "look", "path": "/Cameras", **gaze})

    def follow(self, offset: np.ndarray) -> None:
        """Set the offset (3,) [m] of the camera since ``look``; movements by the user remain."""
        if self.keyframes is not None:
            self._offsets.append(offset.tolist())
        elif not np.array_equal(offset, self._offset):
            self.window.post({"type": "follow", "path": "/Cameras", "offset": offset.tolist()})
            floor = np.eye(4)
            floor[:2, 3] = np.round(offset[:2] / self._pitch) * self._pitch  # the finite grid moves with the camera
            self.place("ground", floor)
        self._offset = offset

    def hide(self, name: str) -> None:
        """Hide a node; the viewer's controls show it again."""
        self.root[name].set_property("visible", False)

    def copy(self, name: str, source: str, color: int | None = None, opacity: float = 1.0) -> None:
        """Draw a copy of another node, without new geometry data; ``color=None`` keeps its colours."""
        command = {"color": color, "opacity": opacity, "source": f"/meshcat/{source}"}
        self.window.post({"type": "copy", "path": f"/meshcat/{name}", **command})

    def mesh(self, name: str, shape: mg.Geometry, color: int, opacity: float = 1.0) -> None:
        """Draw a shape of one colour."""
        material = mg.MeshLambertMaterial(color=color, opacity=opacity, transparent=opacity < 1.0)
        self.root[name].set_object(shape, material)

    def path(self, name: str, points: np.ndarray, color: int, width: float, dashed: bool = False) -> None:
        """Draw a path through points (N, 3) [m]; slashes in the name group paths in Meshcat's controls."""
        # WebGL draws all lines one pixel wide, so a path is a row of dots that touch each other.
        length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        dots = max(2, min(_MOST_DOTS, int(length[-1] / (0.4 * width)) + 1))
        along = np.linspace(0.0, length[-1], dots)
        if dashed:
            along = along[np.mod(along, 6.0 * width) < 3.2 * width]
        vertices = np.stack([np.interp(along, length, column) for column in points.T]).astype(np.float32)
        shade = np.array([color >> 16 & 255, color >> 8 & 255, color & 255], dtype=np.float32) / 255
        colors = np.tile(shade[:, None], (1, len(along)))
        self.root[name].set_object(mg.PointCloud(vertices, colors, size=width))

    def grid(self, height: float, center: np.ndarray, half: float) -> None:
        """Draw a square grid at a height, of half width ``half`` about a centre [m]."""
        pitch = 0.5 * 2.0 ** max(0, round(np.log2(half / 10.0)))
        self._pitch = pitch
        self.root["ground"].set_object(_grid(height, np.round(center[:2] / pitch) * pitch, half, pitch))

    def overlay(
        self, title: str, rows: Sequence[Mapping[str, object]], legend: Sequence[Mapping[str, object]], **series: object
    ) -> None:
        """Show the overlay and the legend in the corners of the page."""
        content = {"title": title, "rows": list(rows), "legend": list(legend), **series}
        self.window.post({"type": "overlay", "path": "/overlay", **content}, single=True)

    def overlay_values(self, values: Sequence[float], chips: Sequence[str | None]) -> None:
        """Update the values on the live overlay; ``chips`` are colours, or None."""
        self.window.post({"type": "overlay_values", "path": "/overlay", "values": list(values), "chips": list(chips)})


def _grid(height: float, center: np.ndarray, half: float, pitch: float) -> mg.LineSegments:
    """Grid of short segments: renderers may drop long lines that pass behind the camera, as in Meshcat's own grid."""
    count = int(np.ceil(half / pitch))
    ticks = (np.arange(-count, count + 1) * pitch).astype(np.float32)
    along, across = np.meshgrid(ticks[:-1], ticks, indexing="ij")
    starts, ends = along.ravel(), along.ravel() + np.float32(pitch)
    lines, level = across.ravel(), np.full(along.size, height, dtype=np.float32)
    parallel = np.stack([np.stack([starts, lines, level]), np.stack([ends, lines, level])], axis=-1)
    crossing = parallel[[1, 0, 2]]
    points = np.concatenate([parallel, crossing], axis=1).reshape(3, -1)
    points[:2] += center.astype(np.float32)[:, None]
    return mg.LineSegments(mg.PointsGeometry(points), mg.LineBasicMaterial(color=0xA9B4BF))
