"""Optimal planner in a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from rnc_pin.scenario.schema.base import Numbers, Positive, Strict
from rnc_pin.scenario.schema.reference_settings import Pose, ReferenceItem

WeightSetting = float | Numbers | dict[str, float]
"""One number, one for each row, or a mapping by name (zero for the others)."""
Limits = Annotated[list[float | None], Field(min_length=2, max_length=2)]
"""Smallest and largest value; null for no limit."""


class OutputCostSettings(Strict):
    """Squared distance of outputs from a target."""

    outputs: Annotated[list[str], Field(min_length=1)]
    """Names of outputs that have a value."""
    target: Numbers
    """Target; one number for each output."""
    weight: WeightSetting = 1.0
    """Weight: one number, one for each output, or a mapping by name."""
    phase: Literal["running", "terminal", "both"] = "running"
    """Over the motion, at its end, or both."""


class CostSettings(Strict):
    """Costs of a motion: weighted squares, integrated over time."""

    effort: WeightSetting | None = 1.0
    """Weight of the inputs of the form: one number, one for each, or a mapping by name."""
    velocity: WeightSetting | None = None
    """Weight of the reduced velocities."""
    acceleration: WeightSetting | None = None
    """Weight of the reduced accelerations, in the forms "acceleration" and "dynamic"."""
    posture: dict[str, float] | None = None
    """Weights of the distance from the initial configuration, by names of entries of v."""
    outputs: list[OutputCostSettings] = []
    """Costs of outputs."""


class BoundSettings(Strict):
    """Hard bounds, by name: [smallest, largest], with null for no limit."""

    input: dict[str, Limits] = {}
    """Inputs of the form. Those of the form "acceleration" end in ``_dot``."""
    velocity: dict[str, Limits] = {}
    """Rates of reducing outputs."""
    output: dict[str, Limits] = {}
    """Outputs that have a value, such as joint angles."""


class PlanLimits(Strict):
    """Limits of the robot's file that a plan keeps. A bound for the same row replaces one; null removes a kind."""

    position: Literal["file"] | None = "file"
    """Position limits of joints."""
    velocity: Literal["file"] | None = "file"
    """Velocity limits of joints."""
    effort: Literal["file"] | None = "file"
    """Effort limits of actuators, in the form "dynamic". A limit of 0 counts as not stated."""


class PathGuess(Strict):
    """Path of a steered vehicle, whose reducing outputs are forward speed and steering angle."""

    frame: str
    """Frame at the middle of the rear axle, with x forward."""
    to: Pose
    """Goal pose: x, y [m] and heading [rad]."""
    via: list[Pose] = []
    """Intermediate poses; the vehicle stops at each."""
    wheelbase: Positive
    """Distance between rear and front axle [m]."""
    max_steering: Annotated[float, Field(gt=0, lt=np.pi / 2)] = np.pi / 4
    """Largest steering angle of an equivalent front wheel in the middle [rad]."""


class GuessSettings(Strict):
    """First guess of the motion: configurations to pass, a vehicle's path, or a motion of the reducing outputs."""

    through: list[dict[str, float | list[float]]] | None = None
    """Configurations between start and goal at equal times, each with joints to positions; other joints keep their
    initial position."""
    path: PathGuess | None = None
    """Path of a steered vehicle."""
    reducing: ReferenceItem | None = None
    """Motion of all reducing outputs from their initial values; the constraints give the rest."""

    @model_validator(mode="after")
    def _one_guess(self) -> GuessSettings:
        if sum(each is not None for each in (self.through, self.path, self.reducing)) != 1:
            raise ValueError("expected one of 'through', 'path' and 'reducing'")
        return self


class OptimalPlanner(Strict):
    """Optimal motion, planned before the run. It gives the references of the task that the file does not give, and the
    plan of a controller of type "plan_feedback".
    """

    type: Literal["optimal"]
    """Optimal control with exact derivatives."""
    goal: dict[str, float] = {}
    """Values at the end by names of outputs. An orientation needs all its rows. Empty leaves the end to costs."""
    duration: Positive | Annotated[list[Positive], Field(min_length=2, max_length=2)]
    """Duration [s], or its shortest and longest value for a free duration."""
    time_weight: Annotated[float, Field(ge=0)] = 0.0
    """Cost of a free duration [1/s]."""
    form: Literal["kinematic", "acceleration", "dynamic"] = "acceleration"
    """Inputs: reduced velocities, their rates, or the actuators' inputs."""
    costs: CostSettings = CostSettings()
    """Costs."""
    bounds: BoundSettings = BoundSettings()
    """Hard bounds. They replace limits of the robot's file for the same rows; [null, null] leaves a row without any."""
    limits: PlanLimits | None = PlanLimits()
    """Limits of the robot's file; null for none."""
    clearance: Annotated[float, Field(ge=0)] | None = 0.05
    """Distance from the obstacles of the scenario during the whole motion [m]; null to ignore them."""
    links: bool = False
    """True for that distance between links of the robot too."""
    nodes: Annotated[int, Field(ge=2, le=1000)] = 40
    """Number of intervals with constant inputs."""
    iterations: Annotated[int, Field(ge=1, le=10000)] = 100
    """Largest number of iterations of each guess."""
    refinements: Annotated[int, Field(ge=0, le=4)] = 2
    """Largest number of times that the intervals are halved, because a fine integration of the plan violates the goal
    or a bound."""
    accuracy: Positive = 0.005
    """Largest violation that the verification of a plan accepts [m or rad]. It integrates the plan with a fine step,
    with the feedback of the run. If no plan is accepted, the scenario is refused."""
    guess: GuessSettings | None = None
    """First guess; the straight line by default."""
    seeds: Annotated[int, Field(ge=0, le=1000)] = 6
    """Number of random guesses that are tried if others do not lead to a plan."""
    solutions: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of plans of which the cheapest is taken."""
    at_rest: bool = True
    """True if the motion ends at rest."""
