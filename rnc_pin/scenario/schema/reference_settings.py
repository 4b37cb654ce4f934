"""References in a scenario file."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from rnc_pin.planning.relative_references import (
    RelativeHarmonic,
    RelativeHold,
    RelativeMinimumJerk,
    RelativeReference,
    RelativeViaPoints,
)
from rnc_pin.scenario.schema.base import Positive, Strict
from rnc_pin.scenario.schema.derived import one_of

ReferenceItem = Annotated[
    RelativeReference,
    one_of(
        minimum_jerk=RelativeMinimumJerk,
        via_points=RelativeViaPoints,
        harmonic=RelativeHarmonic,
        hold=RelativeHold,
    ),
]
HOLD: dict[str, object] = {"hold": {}}
"""Reference that keeps the initial value, in the form of a file."""


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
