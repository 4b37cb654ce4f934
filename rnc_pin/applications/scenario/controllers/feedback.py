"""Feedback about an equilibrium, along a plan, or to a goal at rest, with the goals and bounds of optimal control."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, cast

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from rnc_pin.analysis import check_sampling, equilibrium, linearize, lqr
from rnc_pin.applications.scenario.controllers.base import ControllerSettings
from rnc_pin.applications.scenario.controllers.context import (
    MIN_SINGULAR_VALUE,
    BuiltController,
    ControllerContext,
    reduced_velocity,
    refuse_or_warn,
)
from rnc_pin.applications.scenario.schema.derived import part
from rnc_pin.applications.scenario.schema.kinds import OutputItem
from rnc_pin.applications.scenario.schema.motions import LimitItem, Limits, MotionProblem, WeightSetting
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.control import ActuatorVelocityController, Controller, KinematicController, StateFeedback
from rnc_pin.errors import ConfigurationError, RncError, nearest
from rnc_pin.io import Numbers, wrong
from rnc_pin.model import OutputKind, Positive, ReducedModel
from rnc_pin.motion import optimal
from rnc_pin.motion.planning import Joined, OutputTarget, Reference, WaySettings, find_way
from rnc_pin.simulation import obstacles_passed

WAY_SEARCH = WaySettings(seconds=150.0, motions=20_000)
"""Search of a way: the motions end it on a usual computer, a busy one has time."""

_ACCURACY = optimal.SolverSettings().accuracy  # of a predicted motion [m]
_FURTHER = 100  # motions that are checked for a faster way to follow


def goal_of(
    given: Mapping[str, float], outputs: Sequence[OutputKind], reduced: ReducedModel
) -> dict[OutputTarget, ArrayLike]:
    """Goal by output: rows of one output together, so that orientations are whole.

    Args:
        given: goal by names of rows.
        outputs: outputs of the scenario.
        reduced: the model.

    Raises:
        ConfigurationError: a name is unknown.
    """
    names = (*reduced.reducing.names, *reduced.vertical.names)
    check_output_names("goal", given, names)
    goal: dict[OutputTarget, ArrayLike] = {}
    rest, rows = dict(given), iter(names)
    for output in outputs:
        own = [next(rows) for _ in output.bind(reduced.robot).names]
        if len(own) > 1 and all(name in rest for name in own):
            goal[output] = [rest.pop(name) for name in own]
    return goal | rest


def bounds_of(
    settings: MotionProblem, reduced: ReducedModel, obstacles: Sequence[Obstacle], q0: np.ndarray, accuracy: float
) -> Iterator[optimal.BoundKind]:
    """Hard bounds of the settings.

    Args:
        settings: settings with bounds and a clearance.
        reduced: the model.
        obstacles: bodies in the world.
        q0: configuration (nq,) at the start of the run.
        accuracy: accuracy of motions, by which links stay apart unless they are nearer at the start [m].

    Raises:
        ConfigurationError: a name is unknown.
    """
    bounds = settings.bounds
    if bounds.input:
        yield optimal.InputBound(*_limits(bounds.input))
    if bounds.velocity:
        yield optimal.VelocityBound(*_limits(bounds.velocity))
    if bounds.output:
        check_output_names("bounds.output", bounds.output, (*reduced.reducing.names, *reduced.vertical.names))
        yield optimal.OutputBound(list(bounds.output), *_limits(bounds.output))
    if settings.clearance is not None and obstacles:
        beside = CollisionDistances(reduced.robot, obstacles, PairSelection(links=False))
        if beside.pairs:
            yield optimal.DistanceBound(beside, settings.clearance)
    geometry = reduced.robot.collision_model if settings.links else None
    if geometry is not None and len(geometry.geometryObjects):
        own = CollisionDistances(reduced.robot, q0=q0)
        if own.pairs:
            yield optimal.DistanceBound(own, float(own.at(q0, within=accuracy).distance.min(initial=accuracy)))


def check_output_names(key: str, given: Iterable[str], names: Sequence[str]) -> None:
    """Refuse names of outputs that a model does not have.

    Args:
        key: key of the file.
        given: names in the file.
        names: names of the model.

    Raises:
        ConfigurationError: a name is unknown.
    """
    for name in given:
        if name not in names:
            raise ConfigurationError(f"{key}: no output '{name}'{nearest(name, names)}")


def near_singular(what: str, reduced: ReducedModel, q: np.ndarray) -> tuple[str, ...]:
    """Complaint about configurations (n, nq) if one of them is nearly singular."""
    smallest = float(np.min(reduced.at(q).smallest_singular_value))
    said = f"{what} is near a singular configuration: smallest singular value {smallest:.2g}"
    return (f"{said}, limit {MIN_SINGULAR_VALUE:g}",) if smallest < MIN_SINGULAR_VALUE else ()


def _limits(given: Mapping[str, Limits]) -> tuple[dict[str, float], dict[str, float]]:
    """Lower and upper limits by name; null is no limit, not that of the robot's file."""
    lower = {name: -np.inf if low is None else float(low) for name, (low, _) in given.items()}
    return lower, {name: np.inf if high is None else float(high) for name, (_, high) in given.items()}


