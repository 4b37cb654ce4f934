"""Planar path of a base that makes one constant twist after the other, with its derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rnc_pin.math.components import Component, minus, plus, times
from rnc_pin.model.coordinates import arc_chord

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
        steps: twists of the steps in the axes of the base (3, N): two lengths [m] and an angle [rad].
        slopes: derivatives of the steps (3 entries) by the number of the parameter, where they are not zero.
        size: number of parameters P.
    """

    def __init__(
        self, time: np.ndarray, steps: np.ndarray, slopes: Mapping[int, Sequence[Component]], size: int
    ) -> None:
        self._time, self._steps, self._slopes, self._size = time, steps, slopes, size
        self._pose = np.zeros((3, len(time)))
        np.cumsum(steps[2], out=self._pose[2, 1:])
        displacement = _Displacement(self._pose[2, :-1], steps)
        np.cumsum(displacement.values, axis=1, out=self._pose[:2, 1:])
        self._d_pose: dict[int, np.ndarray] = {}
        for k, slope in slopes.items():
            change = self._d_pose[k] = np.zeros((3, len(time)))
            np.cumsum(np.broadcast_to(slope[2], len(time) - 1), out=change[2, 1:])
            for row, part in enumerate(displacement.along(slope, change[2, :-1])):
                np.cumsum(np.broadcast_to(part, len(time) - 1), out=change[row, 1:])

    def at(self, times: np.ndarray) -> Poses:
        """Poses at times (M,) within the path."""
        k = np.clip(np.searchsorted(self._time, times, side="right") - 1, 0, self._steps.shape[1] - 1)
        interval = self._time[k + 1] - self._time[k]
        share = (times - self._time[k]) / interval
        step, begin = self._steps[:, k], self._pose[:, k]
        displacement = _Displacement(begin[2], step * share)
        values = np.empty((len(times), 3), order="F")
        values[:, :2] = (begin[:2] + displacement.values).T
        values[:, 2] = begin[2] + step[2] * share
        slopes = np.zeros((len(times), 3, self._size), order="F")
        for number, slope in self._slopes.items():
            part = [share * (each[k] if isinstance(each, np.ndarray) else each) for each in slope]
            change = self._d_pose[number][:, k]
            x, y = displacement.along(part, change[2])
            np.add(change[0], x, out=slopes[:, 0, number])
            np.add(change[1], y, out=slopes[:, 1, number])
            np.add(change[2], part[2], out=slopes[:, 2, number])
        rate = (step / interval).T
        rates = np.column_stack([rotated(values[:, 2], rate[:, :2]), rate[:, 2]])
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


class _Displacement:
    """Displacements (2, N) of twists (3, N) of a base with a heading (N,), with their derivatives."""

    def __init__(self, heading: np.ndarray, twist: np.ndarray) -> None:
        x, y, w = twist
        small = np.abs(w) < _SMALL
        safe = np.where(small, 1.0, w)
        s, c = arc_chord(w)
        d_s = np.where(small, -w / 3 + w**3 / 30, (np.cos(w) - s) / safe)
        d_c = np.where(small, 0.5 - w**2 / 8 + w**4 / 144, (np.sin(w) - c) / safe)
        cosine, sine = np.cos(heading), np.sin(heading)
        # By the twist: (p, -q; q, p) = R(heading) (s, -c; c, s) for its lengths, (a, b) for its angle.
        self._p, self._q = cosine * s - sine * c, sine * s + cosine * c
        along, side = d_s * x - d_c * y, d_s * y + d_c * x
        self._a, self._b = cosine * along - sine * side, sine * along + cosine * side
        self.values = np.stack([self._p * x - self._q * y, self._q * x + self._p * y])

    def along(self, slope: Sequence[Component], turn: Component) -> tuple[Component, Component]:
        """Derivatives for those of the twist (3 entries) and of the heading."""
        x, y, w = slope
        there, aside = minus(times(self._p, x), times(self._q, y)), plus(times(self._q, x), times(self._p, y))
        return (
            minus(plus(there, times(self._a, w)), times(self.values[1], turn)),
            plus(plus(aside, times(self._b, w)), times(self.values[0], turn)),
        )
