"""Control to a goal at rest: plans with feedback, model-predictive control, or navigation."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import fields, replace
from typing import Annotated, ClassVar, Literal, cast

from pydantic import Field

from rnc_pin.applications.scenario.controllers.base import ControllerSettings
from rnc_pin.applications.scenario.controllers.context import BuiltController, ControllerContext, at_key
from rnc_pin.applications.scenario.motion_problem import bounds_of, goal_of
from rnc_pin.applications.scenario.schema.base import Positive
from rnc_pin.applications.scenario.schema.derived import part
from rnc_pin.applications.scenario.schema.planner_settings import LimitItem, MotionProblem, WeightSetting
from rnc_pin.collision import PairSelection
from rnc_pin.control import (
    ActuatorVelocityController,
    Controller,
    KinematicController,
    NavigationController,
    WayFollowing,
)
from rnc_pin.optimal import EffortCost, PredictiveController, SetPointController, SetPointCost, UpdateSchedule

_FORM = {"form": Literal["acceleration", "dynamic"]}
_POINT = part(
    SetPointController,
    "form",
    "nodes",
    "seeds",
    "tolerance",
    "tube",
    "check",
    "state_cost",
    "braking",
    "velocities",
    forms=_FORM,
)
_NAVIGATION = part(NavigationController, "clearance", "seed")
_FOLLOWING = part(WayFollowing, *(each.name for each in fields(WayFollowing)))
_PREDICTIVE = part(PredictiveController, "horizon", "form", "nodes", "velocities", forms=_FORM)
_COST = part(
    SetPointCost,
    "weight",
    "velocity_weight",
    "precision",
    forms=dict.fromkeys(("weight", "velocity_weight"), WeightSetting),
)
_SCHEDULE = part(UpdateSchedule, "period", "iterations", "delay", "budget")


class _ToGoal(ControllerSettings):
    """Controller to a goal at rest, by forces or by velocities."""

    follows: ClassVar[frozenset[str]] = frozenset()
    advice: ClassVar[str] = ", which drives to its own goal"

    def _build(self, context: ControllerContext) -> BuiltController:
        with at_key("controller"):
            made = self._controller(context)
            if isinstance(made, NavigationController) or made.velocities:
                servos = ActuatorVelocityController(context.reduced, cast(KinematicController, made))
                return BuiltController(servos, ())
        return BuiltController(cast(Controller, made), ())

    @abstractmethod
    def _controller(
        self, context: ControllerContext
    ) -> SetPointController | PredictiveController | NavigationController: ...


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

    def _controller(self, context: ControllerContext) -> SetPointController:
        duration = tuple(self.duration) if isinstance(self.duration, list) else self.duration
        return _POINT.build(
            self,
            reduced=context.reduced,
            goal=goal_of(self.goal, context.outputs, context.reduced),
            duration=duration,
            bounds=list(bounds_of(self, context.reduced, context.obstacles)),
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

    def _controller(self, context: ControllerContext) -> PredictiveController:
        goal = goal_of(self.goal, context.outputs, context.reduced)
        return _PREDICTIVE.build(
            self,
            reduced=context.reduced,
            costs=[_COST.build(self, goal=goal), EffortCost(self.effort)],
            bounds=list(bounds_of(self, context.reduced, context.obstacles)),
            updates=_SCHEDULE.build(self),
            goal=goal if self.equality else None,
        )


class NavigationSettings(_ToGoal, _NAVIGATION.model, _FOLLOWING.model):  # type: ignore[name-defined, misc]
    """A way to a goal at rest around the obstacles, and another one where it is blocked."""

    velocities: ClassVar[bool] = True

    type: Literal["navigation"]
    """A way to a goal around the obstacles, also those that move into it. It commands velocities."""
    goal: Annotated[dict[str, float], Field(min_length=1)]
    """Values at rest by names of outputs. An orientation needs all its rows."""
    links: bool = True
    """True to check links of the robot against each other too."""
    motions: Annotated[int, Field(ge=1)] = NavigationController.search.motions or 1
    """Number of checked motions after which a search ends without a way."""
    improve: Annotated[int, Field(ge=0)] = NavigationController.search.improve
    """Number of motions that a search checks for faster ways after the first one."""

    def _controller(self, context: ControllerContext) -> NavigationController:
        return _NAVIGATION.build(
            self,
            reduced=context.reduced,
            goal=goal_of(self.goal, context.outputs, context.reduced),
            obstacles=context.obstacles,
            selection=PairSelection(links=self.links),
            settings=replace(NavigationController.search, motions=self.motions, improve=self.improve),
            following=_FOLLOWING.build(self),
        )
