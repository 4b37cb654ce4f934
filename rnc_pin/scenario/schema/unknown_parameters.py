"""Unknown parameters of the kinematics: masses, or radii and tracks of wheels."""

from __future__ import annotations

from typing import Annotated

from pydantic import Discriminator, Field, Tag, model_validator

from rnc_pin.scenario.schema.base import Positive, Strict


class _EstimatedParameters(Strict):
    dead_zone: Annotated[float, Field(ge=0)] = 0.0
    """Prediction error below which adaptation stops, because of noise [m/s or rad/s]."""


class UnknownMasses(_EstimatedParameters):
    """Unknown masses of bodies."""

    base: str
    """Joint whose momentum is conserved."""
    initial: Annotated[dict[str, float], Field(min_length=1)]
    """First estimates: joint that carries the body to mass, in ``unit``."""
    unit: Positive = 1.0
    """Unit of the estimates [kg]; the paper's parameters m_k / J have the unit J."""
    bounds: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.05, 20.0]
    """Lower and upper bound of the estimates, in ``unit``."""

    @property
    def estimates(self) -> list[float]:
        return list(self.initial.values())


class _WheelLength(Strict):
    wheels: Annotated[list[str], Field(min_length=1)]
    """Frames of the wheels with this radius or track."""
    initial: Positive
    """First estimate [m]."""


class UnknownWheels(_EstimatedParameters):
    """Unknown radii and tracks of wheels."""

    radii: list[_WheelLength] = []
    """Unknown radii; each is common to its wheels."""
    tracks: list[_WheelLength] = []
    """Unknown tracks; each is the distance between two wheels along their axle."""
    bounds: Annotated[list[float], Field(min_length=2, max_length=2)] = [0.01, 5.0]
    """Lower and upper bound of all estimates [m]."""

    @model_validator(mode="after")
    def _check_any(self) -> UnknownWheels:
        if not self.radii and not self.tracks:
            raise ValueError("name at least one radius or track")
        return self

    @property
    def estimates(self) -> list[float]:
        return [each.initial for each in (*self.radii, *self.tracks)]


def _kind_of(raw: object) -> str:
    keys = raw if isinstance(raw, dict) else ()
    return "unknown_wheels" if "radii" in keys or "tracks" in keys else "unknown_masses"


Unknown = Annotated[
    Annotated[UnknownMasses, Tag("unknown_masses")] | Annotated[UnknownWheels, Tag("unknown_wheels")],
    Discriminator(_kind_of),
]
