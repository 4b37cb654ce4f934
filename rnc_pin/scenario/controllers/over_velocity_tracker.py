"""Builders of kinematic controllers over a velocity tracker: adaptive (10), computed torque, or velocity servos."""

from __future__ import annotations

from typing import cast

import numpy as np

from rnc_pin.control import (
    ActuatorVelocityController,
    Combined,
    ComputedTorque,
    KinematicController,
    ReducingOutputController,
    RedundancyController,
    Secondary,
    SteeringController,
    VelocityGains,
    VelocityQP,
    VelocityTarget,
    VelocityTracker,
    design_velocity_gains,
)
from rnc_pin.control.gain_design import OUTER_GAINS
from rnc_pin.control.redundancy import check_freedom
from rnc_pin.control.whole_body import ProgramState
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.task import Task
from rnc_pin.planning import Joined, Reference, ReferencePoint
from rnc_pin.scenario.controllers.context import (
    MIN_SINGULAR_VALUE,
    BuiltController,
    ControllerContext,
    at_key,
    build_type,
    holding_force,
    inertia_bound,
    refuse_or_warn,
    sized_gain,
    tracker_gains,
)
from rnc_pin.scenario.controllers.task_goals import TaskGoals
from rnc_pin.scenario.schema.controllers import (
    Class1Settings,
    ReducingOutputsSettings,
    RedundancySettings,
    SteeringSettings,
    UncertainRedundancySettings,
    VelocityTrackerSettings,
)
from rnc_pin.scenario.schema.secondary_objectives import SecondarySettings
from rnc_pin.simulation import Margins, margins_along, obstacles_passed

_ROLLOUT_STEP = 0.05  # [s]; a coarse step is enough, because the inertia varies smoothly


@build_type.register
def _redundancy(settings: RedundancySettings, context: ControllerContext) -> BuiltController:
    secondary = None
    if settings.secondary is not None:
        try:
            check_freedom(context.task)
            secondary = _secondary(settings.secondary, context)
        except RncError as error:
            raise ConfigurationError(f"controller.secondary: {error}") from None
    return track(settings, context, _class_1(settings, context, secondary), context.task)


@build_type.register
def _uncertain_redundancy(settings: UncertainRedundancySettings, context: ControllerContext) -> BuiltController:
    return track(settings, context, _class_1(settings, context), context.task)


@build_type.register
def _steering(settings: SteeringSettings, context: ControllerContext) -> BuiltController:
    kinematic = SteeringController(
        context.reduced,
        context.task,
        context.primary,
        context.slithering or context.vertical,
        k3=_outer_gain(settings, "k3", len(context.task.vertical)),
        k4=OUTER_GAINS[settings.preset].k4 if settings.k4 is None else settings.k4,
        k21=_outer_gain(settings, "k21", len(context.task.primary)),
        monitored=context.monitored,
    )
    return track(settings, context, kinematic)


@build_type.register
def _reducing_outputs(settings: ReducingOutputsSettings, context: ControllerContext) -> BuiltController:
    task = context.task
    reference = _Reordered(
        Joined([context.primary, context.redundant]), np.argsort(np.concatenate([task.primary, task.redundant]))
    )
    gain = sized_gain("k21", settings.k21, task.r)
    k2 = {} if gain is None else {"k2": gain}
    return track(
        settings, context, ReducingOutputController(context.reduced, reference, **k2, monitored=context.monitored)
    )


def _class_1(
    settings: Class1Settings, context: ControllerContext, secondary: Secondary | None = None
) -> RedundancyController:
    """Build controller (12).

    Raises:
        ConfigurationError: the task does not fit, or the reference has a trailer.
    """
    if context.slithering is not None:
        raise ConfigurationError("reference.path.trailer: needs the controller type 'steering'")
    return RedundancyController(
        context.task,
        context.primary,
        context.vertical,
        k3=_outer_gain(settings, "k3", len(context.task.vertical)),
        k21=_outer_gain(settings, "k21", len(context.task.primary)),
        secondary=secondary,
    )


def _outer_gain(settings: VelocityTrackerSettings, name: str, size: int) -> float | np.ndarray:
    """Outer gain of the settings, or of their preset."""
    given = sized_gain(name, getattr(settings, name), size)
    return cast(float, getattr(OUTER_GAINS[settings.preset], name)) if given is None else given


