"""Motions of a scenario: references of outputs, the path of a vehicle, and the optimal motion of its planner."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.applications.scenario.controllers import ControllerContext, feedback
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.motions import CostSettings, GuessSettings, OptimalPlanner, VehiclePath
from rnc_pin.array_shapes import Float
from rnc_pin.collision import PairSelection
from rnc_pin.control import SlitheringReference
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model import Kinematics, ReducedModel
from rnc_pin.motion import optimal
from rnc_pin.motion.planning import CarPath, Hold, OutputTarget, Reference, SteeringGeometry, Way, find_way
from rnc_pin.plants import ReducedPlant
from rnc_pin.robots import Robot
from rnc_pin.simulation import PlannedPath

_SLOWER = 1.5  # default of the duration, in durations of the way: accelerations take time
_POINTS = 400  # of a planned path


def frame_poses(
    robot: Robot, frame: str, configurations: np.ndarray
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Return x, y [m] and heading [rad] of a frame at configurations (n, nq), and its heights [m].

    Args:
        robot: the robot.
        frame: name of the frame.
        configurations: the configurations.
    """
    rotation, place = Kinematics(robot).position(configurations).placement(robot.frame_id(frame))
    heading = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return np.column_stack([place[:, :2], heading]), place[:, 2]


@dataclass(frozen=True)
class RunContext(ControllerContext):
    """Context of a controller with the whole file, of which plans read more."""

    scenario: ScenarioFile


def with_references(context: RunContext) -> RunContext:
    """Return the context with the references of the task's outputs: of the file, of the plan, or constant.

    Args:
        context: what the scenario has built so far.
    """
    scenario, task, motion = context.scenario, context.task, context.plan
    if motion is not None and scenario.reference.path is not None:
        raise ConfigurationError("reference.path: 'planner' plans the motion; remove one of them")
    said, (x1, x2) = scenario.reference, context.reduced.at(context.q0).outputs()
    followed = frozenset[str]() if scenario.controller is None else scenario.controller.followed
    references: dict[str, Reference] = {}
    given = []
    for name, settings, start, coordinates in (
        ("primary", said.primary, x2[task.primary], task.primary_coordinates),
        ("redundant", said.redundant, x2[task.redundant], task.redundant_coordinates),
        ("vertical", said.vertical, x1[task.vertical], task.vertical_coordinates),
    ):
        outputs = context.names[name]
        with RncError.at(f"reference.{name}"):
            # The file first, then the plan for what the controller follows; what neither gives stays where it is.
            if settings is not None:
                references[name] = settings.from_start(start, coordinates)
            elif motion is not None and outputs and name in followed:
                references[name] = motion.reference(outputs)
            else:
                references[name] = Hold(start)
                continue
            given.append(name)
    return _with_path(replace(context, references=references, given=tuple(given)))


