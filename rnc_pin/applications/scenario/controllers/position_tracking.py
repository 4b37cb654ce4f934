"""Controllers over a position tracker (8)-(9)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from rnc_pin.applications.scenario.controllers.base import (
    AdaptationSettings,
    InertiaBoundSettings,
    preset_gains,
    sized_gain,
)
from rnc_pin.applications.scenario.controllers.context import BuiltController, ControllerContext, at_key
from rnc_pin.applications.scenario.schema.derived import PartialCall, part
from rnc_pin.applications.scenario.schema.motions import Pose
from rnc_pin.control import (
    OUTER_GAINS,
    GainDesign,
    JacobianTransposeController,
    PositionGains,
    PositionTracker,
    SplitController,
    UnicycleStabilizer,
    VelocityGains,
    VelocityTracker,
    design_position_gains,
    design_velocity_gains,
    effective_inertia,
)
from rnc_pin.errors import ConfigurationError
from rnc_pin.model import NotNegative, Task

_GAINS = preset_gains(PositionGains, "k1", "k2", "gamma", "beta", "sigma")
_ACTIVE = part(JacobianTransposeController, "active")
PlatformItem = Annotated[
    PartialCall[UnicycleStabilizer],
    part(
        UnicycleStabilizer,
        "goal",
        "position",
        "begin",
        keys={"goal": "to"},
        forms={
            "goal": Annotated[Pose, Field(description="Goal pose: x, y [m] and heading [rad].")],
            "position": Annotated[
                list[str],
                Field(min_length=2, max_length=2, description="Names of the vertical outputs x and y of the platform."),
            ],
            "begin": Annotated[NotNegative, Field(description="Start time of the second phase [s].")],
        },
        required=("begin",),
    ),
]
"""Goal of a unicycle platform in the second phase."""


class JacobianTransposeSettings(InertiaBoundSettings, _GAINS.model, _ACTIVE.model):  # type: ignore[name-defined, misc]
    """Tracking of the primary outputs by the ``active`` actuators, without velocity measurements: (8)-(9)."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["jacobian_transpose"]
    """Position tracker (8)-(9) on the ``active`` actuators; the others are off."""

    def _build(self, context: ControllerContext) -> BuiltController:
        task, reduced, outputs = context.task, context.reduced, context.task.primary
        bound = self.bound(reduced.r)
        with at_key("controller"):
            gains = design_position_gains(
                partial(effective_inertia, reduced, outputs=outputs, active=self.active),
                context.q0,  # undriven outputs drift, so the region of motion is unknown
                context.simulation.dt,
                GainDesign(
                    self.preset,
                    None if bound is None else bound[outputs],
                    overrides=self.tracker_gains(PositionGains, len(outputs)),
                ),
            )
        tracker = PositionTracker(context.primary, gains, outputs=outputs, angular=task.primary_coordinates)
        return BuiltController(JacobianTransposeController(reduced, tracker, self.active))


class TwoPhaseSettings(AdaptationSettings):
    """Class 3: (8)-(9) moves the primary outputs and then holds them while a point stabiliser drives the platform."""

    follows: ClassVar[frozenset[str]] = frozenset({"primary"})

    type: Literal["two_phase"]
    """Class 3: (8)-(9) for the primary outputs, then a point stabiliser for the platform."""
    platform: PlatformItem
    """Goal pose and start time of the platform: position, to, begin."""

    def _build(self, context: ControllerContext) -> BuiltController:
        task, reduced, goal = context.task, context.reduced, self.platform
        x2 = reduced.reducing
        if len(task.redundant) != 2 or not x2.quasi[task.redundant[0]] or not x2.angular[task.redundant[1]]:
            raise ConfigurationError("task.redundant: two_phase requires forward speed and yaw of the platform")
        position = Task.of(reduced, task.primary_names, task.redundant_names, goal.given["position"]).vertical
        hand_gains, platform_gains = self._gains(context)
        force = self.holding_force(context)
        hand = PositionTracker(
            context.primary,
            hand_gains,
            angular=task.primary_coordinates,
            gravity_compensation=None if force is None else force[task.primary],
        )
        outer = OUTER_GAINS[self.preset]
        stabilizer = goal.build(
            goal=np.array(goal.given["goal"]),
            position=position,
            k=outer.k,
            rate=outer.rate,
            tolerance=outer.tolerance,
            max_speed=outer.max_speed,
        )
        platform = VelocityTracker(stabilizer, platform_gains, None if force is None else force[task.redundant])
        return BuiltController(SplitController([(hand, task.primary), (platform, task.redundant)], task.r))

    def _gains(self, context: ControllerContext) -> tuple[PositionGains, VelocityGains]:
        """Gains of the hand's tracker and of the platform's tracker, from the inertia at the initial configuration."""
        reduced, primary, redundant = context.reduced, context.task.primary, context.task.redundant
        start, dt = context.q0[None], context.simulation.dt
        dead_zone, bound = sized_gain("dead_zone", self.dead_zone, reduced.r), self.bound(reduced.r)

        def design(part: np.ndarray) -> GainDesign:
            return GainDesign(self.preset, None if bound is None else bound[part], delay=self.delay)

        still = dead_zone[redundant] if isinstance(dead_zone, np.ndarray) else dead_zone
        driven = replace(design(redundant), adaptation=self.adaptation, overrides={"dead_zone": still})
        with at_key("controller"):
            hand = design_position_gains(
                lambda q: reduced.at(q).H[..., primary, :][..., primary], start, dt, design(primary)
            )
            platform = design_velocity_gains(reduced, start, dt, driven, outputs=redundant)
        return hand, platform