def track(
    settings: VelocityTrackerSettings,
    context: ControllerContext,
    kinematic: KinematicController,
    task: Task | None = None,
    horizon: float | None = None,
    goals: TaskGoals | None = None,
) -> BuiltController:
    """Check the reference and build the velocity tracker under a kinematic controller.

    Args:
        settings: settings of the tracker.
        context: inputs for building the controller.
        kinematic: computes the rates of the reducing outputs.
        task: task whose A4 the kinematic controller inverts, if any.
        horizon: duration of the motion to check [s]; by default that of the references of the scenario.
        goals: goals of a controller that may give goals up.

    Raises:
        InfeasibleError: no gains fit the motion, or preflight refuses it.
    """
    reduced, q0 = context.reduced, context.q0
    margins, complaints, doubts = check_motion(context, kinematic, task, horizon, goals)
    time_scale = 1.0 if margins.grip is None else margins.grip.time_scale
    if settings.tracker == "computed_torque":
        gain = sized_gain("k", settings.k, reduced.r)
        k = {} if gain is None else {"k": gain}
        computed = ComputedTorque(reduced, kinematic, **k)
        return BuiltController(computed, complaints, time_scale=time_scale, goals=goals, doubts=doubts)
    if settings.tracker == "velocity":
        with at_key("controller"):
            servos = ActuatorVelocityController(reduced, kinematic)
        return BuiltController(servos, complaints, time_scale=time_scale, goals=goals, doubts=doubts)
    # The results of a run are useful even if it ends in a singular configuration.
    region = margins.q if margins.singular is None else q0[None]
    with at_key("controller"):
        gains = design_velocity_gains(
            reduced,
            region,
            context.simulation.dt,
            preset=settings.preset,
            inertia_bound=inertia_bound(settings, reduced.r),
            bandwidth=settings.bandwidth,
            adaptation=settings.adaptation,
            delay=settings.delay,
            overrides=tracker_gains(settings, VelocityGains, reduced.r),
        )
    tracker = VelocityTracker(kinematic, gains, holding_force(settings, context))
    return BuiltController(tracker, complaints, time_scale=time_scale, goals=goals, doubts=doubts)


def check_motion(
    context: ControllerContext,
    kinematic: KinematicController,
    task: Task | None = None,
    horizon: float | None = None,
    goals: TaskGoals | None = None,
    stands_in: bool = False,
) -> tuple[Margins, tuple[str, ...], tuple[str, ...]]:
    """Roll out a kinematic controller. Return the margins of the motion, complaints, and doubts about goals.

    Args:
        context: inputs for building the controller.
        kinematic, task, horizon, goals: as for ``track``.
        stands_in: True if another controller will run, so that the motion may differ.

    Raises:
        InfeasibleError: there are complaints, and preflight refuses such a motion.
    """
    reduced, horizon = context.reduced, context.horizon if horizon is None else horizon
    if isinstance(kinematic, VelocityQP):
        kinematic = _OncePerSample(kinematic)
    margins = margins_along(reduced, kinematic, context.q0, horizon, _ROLLOUT_STEP, task, context.grip)
    passed = obstacles_passed(reduced.robot, margins.time, margins.q, context.obstacles)
    complaints = (
        *margins.complaints(MIN_SINGULAR_VALUE),
        *(f"the reference passes through obstacle '{each.names[1]}': {each}" for each in passed),
    )
    if stands_in:
        complaints = tuple(f"{each} (in a roll-out by velocities, the run may differ)" for each in complaints)
    doubts: tuple[str, ...] = ()
    given_up: tuple[str, ...] = ()
    if goals is not None and margins.singular is None:
        doubts, given_up = goals.doubts(float(margins.time[-1]), margins.q[-1], context.goal_tolerance)
    return margins, refuse_or_warn(context.preflight, complaints, given_up), doubts


class _OncePerSample:
    """Program whose velocity is computed once per sample of a roll-out: within a sample it does not read q."""

    def __init__(self, program: VelocityQP) -> None:
        self._program = program
        self._last: tuple[ProgramState, tuple[VelocityTarget, ProgramState]] | None = None

    def initial_state(self, measurement: Measurement) -> ProgramState:
        return self._program.initial_state(measurement)

    def step(self, t: float, measurement: Measurement, state: ProgramState) -> tuple[VelocityTarget, ProgramState]:
        if self._last is None or self._last[0] is not state:
            self._last = state, self._program.step(t, measurement, state)
        return self._last[1]


def _secondary(settings: SecondarySettings, context: ControllerContext) -> Secondary:
    """Build the secondary objectives."""
    reduced, task = context.reduced, context.task
    parts: list[Secondary] = []
    if settings.posture is not None:
        parts.append(settings.posture.build(task=task, reference=context.redundant))
    if settings.joint_limits is not None:
        parts.append(settings.joint_limits.build(reduced=reduced, task=task))
    if settings.singularity is not None:
        parts.append(settings.singularity.build(reduced=reduced, task=task))
    return Combined(parts)


class _Reordered:
    """Reference with its outputs in another order."""

    def __init__(self, reference: Reference, order: np.ndarray) -> None:
        self._reference, self._order = reference, order
        self.size, self.duration = reference.size, reference.duration

    def at(self, t: float) -> ReferencePoint:
        point = self._reference.at(t)
        return ReferencePoint(*(each[self._order] for each in point))
