"""References: desired positions of outputs, with three time derivatives; their kinds, and those that consist of others.

Every reference has ``size`` and ``at(t)``. Relative references start at the present value of their outputs. Scenario
files write them, by the keys of ``RELATIVE_REFERENCES``. SciPy computes the splines.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Float
from rnc_pin.errors import ConfigurationError, InputError, place_of, short_text
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.model.coordinates import Coordinates, rotation_vector_rates
from rnc_pin.model.input_validation import Numbers, Positive, is_number, numbers_of
from rnc_pin.printing import ObjectSummary, SummaryMixin, counted, described, printed

_BINOMIALS = np.array([[math.comb(order, of) for of in range(4)] for order in range(4)])
_ORDERS = np.subtract.outer(range(4), range(4))


class _Point(Protocol):
    @property
    def position(self) -> np.ndarray: ...


class ReferenceSummary(SummaryMixin):
    """Mixin of references that prints them: positions have the units of the outputs that the reference is for."""

    size: int
    duration: float

    @abstractmethod
    def at(self, t: float) -> _Point: ...

    def _summary(self) -> ObjectSummary:
        end = "never rests" if math.isinf(self.duration) else f"rests from t = {self.duration:g} s on"
        times = [0.0] if math.isinf(self.duration) or not self.duration else [0.0, self.duration]
        lines = [(f"position at t = {t:g} s", described(self.at(t).position)) for t in times]
        return ObjectSummary(f"{type(self).__name__} of {counted(self.size, 'output')}, {end}", lines)


@printed()
class ReferencePoint(NamedTuple):
    """Value of a reference at one time, (k,) each."""

    position: Float[Array, " k"]
    velocity: Float[Array, " k"]
    acceleration: Float[Array, " k"]
    jerk: Float[Array, " k"]


@runtime_checkable
class Reference(Protocol):
    """Desired trajectory of k outputs; any object with these two attributes and this method is one.

    Attributes:
        size: number of outputs, k.
        duration: time after which the reference rests [s]; infinite if it never rests, zero for a constant.

    Example:
        >>> class Ramp:
        ...     size, duration = 1, np.inf
        ...     def at(self, t):
        ...         zero = np.zeros(1)
        ...         return rnc.planning.ReferencePoint(np.array([0.1 * t]), np.array([0.1]), zero, zero)
        >>> isinstance(Ramp(), rnc.planning.Reference), Ramp().at(2.0).position
        (True, array([0.2]))
    """

    size: int
    duration: float

    def at(self, t: float) -> ReferencePoint:
        """Return position, velocity, acceleration and jerk, (k,) each.

        Args:
            t: time [s].
        """


@printed()
class TaskReference(NamedTuple):
    """References of a task."""

    primary: Reference
    """Reference of x21."""
    vertical: Reference
    """Reference of x1."""

    @property
    def duration(self) -> float:
        """Time after which both references rest [s]."""
        return max(self.primary.duration, self.vertical.duration)


class Joined(ReferenceSummary):
    """Concatenation of several references: outputs of all parts in one vector.

    Args:
        references: references of the parts, in the order of the outputs.

    Example:
        >>> parts = [rnc.planning.Hold([1.0]), rnc.planning.Hold([2.0, 3.0])]
        >>> rnc.planning.Joined(parts).at(0.0).position
        array([1., 2., 3.])
    """

    def __init__(self, references: Sequence[Reference]) -> None:
        self._parts = list(references)
        self.size = sum(part.size for part in self._parts)
        # Outputs of parts that end earlier rest until the last one does.
        self.duration = max((part.duration for part in self._parts), default=0.0)

    def at(self, t: float) -> ReferencePoint:
        points = [part.at(t) for part in self._parts]
        return ReferencePoint(*(np.concatenate(each) for each in zip(*points, strict=True)))


class InTurn(ReferenceSummary):
    """Sequence of references of the same outputs; each runs until it rests, then the next one takes over.

    Args:
        references: each begins at the end position and end time of the one before it.

    Example:
        >>> out = rnc.planning.MinimumJerk([0.0], [1.0], duration=2.0)
        >>> back = rnc.planning.MinimumJerk([1.0], [0.0], duration=2.0, begin=2.0)
        >>> reference = rnc.planning.InTurn([out, back])
        >>> reference.duration, reference.at(1.0).velocity, reference.at(3.0).velocity
        (4.0, array([0.9375]), array([-0.9375]))
    """

    def __init__(self, references: Sequence[Reference]) -> None:
        self._parts = list(references)
        self.size, self.duration = self._parts[0].size, self._parts[-1].duration

    def at(self, t: float) -> ReferencePoint:
        # The last part also holds the end.
        return next((part for part in self._parts if t < part.duration), self._parts[-1]).at(t)


# ---------------------------------------------------------------------- kinds


class Hold(ReferenceSummary):
    """Constant reference.

    Args:
        value: (k,).

    Example:
        >>> rnc.planning.Hold([0.5, -1.0]).at(3.0).position
        array([ 0.5, -1. ])
    """

    duration = 0.0

    def __init__(self, value: ArrayLike) -> None:
        position = _admit(value, "value of a constant reference")
        zero = np.zeros_like(position)
        # All calls return the same arrays: a caller that wrote into them would change the reference.
        for each in (position, zero):
            each.setflags(write=False)
        self.size = position.size
        self._point = ReferencePoint(position, zero, zero, zero)

    def at(self, t: float) -> ReferencePoint:
        return self._point


class PiecewisePolynomial(ReferenceSummary):
    """Reference of piecewise polynomials on [begin, end], at rest before and after.

    Args:
        coefficients: of powers of ``t - breaks[piece]``, highest power first, (degree + 1, pieces, k).
        breaks: ends of the pieces, (pieces + 1,) [s].
        begin, end: times between which the polynomials count [s].
    """

    def __init__(self, coefficients: np.ndarray, breaks: np.ndarray, begin: float, end: float) -> None:
        # One matrix for each piece holds the curve and three derivatives, lowest power first: one product gives all.
        self.size = coefficients.shape[2]
        together = np.zeros((coefficients.shape[1], len(coefficients), 4, self.size))
        for order in range(4):
            derivative = np.polynomial.polynomial.polyder(coefficients[::-1], order)
            together[:, : len(derivative), order] = np.moveaxis(derivative, 0, 1)
        self._pieces = list(together.reshape(*together.shape[:2], -1))
        self._breaks = breaks.tolist()
        self._begin, self.duration = begin, end
        self._first, self._last = (Hold(self._at(t)[0]).at(t) for t in (begin, end))

    def at(self, t: float) -> ReferencePoint:
        # Outside its times a polynomial goes on; the reference rests.
        if t < self._begin:
            return self._first
        if t >= self.duration:
            return self._last
        return ReferencePoint(*self._at(t))

    def _at(self, t: float) -> np.ndarray:
        """Value and three derivatives (4, k)."""
        # The last piece contains its end too.
        piece = bisect_right(self._breaks, t, 1, len(self._pieces)) - 1
        terms, since = self._pieces[piece], t - self._breaks[piece]
        powers = [1.0]
        for _ in range(len(terms) - 1):
            powers.append(powers[-1] * since)
        return np.array(powers).dot(terms).reshape(4, self.size)


class MinimumJerk(PiecewisePolynomial):
    """Quintic from rest to rest, with the least integral of squared jerk (Flash and Hogan 1985).

    Args:
        start: (k,).
        goal: (k,).
        duration: of the motion [s].
        begin: time at which it starts [s].

    Example:
        >>> reference = rnc.planning.MinimumJerk([0.0], [1.0], duration=2.0)
        >>> position, velocity, *_ = reference.at(1.0)
        >>> position, velocity  # halfway; the largest velocity is 15/8 of the mean
        (array([0.5]), array([0.9375]))
    """

    def __init__(self, start: ArrayLike, goal: ArrayLike, duration: float, begin: float = 0.0) -> None:
        ends = [_admit(start, "start of a minimum-jerk reference"), _admit(goal, "goal of a minimum-jerk reference")]
        if ends[0].shape != ends[1].shape:
            raise InputError(f"start has shape {ends[0].shape} but goal {ends[1].shape}")
        if not (is_number(duration) and duration > 0):
            raise InputError(f"duration of a minimum-jerk reference has to be positive, found {duration!r}")
        breaks = np.array([begin, begin + duration])
        # 6 s^5 - 15 s^4 + 10 s^3 goes from 0 to 1, and its velocity and acceleration vanish at both ends.
        powers = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0]) / np.diff(breaks) ** np.arange(5.0, -1.0, -1.0)
        coefficients = np.multiply.outer(powers, ends[1] - ends[0])
        coefficients[-1] = ends[0]
        super().__init__(coefficients[:, None], breaks, begin, begin + duration)


class ViaPoints(PiecewisePolynomial):
    """Quintic spline through given points at given times, at rest at both ends.

    Args:
        times: increasing, (n,) [s].
        points: (n, k).

    Example:
        >>> reference = rnc.planning.ViaPoints([0.0, 1.0, 2.0], [[0.0], [1.0], [2.0]])
        >>> position, velocity, *_ = reference.at(1.0)
        >>> position.round(6), bool(velocity > 1.0)  # faster than the mean, because it rests at both ends
        (array([1.]), True)
    """

    def __init__(self, times: ArrayLike, points: ArrayLike) -> None:
        knots, values = _admit(times, "times of via points"), _admit(points, "via points")
        if len(knots) < 2 or len(knots) != len(values) or not (np.diff(knots) > 0).all():
            found = f"found {len(values)} points at the times {short_text(knots.tolist())}"
            raise InputError(f"via points need at least two increasing times, and one point each: {found}")
        # A list of numbers is one output: its points become a column.
        values = values.reshape(len(knots), -1)
        zero = np.zeros(values.shape[1])
        # Velocity and acceleration vanish at both ends: four conditions that a quintic spline needs beside its points.
        rest = [(1, zero), (2, zero)]
        spline = scipy.interpolate.make_interp_spline(knots, values, k=5, bc_type=(rest, rest))
        columns = [scipy.interpolate.PPoly.from_spline((spline.t, column, spline.k)) for column in spline.c.T]
        coefficients = np.stack([column.c for column in columns], axis=-1)
        super().__init__(coefficients, columns[0].x, float(knots[0]), float(knots[-1]))


class Harmonic(ReferenceSummary):
    """``center + amplitude sin(2 pi frequency t + phase)``; the amplitude grows from zero, at rest at the center.

    Args:
        center: (k,).
        amplitude: (k,) or a number.
        frequency: [Hz], (k,) or a number.
        phase: [rad], (k,) or a number.
        ramp: time over which the amplitude grows from zero [s].

    Example:
        >>> reference = rnc.planning.Harmonic([1.0], amplitude=0.5, frequency=0.25, ramp=1.0)
        >>> reference.at(0.0).position, reference.at(5.0).position  # after one and a quarter periods
        (array([1.]), array([1.5]))
    """

    duration = np.inf

    def __init__(
        self, center: ArrayLike, amplitude: ArrayLike, frequency: ArrayLike, phase: ArrayLike = 0.0, ramp: float = 1.0
    ) -> None:
        self._center = _admit(center, "center of a harmonic reference")
        self.size = self._center.size
        given = numbers_of(amplitude, "amplitude"), numbers_of(frequency, "frequency"), numbers_of(phase, "phase")
        try:
            amplitude, frequency, phase = (np.array(np.broadcast_to(each, self._center.shape)) for each in given)
        except ValueError:
            raise InputError(f"amplitude, frequency and phase have to be numbers or lists of {self.size}") from None
        rate = 2 * np.pi * frequency
        orders = np.arange(4.0)[:, None]  # each derivative multiplies by the rate and is a quarter turn ahead
        self._phases, self._amplitudes = phase + 0.5 * np.pi * orders, amplitude * rate**orders
        self._rates = np.tile(rate, (4, 1))  # of the shape of the others: NumPy takes long to repeat rows
        # The step of degree seven from 0 to 1 has three derivatives that vanish at both ends.
        step = np.array([-20.0, 70.0, -84.0, 35.0, 0.0, 0.0, 0.0, 0.0]) / max(ramp, 1e-9) ** np.arange(7.0, -1.0, -1.0)
        self._growth = PiecewisePolynomial(step[:, None, None], np.array([0.0, ramp]), 0.0, ramp)

    def at(self, t: float) -> ReferencePoint:
        if t <= 0:
            zero = np.zeros(self.size)
            return ReferencePoint(self._center, zero, zero, zero)
        waves = self._amplitudes * np.sin(self._rates * t + self._phases)
        if t < self._growth.duration:
            # Until the ramp ends, each derivative has terms of the growth and of the wave, by Leibniz's rule.
            waves = (np.array(self._growth.at(t))[_ORDERS, 0] * _BINOMIALS).dot(waves)
        return ReferencePoint(self._center + waves[0], waves[1], waves[2], waves[3])


class Geodesic(ReferenceSummary):
    """Minimum-jerk motion from start to goal, rotations about one axis: ``R(t) = exp(s(t) log(R1 R0^T)) R0``.

    Outputs on lines and circles move as in ``MinimumJerk``. Positions of rotations are rotation vectors of at most a
    half turn. The jerk of a rotation is NaN, because no controller uses it.

    Args:
        start: (k,), with rotation vectors for rotations.
        goal: (k,), in the same form.
        duration: of the motion [s].
        coordinates: coordinates of the outputs; they tell which outputs are rotations.
        begin: time at which it starts [s].

    Example:
        >>> robot = rnc.Robot.from_urdf("satellite.urdf", base="free", gravity=(0, 0, 0))
        >>> outputs = [rnc.FrameOrientation("satellite"), rnc.FramePosition("satellite")]
        >>> reduced = rnc.NonholonomicSystem(robot).reduce(outputs)
        >>> coordinates = reduced.reducing.coordinates
        >>> quarter = [0.0, 0.0, np.pi / 2, 1.0, 0.0, 0.0]
        >>> reference = rnc.planning.Geodesic(np.zeros(6), quarter, duration=2.0, coordinates=coordinates)
        >>> reference.at(1.0).position.round(6) + 0.0  # an eighth of a turn, and half a metre
        array([0.      , 0.      , 0.785398, 0.5     , 0.      , 0.      ])
    """

    def __init__(
        self, start: ArrayLike, goal: ArrayLike, duration: float, coordinates: Coordinates, begin: float = 0.0
    ) -> None:
        first, last = np.atleast_1d(np.asarray(start, dtype=float)), np.atleast_1d(np.asarray(goal, dtype=float))
        self._whole = MinimumJerk(first, last, duration, begin)
        self._turns = []
        for place in coordinates.rotations:
            triple = slice(place, place + 3)
            R0 = pin.exp3(first[triple])
            # In world axes: the velocity of the rotation is then the rate of s times this constant vector.
            self._turns.append((triple, R0, pin.log3(pin.exp3(last[triple]) @ R0.T)))
        self._share = MinimumJerk([0.0], [1.0], duration, begin)
        self.size, self.duration = self._whole.size, self._whole.duration

    def at(self, t: float) -> ReferencePoint:
        # Copies: outside its times the motion returns the same arrays at each call.
        point = ReferencePoint(*(each.copy() for each in self._whole.at(t)))
        s, s_dot, s_ddot, _ = (float(each[0]) for each in self._share.at(t))
        for triple, R0, arc in self._turns:
            r = pin.log3(pin.exp3(s * arc) @ R0)
            point.position[triple] = r
            point.velocity[triple], point.acceleration[triple] = rotation_vector_rates(r, s_dot * arc, s_ddot * arc)
            point.jerk[triple] = np.nan
        return point


class RelativeReference(ABC):
    """Family of the references whose start is not known yet."""

    @abstractmethod
    def from_start(self, start: Float[Array, " k"], coordinates: Coordinates) -> Reference:
        """Return the reference of k outputs from their values at its start.

        Args:
            start: values (k,) of the outputs at the start.
            coordinates: their kinds: lines, circles and orientations.

        Raises:
            ConfigurationError: the number of values is not k.
            InputError: a value is not valid.
        """


@dataclass(frozen=True)
class RelativeMinimumJerk(RelativeReference):
    """Minimum-jerk motion from the initial value to a goal, at rest at both ends. Orientations turn about one axis.

    Raises:
        ConfigurationError: both ``to`` and ``by`` are given, or none.
    """

    duration: Positive
    """Duration of the motion [s]."""
    to: Numbers | None = None
    """Goal; one number for each output."""
    by: Numbers | None = None
    """Displacement from the initial value, instead of ``to``."""
    begin: float = 0.0
    """Start time of the motion [s]."""

    def __post_init__(self) -> None:
        if (self.to is None) == (self.by is None):
            raise ConfigurationError("expected one of 'to' and 'by'")

    def from_start(self, start: Float[Array, " k"], coordinates: Coordinates) -> Reference:
        given = _sized(self.to if self.by is None else self.by, coordinates)
        goal = given if self.by is None else coordinates.moved(start, given)
        # Rotation vectors that change entry by entry would turn about an axis that moves.
        if coordinates.rotations:
            return Geodesic(start, goal, self.duration, coordinates, self.begin)
        return MinimumJerk(start, goal, self.duration, self.begin)


@dataclass(frozen=True)
class RelativeViaPoints(RelativeReference):
    """Smooth motion from the initial value through points."""

    times: Numbers
    """Times of the points [s], increasing and greater than zero. The initial value is the point at time zero."""
    points: Sequence[Numbers]
    """Points; each has one number for each output."""

    def from_start(self, start: Float[Array, " k"], coordinates: Coordinates) -> Reference:
        # The initial value takes time zero, so no other point can.
        if not len(self.times) == len(self.points) > 0 < self.times[0]:
            found = f"found {len(self.times)} times for {len(self.points)} points"
            raise ConfigurationError(f"via_points: the first time is above 0, that of the initial value; {found}")
        return ViaPoints([0.0, *self.times], [start, *(_sized(point, coordinates) for point in self.points)])


@dataclass(frozen=True)
class RelativeHarmonic(RelativeReference):
    """Sinusoid about a center: ``center + amplitude sin(2 pi frequency t + phase)``."""

    amplitude: Numbers
    """Amplitude; one number for each output."""
    frequency: float | Numbers
    """Frequency [Hz]; one number, or one for each output."""
    phase: float | Numbers = 0.0
    """Phase [rad]; one number, or one for each output."""
    center: Numbers | None = None
    """Center of the oscillation; the initial value by default."""
    ramp: Positive = 1.0
    """Time over which the amplitude grows from zero [s]."""

    def from_start(self, start: Float[Array, " k"], coordinates: Coordinates) -> Reference:
        center = start if self.center is None else _sized(self.center, coordinates)
        return Harmonic(center, _sized(self.amplitude, coordinates), self.frequency, self.phase, self.ramp)


@dataclass(frozen=True)
class RelativeHold(RelativeReference):
    """Constant reference."""

    value: Numbers | None = None
    """Constant value; the initial value by default."""

    def from_start(self, start: Float[Array, " k"], coordinates: Coordinates) -> Reference:
        return Hold(start if self.value is None else _sized(self.value, coordinates))


@dataclass(frozen=True)
class RelativeCircle(RelativeReference):
    """Circle of two outputs about a center, from rest there: the radius grows from zero. Other outputs stay.

    Raises:
        ConfigurationError: both ``period`` and ``speed`` are given, or none.
    """

    radius: Positive
    """Radius [m]."""
    period: Positive | None = None
    """Time of one turn [s]."""
    speed: Positive | None = None
    """Speed along the circle [m/s], instead of ``period``."""
    plane: Sequence[str] = ()
    """Names of the two outputs, by default the first two; the turn is from the first to the second."""
    center: Numbers | None = None
    """Center; one number for each output. The initial value by default."""
    ramp: Positive = 1.0
    """Time over which the radius grows [s]."""

    def __post_init__(self) -> None:
        if (self.period is None) == (self.speed is None):
            raise ConfigurationError("expected one of 'period' and 'speed'")

    def from_start(self, start: Float[Array, " k"], coordinates: Coordinates) -> Reference:
        # Outputs beside the two of the plane have amplitude zero: they stay at their center.
        named = [place_of(name, coordinates.names, "circle.plane: no output") for name in self.plane]
        plane = named or list(range(len(start)))[:2]
        if len(plane) != 2 or len({*plane}) != 2:
            raise ConfigurationError(f"a circle needs two outputs, found {', '.join(self.plane or coordinates.names)}")
        # The first output is a cosine, by a phase of a quarter turn, the second a sine.
        amplitude, phase = np.zeros((2, len(start)))
        amplitude[plane], phase[plane[0]] = self.radius, np.pi / 2
        # The speed along the circle is 2 pi times radius and frequency.
        rate = 1.0 / self.period if self.period else (self.speed or 0.0) / (2 * np.pi * self.radius)
        around = RelativeHarmonic(amplitude.tolist(), rate, phase.tolist(), self.center, self.ramp)
        return around.from_start(start, coordinates)


@dataclass(frozen=True)
class RelativeTable(RelativeReference):
    """Smooth motion through the rows of a table, at rest at both ends. It need not begin at the initial value."""

    file: str
    """Text file, relative to the scenario: ``time`` and names of the outputs with commas, then rows of numbers."""

    def from_start(self, start: Float[Array, " k"], coordinates: Coordinates) -> Reference:
        try:
            lines = read_bytes(Path(self.file)).decode().splitlines()
            names, *rows = ([cell.strip() for cell in line.split(",")] for line in lines if line.strip())
            values = np.array(rows, dtype=float).reshape(len(rows), len(names))
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"{self.file}: expected a line of names, then numbers: {error}") from None
        wanted = ("time", *coordinates.names)
        # Columns of unknown names are refused too: a misspelled output would else be missing without a word.
        for name in names:
            place_of(name, wanted, f"{self.file}: no output")
        times, *points = (values[:, place_of(name, names, f"{self.file}: no column")] for name in wanted)
        return ViaPoints(times, np.transpose(points))


RELATIVE_REFERENCES: Mapping[str, type[RelativeReference]] = MappingProxyType({
    "minimum_jerk": RelativeMinimumJerk, "via_points": RelativeViaPoints, "harmonic": RelativeHarmonic,
    "hold": RelativeHold, "circle": RelativeCircle, "csv": RelativeTable,
})  # fmt: skip
"""Relative references by their keys in files."""


def _sized(values: Sequence[float] | None, coordinates: Coordinates) -> np.ndarray:
    """Values of a reference as an array (k,).

    Raises:
        ConfigurationError: their number is not k; the message names the outputs without a value.
    """
    array, names, size = np.asarray(values, dtype=float), coordinates.names, coordinates.size
    if array.shape == (size,):
        return array
    wrong = f"a reference has {array.size} values for {size} outputs"
    if names and array.ndim == 1:
        wrong += f" ({', '.join(names)})"
        # The names beyond the given values are the outputs that a user forgot.
        wrong += f"; add a value of {', '.join(names[array.size :])}" if array.size < size else ""
    raise ConfigurationError(wrong)


def _admit(value: ArrayLike, what: str) -> np.ndarray:
    array = np.atleast_1d(numbers_of(value, what))
    if not np.isfinite(array).all():
        raise InputError(f"{what} has to be finite, found {array.tolist()}")
    return array
