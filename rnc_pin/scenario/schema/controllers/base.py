"""What the settings of all controllers share: what they build from, and what they give back."""

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
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import Task
from rnc_pin.plain import Json
from rnc_pin.planning import Reference
from rnc_pin.scenario.schema.base import Numbers, Positive, Strict, wrong
from rnc_pin.scenario.schema.controllers.unknown import Unknown
from rnc_pin.scenario.schema.simulation import SimulationSettings

_ALPHA = {"paper": 1.0, "normalised": 20.0, "scaled": 20.0}

Gain = float | Numbers | None
"""One number, one for each output, or what the preset says."""


@dataclass(frozen=True)
class Context:
    """What a controller is built from.

    Attributes:
        reduced: the model.
        task: how its outputs are divided.
        primary, redundant, vertical: references of the task's outputs; those that nobody gave hold the start.
        given: names of the references that the scenario gives.
        q0: where the run starts, (nq,).
        v2_0: reduced velocity that it starts with, (r,); at rest where nothing is said.
        grip: of the wheels on the ground, where the scenario speaks of it.
        simulation: how long and how finely.
        preflight: what to do about singular configurations ahead.
        slithering: instead of ``vertical``, what follows from the path that is driven.
        watched: positions in x1 and reference of vertical outputs that should follow by themselves; for the record.
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
        """How long references move, and a little longer [s]."""
        longest = max(reference.duration for reference in (self.primary, self.redundant, self.vertical)) + 1.0
        return min(self.simulation.duration, longest)


@dataclass(frozen=True)
class Built:
    """A controller, and what was noticed while it was built.

    Attributes:
        controller: ready to run.
        warnings: for the person who runs it.
        notes: for the record of the run.
        slower: factor by which references would have to be slower for all wheels to hold on to the ground.
    """

    controller: Controller
    warnings: tuple[str, ...] = ()
    notes: Mapping[str, Json] = field(default_factory=dict)
    slower: float = 1.0


class ControllerSettings(Strict):
    """One type of controller: its gains, and how it is built."""

    follows: ClassVar[frozenset[str]]
    """References of the task that it reads."""
    advice: ClassVar[str] = ""
    """What would read the others."""
    scaled_only: ClassVar[tuple[str, ...]] = ()
    """Settings that mean nothing under the paper's gains."""

    type: str
    """Which controller."""
    preset: Literal["paper", "normalised", "scaled"] = "scaled"
    """Gains of the paper, gains for an ``inertia_bound``, or gains scaled to the model's inertia H along the way. Only
    the last read H, where masses are unknown the H of their first estimates."""

    @property
    def followed(self) -> frozenset[str]:
        """References that it reads with these settings."""
        return self.follows

    def build(self, context: Context) -> Built:
        """The controller.

        Raises:
            ConfigurationError: a reference is given that it does not read, which would be ignored in silence.
            RncError: something of it does not fit the robot or the task.
        """
        for name in context.given:
            if name not in self.followed:
                message = f"is not followed by a controller of type '{self.type}'{self.advice}"
                raise ConfigurationError(f"reference.{name}: {message}")
        return self.make(context)

    @abstractmethod
    def make(self, context: Context) -> Built:
        """The controller, where all references that are given are followed."""

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
    """Of controllers with an adaptive tracker under them, whose gains have to suit an inertia."""

    inertia_bound: Gain = None
    """Of the preset ``normalised``: what the reduced inertia H stays below, ``diag(inertia_bound) - H >= 0`` (kg, kg
    m^2); one number, or one for each reducing output."""

    def bounds(self, context: Context) -> np.ndarray:
        """The bound for each reducing output, (r,).

        Raises:
            ConfigurationError: not one for each.
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
    """Of controllers that learn the forces that they work against."""

    scaled_only: ClassVar[tuple[str, ...]] = ("adaptation", "delay")

    held: bool | None = None
    """Whether the robot starts held up by its actuators, so that trackers know the force that takes."""
    adaptation: Positive | None = None
    """Of scaled gains, beta / k [1/s]."""
    delay: Annotated[float, Field(ge=0)] | None = None
    """That scaled gains are for, from a measurement until a force answers it, sampling apart [s]."""
    dead_zone: Gain = None
    """Velocity error below which a tracker learns nothing, for noise: one number, or one for each reducing output."""
    unknown: Unknown | None = None
    """Masses, or radii and tracks of wheels, that are estimated."""
    alpha: Annotated[float, Field(ge=0)] | None = None
    """Adaptation of what is estimated (20); 0 for none."""

    def build(self, context: Context) -> Built:
        """The controller; where something is unknown, made and run on what is believed: the truth is not read."""
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
            raise wrong("alpha", "adapts what is unknown, and 'unknown' is missing")
        return self

    @model_validator(mode="after")
    def _not_negative(self) -> HeldSettings:
        if self.dead_zone is not None and np.min(self.dead_zone) < 0:
            raise wrong("dead_zone", "has to be positive or zero")
        return self

    def held_force(self, context: Context) -> np.ndarray | None:
        """What the actuators hold before the run begins, if the controller is told, as a reduced force (r,)."""
        if not self.held:
            return None
        rest = np.zeros(context.reduced.r)
        return context.reduced.inverse_dynamics(context.q0, rest, rest)


def reduced_velocity(reduced: ReducedModel, rates: Mapping[str, float], key: str) -> np.ndarray:
    """A reduced velocity (r,) from rates by the names of the reducing outputs; the others rest.

    Raises:
        ConfigurationError: no such output.
    """
    names = reduced.reducing.names
    v2 = np.zeros(reduced.r)
    for name, rate in rates.items():
        if name not in names:
            raise ConfigurationError(f"{key}: no reducing output '{name}'{nearest(name, names)}")
        v2[names.index(name)] = rate
    return v2


def chosen(name: str, value: Gain, default: float | np.ndarray, size: int) -> float | np.ndarray:
    """A gain of the settings, checked for its length, or the preset's.

    Raises:
        ConfigurationError: not one for each output.
    """
    if value is None:
        return default
    if isinstance(value, list) and len(value) != size:
        raise ConfigurationError(f"controller.{name}: {len(value)} values for {size} outputs")
    return np.array(value) if isinstance(value, list) else value


@contextmanager
def named(key: str) -> Iterator[None]:
    """Say which part of the scenario an error is about."""
    try:
        yield
    except ConfigurationError as error:
        raise type(error)(f"{key}: {error}") from None
