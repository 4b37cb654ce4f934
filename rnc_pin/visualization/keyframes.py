"""Keyframes of an animation in Meshcat's format: transforms, colours and visibility of nodes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
import umsgpack

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
        self._tracks: dict[str, list[bytes]] = {}
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
        track = umsgpack.packb({"name": ".visible", "type": "boolean", "keys": keys})
        self._tracks.setdefault(path, []).append(track)

    def packed(self, single: bool = False) -> bytes:
        """Command that plays the animation, in MessagePack.

        Args:
            single: pack floats in single precision.
        """
        for path, matrices in self._matrices.items():
            self._tracks.setdefault(path, []).extend(self._motion(self._frames[path], np.stack(matrices), single))
        for path, (frames, colors) in self._colors.items():
            track = _track(".material.color", "color", frames, np.stack(colors), single)
            self._tracks.setdefault(path, []).append(track)
        rate = umsgpack.packb(self.rate, force_float_precision="single" if single else "double")
        clips = (
            _map(path=_text(path), clip=_map(fps=rate, name=_text("default"), tracks=_array(tracks)))
            for path, tracks in self._tracks.items()
        )
        options = umsgpack.packb({"play": True, "repetitions": 1})
        return _map(type=_text("set_animation"), path=_text(""), animations=_array(clips), options=options)

    @staticmethod
    def _motion(frames: list[int], matrices: np.ndarray, single: bool) -> list[bytes]:
        columns = matrices[:, :3, :3]
        scale = np.linalg.norm(columns, axis=1)
        turn = np.array([pin.Quaternion(rotation).coeffs() for rotation in columns / scale[:, None, :]])
        # q and -q are the same rotation; neighbours of the same sign interpolate on the short arc.
        signs = np.sign(np.sum(turn[1:] * turn[:-1], axis=1))
        turn[1:] *= np.cumprod(np.where(signs == 0, 1.0, signs))[:, None]
        tracks = [
            _track(".position", "vector3", frames, matrices[:, :3, 3], single),
            _track(".quaternion", "quaternion", frames, turn, single),
        ]
        if np.abs(scale - 1.0).max() > _STILL:
            tracks.append(_track(".scale", "vector3", frames, scale, single))
        return tracks


def _track(name: str, kind: str, frames: list[int], values: np.ndarray, single: bool) -> bytes:
    """Keys of one property; of a constant interval only the first and the last key."""
    moves = np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0) > _STILL
    kept = np.r_[True, moves] | np.r_[moves, True]
    return _map(name=_text(name), type=_text(kind), keys=_keys(np.array(frames)[kept], values[kept], single))


def _keys(frames: np.ndarray, values: np.ndarray, single: bool) -> bytes:
    """Array of ``{"time": frame, "value": [...]}`` for frames (N,) and values (N, k), at most 15 values per key."""
    count, size = values.shape
    number = [("mark", "u1"), ("value", ">f4" if single else ">f8")]
    key = [("head", "S6"), ("mark", "u1"), ("time", ">u4"), ("name", "S7"), ("numbers", number, (size,))]
    keys = np.empty(count, key)
    keys["head"], keys["mark"], keys["time"] = b"\x82" + _text("time"), 0xCE, frames
    keys["name"] = _text("value") + bytes([0x90 + size])
    keys["numbers"]["mark"], keys["numbers"]["value"] = 0xCA if single else 0xCB, values
    return _array([keys.tobytes()], count)


def _text(text: str) -> bytes:
    return bytes(umsgpack.packb(text))


def _map(**entries: bytes) -> bytes:
    """Map of at most 15 packed values."""
    return bytes([0x80 + len(entries)]) + b"".join(_text(name) + value for name, value in entries.items())


def _array(items: Iterable[bytes], count: int | None = None) -> bytes:
    """Array of packed items; ``count`` is given if they are joined already."""
    items = list(items)
    return b"\xdd" + (len(items) if count is None else count).to_bytes(4, "big") + b"".join(items)
