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
    by: Numbers | None = None
    """Displacement from the initial value, instead of ``to``."""
    duration: Positive
    begin: float = 0.0

    @model_validator(mode="after")
    def _one_goal(self) -> _MinimumJerkArguments:
        if (self.to is None) == (self.by is None):
            raise ValueError("expected one of 'to' and 'by'")
        return self


class MinimumJerkReference(Strict):
    """From the initial value to a goal, at rest at both ends; orientations turn about one axis."""

    minimum_jerk: _MinimumJerkArguments

    def build(self, start: np.ndarray, coordinates: Coordinates) -> planning.Reference:
        a = self.minimum_jerk
        goal = _sized(a.to, start) if a.to is not None else coordinates.moved(start, _sized(a.by, start))
        if coordinates.rotations:
            return planning.Geodesic(start, goal, a.duration, coordinates, a.begin)
        return planning.MinimumJerk(start, goal, a.duration, a.begin)


class _ViaArguments(Strict):
    times: Numbers
    """Increasing, after zero: the initial value is the first point [s]."""
    points: list[Numbers]


class ViaReference(Strict):
    """From the initial value through points."""

    via_points: _ViaArguments

    def build(self, start: np.ndarray, coordinates: Coordinates) -> planning.Reference:
        a = self.via_points
        if len(a.times) != len(a.points):
            raise ConfigurationError(f"via_points has {len(a.times)} times for {len(a.points)} points")
        points = [start, *(_sized(np.array(point), start) for point in a.points)]
        return planning.ViaPoints([0.0, *a.times], points)


class _HarmonicArguments(Strict):
    amplitude: Numbers
    frequency: float | Numbers
    phase: float | Numbers = 0.0
    center: Numbers | None = None
    """The initial value by default."""
    ramp: Positive = 1.0


class HarmonicReference(Strict):
    """A sine about a center."""

    harmonic: _HarmonicArguments

    def build(self, start: np.ndarray, coordinates: Coordinates) -> planning.Reference:
        a = self.harmonic
        center = start if a.center is None else _sized(np.array(a.center), start)
        return planning.Harmonic(center, _sized(np.array(a.amplitude), start), a.frequency, a.phase, a.ramp)


class _HoldArguments(Strict):
    value: Numbers | None = None
    """The initial value by default."""


class HoldReference(Strict):
    """A constant."""

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
    """A trailer whose axle should stay on the path that the vehicle before it has driven."""

    frame: str
    """At the middle of its axle."""
    kingpin: str | None = None
    """Where it is coupled; at the frame of the path by default."""


Pose = Annotated[list[float], Field(min_length=3, max_length=3)]


class PathSettings(Strict):
    """A steered vehicle driven from where it is to a pose; gives the primary and vertical references. Of any steering
    geometry: the angle of the steering output for each curvature follows from the constraints.
    """

    frame: str
    """At the middle of the rear axle, x forward."""
    to: Pose
    """x, y [m] and heading [rad]."""
    via: list[Pose] = []
    """Poses to stop at on the way; others are added where the path cannot be driven without."""
    duration: Positive
    """[s]"""
    wheelbase: Positive
    """Rear axle to front axle [m]."""
    max_steering: Annotated[float, Field(gt=0, lt=np.pi / 2)] = np.pi / 4
    """Of a front wheel in the middle [rad]: with the wheelbase it gives the smallest turning radius."""
    forward_only: bool | None = None
    """Never back up; by default where there is a trailer, which cannot slither backwards."""
    trailer: TrailerSettings | None = None

    @model_validator(mode="after")
    def _no_pushing(self) -> PathSettings:
        if self.trailer is not None and self.forward_only is False:
            raise ValueError("a trailer cannot slither backwards: leave out 'forward_only: false' or 'trailer'")
        return self


class References(Strict):
    """Desired trajectories of the task's outputs; what is left out stays at its initial value."""

    path: PathSettings | None = None
    """Instead of ``primary`` (distance driven, steering angle) and, with a trailer, ``vertical`` (its heading, as it
    follows from the path that is driven)."""

    primary: ReferenceItem | None = None
    redundant: ReferenceItem | None = None
    vertical: ReferenceItem | None = None


def _sized(values: Sequence[float] | np.ndarray | None, like: np.ndarray) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if array.shape != like.shape:
        raise ConfigurationError(f"a reference has {array.size} values for {like.size} outputs")
    return array
