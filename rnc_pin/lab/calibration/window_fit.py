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
        self._heading = _summed(steps[2])
        displacement = _Displacement(self._heading[:-1], steps)
        self._place = _summed(displacement.values)
        self._d_heading = {k: _summed(slope[2]) for k, slope in slopes.items()}
        self._d_place = {k: _summed(displacement.along(slope, self._d_heading[k][:-1])) for k, slope in slopes.items()}

    def at(self, times: Array) -> Poses:
        """Poses at times (M,) within the path.

        Args:
            times: times (M,) [s].
        """
        k = np.clip(np.searchsorted(self._time, times, side="right") - 1, 0, self._steps.shape[1] - 1)
        interval = self._time[k + 1] - self._time[k]
        share, step = (times - self._time[k]) / interval, self._steps[:, k]
        displacement = _Displacement(self._heading[k], step * share)
        values = joined(self._place[k] + displacement.values, self._heading[k] + step[2] * share)
        # Columns are contiguous: all that follows works on whole columns.
        slopes = np.zeros((len(times), 3, self._size), order="F")
        for number, slope in self._slopes.items():
            part, turn = share * slope[:, k], self._d_heading[number][k]
            place = self._d_place[number][k] + displacement.along(part, turn)
            slopes[:, 0, number], slopes[:, 1, number], slopes[:, 2, number] = place.real, place.imag, turn + part[2]
        along, across, turning = step / interval
        return Poses(values, slopes, joined(np.exp(1j * values[:, 2]) * (along + 1j * across), turning))


def _summed(steps: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(steps)])


def plane(poses: Array) -> Array:
    """Positions (M,) of poses (M, 3) as complex numbers: turns and shifts of the plane are products and sums."""
    return poses[:, 0] + 1j * poses[:, 1]


def joined(place: Array, heading: Array) -> Array:
    """Poses (M, 3) of complex positions (M,) and headings (M,)."""
    return np.column_stack([place.real, place.imag, heading])


class _Displacement:
    """Complex displacements (N,) of twists (3, N) of a base with a heading (N,), with their derivatives."""

    def __init__(self, heading: Array, twist: Array) -> None:
        length, w = twist[0] + 1j * twist[1], twist[2]
        series_angle = 1e-3  # below which series replace quotients
        small = np.abs(w) < series_angle
        along, across = arc_chord(w)
        chord, turned = along + 1j * across, np.exp(1j * heading)
        series = -w / 3 + w**3 / 30 + 1j * (0.5 - w**2 / 8 + w**4 / 144)
        slope = np.where(small, series, (np.exp(1j * w) - chord) / np.where(small, 1.0, w))
        self._by_length, self._by_angle = turned * chord, turned * slope * length
        self.values = self._by_length * length

    def along(self, slope: Array, turn: Array) -> Array:
        """Derivatives (N,) for derivatives of the twist (3, N) and of the heading (N,).

        Args:
            slope: derivatives of the twist (3, N).
            turn: derivatives of the heading (N,).
        """
        x, y, w = slope
        return self._by_length * (x + 1j * y) + self._by_angle * w + 1j * self.values * turn


_POSITION, _HEADING = 2.0, 1.5  # residuals in standard deviations above which a sample counts less (Huber)


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
        return np.add.reduceat(values, np.flatnonzero(np.diff(self.number, prepend=-1)), axis=0)


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
        root = (np.sqrt(self.weights)[:, [0, 0, 1]] / self.deviations[[0, 0, 1]]).T.ravel()
        J = self.jacobian.swapaxes(0, 1).reshape(len(root), -1)
        return root * self.residuals.T.ravel(), root[:, None] * J


def _first_poses(poses: Array, measured: Array, windows: Windows, w: Array) -> tuple[Array, Array]:
    """Turns (windows,) and complex shifts that bring predicted poses to measured ones best, for weights (M, 2)."""
    total, places = windows.sums(w[:, 0]), (plane(poses), plane(measured))
    means = [windows.sums(w[:, 0] * each) / total for each in places]
    a, z = (each - mean[windows.number] for each, mean in zip(places, means, strict=True))
    C = windows.sums(w[:, 0] * a.conj() * z)
    W, H = windows.sums(w[:, 1]), windows.sums(w[:, 1] * (measured[:, 2] - poses[:, 2]))
    near = np.divide(H, W, out=np.zeros_like(H), where=W > 0)
    by_position = np.angle(C)
    # Newton's method for the minimum of -Re(C exp(-i turn)) + W turn^2 / 2 - H turn, from the better of two guesses.
    turns = [by_position + 2 * np.pi * np.round((near - by_position) / (2 * np.pi)), near]
    costs = [-(C * np.exp(-1j * t)).real + W * t**2 / 2 - H * t for t in turns]
    turn = np.where(costs[0] <= costs[1], *turns)
    for _ in range(30):  # a bound only: from the better guess, a few steps do
        rest = C * np.exp(-1j * turn)
        # The absolute value: where the cost is concave, a step of Newton's method would climb.
        step = (W * turn - H - rest.imag) / np.maximum(np.abs(rest.real) + W, 1e-300)
        # At most a radian: far from the minimum, the curvature says little.
        turn = turn - np.clip(step, -1.0, 1.0)
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    return turn, means[1] - np.exp(1j * turn) * means[0]


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
    return max(map(_correlation_length, fit.residuals.T))


