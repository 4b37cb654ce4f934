"""Meshcat scene of a robot, live or recorded as keyframes, and the camera that keeps the motion in the picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin
import umsgpack

from rnc_pin.visualization.browser.page import meshcat, mg
from rnc_pin.visualization.browser.scene_server import SceneWindow

_SAME_VALUE = 1e-7  # change of a number that a page does not show
FIELD_OF_VIEW = 50.0  # vertical [deg]
VIEW_DIRECTION = (-0.35, 1.0, -0.8)  # viewing direction of a camera that is placed automatically
ASPECT = 1.6  # width over height of the picture


def enlarged_box(corners: np.ndarray) -> np.ndarray:
    """Scale the corners of a robot (N, 3) about their centre, so that parts of its tracks are in the picture.

    Args:
        corners: corners of the shapes of the robot [m].
    """
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    scale = 1.5  # box around a robot that the camera follows, over the size of the robot
    return middle + scale * (corners - middle)


def fitting_camera(points: np.ndarray, forward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Camera that shows all points as large as possible.

    Args:
        points: (N, 3) [m].
        forward: viewing direction (3,), of any length; not vertical.

    Returns:
        Position of the camera and its target, (3,) each [m].
    """
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, forward)])
    half = np.tan(np.deg2rad(FIELD_OF_VIEW / 2)) * np.array([ASPECT, 1.0])
    # A first guess, which the loop centers.
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    centerings = 4
    # Used part of the picture's width and height; overlay, legend and player need the rest.
    used_part = np.array([0.8, 0.58])
    for centerings_left in reversed(range(centerings)):
        away = points - target
        beside, depth = away @ axes.T, away @ forward
        # The nearest place from which every point is inside the picture; not inside a small robot.
        distance = max(float((np.abs(beside) / (used_part * half) - depth[:, None]).max()), 0.2)
        if centerings_left:
            # Perspective enlarges near points, so the middle of the picture is not the middle of the points.
            seen = beside / (distance + depth)[:, None]
            target = target + 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * distance @ axes
    return target - forward * distance, target


class Follower:
    """Camera offset that follows a robot. The camera moves only as far as the robot leaves the middle of the picture.

    Args:
        camera: initial position of the camera (3,) [m].
        target: initial target of the camera (3,) [m].
        point: initial position of the robot (3,) [m]. Its distance from the target is always allowed later.
        close: True if the robot fills the picture.
    """

    def __init__(self, camera: np.ndarray, target: np.ndarray, point: np.ndarray, close: bool = False) -> None:
        self._target = target
        close_distance = 0.1  # of the robot from the target, over the camera's distance, if the robot fills the picture
        largest_distance = 0.3  # of the robot from the target, over the camera's distance: it soon leaves the picture
        # The start is allowed as it is: a camera that a user placed does not jump.
        leash = (close_distance if close else largest_distance) * float(np.linalg.norm(camera - target))
        self._max_distance = max(leash, float(np.linalg.norm(point - target)))
        self.offset = np.zeros(3)

    def follow(self, point: np.ndarray) -> np.ndarray:
        """Return the offset (3,) [m] of camera and target for a robot at a point (3,) [m].

        Args:
            point: position of the robot.
        """
        away = point - self._target - self.offset
        distance = float(np.linalg.norm(away))
        if distance > self._max_distance:  # False if the distance is NaN
            self.offset = self.offset + away * (1.0 - self._max_distance / distance)
        return self.offset


