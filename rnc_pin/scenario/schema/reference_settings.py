"""References in a scenario file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, Tag, model_validator

from rnc_pin import planning
from rnc_pin.errors import ConfigurationError
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.scenario.schema.base import BY_KIND, Numbers, Positive, Strict


class _MinimumJerkArguments(Strict):
    to: Numbers | None = None
    """Goal; one number for each output."""
    by: Numbers | None = None
    """Displacement from the initial value, instead of ``to``."""
    duration: Positive
    """Duration of the motion [s]."""
    begin: float = 0.0
    """Start time of the motion [s]."""

    @model_validator(mode="after")
    def _one_goal(self) -> _MinimumJerkArguments:
        if (self.to is None) == (self.by is None):
            raise ValueError("expected one of 'to' and 'by'")
        return self


class MinimumJerkReference(Strict):
    """Minimum-jerk motion from the initial value to a goal, at rest at both ends. Orientations turn about one axis."""

    minimum_jerk: _MinimumJerkArguments

    def build(self, start: np.ndarray, coordinates: Coordinates) -> planning.Reference:
        a = self.minimum_jerk
        goal = _sized(a.to, start) if a.to is not None else coordinates.moved(start, _sized(a.by, start))
        if coordinates.rotations:
            return planning.Geodesic(start, goal, a.duration, coordinates, a.begin)
        return planning.MinimumJerk(start, goal, a.duration, a.begin)


class _ViaArguments(Strict):
    times: Numbers
    """Times of the points [s], increasing and greater than zero. The initial value is the point at time zero."""
    points: list[Numbers]
    """Points; each has one number for each output."""


class ViaReference(Strict):
    """Smooth motion from the initial value through points."""

    via_points: _ViaArguments

    def build(self, start: np.ndarray, coordinates: Coordinates) -> planning.Reference:
        a = self.via_points
        if len(a.times) != len(a.points):
            raise ConfigurationError(f"via_points has {len(a.times)} times for {len(a.points)} points")
        if a.times and not a.times[0] > 0:
            raise ConfigurationError(
                f"via_points.times: the initial value is the point at time 0, so the first time is greater than 0;"
                f" found {a.times[0]:g}"
            )
        points = [start, *(_sized(np.array(point), start) for point in a.points)]
        return planning.ViaPoints([0.0, *a.times], points)


class _HarmonicArguments(Strict):
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


class HarmonicReference(Strict):
    """Sinusoid about a center: ``center + amplitude sin(2 pi frequency t + phase)``."""

    harmonic: _HarmonicArguments

    def build(self, start: np.ndarray, coordinates: Coordinates) -> planning.Reference:
        a = self.harmonic
        center = start if a.center is None else _sized(np.array(a.center), start)
        return planning.Harmonic(center, _sized(np.array(a.amplitude), start), a.frequency, a.phase, a.ramp)


class _HoldArguments(Strict):
    value: Numbers | None = None
    """Constant value; the initial value by default."""


class HoldReference(Strict):
    """Constant reference."""

    hold: _HoldArguments = _HoldArguments()

    def build(self, start: np.ndarray, coordinates: Coordinates) -> planning.Reference:
        return planning.Hold(start if self.hold.value is None else _sized(np.array(self.hold.value), start))


ReferenceItem = Annotated[
    Annotated[MinimumJerkReference, Tag("minimum_jerk")]
    | Annotated[ViaReference, Tag("via_points")]
    | Annotated[HarmonicReference, Tag("harmonic")]
    | Annotated[HoldReference, Tag("hold")],
    BY_KIND,
]


class TrailerSettings(Strict):
    """Trailer whose axle follows the path of the vehicle in front."""

    frame: str
    """Frame at the middle of the trailer's axle."""
    kingpin: str | None = None
    """Frame of the coupling; by default the frame of the path."""


Pose = Annotated[list[float], Field(min_length=3, max_length=3)]


class PathSettings(Strict):
    """Path of a steered vehicle from its initial pose to a goal pose. It gives the primary reference and, with a
    trailer, the vertical one. The constraints give the steering angle for each curvature, for any steering geometry.
    """

    frame: str
    """Frame at the middle of the rear axle, with x forward."""
    to: Pose
    """Goal pose: x, y [m] and heading [rad]."""
    via: list[Pose] = []
    """Intermediate poses; the vehicle stops at each. If the path is infeasible, the planner adds further poses."""
    duration: Positive
    """Duration of the motion [s]."""
    wheelbase: Positive
    """Distance between rear and front axle [m]."""
    max_steering: Annotated[float, Field(gt=0, lt=np.pi / 2)] = np.pi / 4
    """Largest steering angle of an equivalent front wheel in the middle [rad]. With the wheelbase it gives the smallest
    turning radius."""
    forward_only: bool | None = None
    """True to exclude reverse motion. The default is true with a trailer, which cannot follow in reverse."""
    trailer: TrailerSettings | None = None
    """Trailer that follows the path."""

    @model_validator(mode="after")
    def _no_pushing(self) -> PathSettings:
        if self.trailer is not None and self.forward_only is False:
            raise ValueError("a trailer cannot follow in reverse: remove 'forward_only: false' or 'trailer'")
        return self


class References(Strict):
    """Reference trajectories of the task's outputs. Outputs without a reference keep their initial value."""

    path: PathSettings | None = None
    """Planned path of a vehicle. It replaces ``primary`` (travelled distance, steering angle) and, with a trailer,
    ``vertical`` (heading of the trailer)."""

    primary: ReferenceItem | None = None
    """Reference of the primary outputs."""
    redundant: ReferenceItem | None = None
    """Reference of the redundant outputs."""
    vertical: ReferenceItem | None = None
    """Reference of the vertical outputs."""


def _sized(values: Sequence[float] | np.ndarray | None, like: np.ndarray) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if array.shape != like.shape:
        raise ConfigurationError(f"a reference has {array.size} values for {like.size} outputs")
    return array
