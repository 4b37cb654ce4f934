"""Feedback about an equilibrium, along a plan, or to a goal at rest, with the goals and bounds of optimal control."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Annotated, ClassVar, Literal, cast

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from rnc_pin.analysis import check_sampling, equilibrium, linearize, lqr
from rnc_pin.applications.scenario.controllers.base import (
    MIN_SINGULAR_VALUE,
    BuiltController,
    ControllerContext,
    ControllerSettings,
    reduced_velocity,
)
from rnc_pin.applications.scenario.schema.kinds import OutputItem
from rnc_pin.applications.scenario.schema.motions import FileLimitSettings, Limits, MotionProblem, WeightSetting
from rnc_pin.collision import CollisionDistances, PairSelection
from rnc_pin.control import ActuatorVelocityController, Controller, KinematicController, StateFeedback
from rnc_pin.errors import ConfigurationError, RncError, place_of
from rnc_pin.io import wrong
from rnc_pin.model import NotNegative, Positive, ReducedModel
from rnc_pin.motion import optimal
from rnc_pin.motion.planning import Joined, OutputTarget, WaySettings, find_way

WAY_SEARCH = WaySettings(seconds=150.0, motions=20_000)
"""Search of a way: the motions end it on a usual computer, a busy one has time."""

_ACCURACY = optimal.SolverSettings().accuracy  # of a predicted motion [m]
_FURTHER = 100  # motions that are checked for a faster way to follow


def goal_of(given: Mapping[str, float], context: ControllerContext) -> dict[OutputTarget, ArrayLike]:
    """Goal by output: rows of one output together, so that orientations are whole.

    Args:
        given: goal by names of rows.
        context: the model and the outputs of the scenario.

    Raises:
        ConfigurationError: a name is unknown.
    """
    reduced = context.reduced
    check_output_names("goal", given, reduced)
    goal: dict[OutputTarget, ArrayLike] = {}
    rest, rows = dict(given), iter((*reduced.reducing.names, *reduced.vertical.names))
    # Rows of a rotation are no separate coordinates: three numbers of one output are one goal on SO(3).
    for output in context.scenario.listed_outputs:
        own = [next(rows) for _ in output.bind(reduced.robot).names]
        if len(own) > 1 and all(name in rest for name in own):
            goal[output] = [rest.pop(name) for name in own]
    return goal | rest


def bounds_of(settings: MotionProblem, context: ControllerContext, accuracy: float) -> Iterator[optimal.BoundKind]:
    """Hard bounds of the settings.

    Args:
        settings: settings with bounds and a clearance.
        context: the model, its start and the obstacles.
        accuracy: accuracy of motions, by which links stay apart unless they are nearer at the start [m].

    Raises:
        ConfigurationError: a name is unknown.
    """
    bounds, reduced, q0 = settings.bounds, context.reduced, context.q0
    if bounds.input:
        yield optimal.InputBound(*_limits(bounds.input))
    if bounds.velocity:
        yield optimal.VelocityBound(*_limits(bounds.velocity))
    if bounds.output:
        check_output_names("bounds.output", bounds.output, reduced)
        yield optimal.OutputBound(list(bounds.output), *_limits(bounds.output))
    # Obstacles and links have bounds of their own: clearance is asked for, links only must not come nearer.
    if settings.clearance is not None and context.obstacles:
        beside = CollisionDistances(reduced.robot, context.obstacles, PairSelection(links=False))
        if beside.pairs:
            yield optimal.DistanceBound(beside, settings.clearance)
    if settings.links and reduced.robot.has_collision_shapes:
        own = CollisionDistances(reduced.robot, q0=q0)
        if own.pairs:
            # Links that are nearer at the start than the accuracy, as in a folded arm, may stay so.
            yield optimal.DistanceBound(own, float(own.at(q0, within=accuracy).distance.min(initial=accuracy)))


def check_output_names(key: str, given: Iterable[str], reduced: ReducedModel, others: Iterable[str] = ()) -> None:
    """Refuse names of outputs that a model does not have.

    Args:
        key: key of the file.
        given: names in the file.
        reduced: the model.
        others: further names that are valid.

    Raises:
        ConfigurationError: a name is unknown.
    """
    for name in given:
        place_of(name, (*reduced.reducing.names, *reduced.vertical.names, *others), f"{key}: no output")


def near_singular(what: str, reduced: ReducedModel, q: np.ndarray) -> tuple[str, ...]:
    """Complaint about configurations (n, nq) if one of them is nearly singular.

    Args:
        what: name of the configurations, for the message.
        reduced: the model.
        q: the configurations.
    """
    smallest = float(np.min(reduced.at(q).smallest_singular_value))
    said = f"{what} is near a singular configuration: smallest singular value {smallest:.2g}"
    return (f"{said}, limit {MIN_SINGULAR_VALUE:g}",) if smallest < MIN_SINGULAR_VALUE else ()


def _limits(given: Mapping[str, Limits]) -> tuple[dict[str, float], dict[str, float]]:
    """Lower and upper limits by name; null is no limit, not that of the robot's file."""
    lower = {name: -np.inf if low is None else float(low) for name, (low, _) in given.items()}
    return lower, {name: np.inf if high is None else float(high) for name, (_, high) in given.items()}


