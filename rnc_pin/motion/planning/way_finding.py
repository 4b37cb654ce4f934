"""Global planning: a collision-free way of a reduced system from a configuration to a goal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Float
from rnc_pin.collision import Obstacle, PairSelection
from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError, check_extra
from rnc_pin.model.input_validation import (
    ConfigurationValidator,
    NotNegative,
    Positive,
    check_instances,
    check_settings,
)
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget
from rnc_pin.motion.planning.action_models import KinematicFlow
from rnc_pin.motion.planning.exact_steering import ExactMotion, Steering, base_axes
from rnc_pin.motion.planning.steering_detection import SampledBases, find_steering
from rnc_pin.motion.planning.way import Way, WayInfo, way_along
from rnc_pin.motion.planning.way_checking import WayChecker, check_configuration, goal_configurations, way_checker
from rnc_pin.motion.planning.way_propagation import DEVIATION, PropagatedSearch
from rnc_pin.motion.planning.way_search import SHORTER, SearchBudget, WaySearch, base_area, drive_times, speed_limits

_ATTEMPT = 4000  # motions of each further search, before it starts again with other random numbers
_ROOM = 0.02  # of the range of a steering joint, at each end: feedback along a way needs it


@dataclass(frozen=True)
class WaySettings:
    """Settings of the search for a way.

    Attributes:
        seconds: time after which the search ends without a way [s].
        goals: largest number of configurations that are tried for a goal of outputs.
        shortcuts: number of attempts to shorten each way.
        improve: number of motions that may be checked to find faster ways after the first one.
        motions: number of checked motions after which the search ends, whatever the time; None for any number. OMPL
            may finish an iteration, which checks a few more.
        hold: names of joints that keep their positions.
        area: smallest and largest x, y and z (2, 3) of the base [m]; by default the box around start, goals and
            obstacles, with room to turn around it.

    Raises:
        ConfigurationError: a number is out of range.

    Example:
        >>> rnc.planning.WaySettings(seconds=5.0, hold=["torso_lift_joint"]).shortcuts
        100
    """

    seconds: Positive = 30.0
    goals: Annotated[int, Ge(1)] = 4
    shortcuts: Annotated[int, Ge(0)] = 100
    improve: Annotated[int, Ge(0)] = 0
    motions: Annotated[int, Ge(1)] | None = None
    hold: Sequence[str] = ()
    area: ArrayLike | None = None

    def __post_init__(self) -> None:
        check_settings(self)


_DEFAULT = WaySettings()


def find_way(
    reduced: ReducedModel,
    q0: ArrayLike,
    goal: Mapping[OutputTarget, ArrayLike] | ArrayLike,
    obstacles: Sequence[Obstacle] = (),
    *,
    selection: PairSelection | None = None,
    clearance: NotNegative = 0.01,
    settings: WaySettings = _DEFAULT,
    seed: int = 0,
) -> Way:
    """Return a collision-free way from a configuration to a goal, along which the constraint rows hold.

    OMPL's planner RRTConnect searches over exact motions (``find_steering``). Where none are known, as for trailers and
    momentum, motions with constant reduced velocities are propagated from start and goal, and joined by Newton's
    method. A motion counts as free only if bounds of the distances show it, between samples too. Then the way becomes
    shorter, as far as this makes it faster. The same seed gives the same way, unless the time is up before.

    The position limits of the robot's file hold. Wheels that follow end at any angle.

    Args:
        reduced: the model.
        q0: start (nq,).
        goal: values by output, as for ``solve_ik``, or a configuration (nq,).
        obstacles: obstacles, all of which stand.
        selection: rules for pairs of links; by default all pairs that are not adjacent.
        clearance: smallest distance to obstacles [m]. The check has a tolerance of 1 mm, or 1 % of the largest link.
        settings: settings of the search.
        seed: seed of all random choices.

    Raises:
        ConfigurationError: OMPL is not installed, an obstacle moves, or rows prescribe a motion.
        InfeasibleError: the start or the goal is in collision or beyond a limit, or no way is found in the time. The
            message names the nearest place and the pair that blocks most motions; ``error.q`` is the nearest
            configuration that was reached.
        InputError: wrong shapes, or a clearance that is negative.

    Example:
        >>> import coal
        >>> robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> wall = rnc.collision.Obstacle(coal.Box(0.1, 3.0, 2.0), position=(1.5, 0.0, 0.0), name="wall")
        >>> behind = {rnc.FramePosition("axle", "xy"): [3.0, 0.0], rnc.FrameYaw("axle"): 0.0}
        >>> way = rnc.planning.find_way(reduced, robot.configuration(), behind, [wall])
        >>> way.at(way.duration)[:2].round(6), way.residual < 1e-9, way.narrowest.distance > 0.01
        (array([3., 0.]), True, True)
    """
    if not 0.0 <= clearance < np.inf:
        raise InputError(f"clearance: expected a number of at least 0 m, found {clearance!r}")
    _check_stands(obstacles)
    start = ConfigurationValidator(reduced.robot).validate_one(q0, "q0")
    steering = _steering(reduced, start, settings)
    planned = ~SampledBases(reduced, start).followers() if steering is None else steering.planned
    # Nodes of propagated motions are checked with geodesics between them, which the motion leaves by this much.
    apart = clearance if steering else clearance + DEVIATION
    checker = way_checker(reduced.robot, start, obstacles, selection, apart)
    budget = SearchBudget(settings.seconds, settings.motions)
    check_configuration(reduced, checker, start, "start")
    limits = settings.seconds / 2, settings.goals, settings.hold  # the search has at least half of the time
    ends = goal_configurations(goal, start, steering, reduced, checker, *limits, seed)
    places = np.vstack([start, ends])
    area = base_area(reduced, 0.0 if steering is None else steering.radius, places, obstacles, checker, settings.area)
    speeds = speed_limits(reduced, planned)
    search: WaySearch | PropagatedSearch
    if steering is None:
        search = PropagatedSearch(KinematicFlow(reduced), planned, checker, places, area, speeds, budget)
    else:
        search = WaySearch(steering, checker, places, area, budget)
    motion = _fastest(search, reduced, speeds, settings, budget, seed)
    if motion is None:
        raise _failure(search, checker, reduced, ends, budget)
    if steering is not None:
        motion = steering.completed(motion, start)
        # The search has moved planned joints alone: wheels and casters that follow are looked at once, at its end.
        follow = None if planned.all() else checker
        if follow is not None and not follow.holds_with(steering.along(start, motion.steps), ~planned):
            raise InfeasibleError("find_way: wheels or casters that follow collide on the way: they are not round")
    kind = "propagated" if steering is None else steering.kind
    info = WayInfo(kind, budget.elapsed, budget.motions, len(ends))
    return way_along(reduced, planned, checker, motion, info)


def _check_stands(obstacles: Sequence[Obstacle]) -> None:
    """Raise an error unless all obstacles stand."""
    check_instances("obstacles", obstacles, Obstacle)
    for each in obstacles:
        if each.motion is not None:
            raise ConfigurationError(
                f"find_way: obstacle '{each.name}' moves, and a way is for a world that stands still; give it where it "
                "is at a time t (obstacle.at_rest(t)), and find another way when it has moved"
            )


def _fastest(
    search: WaySearch | PropagatedSearch,
    reduced: ReducedModel,
    speeds: Float[Array, " nv"],
    settings: WaySettings,
    budget: SearchBudget,
    seed: int,
) -> ExactMotion | None:
    """Fastest motion that searches find until the budget is over; None for none."""
    motion, every, attempt = search.direct(), list(reduced.robot.model.names)[1:], 0
    direct, tight = motion is not None, base_axes(reduced.robot.model) > 0
    best: ExactMotion | None = None
    shortest = np.inf
    while True:
        if motion is None:
            first = 400  # motions of the first search, in which joints stay within the range of start and goals
            # At first the joints of a mobile robot stay within the range of start and goals: most ways need its base
            # alone, and the space of the arm's joints is much larger.
            held, most = (every, first) if tight else (settings.hold, _ATTEMPT)
            motion = search.run(held, most, seed + attempt)
            attempt += 1
        if motion is not None:
            # RRT's ways have needless detours: before they are shortened, their durations say little.
            motion = search.shortened(motion, settings.shortcuts, seed)
            duration = float(drive_times(motion.steps, speeds).sum())
            if best is None:
                budget.limit(settings.improve)
            if duration < (1.0 - SHORTER) * shortest:
                best, shortest = motion, duration
            motion = None
        tight = tight and best is not None  # what led to a way may lead to a faster one
        if direct or budget.is_over:
            break
    return best


def _steering(reduced: ReducedModel, start: Array, settings: WaySettings) -> Steering | None:
    """Exact steering; None if none is known, so that motions have to be propagated."""
    try:
        steering = find_steering(reduced, start, room=_ROOM)
    except ConfigurationError:
        if reduced.affine:
            raise ConfigurationError("find_way: rows prescribe a motion, which cannot be driven backwards") from None
        if list(settings.hold):
            raise ConfigurationError(
                "find_way: hold needs an exact steering, which is not known for this system; lock these joints"
            ) from None
        return None
    check_extra("ompl", "find_way")  # only here: propagated motions need no OMPL
    return steering


def _failure(
    search: WaySearch | PropagatedSearch,
    checker: WayChecker | None,
    reduced: ReducedModel,
    ends: Array,
    budget: SearchBudget,
) -> InfeasibleError:
    """Error about a search without a way: how near it came, and what is in the way."""
    size, near = base_axes(reduced.robot.model), search.nearest.q
    text = f"no way found in {budget.elapsed:.0f} s, {budget.motions} motions checked"
    if size:
        away = float(np.linalg.norm(ends[:, :size] - near[:size], axis=1).min())
        text += f"; nearest {away:.2g} m from the goal, with the base at {np.round(near[:size], 2).tolist()}"
    if checker is not None and checker.blocks.any():
        worst = int(np.argmax(checker.blocks))
        pair, share = checker.distances.pairs[worst].label, checker.blocks[worst] / checker.blocks.sum()
        text += f"; {pair} block most motions ({share:.0%})"
    error = InfeasibleError(f"find_way: {text}")
    error.q = near
    return error