class Keyframes:
    """Collector of the keyframes of all nodes.

    Args:
        rate: frames per second.
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._poses: dict[str, list[tuple[int, np.ndarray]]] = {}
        self._tracks: dict[str, list[dict[str, object]]] = {}

    def place(self, path: str, frame: int, matrix: np.ndarray) -> None:
        """Set the transform (4, 4) of a node at a frame, which may include a scale.

        Args:
            path: path of the node.
            frame: number of the frame.
            matrix: the transform.
        """
        self._poses.setdefault(path, []).append((frame, matrix))

    def appear(self, path: str, frame: int) -> None:
        """Show a node from this frame on.

        Args:
            path: path of the node.
            frame: number of the frame.
        """
        # Two keys at least: Three.js interpolates between keys, and shows a track of one key as constant.
        keys = [{"time": 0, "value": frame == 0}, {"time": max(frame, 1), "value": True}]
        self._tracks.setdefault(path, []).append({"name": ".visible", "type": "boolean", "keys": keys})

    def command(self) -> dict[str, object]:
        """Command that plays the animation."""
        for path, poses in self._poses.items():
            frames, matrices = zip(*poses, strict=True)
            self._tracks.setdefault(path, []).extend(self._motion(frames, np.stack(matrices)))
        clips = [
            {"path": path, "clip": {"fps": self.rate, "name": "default", "tracks": tracks}}
            for path, tracks in self._tracks.items()
        ]
        return {"type": "set_animation", "animations": clips, "options": {"play": True, "repetitions": 1}}

    @staticmethod
    def _motion(frames: Sequence[int], matrices: np.ndarray) -> list[dict[str, object]]:
        columns = matrices[:, :3, :3]
        # Three.js keeps a transform as position, quaternion and scale, and interpolates these.
        scale = np.linalg.norm(columns, axis=1)
        turn = np.array([pin.Quaternion(rotation).coeffs() for rotation in columns / scale[:, None, :]])
        # q and -q are the same rotation; neighbours of the same sign interpolate on the short arc.
        signs = np.sign(np.sum(turn[1:] * turn[:-1], axis=1))
        turn[1:] *= np.cumprod(np.where(signs == 0, 1.0, signs))[:, None]
        tracks = [
            _track(".position", "vector3", frames, matrices[:, :3, 3]),
            _track(".quaternion", "quaternion", frames, turn),
        ]
        # Most nodes have no scale: a track of ones would be a third of the file.
        if np.abs(scale - 1.0).max() > _SAME_VALUE:
            tracks.append(_track(".scale", "vector3", frames, scale))
        return tracks


def _track(name: str, kind: str, frames: Sequence[int], values: np.ndarray) -> dict[str, object]:
    """Keys of one property as Three.js takes them; of a constant interval only the first and the last key."""
    moves = np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0) > _SAME_VALUE
    # Both ends of a constant interval stay, so that the player does not interpolate into it.
    kept = np.r_[True, moves] | np.r_[moves, True]
    return {"name": name, "type": kind, "times": _packed(np.array(frames)[kept]), "values": _packed(values[kept])}


def _packed(numbers: np.ndarray) -> umsgpack.Ext:
    # The page reads this type as a Float32Array. Single precision halves a file; its error is far below a pixel.
    return umsgpack.Ext(0x17, numbers.astype("<f4").tobytes())


class MeshcatScene:
    """Meshcat scene. Nodes of a live scene move immediately; nodes of a recording move by keyframes.

    Args:
        window: window to draw in; by default a window that is not served.
        rate: frames per second of a recording; None for a live scene.
    """

    def __init__(self, window: SceneWindow | None = None, rate: float | None = None) -> None:
        self.window = window or SceneWindow()
        self.root = meshcat.Visualizer(window=self.window)
        self.root["/Background"].set_property("top_color", [0.96, 0.975, 0.99])
        self.root["/Background"].set_property("bottom_color", [0.85, 0.885, 0.925])
        # Meshcat has a grid of 20 m at z = 0, whatever the size and the ground of the robot are.
        for name in ("/Axes", "/Grid"):
            self.root[name].set_property("visible", False)
        self.keyframes = None if rate is None else Keyframes(rate)
        self.frame = 0
        self._offset = np.zeros(3)
        self._offsets: list[list[float]] = []
        self._pitch = 1.0

    # ------------------------------------------------------------------ motion

    def place(self, name: str, matrix: np.ndarray) -> None:
        """Set the transform (4, 4) of a node, which may include a scale.

        Args:
            name: name of the node.
            matrix: the transform.
        """
        path = f"/meshcat/{name}"
        if self.keyframes is None or self.frame == 0:
            # A page shows the first frame until it plays; every later one is a keyframe.
            self.window.place(path, matrix)
        if self.keyframes is not None:
            self.keyframes.place(path, self.frame, matrix)

    def appear(self, name: str) -> None:
        """Show a node from the current frame on; a live scene shows it anyway.

        Args:
            name: name of the node.
        """
        if self.keyframes is not None:
            self.keyframes.appear(f"/meshcat/{name}", self.frame)

    def play(self) -> None:
        """Add the recorded motion to the scene."""
        if self.keyframes is not None:
            # A robot that stays in the picture needs no track.
            if self._offset.any():
                track = {"offsets": self._offsets, "rate": self.keyframes.rate}
                self.window.post({"type": "track", "path": "/Cameras", **track}, single=True)
            self.window.post(self.keyframes.command())

    # ------------------------------------------------------------------ content

    def set_camera(self, camera: np.ndarray, target: np.ndarray) -> None:
        """Set position and target of the camera in the world, (3,) each [m].

        Args:
            camera: position of the camera.
            target: point that it looks at.
        """
        # Meshcat's default plane would cut off what is farther than 100 m.
        far = max(100.0, 10.0 * float(np.linalg.norm(camera - target)))
        gaze = {"position": camera.tolist(), "target": target.tolist(), "fov": FIELD_OF_VIEW, "far": far}
        self.window.post({"type": "look", "path": "/Cameras", **gaze})

    def follow(self, offset: np.ndarray) -> None:
        """Set the offset (3,) [m] of the camera since ``look``; movements by the user remain.

        Args:
            offset: displacement in the world.
        """
        if self.keyframes is not None:
            self._offsets.append(offset.tolist())
        elif not np.array_equal(offset, self._offset):
            self.window.post({"type": "follow", "path": "/Cameras", "offset": offset.tolist()})
            floor = np.eye(4)
            floor[:2, 3] = np.round(offset[:2] / self._pitch) * self._pitch  # the finite grid moves with the camera
            self.place("ground", floor)
        self._offset = offset

    def hide(self, name: str) -> None:
        """Hide a node; the viewer's controls show it again.

        Args:
            name: name of the node.
        """
        self.root[name].set_property("visible", False)

    def copy(self, name: str, source: str, color: int, opacity: float) -> None:
        """Draw a copy of another node in one colour, without new geometry data.

        Args:
            name: name of the copy.
            source: name of the copied node.
            color: colour, 0xRRGGBB.
            opacity: from 0 to 1.
        """
        command = {"color": color, "opacity": opacity, "source": f"/meshcat/{source}"}
        self.window.post({"type": "copy", "path": f"/meshcat/{name}", **command})

    def mesh(self, name: str, shape: mg.Geometry, color: int, opacity: float = 1.0) -> None:
        """Draw a shape of one colour.

        Args:
            name: name of the node.
            shape: geometry of Meshcat.
            color: colour, 0xRRGGBB.
            opacity: from 0 to 1.
        """
        material = mg.MeshLambertMaterial(color=color, opacity=opacity, transparent=opacity < 1.0)
        self.root[name].set_object(shape, material)

    def path(self, name: str, points: np.ndarray, color: int, width: float, line: str = "line") -> None:
        """Draw a path through points (N, 3) [m]; slashes in the name group paths in Meshcat's controls.

        Args:
            name: name of the object.
            points: points (N, 3) [m].
            color: colour.
            width: width of the line [m].
            line: "line", "dashed" or "dotted".
        """
        # WebGL draws all lines one pixel wide, so a path is a row of dots that touch each other.
        length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        most_dots = 2000
        dots = max(2, min(most_dots, int(length[-1] / (0.4 * width)) + 1))
        along = np.linspace(0.0, length[-1], dots)
        patterns = {"dashed": (6.0, 3.2), "dotted": (3.0, 0.8)}  # period of a line and its drawn part, over its width
        if line in patterns:
            period, drawn = patterns[line]
            along = along[np.mod(along, period * width) < drawn * width]
        # Even along the path, whatever its points are: dots of a fast motion would lie apart.
        vertices = np.stack([np.interp(along, length, column) for column in points.T]).astype(np.float32)
        shade = np.array([color >> 16 & 255, color >> 8 & 255, color & 255], dtype=np.float32) / 255
        self.root[name].set_object(mg.PointCloud(vertices, np.tile(shade[:, None], (1, len(along))), size=width))

    def grid(self, height: float, center: np.ndarray, half: float) -> None:
        """Draw a square grid at a height, of half width ``half`` about a centre [m].

        Args:
            height: height of the grid.
            center: point (3,) in its middle.
            half: half of its width.
        """
        # Powers of two: the number of lines stays between bounds for a robot of any size.
        self._pitch = pitch = 0.5 * 2.0 ** max(0, round(np.log2(half / 10.0)))
        self.root["ground"].set_object(_grid(height, np.round(center[:2] / pitch) * pitch, half, pitch))

    def overlay(
        self, title: str, rows: Sequence[Mapping[str, object]], legend: Sequence[Mapping[str, object]], **series: object
    ) -> None:
        """Show the overlay and the legend in the corners of the page.

        Args:
            title: title of the page.
            rows: labels of the numbers, as ``Overlay.labels`` returns them.
            legend: layers, as ``RunScene.legend`` returns them.
            series: numbers of all frames of a recording, by the names that ``page.js`` reads.
        """
        content = {"title": title, "rows": list(rows), "legend": list(legend), **series}
        self.window.post({"type": "overlay", "path": "/overlay", **content}, single=True)

    def overlay_values(self, values: Sequence[float], chips: Sequence[str | None]) -> None:
        """Update the values on the live overlay; ``chips`` are colours, or None.

        Args:
            values: numbers of the rows.
            chips: colour of each row.
        """
        self.window.post({"type": "overlay_values", "path": "/overlay", "values": list(values), "chips": list(chips)})


def _grid(height: float, center: np.ndarray, half: float, pitch: float) -> mg.LineSegments:
    """Grid of short segments: renderers may drop long lines that pass behind the camera, as in Meshcat's own grid."""
    count = int(np.ceil(half / pitch))
    ticks = (np.arange(-count, count + 1) * pitch).astype(np.float32)
    along, across = np.meshgrid(ticks[:-1], ticks, indexing="ij")
    starts, ends = along.ravel(), along.ravel() + np.float32(pitch)
    lines, level = across.ravel(), np.full(along.size, height, dtype=np.float32)
    parallel = np.stack([np.stack([starts, lines, level]), np.stack([ends, lines, level])], axis=-1)
    # The same lines with x and y exchanged.
    points = np.concatenate([parallel, parallel[[1, 0, 2]]], axis=1).reshape(3, -1)
    points[:2] += center.astype(np.float32)[:, None]
    return mg.LineSegments(mg.PointsGeometry(points), mg.LineBasicMaterial(color=0xA9B4BF))
