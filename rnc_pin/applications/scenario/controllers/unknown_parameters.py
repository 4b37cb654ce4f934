"""Unknown parameters of the kinematics: masses, or radii and tracks of wheels."""

from __future__ import annotations

from abc import abstractmethod
from functools import partial
from typing import Annotated, ClassVar

from pydantic import Discriminator, Field, Tag, model_validator

from rnc_pin.applications.scenario.controllers.context import at_key
from rnc_pin.applications.scenario.schema.base import Positive, Strict
from rnc_pin.applications.scenario.schema.derived import Entry, part
from rnc_pin.control import (
    Estimator,
    MomentumRegressor,
    Regressor,
    UnknownMass,
    UnknownRadius,
    UnknownTrack,
    WheelRegressor,
)
from rnc_pin.model import NotNegative, ReducedModel

_ENDS = Field(min_length=2, max_length=2, description="Lower and upper bound of all estimates, in their unit.")
_ERROR = Field(description="Prediction error below which adaptation stops, because of noise [m/s or rad/s].")
_FORMS = {"bounds": Annotated[list[float], _ENDS], "dead_zone": Annotated[NotNegative, _ERROR]}
_estimates = partial(part, Estimator, "bounds", "dead_zone", forms=_FORMS)
_OF_MASSES, _OF_WHEELS = _estimates(), _estimates(defaults={"bounds": [0.01, 5.0]})
_BASE, _UNIT = part(MomentumRegressor, "base"), part(UnknownMass, "unit")
_WHEELS = part(UnknownRadius, "wheels", forms={"wheels": Annotated[list[str], Field(min_length=1)]})


class _EstimatedParameters(Strict):
    entry: ClassVar[Entry[Estimator]]

    @property
    @abstractmethod
    def estimates(self) -> list[float]:
        """First estimates."""

    @abstractmethod
    def regressor(self, reduced: ReducedModel) -> Regressor:
        """Model of the unknown parameters."""

    def estimator(self, reduced: ReducedModel, alpha: object) -> Estimator:
        """Build the estimator with an adaptation gain."""
        with at_key("controller.unknown"):
            regressor = self.regressor(reduced)
            return self.entry.build(self, reduced=reduced, regressor=regressor, initial=self.estimates, alpha=alpha)


class UnknownMasses(_EstimatedParameters, _OF_MASSES.model, _BASE.model, _UNIT.model):  # type: ignore[name-defined, misc]
    """Unknown masses of bodies."""

    entry: ClassVar[Entry[Estimator]] = _OF_MASSES

    initial: Annotated[dict[str, float], Field(min_length=1)]
    """First estimates: joint that carries the body to mass, in ``unit``."""

    @property
    def estimates(self) -> list[float]:
        return list(self.initial.values())

    def regressor(self, reduced: ReducedModel) -> Regressor:
        masses = [_UNIT.build(self, joint=joint) for joint in self.initial]
        return _BASE.build(self, robot=reduced.robot, unknown=masses)


class _WheelLength(_WHEELS.model):  # type: ignore[name-defined, misc]
    """Wheels with one unknown radius or track."""

    initial: Positive
    """First estimate [m]."""


class UnknownWheels(_EstimatedParameters, _OF_WHEELS.model):  # type: ignore[name-defined, misc]
    """Unknown radii and tracks of wheels."""

    entry: ClassVar[Entry[Estimator]] = _OF_WHEELS

    radii: list[_WheelLength] = []
    """Unknown radii; each is common to its wheels."""
    tracks: list[_WheelLength] = []
    """Unknown tracks; each is the distance between two wheels along their axle."""

    @model_validator(mode="after")
    def _check_any(self) -> UnknownWheels:
        if not self.radii and not self.tracks:
            raise ValueError("name at least one radius or track")
        return self

    @property
    def estimates(self) -> list[float]:
        return [each.initial for each in (*self.radii, *self.tracks)]

    def regressor(self, reduced: ReducedModel) -> Regressor:
        radii = [UnknownRadius(each.wheels) for each in self.radii]
        return WheelRegressor(reduced, [*radii, *(UnknownTrack(each.wheels) for each in self.tracks)])


def _kind_of(raw: object) -> str:
    keys = raw if isinstance(raw, dict) else ()
    return "unknown_wheels" if "radii" in keys or "tracks" in keys else "unknown_masses"


Unknown = Annotated[
    Annotated[UnknownMasses, Tag("unknown_masses")] | Annotated[UnknownWheels, Tag("unknown_wheels")],
    Discriminator(_kind_of),
]
