"""References and the optimal planner in a scenario file."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from rnc_pin.applications.scenario.schema.derived import ClassReader, checked, one_of
from rnc_pin.io import Numbers, Strict
from rnc_pin.model import NotNegative, Positive
from rnc_pin.motion.optimal import FileLimits, OutputCost, SolverSettings
from rnc_pin.motion.planning import RELATIVE_REFERENCES, RelativeReference, RelativeTable

_REFERENCES = {**RELATIVE_REFERENCES, "csv": ClassReader(RelativeTable, short="file")}
ReferenceItem = Annotated[RelativeReference, one_of(**_REFERENCES)]


Pose = Annotated[list[float], Field(min_length=3, max_length=3)]


class TrailerSettings(Strict):
    """Heading of a trailer whose axle is on the tractor's driven path, one chord L behind the kingpin.

    Attributes:
        frame: frame in the middle of the trailer's axle.
        kingpin: frame at the kingpin, on either body; the tractor frame by default. The position of another frame has
            to be a vertical output too.
    """

    frame: str
    kingpin: str | None = None


class VehiclePath(Strict):
    """Path of a steered vehicle, whose reducing outputs are forward speed and steering angle.

    Attributes:
        to: goal pose: x, y [m] and heading [rad].
        wheelbase: distance between rear and front axle [m].
        via: intermediate poses where the vehicle stops, in this order.
        max_steering: largest steering angle of an equivalent front wheel in the middle [rad]. With the wheelbase it
            gives the smallest turning radius.
        frame: frame at the middle of the rear axle, with x forward.
    """

    to: Pose
    wheelbase: Positive
    via: list[Pose] = []
    max_steering: Annotated[float, Field(gt=0, lt=math.pi / 2)] = math.pi / 4
    frame: str


class PathSettings(VehiclePath):
    """Path of a steered vehicle from its initial pose to a goal pose. It gives the primary reference and, with a
    trailer, the vertical one. The constraints give the steering angle for each curvature, for any steering geometry.

    Attributes:
        duration: duration of the motion [s].
        forward_only: True to exclude reverse motion. The default is true with a trailer, which cannot follow in
            reverse.
        trailer: trailer whose axle follows the path of the vehicle.
    """

    duration: Positive
    forward_only: bool | None = None
    trailer: TrailerSettings | None = None

    @model_validator(mode="after")
    def _no_pushing(self) -> PathSettings:
        if self.trailer is not None and self.forward_only is False:
            raise ValueError("a trailer cannot follow in reverse: remove 'forward_only: false' or 'trailer'")
        return self


class References(Strict):
    """Reference trajectories of the task's outputs. Outputs without a reference keep their initial value.

    Attributes:
        path: planned path of a vehicle. It replaces ``primary`` (travelled distance, steering angle) and, with a
            trailer, ``vertical`` (heading of the trailer).
        primary: reference of the primary outputs.
        redundant: reference of the redundant outputs.
        vertical: reference of the vertical outputs.
    """

    path: PathSettings | None = None

    primary: ReferenceItem | None = None
    redundant: ReferenceItem | None = None
    vertical: ReferenceItem | None = None


WeightSetting = float | Numbers | dict[str, float]
"""One number, one for each row, or a mapping by name (zero for the others)."""


def _ordered(ends: list[float | None]) -> list[float | None]:
    # Equal ends are allowed: they fix a value.
    if ends[0] is not None and ends[1] is not None and ends[0] > ends[1]:
        raise ValueError(f"smallest value {ends[0]:g} is above largest value {ends[1]:g}")
    return ends


Limits = Annotated[list[float | None], Field(min_length=2, max_length=2), AfterValidator(_ordered)]
"""Smallest and largest value; null for no limit."""


class OutputCostSettings(Strict):
    """Squared distance of outputs from a target.

    Attributes:
        outputs: names of outputs that have a value.
        target: target; one number for each output.
        weight: weight of each row [1/(unit^2 s) over time, 1/unit^2 at the end].
        phase: "running" for over the motion, "terminal" for at its end, or "both".
    """

    outputs: Annotated[list[str], Field(min_length=1)]
    target: Numbers
    weight: WeightSetting = 1.0
    phase: Literal["running", "terminal", "both"] = "running"

    @model_validator(mode="after")
    def _fits(self) -> OutputCostSettings:
        checked(self.build)  # the class has the rules; here their errors get a place in the file
        return self

    def build(self) -> OutputCost:
        return OutputCost(self.outputs, self.target, self.weight, self.phase)


class CostSettings(Strict):
    """Costs of a motion: weighted squares, integrated over time.

    Attributes:
        effort: weight of the inputs of the form: one number, one for each, or a mapping by name.
        velocity: weight of the reduced velocities.
        acceleration: weight of the reduced accelerations, in the forms "acceleration" and "dynamic".
        posture: weights of the distance from the initial configuration, by names of entries of v.
        outputs: costs of outputs.
    """

    effort: WeightSetting | None = 1.0
    velocity: WeightSetting | None = None
    acceleration: WeightSetting | None = None
    posture: dict[str, float] | None = None
    outputs: list[OutputCostSettings] = []


class BoundSettings(Strict):
    """Hard bounds, by name: [smallest, largest], with null for no limit.

    Attributes:
        input: inputs of the form. Those of the form "acceleration" end in ``_dot``.
        velocity: rates of reducing outputs.
        output: outputs that have a value, such as joint angles.
    """

    input: dict[str, Limits] = {}
    velocity: dict[str, Limits] = {}
    output: dict[str, Limits] = {}


class FileLimitSettings(Strict):
    """Limits of the robot's file that a plan keeps. A bound that is stated for the same row replaces one.

    Attributes:
        position: keep the position limits of joints; continuous joints and bases have none.
        velocity: keep the velocity limits of joints.
        effort: keep the effort limits of actuators; a force on a frame has its ``limit``.
    """

    position: Literal["file"] | None = "file"
    velocity: Literal["file"] | None = "file"
    effort: Literal["file"] | None = "file"

    def build(self) -> FileLimits:
        return FileLimits(self.position is not None, self.velocity is not None, self.effort is not None)


class GuessSettings(Strict):
    """First guess of the motion: configurations to pass, a vehicle's path, or a motion of the reducing outputs.

    Attributes:
        through: configurations between start and goal at equal times, each with joints to positions; other joints keep
            their initial position.
        path: path of a steered vehicle.
        reducing: motion of all reducing outputs from their initial values; the constraints give the rest.
    """

    through: list[dict[str, float | list[float]]] | None = None
    path: VehiclePath | None = None
    reducing: ReferenceItem | None = None

    @model_validator(mode="after")
    def _one_guess(self) -> GuessSettings:
        # Each gives all configurations of the motion, so that two would contradict each other.
        if sum(each is not None for each in (self.through, self.path, self.reducing)) != 1:
            raise ValueError("expected one of 'through', 'path' and 'reducing'")
        return self


class MotionProblem(Strict):
    """Goal and bounds of an optimal motion.

    Attributes:
        goal: values at the end by names of outputs. An orientation needs all its rows. Empty leaves the end to costs.
        bounds: hard bounds. They replace limits of the robot's file for the same rows; [null, null] leaves a row
            without any.
        clearance: distance from the obstacles of the scenario during the whole motion [m]; null to ignore them.
        links: True to keep links of the robot from each other too, as the verdict of a run checks them.
    """

    goal: dict[str, float] = {}
    bounds: BoundSettings = BoundSettings()
    clearance: Annotated[float, Field(ge=0)] | None = 0.05
    links: bool = True


class OptimalPlanner(MotionProblem):
    """Optimal motion, planned before the run. It gives the references of the task that the file does not give, and the
    plan of a controller of type "plan_feedback".

    Attributes:
        type: optimal control with exact derivatives; "global" first searches a way around the obstacles, its guess.
        duration: duration [s], or its shortest and longest value for a free duration. By default 1.5 times that of the
            way; type "optimal" needs one.
        costs: costs.
        limits: limits of the robot's file; null for none.
        guess: first guess; the straight line by default.
        form: "kinematic" (input v2), "acceleration" (input v2_dot) or "dynamic" (input T).
        nodes: number of intervals with constant inputs.
        iterations: largest number of iterations from each guess. Refinements of its solution together take at most
            twice as many, where an iteration over halved intervals counts twice.
        refinements: how often the planner may halve the intervals and solve again from the plan so far, because the
            verification finds a violation above ``accuracy``.
        accuracy: largest violation of bounds and goal that the verification of a plan accepts [their units]. Distances
            from obstacles are planned as much larger, so that the plan keeps its clearance.
        reserve: share of bounded ranges of outputs and of bounded velocities that a plan keeps free at its nodes,
            whatever states the bound: feedback needs it in the run. It ends where the start or the goal is.
        seeds: number of further guesses that are tried if others do not lead to a plan. The first ones pass both sides
            of obstacles in the way of a mobile base. Shortest paths of a car in turn with random motions follow, for
            other systems loops of the shape where the rows couple the rest to it, then random motions.
        solutions: number of solutions among which the cheapest is returned. If fewer guesses lead to some, a warning
            and ``info.solutions`` tell. By default those of the first five guesses if the rows do not allow the
            straight line, no distances or contact forces are bounded and no guess is given; else one.
        at_rest: True if the motion ends at rest.
        time_weight: cost of a free duration [1/s].
    """

    type: Literal["optimal", "global"]
    duration: Positive | Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None
    costs: CostSettings = CostSettings()
    limits: FileLimitSettings | None = Field({}, validate_default=True)
    guess: GuessSettings | None = None
    form: Literal["kinematic", "acceleration", "dynamic"] = "acceleration"
    nodes: Annotated[int, Field(ge=2, le=1000)] = 40
    iterations: Annotated[int, Field(ge=1, le=10000)] = 100
    refinements: Annotated[int, Field(ge=0, le=4)] = 2
    accuracy: Positive = 0.005
    reserve: Annotated[float, Field(ge=0, lt=0.5)] = 0.005
    seeds: Annotated[int, Field(ge=0, le=1000)] = 6
    solutions: Annotated[int, Field(ge=1, le=1000)] | None = None
    at_rest: bool = True
    time_weight: NotNegative = 0.0

    @model_validator(mode="after")
    def _guess_of_type(self) -> OptimalPlanner:
        if self.type == "global" and self.guess is not None:
            raise ValueError("type 'global' searches the guess: remove 'guess', or use type 'optimal'")
        if self.type == "global" and not self.goal:
            raise ValueError("type 'global' needs a goal")
        # A way has a duration of its own, from which the usual one follows; a straight line has none.
        if self.type == "optimal" and self.duration is None:
            raise ValueError("type 'optimal' needs a duration")
        return self

    @property
    def solver(self) -> SolverSettings:
        """Settings of the solver."""
        return SolverSettings(**self.values_of("nodes", "iterations", "refinements", "accuracy", "reserve"))