def _with_path(context: RunContext) -> RunContext:
    """Return the context with the path of ``reference.path``, which gives primary reference and trailer's heading."""
    scenario, reduced, task = context.scenario, context.reduced, context.task
    settings = scenario.reference.path
    if settings is None:
        return context
    # Both speed and steering follow from the path, and the trailer's heading: a second reference would contradict.
    if scenario.reference.primary is not None or (settings.trailer and scenario.reference.vertical is not None):
        raise ConfigurationError("reference.path: replaces 'primary' and, with a trailer, 'vertical'; remove those")
    trailer, slithering = settings.trailer, None
    with ConfigurationError.at("reference.path"):
        forward_only = trailer is not None or bool(settings.forward_only)
        path = _car_path("primary", settings, context, task.primary, settings.duration, forward_only)
        if trailer is not None:
            slithering = SlitheringReference(reduced, task, settings.frame, trailer.frame, trailer.kingpin)
    poses = np.round(path.poses[:: max(1, len(path.poses) // _POINTS)], 5).tolist()  # as much as a plot resolves
    names = [f"{settings.frame}_{axis}" for axis in "xy"]
    monitored = None
    if all(name in reduced.vertical.names for name in names):
        monitored = (np.array([reduced.vertical.names.index(name) for name in names]), path.position)
    planned = PlannedPath(settings.frame, tuple((x, y, heading) for x, y, heading in poses))
    references = {**context.references, "primary": path.reference}
    return replace(context, references=references, slithering=slithering, monitored=monitored, path=planned)


def _car_path(
    role: str,
    settings: VehiclePath,
    context: RunContext,
    outputs: np.ndarray,
    duration: float,
    forward_only: bool = False,
) -> CarPath:
    """Path of a vehicle from its pose at the start; ``outputs`` (2,) are indices of speed and steering in x2."""
    reduced, q0 = context.reduced, context.q0
    if len(outputs) != 2 or reduced.reducing.quasi[outputs].tolist() != [True, False]:
        raise ConfigurationError(f"{role} outputs must be forward speed and steering angle, in this order")
    speed, steering = (int(index) for index in outputs)
    start = frame_poses(reduced.robot, settings.frame, q0[None])[0][0]
    largest = float(np.tan(settings.max_steering) / settings.wheelbase)  # curvature of the front wheel [1/m]
    geometry = SteeringGeometry(reduced, q0, settings.frame, speed=speed, steering=steering, largest=largest)
    own = settings.values_of("wheelbase", "via", "max_steering")
    return CarPath(start, settings.to, duration, forward_only=forward_only, geometry=geometry, **own)


# ------------------------------------------------------------------ optimal motion


_Goal = Mapping[OutputTarget, ArrayLike]
Plans = dict[str, optimal.MotionPlan]
"""Optimal motions of a scenario and its comparisons by what they solve: equal problems are solved once."""


def with_plan(context: RunContext, plans: Plans) -> RunContext:
    """Return the context with the optimal motion of ``planner``, and with its duration.

    Args:
        context: what the scenario has built so far.
        plans: motions so far; a new one is added.

    Raises:
        RncError: the settings do not fit the model, or no plan is found.
    """
    scenario = context.scenario
    if scenario.planner is None:
        return context
    system = (scenario.robot, scenario.constraints, scenario.mimic, scenario.actuators, scenario.forces)
    problem = (scenario.outputs, scenario.obstacles, scenario.initial, scenario.planner, scenario.seed)
    # Comparisons differ in controllers and gains, rarely in the problem; a plan takes seconds to minutes. All of these
    # are settings, whose repr has every value.
    key = repr((system, problem, _regulator(scenario), scenario.timing.dt, scenario.timing.plant_options))
    if key not in plans:
        with RncError.at("planner"):
            plans[key] = _plan(context, scenario.planner)
    return replace(context, plan=plans[key], simulation=scenario.timing.of_plan(plans[key].duration))


def _plan(context: RunContext, settings: OptimalPlanner) -> optimal.MotionPlan:
    scenario, reduced, timing = context.scenario, context.reduced, context.scenario.timing
    kinematic = settings.form == "kinematic"
    if kinematic and context.v2_0.any():  # velocities are its inputs, which jump
        raise ConfigurationError("form 'kinematic' starts with any velocity; remove 'initial.v2'")
    goal = feedback.goal_of(settings.goal, context) or None
    guess, duration = _first_guess(context, settings, goal)
    return optimal.plan(
        reduced,
        context.q0,
        goal,
        duration,
        costs=list(_costs(context, settings.costs)),
        bounds=list(feedback.bounds_of(settings, context, settings.accuracy)),
        limits=None if settings.limits is None else settings.limits.build(),
        settings=settings.solver,
        guess=guess,
        seed=scenario.seed,
        v2_0=None if kinematic else context.v2_0,
        **settings.values_of("form", "seeds", "solutions", "at_rest", "time_weight"),
        # A plan is verified in the loop that will run it.
        feedback=lambda plan: _regulator(scenario).along(reduced, plan, timing.joint_damping),
        dt=timing.dt,
        plant=ReducedPlant(reduced, *timing.plant_options),
    )


def _costs(context: RunContext, costs: CostSettings) -> Iterator[optimal.CostKind]:
    kinds = (
        (optimal.EffortCost, costs.effort),
        (optimal.VelocityCost, costs.velocity),
        (optimal.AccelerationCost, costs.acceleration),
    )
    yield from (kind(weight) for kind, weight in kinds if weight is not None)
    if costs.posture is not None:
        yield optimal.PostureCost(context.q0, costs.posture)
    for each in costs.outputs:
        feedback.check_output_names("costs.outputs", each.outputs, context.reduced)
        yield each.build()


def _first_guess(
    context: RunContext, settings: OptimalPlanner, goal: _Goal | None
) -> tuple[Way | np.ndarray | None, float | tuple[float, float]]:
    """First guess, a way, configurations (n, nq) or None for the straight line, and the duration."""
    given = settings.duration
    duration = (given[0], given[1]) if isinstance(given, list) else given
    if settings.type == "global":
        assert goal is not None
        for each in context.obstacles:
            if each.motion is not None:
                text = f"obstacle '{each.name}' moves, and type 'global' searches a way in a world that stands"
                raise ConfigurationError(f"{text}; use type 'optimal', which follows its motion")
        # As the bounds of the plan: null ignores obstacles, and links count if they are asked for.
        beside = () if settings.clearance is None else context.obstacles
        selection, clearance = PairSelection(links=settings.links), settings.clearance or 0.0
        search = partial(find_way, selection=selection, clearance=clearance, settings=feedback.WAY_SEARCH)
        way = search(context.reduced, context.q0, goal, beside, seed=context.scenario.seed)
        return way, _SLOWER * way.duration if duration is None else duration
    assert duration is not None
    return _guess(context, settings.guess, goal, float(np.mean(duration))), duration  # of a free one, the middle


def _guess(context: RunContext, guess: GuessSettings | None, goal: _Goal | None, duration: float) -> np.ndarray | None:
    """Configurations (n, nq) of the first guess; None for the straight line."""
    reduced, q = context.reduced, context.q0
    if guess is None:
        return None
    if guess.through is not None:
        end = optimal.goal_configuration(reduced, q, goal)
        here = reduced.robot.joint_values(q)
        return np.array([q, *(reduced.robot.configuration({**here, **each}) for each in guess.through), end])
    if guess.path is not None:
        with ConfigurationError.at("guess.path"):
            path = _car_path("reducing", guess.path, context, np.arange(reduced.r), duration)
        return optimal.driven_configurations(reduced, q, path.reference, duration)
    assert guess.reducing is not None
    _, x2 = reduced.at(q).outputs()
    motion = guess.reducing.from_start(x2, reduced.reducing.coordinates)
    return optimal.driven_configurations(reduced, q, motion, duration)


def _regulator(scenario: ScenarioFile) -> feedback.PlanFeedbackSettings:
    """Settings of the feedback of the run.

    Trackers of outputs have another feedback; the usual regulator stands for it.
    """
    chosen = scenario.controller
    usual = feedback.PlanFeedbackSettings(type="plan_feedback")
    return chosen if isinstance(chosen, feedback.PlanFeedbackSettings) else usual


def planned_path(found: optimal.MotionPlan, reduced: ReducedModel, frame: str) -> PlannedPath:
    """Path of a frame along a plan.

    Args:
        found: the plan.
        reduced: the model.
        frame: name of the frame.
    """
    # Between nodes by the planner's own integration: straight lines would cut the corners of a car.
    model = optimal.action_model(reduced, found.info.form)
    parts, h = max(1, round(_POINTS / len(found.u))), np.diff(found.time)
    start = optimal.Nodes(found.q[:-1], found.w[:-1])
    pieces = [model.step(start, found.u, h * part / parts).q for part in range(parts)]
    q = np.concatenate([np.stack(pieces, axis=1).reshape(-1, found.q.shape[1]), found.q[-1:]])
    poses, heights = frame_poses(reduced.robot, frame, q)
    on_ground = reduced.robot.model.joints[1].shortname() == "JointModelPlanar"  # drawn on the ground, not at a height
    kept = () if on_ground else tuple(np.round(heights, 5).tolist())
    return PlannedPath(frame, tuple((x, y, heading) for x, y, heading in np.round(poses, 5).tolist()), kept)
