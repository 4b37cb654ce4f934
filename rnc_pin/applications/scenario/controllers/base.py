"""Settings that several types of controllers share, such as unknown parameters, and free motion.

A settings class holds and checks the values of a file. Its keys are parameters of the classes and functions that
compute with them. ``build`` passes them on.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from typing import Annotated, ClassVar, Literal, cast

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from rnc_pin import control
from rnc_pin.applications.scenario.controllers.context import BuiltController, ControllerContext
from rnc_pin.applications.scenario.schema.derived import Entry, T, part
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import Numbers, Strict, wrong
from rnc_pin.model import NotNegative, Positive, ReducedModel

_Gains = type[control.VelocityGains] | type[control.PositionGains]
_ENDS = Field(min_length=2, max_length=2, description="Lower and upper bound of all estimates, in their unit.")
_ERROR = Field(description="Prediction error below which adaptation stops, because of noise [m/s or rad/s].")
_FORMS = {"bounds": Annotated[list[float], _ENDS], "dead_zone": Annotated[NotNegative, _ERROR]}
_estimates = partial(part, control.Estimator, "bounds", "dead_zone", forms=_FORMS)
_OF_MASSES, _OF_WHEELS = _estimates(), _estimates(defaults={"bounds": [0.01, 5.0]})
_BASE, _UNIT = part(control.MomentumRegressor, "base"), part(control.UnknownMass, "unit")
_WHEELS = part(control.UnknownRadius, "wheels", forms={"wheels": Annotated[list[str], Field(min_length=1)]})


class _EstimatedParameters(Strict):
    entry: ClassVar[Entry[control.Estimator]]

    @property
    @abstractmethod
    def estimates(self) -> list[float]:
        """First estimates."""

    @abstractmethod
    def regressor(self, reduced: ReducedModel) -> control.Regressor:
        """Model of the unknown parameters."""

    def estimator(self, reduced: ReducedModel, alpha: object) -> control.Estimator:
        """Build the estimator with an adaptation gain."""
        with ConfigurationError.at("controller.unknown"):
            regressor = self.regressor(reduced)
            return self.entry.build(self, reduced=reduced, regressor=regressor, initial=self.estimates, alpha=alpha)


class UnknownMasses(_EstimatedParameters, _OF_MASSES.model, _BASE.model, _UNIT.model):  # type: ignore[name-defined, misc]
    """Unknown masses of bodies."""

    entry: ClassVar[Entry[control.Estimator]] = _OF_MASSES

    initial: Annotated[dict[str, float], Field(min_length=1)]
    """First estimates: joint that carries the body to mass, in ``unit``."""

    @property
    def estimates(self) -> list[float]:
        return list(self.initial.values())

    def regressor(self, reduced: ReducedModel) -> control.Regressor:
        masses = [_UNIT.build(self, joint=joint) for joint in self.initial]
        return _BASE.build(self, robot=reduced.robot, unknown=masses)


class _WheelLength(_WHEELS.model):  # type: ignore[name-defined, misc]
    """Wheels with one unknown radius or track."""

    initial: Positive
    """First estimate [m]."""


class UnknownWheels(_EstimatedParameters, _OF_WHEELS.model):  # type: ignore[name-defined, misc]
    """Unknown radii and tracks of wheels."""

    entry: ClassVar[Entry[control.Estimator]] = _OF_WHEELS

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

    def regressor(self, reduced: ReducedModel) -> control.Regressor:
        radii = [control.UnknownRadius(each.wheels) for each in self.radii]
        return control.WheelRegressor(reduced, [*radii, *(control.UnknownTrack(each.wheels) for each in self.tracks)])


def _kind_of(raw: object) -> str:
    keys = raw if isinstance(raw, dict) else ()
    return "unknown_wheels" if "radii" in keys or "tracks" in keys else "unknown_masses"


Unknown = Annotated[
    Annotated[UnknownMasses, Tag("unknown_masses")] | Annotated[UnknownWheels, Tag("unknown_wheels")],
    Discriminator(_kind_of),
]


def sized_gain(name: str, value: float | Numbers | None, size: int) -> float | np.ndarray | None:
    """Return a gain of the settings after a check of its length; None if it is not given.

    Raises:
        ConfigurationError: the number of values is not ``size``.
    """
    if isinstance(value, list) and len(value) != size:
        raise ConfigurationError(f"controller.{name}: {len(value)} values for {size} outputs")
    return np.array(value) if isinstance(value, list) else value


class ControllerSettings(Strict):
    """Settings of one type of controller."""

    follows: ClassVar[frozenset[str]]
    """References of the task that the controller reads."""
    advice: ClassVar[str] = ""
    """Hint for error messages: a setting that reads the other references."""
    scaled_only: ClassVar[tuple[str, ...]] = ()
    """Settings that only the preset ``scaled`` reads."""

    type: str
    """Type of the controller."""
    preset: control.Preset = "scaled"
    """Default gains. "paper": gains of the paper. "scaled": gains scaled to the reduced inertia H along the reference.
    Only "scaled" reads H. With unknown masses it reads H of the first estimates."""

    @property
    def followed(self) -> frozenset[str]:
        """References that the controller reads with these settings."""
        return self.follows

    def build(self, context: ControllerContext) -> BuiltController:
        """Build the controller.

        Raises:
            ConfigurationError: the scenario gives a reference that the controller does not read.
            RncError: the settings do not fit the robot or the task.
        """
        for name in context.given:
            if name not in self.followed:
                message = f"is not followed by a controller of type '{self.type}'{self.advice}"
                raise ConfigurationError(f"reference.{name}: {message}")
        return self._build(context)

    @abstractmethod
    def _build(self, context: ControllerContext) -> BuiltController: ...

    def outer_gain(self, name: str, size: int = 1) -> float | np.ndarray:
        """Gain of the settings for ``size`` outputs, or that of their preset."""
        given = sized_gain(name, getattr(self, name), size)
        return cast(float, getattr(control.OUTER_GAINS[self.preset], name)) if given is None else given

    def tracker_gains(self, kind: _Gains, size: int) -> dict[str, float | np.ndarray | None]:
        """Gains of a tracker that the settings give, by name; None for others."""
        names = [each.name for each in fields(kind) if each.name in type(self).model_fields]
        return {name: sized_gain(name, getattr(self, name), size) for name in names}

    @model_validator(mode="before")
    @classmethod
    def _name_missing_setting(cls, raw: object) -> object:
        for name, info in cls.model_fields.items():
            if isinstance(raw, dict) and info.is_required() and name not in raw:
                what = cls.key_descriptions()[name]
                raise wrong(name, f"is missing; expected {what[0].lower()}{what[1:].rstrip('.')}")
        return raw

    @model_validator(mode="after")
    def _check_preset(self) -> ControllerSettings:
        for name in self.scaled_only:
            if self.preset != "scaled" and getattr(self, name) is not None:
                raise wrong(name, "belongs to the preset 'scaled'")
        return self


def preset_gains(kind: Callable[..., T], *names: str) -> Entry[T]:
    """Return an entry of gains that those of a preset replace if the file does not give them."""
    return part(kind, *names, optional=names)


_RATES = part(control.GainDesign, "adaptation", "delay")
_DEAD_ZONE, _ALPHA = preset_gains(control.VelocityGains, "dead_zone"), preset_gains(control.OuterGains, "alpha")


class AdaptationSettings(ControllerSettings, _RATES.model, _DEAD_ZONE.model, _ALPHA.model):  # type: ignore[name-defined, misc]
    """Settings of controllers that learn disturbance forces, and unknown parameters of the kinematics."""

    scaled_only: ClassVar[tuple[str, ...]] = ("adaptation", "delay")

    gravity_compensation: bool | None = None
    """True if the actuators hold the robot against gravity before the run. Trackers then start with that force. By
    default with preset "scaled", for a run that starts at rest where gravity loads the outputs."""
    unknown: Unknown | None = None
    """Masses, or radii and tracks of wheels, to estimate."""

    def build(self, context: ControllerContext) -> BuiltController:
        """Build the controller. With unknown parameters it uses the estimated model and never the true one."""
        if self.unknown is None:
            return super().build(context)
        estimator = self.unknown.estimator(context.reduced, self.outer_gain("alpha"))
        built, regressor = super().build(replace(context, reduced=estimator.model)), estimator.regressor
        notes = {
            **built.notes,
            "estimates": dict(zip(regressor.names, regressor.units, strict=True)),
            "predicted": dict(zip(regressor.predicted, regressor.predicted_units, strict=True)),
        }
        return replace(built, controller=control.UncertainController(estimator, built.controller), notes=notes)

    def holding_force(self, context: ControllerContext) -> np.ndarray | None:
        """Reduced force that holds the robot at rest at ``q0``, (r,); None without gravity compensation."""
        wanted = self.gravity_compensation
        if wanted is None:
            starts_at_rest = context.v2_0 is None or not context.v2_0.any()
            wanted = self.preset == "scaled" and starts_at_rest and control.gravity_loads(context.reduced, context.q0)
        if not wanted:
            return None
        rest = np.zeros(context.reduced.r)
        return context.reduced.inverse_dynamics(context.q0, rest, rest)

    @model_validator(mode="after")
    def _check_adaptation(self) -> AdaptationSettings:
        if self.alpha is not None and self.unknown is None:
            raise wrong("alpha", "needs 'unknown', which is missing")
        if self.dead_zone is not None and np.min(self.dead_zone) < 0:
            raise wrong("dead_zone", f"expected numbers of at least 0, found {self.dead_zone}")
        return self


class NoControlSettings(ControllerSettings):
    """No control: the robot moves freely."""

    follows: ClassVar[frozenset[str]] = frozenset()

    type: Literal["none"]
    """Free motion: all actuator inputs are zero, and no output has a goal."""

    def _build(self, context: ControllerContext) -> BuiltController:
        return BuiltController(control.ZeroInput(context.reduced))
