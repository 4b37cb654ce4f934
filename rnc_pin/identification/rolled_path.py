"""Planar path of a base that makes one constant twist after the other, with its derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rnc_pin.math.coordinates import arc_chord

_SMALL = 1e-3  # angle below which series replace quotients


class Poses(NamedTuple):
    """Poses (M, 3) along a path, x, y [m] and heading [rad], with their derivatives."""

    values: np.ndarray
    slopes: np.ndarray
    """Derivatives with respect to the parameters, (M, 3, P)."""
    rates: np.ndarray
    """Rates (M, 3) [m/s, rad/s]."""


class RolledPath:
    """Path that begins at the origin. Step i is ``exp(xi_i)`` on SE(2), from time i to time i + 1.

    Args:
        time: times (N + 1,) [s].
        steps: twists of the steps in the axes of the base (N, 3): two lengths [m] and an angle [rad].
        slopes: derivatives of the steps (N, 3, P).
    """

    def __init__(self, time: np.ndarray, steps: np.ndarray, slopes: np.ndarray) -> None:
        self._time, self._steps, self._slopes = time, steps, slopes
        moved, d_moved = _displacement(steps, slopes)
        self._heading = _summed(steps[:, 2])
        self._d_heading = _summed(slopes[:, 2])
        turned, d_turned = _turned(self._heading[:-1], self._d_heading[:-1], moved, d_moved)
        self._position, self._d_position = _summed(turned), _summed(d_turned)

    def at(self, times: np.ndarray) -> Poses:
        """Poses at times (M,) within the path."""
        k = np.clip(np.searchsorted(self._time, times, side="right") - 1, 0, len(self._steps) - 1)
        interval = self._time[k + 1] - self._time[k]
        share = (times - self._time[k]) / interval
        part, d_part = self._steps[k] * share[:, None], self._slopes[k] * share[:, None, None]
        moved, d_moved = _displacement(part, d_part)
        turned, d_turned = _turned(self._heading[k], self._d_heading[k], moved, d_moved)
        heading, d_heading = self._heading[k] + part[:, 2], self._d_heading[k] + d_part[:, 2]
        values = np.column_stack([self._position[k] + turned, heading])
        slopes = np.concatenate([self._d_position[k] + d_turned, d_heading[:, None]], axis=1)
        rate = self._steps[k] / interval[:, None]
        rates = np.column_stack([rotated(heading, rate[:, :2]), rate[:, 2]])
        return Poses(values, slopes, rates)


def rotated(angle: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Plane vectors (M, 2, ...) turned by angles (M,)."""
    angle = angle.reshape(-1, *[1] * (vectors.ndim - 2))
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)


def sideways(vectors: np.ndarray) -> np.ndarray:
    """Plane vectors (M, 2) turned by a right angle."""
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)


def _summed(values: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


def _turned(
    angle: np.ndarray, d_angle: np.ndarray, vectors: np.ndarray, d_vectors: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (M, 2) turned by angles (M,), and their derivatives (M, 2, P)."""
    found = rotated(angle, vectors)
    return found, rotated(angle, d_vectors) + sideways(found)[:, :, None] * d_angle[:, None]


def _displacement(steps: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (N, 2) of twists (N, 3) and their derivatives (N, 2, P)."""
    w = steps[:, 2]
    small = np.abs(w) < _SMALL
    safe = np.where(small, 1.0, w)
    s, c = arc_chord(w)
    d_s = np.where(small, -w / 3 + w**3 / 30, (np.cos(w) - s) / safe)
    d_c = np.where(small, 0.5 - w**2 / 8 + w**4 / 144, (np.sin(w) - c) / safe)
    along, side = steps[:, :2], sideways(steps[:, :2])
    turned = np.stack([-slopes[:, 1], slopes[:, 0]], axis=1)
    found = s[:, None] * along + c[:, None] * side
    linear = s[:, None, None] * slopes[:, :2] + c[:, None, None] * turned
    return found, linear + (d_s[:, None] * along + d_c[:, None] * side)[:, :, None] * slopes[:, None, 2]