class StateFeedbackSettings(ControllerSettings):
    """Linear-quadratic regulator about the equilibrium or steady motion nearest to the initial configuration.

    Attributes:
        type: linear-quadratic regulator, for systems with fewer actuators than velocities. It uses the model.
        v2: rates of reducing outputs in the steady motion, by name; the initial rates by default.
        state_cost: weights of states: one number, one for each, or by name. Names of rates end in ``_dot``.
        input_cost: weights of the actuators' inputs: one number, one for each, or a mapping by name.
        coordinates: configuration part of the state: outputs, or entries of ``v`` by name (``robot.velocity_names``).
            An entry of ``v`` is a small motion of that joint; ``"root_joint[3]"`` is the roll of a free base in its own
            axes. By default all entries of ``v``, as perturbations in a frame that moves along with the motion; of
            those that holonomic rows relate, such as heights of wheels, as many as they leave free.
        rates: names of the reducing outputs whose rates are states; all of them by default.
        hold: joints whose equilibrium position is their initial position.
        cyclic: joints, or entries of v by name, that may move although the dynamics depend on them, such as a slightly
            unbalanced wheel. The motion is then steady at their present position only.
    """

    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant"})

    type: Literal["state_feedback"]
    v2: dict[str, float] | None = None
    state_cost: WeightSetting
    input_cost: WeightSetting = 1.0
    coordinates: list[str | OutputItem] | None = None
    rates: list[str] | None = None
    hold: list[str] = []
    cyclic: list[str] = []

    def _build(self, context: ControllerContext) -> BuiltController:
        reduced = context.reduced
        v2 = context.v2_0 if self.v2 is None else reduced_velocity(reduced, self.v2, "controller.v2")
        with RncError.at("controller"):
            found = equilibrium(reduced, context.q0, self.hold, v2, self.cyclic)
            linear = linearize(reduced, found.q, v2, found.T, self.coordinates, self.rates, self.cyclic)
            K = lqr(linear, self.state_cost, self.input_cost)
            check_sampling(linear, K, context.simulation.dt)
        # References of the task are errors of outputs beside the state; without any, the equilibrium is the goal.
        given = [context.references[role] for role in context.given]
        names = [name for role in context.given for name in context.names[role]]
        reference = Joined(given) if given else None
        # Both: the equilibrium may be far from the start, and the run begins at the start.
        near = near_singular("start", reduced, np.stack([context.q0, found.q]))
        return BuiltController(StateFeedback(linear, K, reference, names), context.refuse_or_warn(near))


