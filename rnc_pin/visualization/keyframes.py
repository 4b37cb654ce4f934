"""Keyframes of an animation in Meshcat's format: transforms, colours and visibility of nodes."""

from __future__ import annotations

import numpy as np
import scipy

_STILL = 1e-7


class Keyframes:
    """Collector of the keyframes of all nodes.

    Args:
        rate: frames per second.
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._frames: dict[str, list[int]] = {}
        self._matrices: dict[str, list[np.ndarray]] = {}
        self._tracks: dict[str, list[dict[str, object]]] = {}
        self._colors: dict[str, tuple[list[int], list[np.ndarray]]] = {}

    def place(self, path: str, frame: int, matrix: np.ndarray) -> None:
        """Set the transform (4, 4) of a node at a frame, which may include a scale."""
        self._frames.setdefault(path, []).append(frame)
        self._matrices.setdefault(path, []).append(matrix)

    def paint(self, path: str, frame: int, color: np.ndarray) -> None:
        """Set the colour of an object at a frame, (3,) in [0, 1]."""
        frames, colors = self._colors.setdefault(path + "/<object>", ([], []))
        frames.append(frame)
        colors.append(color)

    def appear(self, path: str, frame: int) -> None:
        """Show a node from this frame on."""
        keys = [{"time": 0, "value": frame == 0}, {"time": max(frame, 1), "value": True}]
        self._tracks.setdefault(path, []).append({"name": ".visible", "type": "boolean", "keys": keys})

    def command(self) -> dict[str, object]:
        """Command that plays the animation."""
        for path, matrices in self._matrices.items():
            self._tracks.setdefault(path, []).extend(self._motion(self._frames[path], np.stack(matrices)))
        for path, (frames, colors) in self._colors.items():
            track = _track(".material.color", "color", frames, np.stack(colors))
            self._tracks.setdefault(path, []).append(track)
        clips = [
            {"path": path, "clip": {"fps": self.rate, "name": "default", "tracks": tracks}}
            for path, tracks in self._tracks.items()
        ]
        options = {"play": True, "repetitions": 1}
        return {"type": "set_animation", "path": "", "animations": clips, "options": options}

    @staticmethod
    def _motion(frames: list[int], matrices: np.ndarray) -> list[dict[str, object]]:
        columns = matrices[:, :3, :3]
        scale = np.linalg.norm(columns, axis=1)
        turn = scipy.spatial.transform.Rotation.from_matrix(columns / scale[:, None, :]).as_quat()
        # q and -q are the same rotation; neighbours of the same sign interpolate on the short arc.
        signs = np.sign(np.sum(turn[1:] * turn[:-1], axis=1))
        turn[1:] *= np.cumprod(np.where(signs == 0, 1.0, signs))[:, None]
        tracks = [
            _track(".position", "vector3", frames, matrices[:, :3, 3]),
            _track(".quaternion", "quaternion", frames, turn),
        ]
        if np.abs(scale - 1.0).max() > _STILL:
            tracks.append(_track(".scale", "vector3", frames, scale))
        return tracks


def _track(name: str, kind: str, frames: list[int], values: np.ndarray) -> dict[str, object]:
    """Keys of one property; of a constant interval only the first and the last key."""
    moves = np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0) > _STILL
    kept = np.r_[True, moves] | np.r_[moves, True]
    keys = [{"time": int(frames[i]), "value": values[i].tolist()} for i in np.flatnonzero(kept)]
    return {"name": name, "type": kind, "keys": keys}
