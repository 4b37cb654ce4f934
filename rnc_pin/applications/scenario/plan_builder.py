"""Optimal motion of a scenario: its problem, its first guess, and the path of a frame along it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from rnc_pin.applications.scenario.controllers.feedback import (
    WAY_SEARCH,
    PlanFeedbackSettings,
    bounds_of,
    check_output_names,
    goal_of,
)
from rnc_pin.applications.scenario.reference_builder import frame_poses
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.motions import GuessSettings, OptimalPlanner, VehiclePath
from rnc_pin.collision import Obstacle, PairSelection
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model import ReducedModel
from rnc_pin.optimal import (
    AccelerationCost,
    CostKind,
    EffortCost,
    MotionPlan,
    Nodes,
    PostureCost,
    RunFeedback,
    VelocityCost,
    Weight,
    action_model,
    driven_configurations,
    goal_configuration,
    tvlqr,
)
from rnc_pin.planning import OutputTarget, Reference, Way, find_way
from rnc_pin.robots import Robot
from rnc_pin.simulation import PlannedPath

_SLOWER = 1.5  # default of the duration, in durations of the way: accelerations take time
_POINTS = 400  # of a planned path


class Start(NamedTuple):
    """Initial state of a run: configuration (nq,) and reduced velocity (r,)."""

    q: np.ndarray
    v2: np.ndarray


class Plans:
    """Optimal motions of a scenario and its comparisons: equal problems are solved once."""

    def __init__(self) -> None:
        self._found: dict[str, MotionPlan] = {}

    def plan(
        self, scenario: ScenarioFile, reduced: ReducedModel, start: Start, obstacles: Sequence[Obstacle]
    ) -> MotionPlan:
        """Return the optimal motion of a scenario, like ``build_plan``."""
        system = (scenario.robot, scenario.constraints, scenario.mimic, scenario.actuators, scenario.forces)
        problem = (scenario.outputs, scenario.obstacles, scenario.initial, scenario.planner, scenario.seed)
        key = repr((system, problem, _regulator(scenario)))
        if key not in self._found:
            self._found[key] = build_plan(scenario, reduced, start, obstacles)
        return self._found[key]


def build_plan(
    scenario: ScenarioFile, reduced: ReducedModel, start: Start, obstacles: Sequence[Obstacle]
) -> MotionPlan:
    """Plan the motion of ``planner``.

    Raises:
        RncError: the settings do not fit the model, or no plan is found.
    """
    settings = scenario.planner
    assert settings is not None
    names = (*reduced.reducing.names, *reduced.vertical.names)
    kinematic = settings.form == "kinematic"
    with RncError.at("planner"):
        if kinematic and start.v2.any():
            raise ConfigurationError("form 'kinematic' starts with any velocity; remove 'initial.v2'")
        goal = goal_of(settings.goal, scenario.listed_outputs, reduced) or None
        guess, duration = _first_guess(scenario, reduced, start, goal, obstacles)
        return settings.build(
            reduced,
            q0=start.q,
            goal=goal,
            costs=list(_costs(settings, start, names)),
            bounds=list(bounds_of(settings, reduced, obstacles)),
            duration=duration,
            guess=guess,
            seed=scenario.seed,
            v2_0=None if kinematic else start.v2,
            feedback=_feedback(scenario, reduced),
        )


def _regulator(scenario: ScenarioFile) -> tuple[str, Weight, Weight]:
    """Gains, weights of states and of inputs of the feedback of the run.

    Trackers of outputs have another feedback; the usual regulator stands for it.
    """
    chosen = scenario.controller
    if isinstance(chosen, PlanFeedbackSettings):
        return chosen.gains, chosen.state_cost, chosen.input_cost
    return "tvlqr", 1.0, 1.0


def _feedback(scenario: ScenarioFile, reduced: ReducedModel) -> RunFeedback:
    gains, state_cost, input_cost = _regulator(scenario)
    if gains == "plan":
        return "plan"
    return lambda found: tvlqr(reduced, found, state_cost, input_cost).K


def planned_path(found: MotionPlan, reduced: ReducedModel, frame: str) -> PlannedPath:
    """Path of a frame along a plan."""
    model = action_model(reduced, found.info.form)
    parts, h = max(1, round(_POINTS / len(found.u))), np.diff(found.time)
    start = Nodes(found.q[:-1], found.w[:-1])
    pieces = [model.step(start, found.u, h * part / parts).q for part in range(parts)]
    q = np.concatenate([np.stack(pieces, axis=1).reshape(-1, found.q.shape[1]), found.q[-1:]])
    poses, heights = frame_poses(reduced.robot, frame, q)
    rows = np.round(poses, 5).tolist()
    on_ground = reduced.robot.model.joints[1].shortname() == "JointModelPlanar"
    kept = () if on_ground else tuple(np.round(heights, 5).tolist())
    return PlannedPath(frame, tuple((x, y, heading) for x, y, heading in rows), kept)


def _costs(settings: OptimalPlanner, start: Start, names: Sequence[str]) -> Iterator[CostKind]:
    costs = settings.costs
    kinds = (EffortCost, costs.effort), (VelocityCost, costs.velocity), (AccelerationCost, costs.acceleration)
    yield from (kind(weight) for kind, weight in kinds if weight is not None)
    if costs.posture is not None:
        yield PostureCost(start.q, costs.posture)
    for each in costs.outputs:
        check_output_names("costs.outputs", cast(list[str], each.output), names)
        yield each


def _first_guess(
    scenario: ScenarioFile,
    reduced: ReducedModel,
    start: Start,
    goal: Mapping[OutputTarget, ArrayLike] | None,
    obstacles: Sequence[Obstacle],
) -> tuple[Way | np.ndarray | None, float | tuple[float, ...]]:
    """First guess, a way, configurations (n, nq) or None for the straight line, and the duration."""
    settings = scenario.planner
    assert settings is not None
    given = settings.duration
    duration = tuple(given) if isinstance(given, list) else given
    if settings.type == "global":
        assert goal is not None
        beside = () if settings.clearance is None else obstacles
        selection, clearance, seed = PairSelection(links=settings.links), settings.clearance or 0.0, scenario.seed
        search = partial(find_way, selection=selection, clearance=clearance, settings=WAY_SEARCH, seed=seed)
        way = search(reduced, start.q, goal, beside)
        if duration is None:
            duration = _SLOWER * way.duration
        return way, duration
    assert duration is not None
    return _guess(settings.guess, reduced, start, goal, float(np.mean(duration))), duration


def _guess(
    guess: GuessSettings | None,
    reduced: ReducedModel,
    start: Start,
    goal: Mapping[OutputTarget, ArrayLike] | None,
    duration: float,
) -> np.ndarray | None:
    """Configurations (n, nq) of the first guess; None for the straight line."""
    if guess is None:
        return None
    if guess.path is not None:
        reference = _path(guess.path, reduced, start.q, duration)
        return driven_configurations(reduced, start.q, reference, duration)
    if guess.reducing is not None:
        _, x2 = reduced.at(start.q).outputs()
        motion = guess.reducing.from_start(x2, reduced.reducing.coordinates)
        return driven_configurations(reduced, start.q, motion, duration)
    assert guess.through is not None
    end = goal_configuration(reduced, start.q, goal)
    return np.array([start.q, *(_with_joints(reduced.robot, start.q, each) for each in guess.through), end])


def _with_joints(robot: Robot, q: np.ndarray, joints: Mapping[str, float | list[float]]) -> np.ndarray:
    """Configuration with other positions of some joints."""
    moved, given = q.copy(), robot.configuration(joints)
    for joint in joints:
        place = robot.model.joints[robot.model.getJointId(joint)]
        rows = slice(place.idx_q, place.idx_q + place.nq)
        moved[rows] = given[rows]
    return moved


def _path(settings: VehiclePath, reduced: ReducedModel, q0: np.ndarray, duration: float) -> Reference:
    if reduced.reducing.quasi.tolist() != [True, False]:
        raise ConfigurationError("guess.path: reducing outputs must be forward speed and steering angle, in this order")
    poses, _ = frame_poses(reduced.robot, settings.frame, q0[None])
    return settings.path(reduced, q0, poses[0], duration).reference
