"""References and the optimal planner in a scenario file."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from rnc_pin.applications.scenario.schema.derived import Entry, PartialCall, one_of, part
from rnc_pin.control import SlitheringReference
from rnc_pin.io import Numbers, Strict
from rnc_pin.model import Positive, ReducedModel
from rnc_pin.motion.optimal import FileLimits, MotionPlan, OutputCost, SolverSettings, plan
from rnc_pin.motion.planning import RELATIVE_REFERENCES, CarPath, RelativeReference, RelativeTable, SteeringGeometry

_REFERENCES = {**RELATIVE_REFERENCES, "csv": Entry(RelativeTable, short="file")}
ReferenceItem = Annotated[RelativeReference, one_of(**_REFERENCES)]
HOLD: dict[str, object] = {"hold": {}}
"""Reference that keeps the initial value, in the form of a file."""


Pose = Annotated[list[float], Field(min_length=3, max_length=3)]
GoalPose = Annotated[Pose, Field(description="Goal pose: x, y [m] and heading [rad].")]
_GIVEN = "goal", "wheelbase", "via", "max_steering"
_PATH = part(CarPath, *_GIVEN, keys={"goal": "to"}, forms={"goal": GoalPose, "via": list[Pose]})
TrailerItem = Annotated[
    PartialCall[SlitheringReference],
    Entry(SlitheringReference, late=("reduced", "task", "tractor", "spacing", "window"), keys={"axle": "frame"}),
]


class VehiclePath(_PATH.model):  # type: ignore[name-defined, misc]
    """Path of a steered vehicle, whose reducing outputs are forward speed and steering angle."""

    frame: str
    """Frame at the middle of the rear axle, with x forward."""

    def path(
        self,
        reduced: ReducedModel,
        q0: np.ndarray,
        start: np.ndarray,
        duration: float,
        *,
        speed: int = 0,
        steering: int = 1,
        forward_only: bool = False,
    ) -> CarPath:
        """Path from a pose (3,) of the frame at a configuration (nq,).

        Args:
            reduced, q0, start: the model, its configuration, and the pose of the frame there.
            duration: duration of the motion [s].
            speed, steering: indices of these reducing outputs.
            forward_only: True to exclude reverse motion.
        """
        largest = float(np.tan(self.max_steering) / self.wheelbase)
        geometry = SteeringGeometry(reduced, q0, self.frame, speed=speed, steering=steering, largest=largest)
        return _PATH.build(self, start=start, duration=duration, forward_only=forward_only, geometry=geometry)


class PathSettings(VehiclePath):
    """Path of a steered vehicle from its initial pose to a goal pose. It gives the primary reference and, with a
    trailer, the vertical one. The constraints give the steering angle for each curvature, for any steering geometry.
    """

    duration: Positive
    """Duration of the motion [s]."""
    forward_only: bool | None = None
    """True to exclude reverse motion. The default is true with a trailer, which cannot follow in reverse."""
    trailer: TrailerItem | None = None
    """Trailer whose axle follows the path of the vehicle."""

    @model_validator(mode="after")
    def _no_pushing(self) -> PathSettings:
        if self.trailer is not None and self.forward_only is False:
            raise ValueError("a trailer cannot follow in reverse: remove 'forward_only: false' or 'trailer'")
        return self


class References(Strict):
    """Reference trajectories of the task's outputs. Outputs without a reference keep their initial value."""

    path: PathSettings | None = None
    """Planned path of a vehicle. It replaces ``primary`` (travelled distance, steering angle) and, with a trailer,
    ``vertical`` (heading of the trailer)."""

    primary: ReferenceItem | None = None
    """Reference of the primary outputs."""
    redundant: ReferenceItem | None = None
    """Reference of the redundant outputs."""
    vertical: ReferenceItem | None = None
    """Reference of the vertical outputs."""


WeightSetting = float | Numbers | dict[str, float]
"""One number, one for each row, or a mapping by name (zero for the others)."""


def _ordered(ends: list[float | None]) -> list[float | None]:
    if ends[0] is not None and ends[1] is not None and ends[0] > ends[1]:
        raise ValueError(f"smallest value {ends[0]:g} is above largest value {ends[1]:g}")
    return ends


Limits = Annotated[list[float | None], Field(min_length=2, max_length=2), AfterValidator(_ordered)]
"""Smallest and largest value; null for no limit."""


_NAMES = Field(min_length=1, description="Names of outputs that have a value.")
_TARGET = Annotated[Numbers, Field(description="Target; one number for each output.")]
_FORMS = {"output": Annotated[list[str], _NAMES], "target": _TARGET, "weight": WeightSetting}
OutputCostItem = Annotated[OutputCost, Entry(OutputCost, keys={"output": "outputs"}, forms=_FORMS)]


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


_Kept = Annotated[Literal["file"] | None, AfterValidator(lambda said: said is not None)]
_KINDS = [each.name for each in fields(FileLimits) if isinstance(each.default, bool)]
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
    links: bool = True
    """True to keep links of the robot from each other too, as the verdict of a run checks them."""


_SOLVER = part(SolverSettings, "nodes", "iterations", "refinements", "accuracy", "reserve")
_PLAN = part(plan, "form", "seeds", "solutions", "at_rest", "time_weight")


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
