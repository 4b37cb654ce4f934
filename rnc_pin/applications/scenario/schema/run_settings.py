"""Simulation, friction of the ground, and distributions that a sweep draws from, in a scenario file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, RootModel, Tag

from rnc_pin.analysis import Grip
from rnc_pin.applications.scenario.schema.derived import NAME, Content, Entry, PartialCall
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import LIST, Strict
from rnc_pin.model import Positive
from rnc_pin.plants import ReducedPlant
from rnc_pin.simulation import Stop

_FORMS = {"substeps": Annotated[int, Field(ge=1)] | None, "tolerance": Positive}
_PLANT = Entry(ReducedPlant, late=("reduced",), forms=_FORMS)
_STOP = Entry(Stop, late=("speed", "lift_off"))
GripItem = Annotated[PartialCall[Grip], Entry(Grip, late=("reduced",))]
"""Friction of the ground."""


class SimulationSettings(_PLANT.model, _STOP.model):  # type: ignore[name-defined, misc]
    """Duration and steps of the simulation, and the effects of a real robot that it includes."""

    duration: Positive | Literal["plan"] = "plan"
    """Simulated time [s], or "plan" for the whole samples of the plan of ``planner``, the default with one."""
    dt: Positive = 0.002
    """Sampling period of the controller [s]."""
    on_lift_off: Literal["ignore", "stop"] = "ignore"
    """Action if a contact with the ground would have to pull: "ignore" only reports it, "stop" ends the run."""

    @property
    def plant_options(self) -> dict[str, Any]:
        """Arguments of ``ReducedPlant`` by name."""
        return _PLANT.given(self)

    @property
    def seconds(self) -> float:
        """Simulated time [s]. A run of its plan has it when the plan is known."""
        if self.duration == "plan":
            raise ConfigurationError("simulation.duration: is missing, and without 'planner' no plan gives it")
        return self.duration

    def of_plan(self, duration: float) -> SimulationSettings:
        """Settings whose duration is known.

        Args:
            duration: that of the plan [s].
        """
        samples = math.ceil(duration / self.dt - 1e-6)
        return self.model_copy(update={"duration": samples * self.dt}) if self.duration == "plan" else self

    @property
    def stop(self) -> Stop:
        """Conditions that end the run early."""
        return _STOP.build(self, lift_off=self.on_lift_off == "stop")


def _ordered(ends: list[float]) -> list[float]:
    if ends[0] > ends[1]:
        raise ValueError(f"minimum {ends[0]:g} is greater than maximum {ends[1]:g}")
    return ends


def _positive(ends: list[float]) -> list[float]:
    if ends[0] <= 0.0:
        raise ValueError(f"expected a minimum greater than 0, found {ends[0]:g}")
    return ends


Ends = Annotated[list[float], Field(min_length=2, max_length=2), AfterValidator(_ordered)]


class UniformRange(RootModel[Ends]):
    """Uniform distribution: [minimum, maximum]."""

    def draw(self, generator: np.random.Generator) -> float:
        return float(generator.uniform(self.root[0], self.root[1]))

    def examples(self) -> Sequence[float]:
        return self.root


class LogUniformDistribution(Strict):
    """Uniform distribution of the logarithm."""

    log_uniform: Annotated[Ends, AfterValidator(_positive)]
    """Minimum, greater than zero, and maximum."""

    def draw(self, generator: np.random.Generator) -> float:
        low, high = self.log_uniform
        return float(np.clip(math.exp(generator.uniform(math.log(low), math.log(high))), low, high))

    def examples(self) -> Sequence[float]:
        return self.log_uniform


class NormalSettings(Strict):
    """Mean and standard deviation."""

    mean: float
    """Mean."""
    std: Positive
    """Standard deviation."""


class NormalDistribution(Strict):
    """Normal distribution."""

    normal: NormalSettings

    def draw(self, generator: np.random.Generator) -> float:
        return float(generator.normal(self.normal.mean, self.normal.std))

    def examples(self) -> Sequence[float]:
        return [self.normal.mean]


class IntegerDistribution(Strict):
    """Uniform distribution over integers."""

    integers: Annotated[list[int], Field(min_length=2, max_length=2), AfterValidator(_ordered)]
    """Minimum and maximum; both can be drawn."""

    def draw(self, generator: np.random.Generator) -> int:
        low, high = self.integers
        return int(generator.integers(low, high, endpoint=True))

    def examples(self) -> Sequence[int]:
        return self.integers


class ChoiceDistribution(Strict):
    """Choice among values, all equally probable."""

    choice: Annotated[list[Content], Field(min_length=1)]
    """Values: numbers, texts, lists or mappings."""

    def draw(self, generator: np.random.Generator) -> Content:
        return self.choice[int(generator.integers(len(self.choice)))]

    def examples(self) -> Sequence[Content]:
        return self.choice


def _kind(raw: object) -> str:
    """Tag of a distribution: its key, or ``LIST``."""
    if isinstance(raw, UniformRange | list):
        return LIST
    if isinstance(raw, Strict):
        return next(iter(type(raw).model_fields))
    return str(next(iter(raw))) if isinstance(raw, dict) and len(raw) == 1 else NAME


Distribution = Annotated[
    Annotated[UniformRange, Tag(LIST)]
    | Annotated[NormalDistribution, Tag("normal")]
    | Annotated[LogUniformDistribution, Tag("log_uniform")]
    | Annotated[IntegerDistribution, Tag("integers")]
    | Annotated[ChoiceDistribution, Tag("choice")],
    Discriminator(_kind),
]
"""Distribution of a drawn value."""


class Distributions(RootModel[dict[str, Distribution]]):
    """Distributions by name."""
