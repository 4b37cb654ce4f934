"""References in a scenario file."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from rnc_pin.applications.scenario.schema.base import Positive, Strict
from rnc_pin.applications.scenario.schema.derived import Entry, PartialCall, one_of
from rnc_pin.control import SlitheringReference
from rnc_pin.model import ReducedModel
from rnc_pin.planning import (
    CarPath,
    RelativeHarmonic,
    RelativeHold,
    RelativeMinimumJerk,
    RelativeReference,
    RelativeViaPoints,
    SteeringGeometry,
)

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


Pose = Annotated[list[float], Field(min_length=3, max_length=3)]
_PATH = Entry(
    CarPath,
    late=("start", "duration", "forward_only", "geometry"),
    keys={"goal": "to"},
    forms={
        "goal": Annotated[Pose, Field(description="Goal pose: x, y [m] and heading [rad].")],
        "via": list[Pose],
    },
)
TrailerItem = Annotated[
    PartialCall[SlitheringReference],
    Entry(SlitheringReference, late=("reduced", "task", "tractor", "spacing", "window"), keys={"axle": "frame"}),
]


class VehiclePath(_PATH.model):  # type: ignore[name-defined, misc]
    """Path of a steered vehicle, whose reducing outputs are forward speed and steering angle."""

    frame: str
    """Frame at the middle of the rear axle, with x forward."""

    def path(
        self,
        reduced: ReducedModel,
        q0: np.ndarray,
        start: np.ndarray,
        duration: float,
        *,
        speed: int = 0,
        steering: int = 1,
        forward_only: bool = False,
    ) -> CarPath:
        """Path from a pose (3,) of the frame at a configuration (nq,).

        Args:
            reduced, q0, start: the model, its configuration, and the pose of the frame there.
            duration: duration of the motion [s].
            speed, steering: indices of these reducing outputs.
            forward_only: True to exclude reverse motion.
        """
        largest = float(np.tan(self.max_steering) / self.wheelbase)
        geometry = SteeringGeometry(reduced, q0, self.frame, speed=speed, steering=steering, largest=largest)
        return _PATH.build(self, start=start, duration=duration, forward_only=forward_only, geometry=geometry)


class PathSettings(VehiclePath):
    """Path of a steered vehicle from its initial pose to a goal pose. It gives the primary reference and, with a
    trailer, the vertical one. The constraints give the steering angle for each curvature, for any steering geometry.
    """

    duration: Positive
    """Duration of the motion [s]."""
    forward_only: bool | None = None
    """True to exclude reverse motion. The default is true with a trailer, which cannot follow in reverse."""
    trailer: TrailerItem | None = None
    """Trailer whose axle follows the path of the vehicle."""

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
