"""Base classes of the settings of all controllers, and the input and result of building one."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from rnc_pin.analysis import Grip
from rnc_pin.control import Controller, Estimator, SlitheringReference, UncertainController
from rnc_pin.errors import ConfigurationError, nearest
from rnc_pin.io.json import Json
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.planning import Reference
from rnc_pin.scenario.schema.base import Numbers, Positive, Strict, wrong
from rnc_pin.scenario.schema.controllers.unknown import Unknown
from rnc_pin.scenario.schema.simulation_settings import SimulationSettings

_ALPHA = {"paper": 1.0, "normalised": 20.0, "scaled": 20.0}

Gain = float | Numbers | None
"""One number, one for each output, or None for the value of the preset."""


@dataclass(frozen=True)
class Context:
    """Inputs for building a controller.

    Attributes:
        reduced: the model.
        task: roles of the outputs.
        primary, redundant, vertical: references of the task's outputs; constant at the start if not given.
        given: names of the references that the scenario gives.
        q0: initial configuration, (nq,).
        v2_0: initial reduced velocity, (r,); None for rest.
        grip: friction of the wheels on the ground, if the scenario gives it.
        simulation: duration and steps.
        preflight: action if a singular configuration is ahead.
        slithering: reference of a trailer on the path of its tractor, which replaces ``vertical``.
        watched: positions in x1 and reference of monitored vertical outputs; for the record only.
    """

    reduced: ReducedModel
    task: Task
    primary: Reference
    redundant: Reference
    vertical: Reference
    given: tuple[str, ...]
    q0: np.ndarray
    simulation: SimulationSettings
    preflight: Literal["warn", "refuse"] = "warn"
    slithering: SlitheringReference | None = None
    watched: tuple[np.ndarray, Reference] | None = None
    v2_0: np.ndarray | None = None
    grip: Grip | None = None

    @property
    def horizon(self) -> float:
        """Time until all references are constant, plus 1 s, at most the duration of the simulation [s]."""
        longest = max(reference.duration for reference in (self.primary, self.redundant, self.vertical)) + 1.0
        return min(self.simulation.duration, longest)


@dataclass(frozen=True)
class Built:
    """Controller, with the warnings of the check before the run.

    Attributes:
        controller: ready to run.
        warnings: messages for the user.
        notes: entries for the record of the run.
        slower: factor by which the references must be slowed down so that no wheel slips.
    """

    controller: Controller
    warnings: tuple[str, ...] = ()
    notes: Mapping[str, Json] = field(default_factory=dict)
    slower: float = 1.0


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
    preset: Literal["paper", "normalised", "scaled"] = "scaled"
    """Default gains. "paper": gains of the paper. "normalised": gains for an ``inertia_bound``. "scaled": gains scaled
    to the reduced inertia H along the reference. Only "scaled" reads H. With unknown masses it reads H of the first
    estimates."""

    @property
    def followed(self) -> frozenset[str]:
        """References that the controller reads with these settings."""
        return self.follows

    def build(self, context: Context) -> Built:
        """Build the controller.

        Raises:
            ConfigurationError: the scenario gives a reference that the controller does not read.
            RncError: the settings do not fit the robot or the task.
        """
        for name in context.given:
            if name not in self.followed:
                message = f"is not followed by a controller of type '{self.type}'{self.advice}"
                raise ConfigurationError(f"reference.{name}: {message}")
        return self.make(context)

    @abstractmethod
    def make(self, context: Context) -> Built:
        """Build the controller; all given references are among ``followed``."""

    @model_validator(mode="before")
    @classmethod
    def _say_what_is_missing(cls, raw: object) -> object:
        for name, info in cls.model_fields.items():
            if isinstance(raw, dict) and info.is_required() and name not in raw:
                what = str(info.description)
                raise wrong(name, f"is missing; expected {what[0].lower()}{what[1:].rstrip('.')}")
        return raw

    @model_validator(mode="after")
    def _suit_the_preset(self) -> ControllerSettings:
        for name in self.scaled_only:
            if self.preset != "scaled" and getattr(self, name) is not None:
                raise wrong(name, "belongs to the preset 'scaled'")
        return self


class AdaptiveSettings(ControllerSettings):
    """Settings of controllers with an adaptive tracker, whose gains depend on the inertia."""

    inertia_bound: Gain = None
    """Upper bound of the reduced inertia, ``diag(inertia_bound) - H >= 0`` [kg, kg m^2], for the preset ``normalised``.
    One number, or one for each reducing output."""

    def bounds(self, context: Context) -> np.ndarray:
        """Return the inertia bound of each reducing output, (r,).

        Raises:
            ConfigurationError: the number of values is not r.
        """
        values = chosen("inertia_bound", self.inertia_bound, 1.0, context.reduced.r)
        return np.broadcast_to(np.asarray(values, dtype=float), (context.reduced.r,))

    @model_validator(mode="after")
    def _bound_where_it_is_read(self) -> AdaptiveSettings:
        if self.preset == "normalised" and self.inertia_bound is None:
            raise wrong("inertia_bound", "is missing; the preset 'normalised' needs a bound on the reduced inertia")
        if self.preset != "normalised" and self.inertia_bound is not None:
            raise wrong("inertia_bound", "belongs to the preset 'normalised'")
        if self.inertia_bound is not None and np.min(self.inertia_bound) <= 0:
            raise wrong("inertia_bound", f"expected positive numbers, found {self.inertia_bound}")
        return self


class HeldSettings(AdaptiveSettings):
    """Settings of controllers that estimate disturbance forces."""

    scaled_only: ClassVar[tuple[str, ...]] = ("adaptation", "delay")

    held: bool | None = None
    """True if the actuators hold the robot against gravity before the run. Trackers then start with that force."""
    adaptation: Positive | None = None
    """Adaptation rate ``beta / k`` of the preset ``scaled`` [1/s]."""
    delay: Annotated[float, Field(ge=0)] | None = None
    """Delay from a measurement to its force, not counting sampling [s]. The preset ``scaled`` uses it."""
    dead_zone: Gain = None
    """Velocity error below which adaptation stops, because of noise [m/s or rad/s]. One number, or one for each
    reducing output."""
    unknown: Unknown | None = None
    """Masses, or radii and tracks of wheels, to estimate."""
    alpha: Annotated[float, Field(ge=0)] | None = None
    """Adaptation gain of the parameter estimates (20); 0 for constant estimates."""

    def build(self, context: Context) -> Built:
        """Build the controller. With unknown parameters it uses the estimated model and never the true one."""
        if self.unknown is None:
            return super().build(context)
        unknown, (low, high) = self.unknown, self.unknown.bounds
        alpha = _ALPHA[self.preset] if self.alpha is None else self.alpha
        with named("controller.unknown"):
            regressor = unknown.build(context.reduced)
            estimator = Estimator(context.reduced, regressor, unknown.estimates, (low, high), alpha, unknown.dead_zone)
        built = super().build(replace(context, reduced=estimator.model))
        notes = {
            "estimates": dict(zip(regressor.names, regressor.units, strict=True)),
            "predicted": dict(zip(regressor.predicted, regressor.predicted_units, strict=True)),
        }
        controller = UncertainController(estimator, built.controller)
        return replace(built, controller=controller, notes={**built.notes, **notes})

    @model_validator(mode="after")
    def _nothing_to_adapt(self) -> HeldSettings:
        if self.alpha is not None and self.unknown is None:
            raise wrong("alpha", "needs 'unknown', which is missing")
        return self

    @model_validator(mode="after")
    def _not_negative(self) -> HeldSettings:
        if self.dead_zone is not None and np.min(self.dead_zone) < 0:
            raise wrong("dead_zone", f"expected numbers of at least 0, found {self.dead_zone}")
        return self

    def held_force(self, context: Context) -> np.ndarray | None:
        """Reduced force that holds the robot at rest at ``q0``, (r,); None unless ``held`` is true."""
        if not self.held:
            return None
        rest = np.zeros(context.reduced.r)
        return context.reduced.inverse_dynamics(context.q0, rest, rest)


def reduced_velocity(reduced: ReducedModel, rates: Mapping[str, float], key: str) -> np.ndarray:
    """Return the reduced velocity (r,) from rates by name of the reducing outputs; other rates are zero.

    Raises:
        ConfigurationError: no reducing output has this name.
    """
    names = reduced.reducing.names
    v2 = np.zeros(reduced.r)
    for name, rate in rates.items():
        if name not in names:
            raise ConfigurationError(f"{key}: no reducing output '{name}'{nearest(name, names)}")
        v2[names.index(name)] = rate
    return v2


def chosen(name: str, value: Gain, default: float | np.ndarray, size: int) -> float | np.ndarray:
    """Return a gain of the settings after a check of its length, or the default of the preset.

    Raises:
        ConfigurationError: the number of values is not ``size``.
    """
    if value is None:
        return default
    if isinstance(value, list) and len(value) != size:
        raise ConfigurationError(f"controller.{name}: {len(value)} values for {size} outputs")
    return np.array(value) if isinstance(value, list) else value


@contextmanager
def named(key: str) -> Iterator[None]:
    """Prepend the key of a part of the scenario to errors."""
    try:
        yield
    except ConfigurationError as error:
        raise type(error)(f"{key}: {error}") from None
