"""Simulation, friction of the ground, and distributions that a sweep draws from, in a scenario file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, RootModel, Tag

from rnc_pin.applications.scenario.schema.derived import Content, tag_of
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import LIST, Strict
from rnc_pin.model import Positive
from rnc_pin.simulation import Stop


class GripSettings(Strict):
    """Friction that constraints need: the norm of their force along the ground over ``friction`` times the load.

    Attributes:
        friction: coefficient of friction of the ground.
    """

    friction: Positive


class SimulationSettings(Strict):
    """Duration and steps of the simulation, and the effects of a real robot that it includes.

    Attributes:
        position_limits: True ends the run if a joint leaves its position limits in the robot's file.
        joint_damping: True for the viscous joint damping of the robot's file.
        actuator_limits: True to clip inputs to the effort limits of the robot's file and of the actuators.
        joint_friction: True for the dry joint friction of the robot's file, with stiction.
        substeps: integration steps in one call of ``advance``, which is a sampling period. By default as many as the
            tolerance asks for: 1, 2, 4 and so on.
        tolerance: largest error that the integration adds in a second, on any entry of configuration and velocity [m,
            rad, m/s or rad/s].
        duration: simulated time [s], or "plan" for the whole samples of the plan of ``planner``, the default with one.
        dt: sampling period of the controller [s].
        on_lift_off: action if a contact with the ground would have to pull: "ignore" only reports it, "stop" ends the
            run.
    """

    position_limits: bool = False
    joint_damping: bool = False
    actuator_limits: bool = False
    joint_friction: bool = False
    substeps: Annotated[int, Field(ge=1)] | None = None
    tolerance: Positive = 1e-7
    duration: Positive | Literal["plan"] = "plan"
    dt: Positive = 0.002
    on_lift_off: Literal["ignore", "stop"] = "ignore"

    @property
    def plant_options(self) -> tuple[bool, bool, bool, int | None, float]:
        """Arguments of ``ReducedPlant`` after the model, and of ``ContactPlant`` after the contacts."""
        return self.joint_damping, self.actuator_limits, self.joint_friction, self.substeps, self.tolerance

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
        # Whole samples, so that the goal is reached within the run; 1e-6 of a sample is rounding of the division.
        samples = math.ceil(duration / self.dt - 1e-6)
        return self.model_copy(update={"duration": samples * self.dt}) if self.duration == "plan" else self

    @property
    def stop(self) -> Stop:
        """Conditions that end the run early."""
        return Stop(position_limits=self.position_limits, lift_off=self.on_lift_off == "stop")


def _ordered(ends: list[float]) -> list[float]:
    if ends[0] > ends[1]:
        raise ValueError(f"minimum {ends[0]:g} is greater than maximum {ends[1]:g}")
    return ends


Ends = Annotated[list[float], Field(min_length=2, max_length=2), AfterValidator(_ordered)]


class UniformRange(RootModel[Ends]):
    """Uniform distribution: [minimum, maximum]."""

    def draw(self, generator: np.random.Generator) -> float:
        return float(generator.uniform(self.root[0], self.root[1]))

    def examples(self) -> Sequence[float]:
        return self.root


class LogUniformDistribution(Strict):
    """Uniform distribution of the logarithm.

    Attributes:
        log_uniform: minimum, greater than zero, and maximum.
    """

    log_uniform: Annotated[list[Positive], Field(min_length=2, max_length=2), AfterValidator(_ordered)]

    def draw(self, generator: np.random.Generator) -> float:
        low, high = self.log_uniform
        # exp(log(high)) may be larger than high by rounding, and a draw beyond its range would be refused.
        return float(np.clip(math.exp(generator.uniform(math.log(low), math.log(high))), low, high))

    def examples(self) -> Sequence[float]:
        return self.log_uniform


class NormalSettings(Strict):
    """Mean and standard deviation.

    Attributes:
        mean: mean.
        std: standard deviation.
    """

    mean: float
    std: Positive


class NormalDistribution(Strict):
    """Normal distribution."""

    normal: NormalSettings

    def draw(self, generator: np.random.Generator) -> float:
        return float(generator.normal(self.normal.mean, self.normal.std))

    def examples(self) -> Sequence[float]:
        return [self.normal.mean]  # it has no ends


class IntegerDistribution(Strict):
    """Uniform distribution over integers.

    Attributes:
        integers: minimum and maximum; both can be drawn.
    """

    integers: Annotated[list[int], Field(min_length=2, max_length=2), AfterValidator(_ordered)]

    def draw(self, generator: np.random.Generator) -> int:
        low, high = self.integers
        return int(generator.integers(low, high, endpoint=True))

    def examples(self) -> Sequence[int]:
        return self.integers


class ChoiceDistribution(Strict):
    """Choice among values, all equally probable.

    Attributes:
        choice: values: numbers, texts, lists or mappings.
    """

    choice: Annotated[list[Content], Field(min_length=1)]

    def draw(self, generator: np.random.Generator) -> Content:
        return self.choice[int(generator.integers(len(self.choice)))]

    def examples(self) -> Sequence[Content]:
        return self.choice


Distribution = Annotated[
    Annotated[UniformRange, Tag(LIST)]
    | Annotated[NormalDistribution, Tag("normal")]
    | Annotated[LogUniformDistribution, Tag("log_uniform")]
    | Annotated[IntegerDistribution, Tag("integers")]
    | Annotated[ChoiceDistribution, Tag("choice")],
    Discriminator(tag_of),
]
"""Distribution of a drawn value."""


class Distributions(RootModel[dict[str, Distribution]]):
    """Distributions by name."""
