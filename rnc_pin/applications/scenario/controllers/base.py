"""Settings that several types of controllers share, such as unknown parameters, and free motion.

A settings class holds and checks the values of a file. Its keys are parameters of the classes and functions that
compute with them. ``build`` passes them on.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from rnc_pin import control
from rnc_pin.applications.scenario.controllers.context import BuiltController, ControllerContext
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import Numbers, Strict, wrong
from rnc_pin.model import NotNegative, Positive, ReducedModel

Gain = float | Numbers
"""Gain in a file: a number, or one for each output."""
_Bounds = Annotated[list[float], Field(min_length=2, max_length=2)]


class _EstimatedParameters(Strict):
    """Parameters to estimate.

    Attributes:
        bounds: lower and upper bound of all estimates, in their unit.
        dead_zone: prediction error below which adaptation stops, because of noise [m/s or rad/s].
    """

    bounds: _Bounds
    dead_zone: NotNegative = 0.0

    @property
    @abstractmethod
    def estimates(self) -> list[float]:
        """First estimates."""

    @abstractmethod
    def regressor(self, reduced: ReducedModel) -> control.Regressor:
        """Model of the unknown parameters."""

    def estimator(self, reduced: ReducedModel, alpha: float) -> control.Estimator:
        """Build the estimator with an adaptation gain."""
        with ConfigurationError.at("controller.unknown"):
            regressor, (low, high) = self.regressor(reduced), self.bounds
            return control.Estimator(reduced, regressor, self.estimates, (low, high), alpha, self.dead_zone)


class UnknownMasses(_EstimatedParameters):
    """Unknown masses of bodies.

    Attributes:
        bounds: lower and upper bound of all estimates, in their unit.
        base: the joint whose momentum is conserved.
        unit: mass that counts as 1 [kg]. The paper's parameters are ``m_k / J``: unit J.
        initial: first estimates: joint that carries the body to mass, in ``unit``.
    """

    bounds: _Bounds = [0.05, 20.0]
    base: str
    unit: Positive = 1.0
    initial: Annotated[dict[str, float], Field(min_length=1)]

    @property
    def estimates(self) -> list[float]:
        return list(self.initial.values())

    def regressor(self, reduced: ReducedModel) -> control.Regressor:
        masses = [control.UnknownMass(joint, self.unit) for joint in self.initial]
        return control.MomentumRegressor(reduced.robot, self.base, masses)


class _WheelLength(Strict):
    """Wheels with one unknown radius or track.

    Attributes:
        wheels: frames of ``RollingWheel`` constraints.
        initial: first estimate [m].
    """

    wheels: Annotated[list[str], Field(min_length=1)]
    initial: Positive


class UnknownWheels(_EstimatedParameters):
    """Unknown radii and tracks of wheels.

    Attributes:
        bounds: lower and upper bound of all estimates, in their unit.
        radii: unknown radii; each is common to its wheels.
        tracks: unknown tracks; each is the distance between two wheels along their axle.
    """

    bounds: _Bounds = [0.01, 5.0]
    radii: list[_WheelLength] = []
    tracks: list[_WheelLength] = []

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


def sized_gain(name: str, value: Gain | np.ndarray, size: int) -> float | np.ndarray:
    """Return a gain after a check of its length.

    Raises:
        ConfigurationError: the number of values is not ``size``.
    """
    if isinstance(value, list) and len(value) != size:
        raise ConfigurationError(f"controller.{name}: {len(value)} values for {size} outputs")
    return np.array(value) if isinstance(value, list) else value


def sized_gains(size: int, **given: Gain | None) -> dict[str, float | np.ndarray | None]:
    """Return gains that the settings give, by name, after a check of their lengths; None for others."""
    return {name: None if value is None else sized_gain(name, value, size) for name, value in given.items()}


class ControllerSettings(Strict):
    """Settings of one type of controller.

    Attributes:
        type: type of the controller.
        preset: default gains. "paper": gains of the paper. "scaled": gains scaled to the reduced inertia H along the
            reference. Only "scaled" reads H. With unknown masses it reads H of the first estimates.
    """

    follows: ClassVar[frozenset[str]]
    """References of the task that the controller reads."""
    advice: ClassVar[str] = ""
    """Hint for error messages: a setting that reads the other references."""
    scaled_only: ClassVar[tuple[str, ...]] = ()
    """Settings that only the preset ``scaled`` reads."""

    type: str
    preset: control.Preset = "scaled"

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

    @property
    def velocity_command(self) -> str:
        """Key and value by which the controller commands velocities, for messages; empty if it commands forces."""
        return ""

    @property
    def outer(self) -> control.OuterGains:
        """Outer gains of the preset, for those that the settings do not give."""
        return control.OUTER_GAINS[self.preset]

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
        for name, value in self:
            if self.preset != "scaled" and name in self.scaled_only and value is not None:
                raise wrong(name, "belongs to the preset 'scaled'")
        return self


class AdaptationSettings(ControllerSettings):
    """Settings of controllers that learn disturbance forces, and unknown parameters of the kinematics.

    Attributes:
        gravity_compensation: True if the actuators hold the robot against gravity before the run. Trackers then start
            with that force. By default with preset "scaled", for a run that starts at rest where gravity loads the
            outputs.
        unknown: masses, or radii and tracks of wheels, to estimate.
        alpha: adaptation gain of parameter estimates (20); 0 for constant estimates.
        dead_zone: velocity error below which adaptation stops, as large as the velocity noise [m/s or rad/s]; zero in
            the paper (``control.feedback``). One number, or one for each reducing output.
        adaptation: for "scaled": adaptation rate ``beta / k`` [1/s]; by default 1, and up to 20 where gravity loads the
            outputs.
        delay: for "scaled": time from a measurement to its force, without sampling [s]; 0 by default.
    """

    scaled_only: ClassVar[tuple[str, ...]] = ("adaptation", "delay")

    gravity_compensation: bool | None = None
    unknown: Unknown | None = None
    alpha: NotNegative | None = None
    dead_zone: Gain | None = None
    adaptation: Positive | None = None
    delay: NotNegative | None = None

    def build(self, context: ControllerContext) -> BuiltController:
        """Build the controller. With unknown parameters it uses the estimated model and never the true one."""
        if self.unknown is None:
            return super().build(context)
        estimator = self.unknown.estimator(context.reduced, self.outer.alpha if self.alpha is None else self.alpha)
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
    """No control: the robot moves freely.

    Attributes:
        type: free motion: all actuator inputs are zero, and no output has a goal.
    """

    follows: ClassVar[frozenset[str]] = frozenset()

    type: Literal["none"]

    def _build(self, context: ControllerContext) -> BuiltController:
        return BuiltController(control.ZeroInput(context.reduced))