class PlanFeedbackSettings(ControllerSettings):
    """Feedback along the plan of ``planner``: its own gains, or those of a time-varying linear-quadratic regulator.

    Attributes:
        type: planned inputs with feedback. It uses the model.
        gains: gains: "tvlqr", a regulator with a ``frequency`` or costs; or "plan", those of the costs of the plan.
        state_cost: weights Q: a number, one for each state, or weights by name: entries of v, and reduced velocities
            with "(rate)" after their names (``plan.info.state_names``). One if only R is given.
        input_cost: weights R in the same forms, positive; one if only Q is given.
        frequency: natural frequency without costs [rad/s].
        bandwidth: decay rate of the velocity error in the kinematic form [1/s].
    """

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = ", which follows the plan of 'planner'"

    type: Literal["plan_feedback"]
    gains: Literal["tvlqr", "plan"] = "tvlqr"
    state_cost: WeightSetting | None = None
    input_cost: WeightSetting | None = None
    frequency: Positive = 10.0
    bandwidth: Positive = 20.0

    def along(self, reduced: ReducedModel, plan: optimal.MotionPlan, joint_damping: bool) -> optimal.PlanFeedback:
        """Feedback along a plan.

        Args:
            reduced: the model.
            plan: the plan.
            joint_damping: True for a plant with joint damping.
        """
        given, K, weights = (self.state_cost, self.input_cost), None, None  # without K, the plan's own gains
        if self.gains != "plan":
            found = optimal.tvlqr(reduced, plan, *given, frequency=self.frequency)
            K, weights = found.K, found.weights
        return optimal.PlanFeedback(reduced, plan, K, self.bandwidth, weights, joint_damping)

    def _build(self, context: ControllerContext) -> BuiltController:
        reduced, plan = context.reduced, context.plan
        if plan is None:
            raise ConfigurationError("controller.type: 'plan_feedback' requires a plan: set 'planner'")
        with ConfigurationError.at("controller"):
            controller = self.along(reduced, plan, context.simulation.joint_damping)
        passed = context.passed_obstacles("the plan", plan.time, plan.q)
        return BuiltController(
            controller, context.refuse_or_warn((*near_singular("the plan", reduced, plan.q), *passed))
        )

    @model_validator(mode="after")
    def _weights_belong_to_tvlqr(self) -> PlanFeedbackSettings:
        for name in ("state_cost", "input_cost", "frequency"):
            if self.gains == "plan" and name in self.model_fields_set:  # stated, not a default
                raise wrong(name, "belongs to gains 'tvlqr'")
        return self


class _ToGoal(ControllerSettings):
    """Controller to a goal at rest, by forces or by velocities."""

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = ", which drives to its own goal"

    def _build(self, context: ControllerContext) -> BuiltController:
        with ConfigurationError.at("controller"):
            return BuiltController(self._controller(context))

    @abstractmethod
    def _controller(self, context: ControllerContext) -> Controller: ...


class _ToSetPoint(_ToGoal, MotionProblem):
    """Goal and bounds of a controller to a set point.

    Attributes:
        goal: values at rest by names of outputs, which determine a configuration. An orientation needs all its rows.
    """

    goal: Annotated[dict[str, float], Field(min_length=1)]


class SetPointSettings(_ToSetPoint):
    """Plans to a goal at rest with feedback: one at the start, and another where the feedback would miss the goal.

    Attributes:
        type: plans to a goal at rest, and follows them with feedback. It uses the model.
        duration: duration of a plan [s], or its shortest and longest value.
        limits: limits of the robot's file that plans keep; null for none.
        form: "kinematic", "acceleration" or "dynamic", as in ``plan``.
        nodes: number of intervals.
        seeds: number of random guesses of each search.
        tolerance: error at rest above which it plans again [m or rad].
        tube: predicted error at the end of a plan from which it plans again [m or rad]. Outputs and distances beyond
            their bounds on the way by more count too.
        check: time between two checks [s].
        braking: decay rate of the velocity while it brakes [1/s]; half of it is that of errors at rest.
        velocities: True for a kinematic controller, whose steps return velocities, for robots that take these: the
            target of an ``ActuatorVelocityController``. The form is "acceleration", so that bounds of inputs limit the
            rates of velocities.
    """

    type: Literal["set_point"]
    duration: Positive | Annotated[list[Positive], Field(min_length=2, max_length=2)]
    limits: FileLimitSettings | None = Field({}, validate_default=True)
    form: Literal["acceleration", "dynamic"] = "dynamic"
    nodes: int = 40
    seeds: int = 6
    tolerance: Positive = 0.005
    tube: Positive = 0.05
    check: Positive = 0.25
    braking: Positive = 4.0
    velocities: bool = False

    @property
    def velocity_command(self) -> str:
        return "velocities: true" if self.velocities else ""

    def _controller(self, context: ControllerContext) -> Controller:
        made = optimal.SetPointController(
            context.reduced,
            goal_of(self.goal, context),
            (self.duration[0], self.duration[1]) if isinstance(self.duration, list) else self.duration,
            bounds=list(bounds_of(self, context, self.tolerance)),
            limits=None if self.limits is None else self.limits.build(),
            **self.values_of("form", "nodes", "seeds", "tolerance", "tube", "check", "braking", "velocities"),
        )
        # Its steps return what ``velocities`` says, which its type does not tell.
        if self.velocities:
            return ActuatorVelocityController(context.reduced, cast(KinematicController, made))
        return cast(Controller, made)


