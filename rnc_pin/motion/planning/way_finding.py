"""Global planning: a collision-free way of a reduced system from a configuration to a goal."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from typing import Annotated, NoReturn

import numpy as np
import pinocchio as pin
from annotated_types import Ge
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Bool, Float
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.constraints.wheeled_base import WheeledBase
from rnc_pin.constraints.wheels_and_blades import RollingRows
from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError, SingularityError, check_extra
from rnc_pin.model.input_validation import NotNegative, Positive, admit_configuration, check_instances, check_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget
from rnc_pin.motion.planning.exact_steering import (
    AimedSteering,
    CarSteering,
    DifferentialDrive,
    ExactMotion,
    FreeSteering,
    JointCouplings,
    Steering,
    base_axes,
)
from rnc_pin.motion.planning.inverse_kinematics import IkResult, IkSearch, TangentBounds, solve_ik
from rnc_pin.motion.planning.way import Way, WayChecker, WayInfo, drive_times, way_along, way_checker
from rnc_pin.motion.planning.way_propagation import DEVIATION, PropagatedSearch
from rnc_pin.motion.planning.way_search import SHORTER, SearchBudget, WaySearch, WayTask, base_area
from rnc_pin.robots.joint_values import limited_positions

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
_Search = WaySearch | PropagatedSearch


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
    start = admit_configuration(q0, reduced.robot, "q0")
    steering = _steering(reduced, start, settings)
    planned = ~SampledBases(reduced, start).followers() if steering is None else steering.planned
    # Nodes of propagated motions are checked with geodesics between them, which the motion leaves by this much.
    apart = clearance if steering else clearance + DEVIATION
    checker = way_checker(reduced.robot, start, obstacles, selection, apart)
    budget = SearchBudget(settings.seconds, settings.motions)
    check_configuration(reduced, checker, start, "start")
    goals = goal_configurations(goal, start, steering, reduced, checker, settings, seed)
    places = np.vstack([start, goals])
    area = base_area(reduced, 0.0 if steering is None else steering.radius, places, obstacles, checker, settings.area)
    task = WayTask(reduced, planned, checker, start, goals, area, budget)
    search = PropagatedSearch(task) if steering is None else WaySearch(steering, task)
    motion = _fastest(search, task, settings, seed)
    if motion is None:
        raise _failure(search, task)
    if steering is not None:
        motion = steering.completed(motion, start)
        # The search has moved planned joints alone: wheels and casters that follow are looked at once, at its end.
        follow = None if planned.all() else checker
        if follow is not None and not follow.holds_with(steering.along(start, motion.steps), ~planned):
            raise InfeasibleError("find_way: wheels or casters that follow collide on the way: they are not round")
    kind = "propagated" if steering is None else steering.kind
    info = WayInfo(kind, budget.elapsed, budget.motions, len(goals))
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


def _fastest(search: _Search, task: WayTask, settings: WaySettings, seed: int) -> ExactMotion | None:
    """Fastest motion that searches find until the budget is over; None for none."""
    motion = search.direct()
    if motion is not None:
        return search.shortened(motion, settings.shortcuts, seed)
    model, budget, best, shortest = task.reduced.robot.model, task.budget, None, np.inf
    tight = base_axes(model) > 0
    for attempt in count():
        first = 400  # motions of the first search, in which joints stay within the range of start and goals
        # At first the joints of a mobile robot stay within the range of start and goals: most ways need its base
        # alone, and the space of the arm's joints is much larger.
        held, most = (list(model.names)[1:], first) if tight else (settings.hold, _ATTEMPT)
        motion = search.run(held, most, seed + attempt)
        if motion is not None:
            # RRT's ways have needless detours: before they are shortened, their durations say little.
            motion = search.shortened(motion, settings.shortcuts, seed)
            duration = float(drive_times(motion.steps, task.speeds).sum())
            if best is None:
                budget.limit(settings.improve)
            if duration < (1.0 - SHORTER) * shortest:
                best, shortest = motion, duration
        tight = tight and best is not None  # what led to a way may lead to a faster one
        if budget.is_over:
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


def _failure(search: _Search, task: WayTask) -> InfeasibleError:
    """Error about a search without a way: how near it came, and what is in the way."""
    size, near, checker = base_axes(task.reduced.robot.model), search.nearest, task.checker
    text = f"no way found in {task.budget.elapsed:.0f} s, {task.budget.motions} motions checked"
    if size:
        away = float(np.linalg.norm(task.goals[:, :size] - near[:size], axis=1).min())
        text += f"; nearest {away:.2g} m from the goal, with the base at {np.round(near[:size], 2).tolist()}"
    if checker is not None and checker.blocks.any():
        worst = int(np.argmax(checker.blocks))
        pair, share = checker.distances.pairs[worst].label, checker.blocks[worst] / checker.blocks.sum()
        text += f"; {pair} block most motions ({share:.0%})"
    error = InfeasibleError(f"find_way: {text}")
    error.q = near
    return error


# ------------------------------------------------------------------ goals

_DRAWN = 4  # random starts for each further goal configuration


def check_configuration(reduced: ReducedModel, checker: WayChecker | None, q: Array, what: str) -> None:
    """Raise an error if a configuration is beyond a limit or too near to something."""
    problem = _problem_of(reduced, checker, q)
    if problem:
        raise InfeasibleError(f"find_way: the {what} {problem}")


def _problem_of(reduced: ReducedModel, checker: WayChecker | None, q: Array) -> str:
    """Text about a configuration that is beyond a limit or too near to something; "" for others."""
    bounds = TangentBounds(reduced.robot)
    moved = np.abs(bounds.clip(q) - q)
    rounding = 1e-9  # [rad or m]; inverse kinematics and integrations end at a limit to rounding
    if moved.max() > rounding:
        worst = int(np.flatnonzero(bounds.q_index == int(np.argmax(moved)))[0])
        name = reduced.robot.velocity_names[int(bounds.v_index[worst])]
        return f"is beyond the position limit of joint '{name}' by {moved.max():.3g}"
    near = None if checker is None else checker.violation(q)
    return "" if near is None else f"is too near: {near[0]} are {near[1]:.3g} m apart"


def goal_configurations(
    goal: Mapping[OutputTarget, ArrayLike] | ArrayLike,
    start: Array,
    steering: Steering | None,
    reduced: ReducedModel,
    checker: WayChecker | None,
    settings: WaySettings,
    seed: int,
) -> Float[Array, "n nq"]:
    """Configurations (n, nq) that reach a goal, without collisions, in half of the time of the settings.

    Args:
        goal: values by output, or a configuration (nq,).
        start: start (nq,).
        steering: exact steering; None if motions are propagated.
        reduced: the model.
        checker: check of motions.
        settings: settings of the search.
        seed: seed of random starts.
    """
    if not isinstance(goal, Mapping):
        end = admit_configuration(goal, reduced.robot, "goal")
        check_configuration(reduced, checker, end, "goal")
        return end[None]
    beside = None
    if checker is not None and checker.distances.obstacles:
        # Obstacles alone repel: links that touch each other at a goal are left to the check below.
        beside = CollisionDistances(reduced.robot, checker.distances.obstacles, PairSelection(links=False))
    begun, found, why = time.monotonic(), list[Array](), ""
    # The check asks for one tolerance beyond the clearance; at its very limit, rounding would decide about a goal.
    clearance = 0.0 if checker is None else checker.clearance + 2 * checker.tolerance

    low, high = np.clip(TangentBounds(reduced.robot, settings.hold).room(start), -np.pi, np.pi)

    def drawn(generator: np.random.Generator) -> Array:
        """Random configuration near the start: joints within their limits, and not at them."""
        return np.asarray(pin.integrate(reduced.robot.model, start, generator.uniform(low, high)))

    def reached(begin: Array, starts: int, besides: CollisionDistances | None = None) -> tuple[IkResult, Array, str]:
        """Result of inverse kinematics, its configuration as the end of an exact motion, and the problem with it."""
        search = IkSearch(starts=starts, seed=seed)
        result = solve_ik(
            reduced, begin, goal, hold=settings.hold, search=search, collisions=besides, clearance=clearance
        )
        q = np.array(result.q) if steering is None else steering.prepared(result.q)
        return result, q, _problem_of(reduced, checker, q)

    def same_problem() -> str:
        """Problem that configurations from random starts share: the goal leaves no choice; "" if they differ."""
        generator, problems = np.random.default_rng(seed), set[str]()
        alike = 3  # random configurations at a goal with the same distance to the same obstacle: all others have it too
        for _ in range(alike):
            result, _, problem = reached(drawn(generator), 20)
            if not result.converged:
                return ""
            problems.add(problem)
        return problems.pop() if len(problems) == 1 else ""

    generator = np.random.default_rng(seed)
    for attempt in count():
        # A goal that few configurations reach is satisfied with one.
        enough = settings.goals if attempt < _DRAWN * settings.goals else 1
        if len(found) >= enough or (attempt and time.monotonic() - begun > settings.seconds / 2):
            break
        begin = drawn(generator) if attempt else start
        # One descent from each random start: a start that fails is replaced by the next one.
        result, q, problem = reached(begin, 1 if attempt else 20, beside)
        # A goal inside an obstacle is refused at once: random starts would take all of the time in vain.
        if not attempt and (problem or not result.converged) and (same := same_problem()):
            raise InfeasibleError(f"find_way: the goal {same}")
        if not result.converged:
            why = why or f"no configuration reaches {', '.join(result.unreachable) or 'the goal beside obstacles'}"
            continue
        why = problem and f"the goal {problem}"
        # The same configuration twice would take a tree of its own in the search, and give no choice.
        if not problem and all(np.abs(q - other).max() > 1e-3 for other in found):
            found.append(q)
    if not found:
        raise InfeasibleError(f"find_way: {why}")
    return np.array(found)


# ------------------------------------------------------------------ steering that the rows allow

_SAMPLES = 6  # random configurations at which the rows are compared
_EXACT = 1e-9  # largest difference of unit vectors that counts as rounding


def find_steering(reduced: ReducedModel, q0: Float[Array, " nq"], *, room: float = 0.0) -> Steering:
    """Find the exact steering that the constraint rows of a reduced system allow.

    Random configurations decide, so that a property that holds there holds everywhere.

    Args:
        reduced: the model.
        q0: a configuration (nq,).
        room: part of the range of a car's steering joint that stays free at each end, e.g. for feedback.

    Raises:
        ConfigurationError: no exact steering is known: trailers, momentum rows, closed loops, or rows that prescribe a
            motion.

    Example:
        >>> robot = rnc.Robot.from_urdf("car.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")])
        >>> steering = rnc.planning.find_steering(system.reduce(), robot.configuration())
        >>> steering.kind
        'car'
    """
    if reduced.affine:
        _unknown(reduced, "its rows prescribe a motion")
    samples = SampledBases(reduced, q0)
    if samples.couplings.unknown:
        _unknown(reduced, f"row '{samples.couplings.unknown[0]}' couples joints")
    planned = ~samples.followers()
    places = np.flatnonzero(planned)
    if reduced.r == len(places):
        return FreeSteering(reduced, planned)  # as many free directions as planned velocities
    if reduced.robot.model.joints[1].shortname() != "JointModelPlanar":
        _unknown(reduced, "the rows restrict joints other than a planar base")
    base = WheeledBase(reduced, next(each.name for each in reduced.robot.model.frames if each.parentJoint == 1))
    rows = [np.linalg.svd(R[places])[0][:, reduced.r :] for R in samples.bases]  # that all velocities satisfy
    if any(np.abs(each[~np.isin(places, [0, 1, 2, *base.resting])]).max(initial=0.0) > _EXACT for each in rows):
        _unknown(reduced, "the rows couple the base with other joints")
    motion, count = base.at(q0), len(places) - reduced.r
    steering = [joint for joint in base.steering if planned[joint]]
    if motion.free.shape[1] == 2 and count - 1 == len(steering) <= 1:
        row = np.linalg.svd(motion.moving[base.base] @ motion.free)[0][:, 2]  # of the axle without pivots
        if np.hypot(row[0], row[1]) < 1e-6:
            _unknown(reduced, "the base cannot turn")
        if count == 1:
            return DifferentialDrive(reduced, planned, row)
        return CarSteering(reduced, planned, row, steering[0], q0, room)
    one_by_one = len(motion.guides) <= len(base.pivots) and {*steering} <= {*base.pivots}
    ranges = (base.upper - base.lower)[base.pivots]
    if motion.free.shape[1] < 3 or not one_by_one or ranges.min() < np.pi:
        _unknown(reduced, "the motion of the base is not that of a car with one steering joint, or of steered drives")
    return AimedSteering(reduced, planned, base, q0)


def _unknown(reduced: ReducedModel, why: str) -> NoReturn:
    raise ConfigurationError(
        f"no exact steering is known for '{reduced.robot.name}': {why}. Known are arms, free bodies, differential "
        "drives, cars with one steering joint, steered drives and Mecanum bases, each with arms"
    )


class SampledBases:
    """Random configurations within the limits, and bases R (nv, r) of the velocities that the rows allow there."""

    def __init__(self, reduced: ReducedModel, q0: Array) -> None:
        self._reduced, self._model, self.couplings = reduced, reduced.robot.model, JointCouplings(reduced)
        self._limited = limited_positions(reduced.robot, None).v
        self._generator = np.random.default_rng(0)  # the kind of a robot's steering does not depend on a seed
        self._q, self.bases = [np.array(q0)], [np.array(reduced.at(q0).R)]
        for _ in range(_SAMPLES - 1):
            with suppress(SingularityError):  # fewer samples decide then: the rows are rarely singular
                q = reduced.random_configuration(self._generator)
                self.bases.append(np.array(reduced.at(q).R))
                self._q.append(q)

    def followers(self) -> Bool[Array, " nv"]:
        """Mask of joints that follow: those of couplings, and those without limits whose motion others determine.

        Among these are wheels, on whose angles no row depends, and casters, whose angles matter for themselves alone.
        """
        found = np.isin(np.arange(self._model.nv), self.couplings.velocities)
        size = -1
        # A wheel below a caster follows only when the caster does: repeat until no joint is added.
        while size < found.sum():
            size = int(found.sum())
            for joint in list(self._model.joints)[1:]:
                if joint.nv != 1 or found[joint.idx_v] or joint.idx_v in self._limited:
                    continue
                # Its motion has to follow from the others: without it, the rest still spans all motions.
                rest = ~found
                rest[joint.idx_v] = False
                if all(np.linalg.matrix_rank(R[rest], tol=_EXACT) == R.shape[1] for R in self.bases):
                    rows = rest if self._is_caster(joint) else slice(None)
                    found[joint.idx_v] = not self.matters(int(joint.idx_v), rows)
        return found

    def _is_caster(self, joint: pin.JointModel) -> bool:
        """True if a wheel that a joint carries trails it by less than its diameter: it turns round below the base."""
        position = self._reduced.at(self._q[0]).position
        wheels = [block for block, *_ in self._reduced.all_constraints.places if isinstance(block, RollingRows)]
        levers = [np.linalg.norm(position.jacobian(each.frame)[:3, joint.idx_v]) / each.radius for each in wheels]
        return bool(min(levers, default=np.inf) < 2.0)

    def matters(self, index: int, rows: slice | Bool[Array, " nv"]) -> bool:
        """True if the velocities that the rows allow depend on a joint.

        Args:
            index: velocity of the joint.
            rows: velocities that count.
        """
        for q, R in zip(self._q, self.bases, strict=True):
            step = np.zeros(self._model.nv)
            step[index] = self._generator.uniform(0.05, 0.5)
            try:
                other = self._reduced.at(self.couplings.applied(pin.integrate(self._model, q, step))).R
            except SingularityError:
                return True
            if np.abs(_projector(other[rows]) - _projector(R[rows])).max() > _EXACT:
                return True
        return False


def _projector(R: Array) -> Array:
    """Projector on the space of the columns, which are dependent if only some rows are taken."""
    U, sizes, _ = np.linalg.svd(R, full_matrices=False)
    span = U[:, sizes > 1e-9 * max(float(sizes[0]), 1e-300)]
    return np.asarray(span @ span.T)
