"""References that start at the present value of their outputs, as scenario files write them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.model.parameter_types import Numbers, Positive
from rnc_pin.planning.references import Geodesic, Harmonic, Hold, MinimumJerk, Reference, ViaPoints


class RelativeReference(ABC):
    """Family of the references whose start is not known yet."""

    @abstractmethod
    def from_start(self, start: Float[Array, " k"], coordinates: Coordinates) -> Reference:
        """Return the reference of k outputs from their values at its start.

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
        goal = (
            _sized(self.to, coordinates) if self.by is None else coordinates.moved(start, _sized(self.by, coordinates))
        )
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
        if len(self.times) != len(self.points):
            raise ConfigurationError(f"via_points has {len(self.times)} times for {len(self.points)} points")
        if not self.times[0] > 0:
            raise ConfigurationError(
                f"via_points.times: the initial value is the point at time 0, so the first time is greater than 0;"
                f" found {self.times[0]:g}"
            )
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
        wrong += f"; add a value of {', '.join(names[array.size :])}" if array.size < size else ""
    raise ConfigurationError(wrong)