_Weights = float | Numbers | dict[str, float]


_STATES = Field(description="Weights of states: one number, one for each, or by name. Names of rates end in ``_dot``.")
_INPUTS = Field(description="Weights of the actuators' inputs: one number, one for each, or a mapping by name.")
_HELD = Field(description="Joints whose equilibrium position is their initial position.")
_EQUILIBRIUM = part(equilibrium, "hold", "cyclic", forms={"hold": Annotated[list[str], _HELD]})
_LINEAR = part(linearize, "coordinates", "rates", forms={"coordinates": list[str | OutputItem] | None})
_COSTS = {"state_cost": Annotated[_Weights, _STATES], "input_cost": Annotated[_Weights, _INPUTS]}
_REGULATOR = part(lqr, *_COSTS, forms=_COSTS)


class StateFeedbackSettings(ControllerSettings, _EQUILIBRIUM.model, _LINEAR.model, _REGULATOR.model):  # type: ignore[name-defined, misc]
    """Linear-quadratic regulator about the equilibrium or steady motion nearest to the initial configuration."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant"})

    type: Literal["state_feedback"]
    """Linear-quadratic regulator, for systems with fewer actuators than velocities. It uses the model."""
    v2: dict[str, float] | None = None
    """Rates of reducing outputs in the steady motion, by name; the initial rates by default."""

    def _build(self, context: ControllerContext) -> BuiltController:
        reduced = context.reduced
        v2 = context.v2_0 if self.v2 is None else reduced_velocity(reduced, self.v2, "controller.v2")
        with RncError.at("controller"):
            found = _EQUILIBRIUM.build(self, reduced=reduced, guess=context.q0, v2=v2)
            linear = _LINEAR.build(self, reduced=reduced, q=found.q, v2=v2, T=found.T, cyclic=self.cyclic)
            K = _REGULATOR.build(self, linear=linear)
            check_sampling(linear, K, context.simulation.dt)
        parts: list[Reference] = [getattr(context, which) for which in context.given]
        names = [name for which in context.given for name in getattr(context.task, f"{which}_names")]
        reference = Joined(parts) if parts else None
        near = near_singular("start", reduced, np.stack([context.q0, found.q]))
        complaints = refuse_or_warn(context.preflight, near)
        return BuiltController(StateFeedback(linear, K, reference, names), complaints)


REGULATOR = *_COSTS, "frequency"
_TVLQR = part(optimal.tvlqr, *REGULATOR, forms=dict.fromkeys(_COSTS, _Weights | None))
_FEEDBACK = part(optimal.PlanFeedback, "bandwidth")


class PlanFeedbackSettings(ControllerSettings, _TVLQR.model, _FEEDBACK.model):  # type: ignore[name-defined, misc]
    """Feedback along the plan of ``planner``: its own gains, or those of a time-varying linear-quadratic regulator."""

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = ", which follows the plan of 'planner'"

    type: Literal["plan_feedback"]
    """Planned inputs with feedback. It uses the model."""
    gains: Literal["tvlqr", "plan"] = "tvlqr"
    """Gains: "tvlqr", a regulator with a ``frequency`` or costs; or "plan", those of the costs of the plan."""

    def _build(self, context: ControllerContext) -> BuiltController:
        reduced, plan = context.reduced, context.plan
        if plan is None:
            raise ConfigurationError("controller.type: 'plan_feedback' requires a plan: set 'planner'")
        with ConfigurationError.at("controller"):
            controller = _FEEDBACK.build(self, reduced=reduced, plan=plan)
            if self.gains != "plan":
                found = _TVLQR.build(self, reduced=reduced, plan=plan)
                controller = _FEEDBACK.build(self, reduced=reduced, plan=plan, K=found.K, weights=found.weights)
        passed = obstacles_passed(reduced.robot, plan.time, plan.q, context.obstacles)
        complaints = (
            *near_singular("the plan", reduced, plan.q),
            *(f"the plan passes through obstacle '{each.names[1]}': {each}" for each in passed),
        )
        return BuiltController(controller, refuse_or_warn(context.preflight, complaints))

    @model_validator(mode="after")
    def _weights_belong_to_tvlqr(self) -> PlanFeedbackSettings:
        for name in REGULATOR:
            if self.gains == "plan" and name in self.model_fields_set:
                raise wrong(name, "belongs to gains 'tvlqr'")
        return self


_FORM = {"form": Literal["acceleration", "dynamic"]}
_PLANS = "form", "nodes", "seeds", "tolerance", "tube", "check", "state_cost", "braking", "velocities"
_POINT = part(optimal.SetPointController, *_PLANS, forms=_FORM)
_WAY = part(find_way, "clearance", "seed", defaults={"clearance": 0.05})
_FOLLOWING = part(optimal.WayFollower, *optimal.WayFollower.described)
_PREDICTIVE = part(optimal.PredictiveController, "horizon", "form", "nodes", forms=_FORM)
_COST = part(
    optimal.SetPointCost,
    "weight",
    "velocity_weight",
    "precision",
    forms=dict.fromkeys(("weight", "velocity_weight"), WeightSetting),
)
_SCHEDULE = part(optimal.UpdateSchedule, "period", "iterations", "delay", "budget")


class _ToGoal(ControllerSettings):
    """Controller to a goal at rest, by forces or by velocities."""

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = ", which drives to its own goal"

    def _build(self, context: ControllerContext) -> BuiltController:
        with ConfigurationError.at("controller"):
            made = self._controller(context)
            if getattr(self, "velocities", False):
                servos = ActuatorVelocityController(context.reduced, cast(KinematicController, made))
                return BuiltController(servos, ())
        return BuiltController(cast(Controller, made), ())

    @abstractmethod
    def _controller(
        self, context: ControllerContext
    ) -> optimal.SetPointController | optimal.PredictiveController | optimal.WayFollower: ...


class _ToSetPoint(_ToGoal, MotionProblem):
    """Goal and bounds of a controller to a set point."""

    goal: Annotated[dict[str, float], Field(min_length=1)]
    """Values at rest by names of outputs, which determine a configuration. An orientation needs all its rows."""


class SetPointSettings(_ToSetPoint, _POINT.model):  # type: ignore[name-defined, misc]
    """Plans to a goal at rest with feedback: one at the start, and another where the feedback would miss the goal."""

    type: Literal["set_point"]
    """Plans to a goal at rest, and follows them with feedback. It uses the model."""
    duration: Positive | Annotated[list[Positive], Field(min_length=2, max_length=2)]
    """Duration of a plan [s], or its shortest and longest value."""
    limits: LimitItem | None = Field({}, validate_default=True)
    """Limits of the robot's file that plans keep; null for none."""

    def _controller(self, context: ControllerContext) -> optimal.SetPointController:
        duration = tuple(self.duration) if isinstance(self.duration, list) else self.duration
        return _POINT.build(
            self,
            reduced=context.reduced,
            goal=goal_of(self.goal, context.outputs, context.reduced),
            duration=duration,
            bounds=list(bounds_of(self, context.reduced, context.obstacles, context.q0, self.tolerance)),
            limits=self.limits,
        )