class PredictiveSettings(_ToSetPoint):
    """Model-predictive control to a goal at rest, with the cost of its set point.

    Attributes:
        type: model-predictive control to a goal at rest. It uses the model.
        effort: weight of the inputs of the form: one number, one for each, or a mapping by name.
        equality: True if the goal holds at the end of the horizon too, which has to be long enough to reach it.
        horizon: duration of the motion [s].
        form: "acceleration" or "dynamic".
        nodes: number of intervals.
        weight: weight of each coordinate; by name of ``rnc.analysis.privileged_coordinates``.
        velocity_weight: weight of squared reduced velocities, in the forms that have them as state.
        precision: homogeneous norm below which the residuals are smooth [m or rad].
        period: time between updates [s].
        iterations: iterations of an update.
        delay: time from a measurement to its input [s].
        budget: processor time of an update [s]; null for no limit, which gives repeatable runs.
    """

    type: Literal["predictive"]
    effort: WeightSetting = 0.01
    equality: bool = False
    horizon: float
    form: Literal["acceleration", "dynamic"] = "dynamic"
    nodes: int = 20
    weight: WeightSetting = 1.0
    velocity_weight: WeightSetting = 1.0
    precision: float = 0.02
    period: float = 0.05
    iterations: int = 1
    delay: float = 0.0
    budget: float | None = None

    def _controller(self, context: ControllerContext) -> Controller:
        goal = goal_of(self.goal, context)
        cost = optimal.SetPointCost(goal, self.weight, self.velocity_weight, precision=self.precision)
        return optimal.PredictiveController(
            context.reduced,
            [cost, optimal.EffortCost(self.effort)],
            self.horizon,
            form=self.form,
            bounds=list(bounds_of(self, context, _ACCURACY)),
            nodes=self.nodes,
            updates=optimal.UpdateSchedule(self.period, self.iterations, self.delay, self.budget),
            goal=goal if self.equality else None,
        )


class WayFollowerSettings(_ToGoal):
    """A way to a goal at rest around the obstacles, found before the run and followed.

    Attributes:
        type: a way to a goal around obstacles that stand, and a controller that follows it. It commands velocities.
        goal: values at rest by names of outputs. An orientation needs all its rows.
        links: True to check links of the robot against each other too.
        clearance: smallest distance to obstacles [m]. The check has a tolerance of 1 mm, or 1 % of the largest link.
        seed: seed of all random choices.
        acceleration: largest rate of each entry of the velocity along the way [m/s^2 or rad/s^2]; at least 4 rad/s^2
            for joints that steer while the base stands.
        speed: share of the velocity of the way that is used.
        tube: distance of the robot from the way at which it stops [m or rad].
        tolerance: error at the end above which a run has missed its goal [m or rad].
        state_cost: weight of the distance from the way in the gains of the feedback.
    """

    type: Literal["way"]
    goal: Annotated[dict[str, float], Field(min_length=1)]
    links: bool = True
    clearance: NotNegative = 0.05
    seed: int = 0
    acceleration: Positive = 0.5
    speed: Positive = 0.8
    tube: Positive = 0.05
    tolerance: Positive = 0.02
    state_cost: Positive = 10.0

    @property
    def velocity_command(self) -> str:
        return f"type: '{self.type}'"

    def _controller(self, context: ControllerContext) -> Controller:
        reduced, pairs = context.reduced, PairSelection(links=self.links)
        # Steering and stops make a short way slow: the fastest of many motions is followed, not the first.
        settings = replace(WAY_SEARCH, improve=_FURTHER)
        search = partial(find_way, settings=settings, seed=self.seed, selection=pairs, clearance=self.clearance)
        way = search(reduced, context.q0, goal_of(self.goal, context), context.obstacles)
        own = self.values_of(*optimal.WayFollower.described)
        return ActuatorVelocityController(reduced, optimal.WayFollower(reduced, way, **own))
