"""Optimal planner in a scenario file."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from rnc_pin.applications.scenario.schema.base import Numbers, Positive, Strict
from rnc_pin.applications.scenario.schema.derived import Entry
from rnc_pin.applications.scenario.schema.reference_settings import ReferenceItem, VehiclePath
from rnc_pin.model import NotNegative, ReducedModel
from rnc_pin.optimal import FileLimits, MotionPlan, OutputCost, SolverSettings, plan

WeightSetting = float | Numbers | dict[str, float]
"""One number, one for each row, or a mapping by name (zero for the others)."""
Limits = Annotated[list[float | None], Field(min_length=2, max_length=2)]
"""Smallest and largest value; null for no limit."""


OutputCostItem = Annotated[
    OutputCost,
    Entry(
        OutputCost,
        keys={"output": "outputs"},
        forms={
            "output": Annotated[list[str], Field(min_length=1, description="Names of outputs that have a value.")],
            "target": Annotated[Numbers, Field(description="Target; one number for each output.")],
            "weight": WeightSetting,
        },
    ),
]


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
    outputs: list[OutputCostItem] = []
    """Costs of outputs."""


class BoundSettings(Strict):
    """Hard bounds, by name: [smallest, largest], with null for no limit."""

    input: dict[str, Limits] = {}
    """Inputs of the form. Those of the form "acceleration" end in ``_dot``."""
    velocity: dict[str, Limits] = {}
    """Rates of reducing outputs."""
    output: dict[str, Limits] = {}
    """Outputs that have a value, such as joint angles."""
    normal_force: NotNegative | None = None
    """Smallest normal force of every contact with the ground [N]; null for none."""
    grip: Positive | None = None
    """Coefficient of friction of the ground: the contact forces stay in their cones; null for none."""


_Kept = Annotated[Literal["file"] | None, AfterValidator(lambda said: said is not None)]
_KINDS = [each.name for each in fields(FileLimits)]
LimitItem = Annotated[
    FileLimits, Entry(FileLimits, forms=dict.fromkeys(_KINDS, _Kept), defaults=dict.fromkeys(_KINDS, "file"))
]
"""Limits of the robot's file that a plan keeps; null removes a kind."""


class GuessSettings(Strict):
    """First guess of the motion: configurations to pass, a vehicle's path, or a motion of the reducing outputs."""

    through: list[dict[str, float | list[float]]] | None = None
    """Configurations between start and goal at equal times, each with joints to positions; other joints keep their
    initial position."""
    path: VehiclePath | None = None
    """Path of a steered vehicle."""
    reducing: ReferenceItem | None = None
    """Motion of all reducing outputs from their initial values; the constraints give the rest."""

    @model_validator(mode="after")
    def _one_guess(self) -> GuessSettings:
        if sum(each is not None for each in (self.through, self.path, self.reducing)) != 1:
            raise ValueError("expected one of 'through', 'path' and 'reducing'")
        return self


class MotionProblem(Strict):
    """Goal and bounds of an optimal motion."""

    goal: dict[str, float] = {}
    """Values at the end by names of outputs. An orientation needs all its rows. Empty leaves the end to costs."""
    bounds: BoundSettings = BoundSettings()
    """Hard bounds. They replace limits of the robot's file for the same rows; [null, null] leaves a row without any."""
    clearance: Annotated[float, Field(ge=0)] | None = 0.05
    """Distance from the obstacles of the scenario during the whole motion [m]; null to ignore them."""
    links: bool = False
    """True for that distance between links of the robot too."""


_SOLVER = Entry(SolverSettings, late=("tolerance", "cost_tolerance", "penalty", "substeps"))
_LATE = (
    "reduced",
    "q0",
    "goal",
    "duration",
    "costs",
    "bounds",
    "limits",
    "settings",
    "guess",
    "seed",
    "v2_0",
    "feedback",
    "progress",
)
_PLAN = Entry(plan, late=_LATE)


class OptimalPlanner(MotionProblem, _PLAN.model, _SOLVER.model):  # type: ignore[name-defined, misc]
    """Optimal motion, planned before the run. It gives the references of the task that the file does not give, and the
    plan of a controller of type "plan_feedback".
    """

    type: Literal["optimal", "global"]
    """Optimal control with exact derivatives; "global" first searches a way around the obstacles, its guess."""
    duration: Positive | Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None
    """Duration [s], or its shortest and longest value for a free duration. By default 1.5 times that of the way; type
    "optimal" needs one."""
    costs: CostSettings = CostSettings()
    """Costs."""
    limits: LimitItem | None = Field({}, validate_default=True)
    """Limits of the robot's file; null for none."""
    guess: GuessSettings | None = None
    """First guess; the straight line by default."""

    @model_validator(mode="after")
    def _guess_of_type(self) -> OptimalPlanner:
        if self.type == "global" and self.guess is not None:
            raise ValueError("type 'global' searches the guess: remove 'guess', or use type 'optimal'")
        if self.type == "global" and not self.goal:
            raise ValueError("type 'global' needs a goal")
        if self.type == "optimal" and self.duration is None:
            raise ValueError("type 'optimal' needs a duration")
        return self

    def build(self, reduced: ReducedModel, **others: object) -> MotionPlan:
        """Plan a motion; the arguments are those of ``plan`` that the file does not give."""
        return _PLAN.build(self, reduced=reduced, limits=self.limits, settings=_SOLVER.build(self), **others)
