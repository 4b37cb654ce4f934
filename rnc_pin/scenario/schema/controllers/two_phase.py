"""Class 3: the primary outputs first, then the platform."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from rnc_pin.control import (
    PositionGains,
    PositionTracker,
    SplitController,
    UnicycleStabilizer,
    VelocityGains,
    VelocityTracker,
)
from rnc_pin.errors import ConfigurationError
from rnc_pin.model.task import Task
from rnc_pin.scenario.schema.base import Strict
from rnc_pin.scenario.schema.controllers.base import Built, Context, HeldSettings, chosen, named


class _Pace(NamedTuple):
    """Gains of the platform's stabiliser, several times slower than its tracker."""

    k: float
    """[1/s]"""
    rate: float
    """[1/s]"""
    close: float
    """[m], [rad]"""
    fastest: tuple[float, float]
    """[m/s], [rad/s]"""


_BRISK = _Pace(0.4, 1.0, 2e-3, (1.0, 1.0))
_PACES = {"paper": _Pace(0.1, 0.2, 0.02, (0.3, 0.3)), "normalised": _BRISK, "scaled": _BRISK}


class PlatformGoal(Strict):
    """Goal of a unicycle platform in the second phase."""

    position: Annotated[list[str], Field(min_length=2, max_length=2)]
    """Names of the vertical outputs x and y of the platform."""
    to: Annotated[list[float], Field(min_length=3, max_length=3)]
    """Goal pose: x, y [m] and heading [rad]."""
    begin: Annotated[float, Field(ge=0)]
    """Start time of the second phase [s]."""


class TwoPhaseSettings(HeldSettings):
    """Class 3: (8)-(9) moves the primary outputs and then holds them while a point stabiliser drives the platform."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["two_phase"]
    """Class 3: (8)-(9) for the primary outputs, then a point stabiliser for the platform."""
    platform: PlatformGoal
    """Goal pose and start time of the platform: position, to, begin."""

    def make(self, context: Context) -> Built:
        task, reduced, goal = context.task, context.reduced, self.platform
        x2 = reduced.reducing
        if len(task.redundant) != 2 or not x2.quasi[task.redundant[0]] or not x2.angular[task.redundant[1]]:
            raise ConfigurationError("task.redundant: two_phase requires forward speed and yaw of the platform")
        places = Task.of(reduced, task.primary_names, task.redundant_names, goal.position).vertical
        position, velocity = self._gains(context)
        held = self.held_force(context)
        tracker = PositionTracker(
            context.primary,
            position,
            angular=task.primary_coordinates,
            held=None if held is None else held[task.primary],
        )
        pace = _PACES[self.preset]
        stabilizer = UnicycleStabilizer(
            np.array(goal.to), places, goal.begin, k=pace.k, rate=pace.rate, close=pace.close, fastest=pace.fastest
        )
        drive = VelocityTracker(stabilizer, velocity, None if held is None else held[task.redundant])
        return Built(SplitController([(tracker, task.primary), (drive, task.redundant)], task.r))

    def _gains(self, context: Context) -> tuple[PositionGains, VelocityGains]:
        """Gains of the hand's tracker and of the platform's tracker."""
        zone = chosen("dead_zone", self.dead_zone, 0.0, context.reduced.r)
        redundant = zone[context.task.redundant] if isinstance(zone, np.ndarray) else zone
        position, velocity = self._preset_gains(context)
        return position, replace(velocity, dead_zone=redundant)

    def _preset_gains(self, context: Context) -> tuple[PositionGains, VelocityGains]:
        if self.preset == "paper":
            return PositionGains.paper(), VelocityGains.paper()
        if self.preset == "normalised":
            bounds = self.bounds(context)
            return (
                PositionGains.normalised(bounds[context.task.primary]),
                VelocityGains.normalised(bounds[context.task.redundant]),
            )
        delay = self.delay or 0.0
        task, reduced, dt, start = context.task, context.reduced, context.simulation.dt, context.q0[None]
        hand = np.ix_(np.arange(1), task.primary, task.primary)
        with named("controller"):
            return (
                PositionGains.scaled(reduced.inertia(start)[hand], dt, delay=delay),
                VelocityGains.scaled(
                    reduced, start, dt, outputs=task.redundant, adaptation=self.adaptation or 1.0, delay=delay
                ),
            )
