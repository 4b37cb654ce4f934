"""What controllers have in common.

They hold gains only. What they learn is a state that is handed in and out, so that a run can be saved,
resumed, batched and replayed to the bit:

    state = controller.initial_state(measurement)
    command, state = controller.step(t, measurement, state)      # once a sample

Those of this package also describe themselves, so that the record of a run says with which gains it was made. One that
does not runs all the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.model.measurement import Measurement
from rnc_pin.plain import Json
from rnc_pin.planning.references import Reference

State: TypeAlias = Any
"""What a controller remembers from one sample to the next: its own affair."""
Description: TypeAlias = Mapping[str, Json]
"""What a controller says of itself: its ``type``, its gains, and the controllers under it by the same rule."""


class VelocityTarget(NamedTuple):
    """What a kinematic controller asks of the reducing outputs; batch axes lead."""

    v2: Float[Array, "*batch r"]
    """Desired rates."""
    v2_dot: Float[Array, "*batch r"]
    """Their rate."""
    x1: Float[Array, "*batch k"] | None = None
    """Desired vertical outputs; NaN where the task has none."""
    x2: Float[Array, "*batch r"] | None = None
    """Desired reducing outputs; NaN where only the rate matters."""
    estimates: Float[Array, "*batch s"] | None = None
    """Parameters that the controller has learnt."""
    prediction_error: Float[Array, "*batch k"] | None = None
    """Measured less predicted rates of the vertical outputs."""


class Command(NamedTuple):
    """What a controller decides; F or T is given, the rest is for the record."""

    F: Float[Array, "*batch r"] | None = None
    """Reduced force, to be allocated to the actuators."""
    T: Float[Array, "*batch p"] | None = None
    """Actuator inputs, where a controller knows its actuators."""
    v2_desired: Float[Array, "*batch r"] | None = None
    x1_desired: Float[Array, "*batch k"] | None = None
    x2_desired: Float[Array, "*batch r"] | None = None
    estimates: Float[Array, "*batch s"] | None = None
    prediction_error: Float[Array, "*batch k"] | None = None


@runtime_checkable
class Controller(Protocol):
    """Decides a command once a sample."""

    def initial_state(self, measurement: Measurement) -> State: ...

    def step(self, t: float, measurement: Measurement, state: State) -> tuple[Command, State]: ...


@runtime_checkable
class KinematicController(Protocol):
    """Decides a velocity target once a sample."""

    def initial_state(self, measurement: Measurement) -> State: ...

    def step(self, t: float, measurement: Measurement, state: State) -> tuple[VelocityTarget, State]: ...


@runtime_checkable
class Describable(Protocol):
    """Says what it is and with which gains: every controller here does."""

    def describe(self) -> Description: ...


def describe(thing: object) -> Description:
    """What something says of itself; the name of its class where it says nothing."""
    return thing.describe() if isinstance(thing, Describable) else {"type": type(thing).__name__}


def listed(values: float | np.ndarray) -> Json:
    """A gain as JSON holds it: a number, or a list of them."""
    numbers: Json = np.asarray(values).tolist()
    return numbers


class _Sized(Protocol):
    size: int


def check_size(reference: Reference | _Sized, size: int, what: str) -> None:
    """Refuse a reference that is not one number for each of its outputs."""
    if reference.size != size:
        raise ConfigurationError(f"the {what} reference has {reference.size} values for {size} outputs")


def elapsed_time(t: float, last: float | None) -> float:
    """Time since the last sample [s]; zero at the first.

    Raises:
        InputError: time runs backwards.
    """
    if last is None:
        return 0.0
    if t < last:
        raise InputError(f"time runs backwards: {t:g} s after {last:g} s")
    return t - last


def spread(values: np.ndarray, where: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Values at some places of an array of this shape, and NaN, "no goal", at the others."""
    whole = np.full(shape, np.nan)
    whole[..., where] = values
    return whole


def command_towards(target: VelocityTarget, F: np.ndarray) -> Command:
    """A command with the record of what it aims at."""
    return Command(
        F=F,
        v2_desired=target.v2,
        x1_desired=target.x1,
        x2_desired=target.x2,
        estimates=target.estimates,
        prediction_error=target.prediction_error,
    )