def _correlation_length(residuals: Array) -> float:
    """Number of samples over which residuals (N,) are correlated: 1 plus twice the sum of their first correlations."""
    r = residuals - residuals.mean()
    limit = len(r) // 2
    # Zeros behind the residuals, at least as many: the product of spectra is periodic.
    size = 2 ** int(np.ceil(np.log2(2 * len(r))))
    product = np.fft.irfft(np.abs(np.fft.rfft(r, size)) ** 2, size)[:limit]
    if limit == 0 or product[0] <= 0:
        return 1.0
    rho = product[1:] / product[0]
    # Below two standard deviations of a correlation of white noise, estimates are noise: they end the sum.
    stops = np.flatnonzero(rho <= 2 / np.sqrt(len(r)))
    return max(1.0, float(1 + 2 * rho[: stops[0] if len(stops) else limit].sum()))


class WindowFit:
    """Least squares of a predicted path over windows.

    Args:
        predict: function from parameters (P,) to poses of the samples.
        measured: measured poses of the samples (M, 3).
        windows: windows of the samples.
        heading: True if headings are measured.
    """

    def __init__(self, predict: Callable[[Array], Poses], measured: Array, windows: Windows, heading: bool) -> None:
        self._predict, self._measured, self._windows, self._heading = predict, measured, windows, heading

    def at(self, p: Array) -> Fit:
        """Fit at parameters (P,), with weights that follow from its residuals.

        Args:
            p: parameters (P,).
        """
        poses, slopes, _ = self._predict(p)
        equal = self._aligned(poses, slopes[:, :, :0], np.ones((len(poses), 2)), np.ones(2))
        return self._settled(poses, slopes, equal)

    def _aligned(self, poses: Array, slopes: Array, weights: Array, deviations: Array) -> Fit:
        """Fit of predicted poses (M, 3) and their derivatives (M, 3, P), for weights (M, 2) and deviations (2,).

        Each window has the first pose that is best for these weights.
        """
        measured, windows, at = self._measured, self._windows, self._windows.number
        w = weights / deviations**2 * [1.0, float(self._heading)]
        turn, shift = _first_poses(poses, measured, windows, w)
        turned, of_place, of_heading = np.exp(1j * turn)[at], w[:, :1], w[:, 1:]
        moved = turned * plane(poses)
        residuals = joined(moved + shift[at] - plane(measured), poses[:, 2] + turn[at] - measured[:, 2])

        def centered(places: Array) -> Array:
            """Places (M, k) without what the first position of their window takes."""
            return np.asarray(places - (windows.sums(of_place * places) / windows.sums(of_place))[at])

        # The best first turn takes its share of each derivative too.
        away = 1j * centered(moved[:, None])
        change, rates = centered(turned[:, None] * (slopes[:, 0] + 1j * slopes[:, 1])), slopes[:, 2]
        wanted = windows.sums(of_place * (away.conj() * change).real + of_heading * rates)
        lever, size = (windows.sums(of_place * np.abs(each) ** 2 + of_heading) for each in (away, moved[:, None]))
        # Without headings, a window whose base stands still does not determine its first turn.
        first = np.divide(wanted, lever, out=np.zeros_like(wanted), where=lever > 1e-15 * size)[at]
        change, rates = change - away * first, rates - first
        if not self._heading:
            residuals[:, 2], rates = 0.0, np.zeros_like(rates)
        return Fit(residuals, np.stack([change.real, change.imag, rates]).swapaxes(0, 1), weights, deviations)

    def _settled(self, poses: Array, slopes: Array, fit: Fit, previous: Array | None = None) -> Fit:
        """The fit with standard deviations from the medians of its residuals, and the weights that follow (Huber).

        Previous deviations (2,) stay if the new ones hardly differ. Medians jump from step to step. A cost that follows
        them has no minimum along a combination of parameters that the log hardly shows.

        First poses are the best ones for these weights. Derivatives follow them too; else parameters that are hardly
        told from a first pose, such as the heading of the sensor, would make steps that overshoot.
        """
        length, angle = fit.sizes
        normal, rayleigh = 1.4826, 0.8493  # standard deviation over the median of |x|, and of a plane vector's length
        floor = 1e-9  # smallest standard deviation [m, rad]: rounding of a log without noise
        deviations = np.maximum([rayleigh * np.median(length), normal * np.median(angle)], floor)
        if not self._heading:
            deviations[1] = 1.0
        alike = 0.05  # relative change of standard deviations that keeps them
        if previous is not None and (np.abs(deviations - previous) < alike * previous).all():
            deviations = previous
        with np.errstate(divide="ignore"):
            limits = [_POSITION * deviations[0] / length, _HEADING * deviations[1] / angle]
        weights = np.minimum(np.stack(limits, axis=1), 1.0)
        return self._aligned(poses, slopes, weights, deviations)

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
                    poses, slopes, _ = self._predict(other)
                    found = self._aligned(poses, slopes[:, :, :0], fit.weights, fit.deviations)
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
