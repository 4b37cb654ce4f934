"""Paths that wheels roll, and fits of unknowns to windows of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.model.coordinates import arc_chord


class Poses(NamedTuple):
    """Poses (M, 3) along a path, x, y [m] and heading [rad], with their derivatives."""

    values: Array
    slopes: Array
    """Derivatives with respect to the parameters, (M, 3, P)."""
    rates: Array
    """Rates (M, 3) [m/s, rad/s]."""


class RolledPath:
    """Path that begins at the origin. Step i is ``exp(xi_i)`` on SE(2), from time i to time i + 1.

    Args:
        time: times (N + 1,) [s].
        steps: twists of the steps in the axes of the base (3, N): two lengths [m] and an angle [rad].
        slopes: derivatives of the steps (3, N) by the number of the parameter, where they are not zero.
        size: number of parameters P.
    """

    def __init__(self, time: Array, steps: Array, slopes: Mapping[int, Array], size: int) -> None:
        self._time, self._steps, self._slopes, self._size = time, steps, slopes, size
        self._pose = np.zeros((3, len(time)))
        np.cumsum(steps[2], out=self._pose[2, 1:])
        displacement = _Displacement(self._pose[2, :-1], steps)
        np.cumsum(displacement.values, axis=1, out=self._pose[:2, 1:])
        self._d_pose: dict[int, Array] = {}
        for k, slope in slopes.items():
            change = self._d_pose[k] = np.zeros((3, len(time)))
            np.cumsum(slope[2], out=change[2, 1:])
            np.cumsum(displacement.along(slope, change[2, :-1]), axis=1, out=change[:2, 1:])

    def at(self, times: Array) -> Poses:
        """Poses at times (M,) within the path.

        Args:
            times: times (M,) [s].
        """
        k = np.clip(np.searchsorted(self._time, times, side="right") - 1, 0, self._steps.shape[1] - 1)
        interval = self._time[k + 1] - self._time[k]
        share = (times - self._time[k]) / interval
        step, begin = self._steps[:, k], self._pose[:, k]
        displacement = _Displacement(begin[2], step * share)
        # Columns are contiguous: all that follows works on whole columns.
        values = np.empty((len(times), 3), order="F")
        values[:, :2] = (begin[:2] + displacement.values).T
        values[:, 2] = begin[2] + step[2] * share
        slopes = np.zeros((len(times), 3, self._size), order="F")
        for number, slope in self._slopes.items():
            part, change = share * slope[:, k], self._d_pose[number][:, k]
            slopes[:, :2, number] = (change[:2] + displacement.along(part, change[2])).T
            slopes[:, 2, number] = change[2] + part[2]
        rate = (step / interval).T
        rates = np.column_stack([rotated(values[:, 2], rate[:, :2]), rate[:, 2]])
        return Poses(values, slopes, rates)


def rotated(angle: Array, vectors: Array) -> Array:
    """Plane vectors (M, 2, ...) turned by angles (M,).

    Args:
        angle: angles (M,) [rad].
        vectors: vectors (M, 2, ...).
    """
    angle = angle.reshape(-1, *[1] * (vectors.ndim - 2))
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)


def sideways(vectors: Array) -> Array:
    """Plane vectors (M, 2) turned by a right angle."""
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)


class _Displacement:
    """Displacements (2, N) of twists (3, N) of a base with a heading (N,), with their derivatives."""

    def __init__(self, heading: Array, twist: Array) -> None:
        x, y, w = twist
        series_angle = 1e-3  # below which series replace quotients
        small = np.abs(w) < series_angle
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

    def along(self, slope: Array, turn: Array) -> Array:
        """Derivatives (2, N) for derivatives of the twist (3, N) and of the heading (N,).

        Args:
            slope: derivatives of the twist (3, N).
            turn: derivatives of the heading (N,).
        """
        x, y, w = slope
        return np.stack([
            self._p * x - self._q * y + self._a * w - self.values[1] * turn,
            self._q * x + self._p * y + self._b * w + self.values[0] * turn,
        ])  # fmt: skip


_POSITION, _HEADING = 2.0, 1.5  # residuals in standard deviations above which a sample counts less (Huber)


Prediction = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Windows:
    """Windows of time: the window of each sample, in the order of time."""

    samples: Array
    """Indices of the samples that are in a window, (M,)."""
    number: Array
    """Number of the window of each of them, from 0, (M,)."""

    @property
    def count(self) -> int:
        """Number of windows."""
        return int(self.number[-1]) + 1 if len(self.number) else 0

    def sums(self, values: Array) -> Array:
        """Sums (windows, ...) of values (M, ...).

        Args:
            values: a value for each sample (M, ...).
        """
        starts = np.flatnonzero(np.diff(self.number, prepend=-1))
        return np.add.reduceat(values, starts, axis=0)


@dataclass
class Fit:
    """Residuals of aligned windows, with standard deviations and weights."""

    residuals: Array
    """Predicted minus measured x, y [m] and heading [rad], (M, 3)."""
    jacobian: Array
    """Derivatives (M, 3, P) for first poses that follow the parameters."""
    weights: Array
    """Robust weights of the position and of the heading, (M, 2), at most 1."""
    deviations: Array
    """Standard deviations of position and heading (2,) [m, rad]."""

    @property
    def sizes(self) -> tuple[Array, Array]:
        """Distances (M,) [m] and errors of the heading (M,) [rad]."""
        return np.hypot(self.residuals[:, 0], self.residuals[:, 1]), np.abs(self.residuals[:, 2])

    def scaled(self) -> tuple[Array, Array]:
        """Weighted residuals (3 M,) and derivatives (3 M, P), without unit; all x first, then all y and headings."""
        root = (np.sqrt(self.weights)[:, [0, 0, 1]] / self.deviations[[0, 0, 1]]).ravel(order="F")
        J = self.jacobian.reshape(len(root), -1, order="F")
        return root * self.residuals.ravel(order="F"), (root * J.T).T


def _first_poses(poses: Array, measured: Array, windows: Windows, w: Array) -> tuple[Array, Array]:
    """Rotation (windows,) and shift (windows, 2) that bring predicted poses to measured ones, for weights (M, 2)."""
    total = windows.sums(w[:, :1])
    at = windows.number
    means = [windows.sums(w[:, :1] * each[:, :2]) / total for each in (poses, measured)]
    a, z = poses[:, :2] - means[0][at], measured[:, :2] - means[1][at]
    A = windows.sums(w[:, 0] * np.sum(a * z, axis=1))
    B = windows.sums(w[:, 0] * (a[:, 0] * z[:, 1] - a[:, 1] * z[:, 0]))
    W, H = windows.sums(w[:, 1]), windows.sums(w[:, 1] * (measured[:, 2] - poses[:, 2]))
    near = np.divide(H, W, out=np.zeros_like(H), where=W > 0)
    by_position = np.arctan2(B, A)
    # Newton's method for the minimum of -A cos - B sin + W turn^2 / 2 - H turn, from the better of two guesses.
    turns = [by_position + 2 * np.pi * np.round((near - by_position) / (2 * np.pi)), near]
    costs = [-A * np.cos(t) - B * np.sin(t) + W * t**2 / 2 - H * t for t in turns]
    turn = np.where(costs[0] <= costs[1], *turns)
    for _ in range(30):  # a bound only: from the better guess, a few steps do
        # The absolute value: where the cost is concave, a step of Newton's method would climb.
        bend = np.maximum(np.abs(A * np.cos(turn) + B * np.sin(turn)) + W, 1e-300)
        step = (A * np.sin(turn) - B * np.cos(turn) + W * turn - H) / bend
        # At most a radian: far from the minimum, the curvature says little.
        turn = turn - np.clip(step, -1.0, 1.0)
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    return turn, means[1] - rotated(turn, means[0])


def weighted(fit: Fit, heading: bool, previous: Array | None = None) -> Fit:
    """The fit with standard deviations from the medians of its residuals, and the weights that follow (Huber).

    Previous deviations (2,) stay if the new ones hardly differ. Medians jump from step to step. A cost that follows
    them has no minimum along a combination of parameters that the log hardly shows.

    Args:
        fit: the fit.
        heading: True if headings are measured.
        previous: standard deviations (2,) of the last step.
    """
    length, angle = fit.sizes
    normal, rayleigh = 1.4826, 0.8493  # standard deviation over the median of |x|, and of the length of a plane vector
    floor = 1e-9  # smallest standard deviation [m, rad]: rounding of a log without noise
    deviations = np.maximum([rayleigh * np.median(length), normal * np.median(angle)], floor)
    if not heading:
        deviations[1] = 1.0
    alike = 0.05  # relative change of standard deviations that keeps them
    if previous is not None and (np.abs(deviations - previous) < alike * previous).all():
        deviations = previous
    with np.errstate(divide="ignore"):
        limits = [_POSITION * deviations[0] / length, _HEADING * deviations[1] / angle]
    return Fit(fit.residuals, fit.jacobian, np.minimum(np.stack(limits, axis=1), 1.0), deviations)


def cost(fit: Fit, deviations: Array) -> float:
    """Huber's cost of a fit for standard deviations (2,).

    Args:
        fit: residuals.
        deviations: standard deviations [m, rad].
    """
    total = 0.0
    for size, limit, deviation in zip(fit.sizes, (_POSITION, _HEADING), deviations, strict=True):
        u = size / deviation
        total += float(np.sum(np.where(u <= limit, u**2 / 2, limit * (u - limit / 2))))
    return total


def correlation_of(fit: Fit) -> float:
    """Number of samples over which residuals are correlated.

    Args:
        fit: the fit, whose samples are in the order of time.
    """
    return max(correlation_length(column) for column in fit.residuals.T)


def correlation_length(residuals: Array) -> float:
    """Number of samples over which residuals (N,) are correlated: 1 plus twice the sum of their first correlations.

    Args:
        residuals: residuals (N,) in the order of time.
    """
    r = residuals - residuals.mean()
    limit = len(r) // 2
    # Zeros behind the residuals, at least as many: the product of spectra is periodic.
    size = 2 ** int(np.ceil(np.log2(2 * len(r))))
    spectrum = np.abs(np.fft.rfft(r, size)) ** 2
    product = np.fft.irfft(spectrum, size)[:limit]
    if limit == 0 or product[0] <= 0:
        return 1.0
    rho = product[1:] / product[0]
    # Below two standard deviations of a correlation of white noise, estimates are noise: they end the sum.
    stops = np.flatnonzero(rho <= 2 / np.sqrt(len(r)))
    return max(1.0, float(1 + 2 * rho[: stops[0] if len(stops) else limit].sum()))


class WindowFit:
    """Least squares of a predicted path over windows.

    Args:
        predict: function from parameters (P,) to poses (M, 3) of the samples and their derivatives (M, 3, P).
        measured: measured poses of the samples (M, 3).
        windows: windows of the samples.
        heading: True if headings are measured.
    """

    def __init__(self, predict: Prediction, measured: Array, windows: Windows, heading: bool) -> None:
        self._predict, self._measured, self._windows, self._heading = predict, measured, windows, heading

    def at(self, p: Array) -> Fit:
        """Fit at parameters (P,), with weights that follow from its residuals.

        Args:
            p: parameters (P,).
        """
        poses, slopes = self._predict(p)
        return self._settled(poses, slopes, self._aligned(poses, slopes[:, :, :0], None))

    def _aligned(self, poses: Array, slopes: Array, previous: Fit | None) -> Fit:
        """Fit of predicted poses (M, 3) and their derivatives (M, 3, P), for the weights of the previous fit.

        Without one, weights are equal. Each window has the first pose that is best for these weights.
        """
        count, measured, windows, heading = len(poses), self._measured, self._windows, self._heading
        deviations = np.ones(2) if previous is None else previous.deviations
        weights = np.ones((count, 2)) if previous is None else previous.weights
        w = weights / deviations**2 * [1.0, float(heading)]
        turn, shift = _first_poses(poses, measured, windows, w)
        at = windows.number
        cosine, sine = np.cos(turn)[at], np.sin(turn)[at]
        moved = rotated(turn[at], poses[:, :2])
        residuals = np.empty((count, 3), order="F")
        residuals[:, :2] = moved + shift[at] - measured[:, :2]
        residuals[:, 2] = poses[:, 2] + turn[at] - measured[:, 2] if heading else 0.0
        size = slopes.shape[2]
        J = np.empty((count, 3, size), order="F")
        if size:
            away, (of_position, of_heading) = sideways(moved), np.ascontiguousarray(w.T)
            # Weighted sums over products of derivatives with respect to the first pose: x, y and turn.
            pushed = of_position[:, None] * away
            total, cross = windows.sums(of_position), windows.sums(pushed)
            normal = np.zeros((windows.count, 3, 3))
            normal[:, 0, 0] = normal[:, 1, 1] = total
            normal[:, :2, 2] = normal[:, 2, :2] = cross
            normal[:, 2, 2] = windows.sums(np.sum(pushed * away, axis=1) + of_heading)
            # Not by solve: without headings, a window whose base stands still does not determine its first turn.
            inverse = np.linalg.pinv(normal, hermitian=True)
        for k in range(size):
            dx, dy, turned = slopes[:, 0, k], slopes[:, 1, k], slopes[:, 2, k]
            x, y = cosine * dx - sine * dy, sine * dx + cosine * dy
            sums = np.stack([
                windows.sums(of_position * x), windows.sums(of_position * y),
                windows.sums(pushed[:, 0] * x + pushed[:, 1] * y + of_heading * turned),
            ], axis=1)  # fmt: skip
            first = (inverse @ sums[:, :, None])[at, :, 0]
            J[:, 0, k] = x - first[:, 0] - away[:, 0] * first[:, 2]
            J[:, 1, k] = y - first[:, 1] - away[:, 1] * first[:, 2]
            J[:, 2, k] = turned - first[:, 2] if heading else 0.0
        return Fit(residuals, J, weights, deviations)

    def _settled(self, poses: Array, slopes: Array, fit: Fit, previous: Array | None = None) -> Fit:
        """The fit with first poses that are best for the weights of its residuals.

        Derivatives follow the first poses for these weights too; else parameters that are hardly told from a first
        pose, such as the heading of the sensor, would make steps that overshoot.
        """
        return self._aligned(poses, slopes, weighted(fit, self._heading, previous))

    def minimized(
        self, p: Array, scales: Array, valid: Callable[[Array], bool], precision: float, prior: float
    ) -> tuple[Array, Fit, bool]:
        """Levenberg-Marquardt on Huber's cost; standard deviations follow the residuals.

        Args:
            p: first parameters (P,).
            scales: typical sizes of the parameters (P,).
            valid: function that returns False for parameters that no robot has.
            precision: step at which the iteration ends, in standard deviations of the parameters for the correlation
                of the residuals.
            prior: standard deviation of the first parameters, relative to their sizes; infinity if they say nothing.

        Returns:
            Parameters, their fit, and True if the iteration converged.
        """
        fit, damping, known, first = self.at(p), 1e-6, 1.0 / prior**2, p

        def total(found: Fit, other: Array) -> float:
            return cost(found, fit.deviations) + known / 2 * float(np.sum(((other - first) / scales) ** 2))

        smallest = 1e-9  # step relative to the sizes of the parameters at which the iteration ends
        most_damping = 1e12  # above, steps are so short that the cost changes by rounding only
        for _ in range(60):  # then the fit has not converged
            r, J = fit.scaled()
            J = J * scales
            H, g, before = J.T @ J + known * np.eye(len(p)), J.T @ r + known * (p - first) / scales, total(fit, p)
            # Marquardt's scaling, but not zero for a parameter without effect: the damped matrix stays regular.
            size = np.maximum(np.diag(H), 1e-12 * np.diag(H).max(initial=1e-300))
            relax = 0.1
            while True:
                step = -np.linalg.solve(H + damping * np.diag(size), g)
                other = p + scales * step
                if valid(other):
                    poses, slopes = self._predict(other)
                    found = self._aligned(poses, slopes[:, :, :0], fit)
                    # Rounding of the cost may not refuse the last steps.
                    if total(found, other) <= before * (1 + 1e-12):
                        break
                # A step after a refused one keeps its damping: less was too little a moment ago.
                damping, relax = max(10 * damping, 1e-6), 1.0
                if damping > most_damping:
                    return p, fit, True  # no descent is left but rounding
            p, fit, damping = other, self._settled(poses, slopes, found, fit.deviations), damping * relax
            if np.abs(step).max(initial=0.0) < smallest or step @ H @ step < precision**2 * correlation_of(fit):
                return p, fit, True
        return p, fit, False