class PredictiveSettings(_ToSetPoint, _PREDICTIVE.model, _COST.model, _SCHEDULE.model):  # type: ignore[name-defined, misc]
    """Model-predictive control to a goal at rest, with the cost of its set point."""

    type: Literal["predictive"]
    """Model-predictive control to a goal at rest. It uses the model."""
    effort: WeightSetting = 0.01
    """Weight of the inputs of the form: one number, one for each, or a mapping by name."""
    equality: bool = False
    """True if the goal holds at the end of the horizon too, which has to be long enough to reach it."""

    def _controller(self, context: ControllerContext) -> optimal.PredictiveController:
        goal = goal_of(self.goal, context.outputs, context.reduced)
        return _PREDICTIVE.build(
            self,
            reduced=context.reduced,
            costs=[_COST.build(self, goal=goal), optimal.EffortCost(self.effort)],
            bounds=list(bounds_of(self, context.reduced, context.obstacles, context.q0, _ACCURACY)),
            updates=_SCHEDULE.build(self),
            goal=goal if self.equality else None,
        )


class WayFollowerSettings(_ToGoal, _WAY.model, _FOLLOWING.model):  # type: ignore[name-defined, misc]
    """A way to a goal at rest around the obstacles, found before the run and followed."""

    velocities: ClassVar[bool] = True

    type: Literal["way"]
    """A way to a goal around obstacles that stand, and a controller that follows it. It commands velocities."""
    goal: Annotated[dict[str, float], Field(min_length=1)]
    """Values at rest by names of outputs. An orientation needs all its rows."""
    links: bool = True
    """True to check links of the robot against each other too."""

    def _controller(self, context: ControllerContext) -> optimal.WayFollower:
        goal = goal_of(self.goal, context.outputs, context.reduced)
        way = _WAY.build(
            self,
            reduced=context.reduced,
            q0=context.q0,
            goal=goal,
            obstacles=context.obstacles,
            selection=PairSelection(links=self.links),
            settings=replace(WAY_SEARCH, improve=_FURTHER),
        )
        return _FOLLOWING.build(self, reduced=context.reduced, way=way)


FeedbackTypes = (
    StateFeedbackSettings | PlanFeedbackSettings | SetPointSettings | PredictiveSettings | WayFollowerSettings
)
