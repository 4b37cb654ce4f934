"""Global planning: a collision-free way of a reduced system from a configuration to a goal."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Annotated

import numpy as np
from annotated_types import Ge
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError, short_text
from rnc_pin.extras import check_extra
from rnc_pin.model.parameter_types import NotNegative, Positive, check_instances, is_count
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget
from rnc_pin.planning.action_models import KinematicFlow
from rnc_pin.planning.exact_steering import ExactMotion, Steering, base_axes
from rnc_pin.planning.steering_detection import find_steering, planned_velocities
from rnc_pin.planning.way import TimedWay, Way, WayInfo, WayTiming, way_along
from rnc_pin.planning.way_checking import WayChecker, way_checker
from rnc_pin.planning.way_goals import WayGoals, check_configuration, validated_configuration
from rnc_pin.planning.way_propagation import DEVIATION, PropagatedSearch
from rnc_pin.planning.way_search import SHORTER, SearchBudget, WaySearch, drive_times, in_slices, speed_limits
from rnc_pin.planning.way_space import base_area

_FIRST = 400  # motions of the first search, in which joints stay within the range of start and goals
_ATTEMPT = 4000  # motions of each further search, before it starts again with other random numbers
_ROOM = 0.02  # of the range of a steering joint, at each end: feedback along a way needs it
_POSED = 4  # crossings that ways lead around


@dataclass(frozen=True)
class WaySettings:
    """Settings of the search for a way.

    Attributes:
        seconds: time after which the search ends without a way [s].
        goals: largest number of configurations that are tried for a goal of outputs.
        shortcuts: number of attempts to shorten each way.
        improve: number of motions that may be checked to find faster ways after the first one.
        wait: longest time that a way waits in all for obstacles that move [s].
        motions: number of checked motions after which the search ends, whatever the time; None for any number. OMPL
            may finish an iteration, which checks a few more.
        hold: names of joints that keep their positions.
        area: smallest and largest x, y and z (2, 3) of the base [m]; by default the box around start, goals and
            obstacles, with room to turn around it.
        reverse: False if a car or a differential drive does not drive backwards, as for ``find_steering``.

    Raises:
        InputError: a number is out of range.

    Example:
        >>> rnc.planning.WaySettings(seconds=5.0, hold=["torso_lift_joint"]).shortcuts
        100
    """

    seconds: Positive = 30.0
    goals: Annotated[int, Ge(1)] = 4
    shortcuts: Annotated[int, Ge(0)] = 100
    improve: Annotated[int, Ge(0)] = 0
    motions: Annotated[int, Ge(1)] | None = None
    wait: NotNegative = 30.0
    hold: Sequence[str] = ()
    area: ArrayLike | None = None
    reverse: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.seconds < np.inf:
            raise InputError(f"seconds: expected a positive number, found {self.seconds!r}")
        if not 0.0 <= self.wait < np.inf:
            raise InputError(f"wait: expected a number of at least 0 s, found {self.wait!r}")
        counts = [("goals", self.goals, 1), ("shortcuts", self.shortcuts, 0), ("improve", self.improve, 0)]
        for name, value, least in counts + ([] if self.motions is None else [("motions", self.motions, 1)]):
            if not is_count(value, least):
                raise InputError(f"{name}: expected an integer of at least {least}, found {value!r}")


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

    Obstacles that move start at time zero, as the way does. A way waits where they cross it, as little as it has to, or
    leads around the place where they do. Bounds show that nothing comes too near until the way ends. They do not tell
    what comes to the goal later.

    The position limits of the robot's file hold. Wheels that follow end at any angle.

    Args:
        reduced: the model.
        q0: start (nq,).
        goal: values by output, as for ``solve_ik``, or a configuration (nq,).
        obstacles: obstacles, at rest or with a motion.
        selection: rules for pairs of links; by default all pairs that are not adjacent.
        clearance: smallest distance to obstacles [m]. The check has a tolerance of 1 mm, or 1 % of the largest link.
        settings: settings of the search.
        seed: seed of all random choices.

    Raises:
        ConfigurationError: OMPL is not installed, or rows prescribe a motion.
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
    finder = WayFinder(reduced, q0, obstacles, selection=selection, clearance=clearance, settings=settings)
    return list(finder.ways(q0, goal, seed))[-1]


class WayFinder:
    """Search for ways among obstacles, at once or in slices; ``find_way`` has its terms.

    Args:
        reduced: the model.
        q0: a configuration (nq,). Links that touch each other there are not checked against each other.
        obstacles: obstacles, at rest or with a motion.
        selection: rules for pairs of links.
        clearance: smallest distance to obstacles [m].
        settings: settings of the search.

    Attributes:
        steering: exact steering; None if motions are propagated.
        planned: mask (nv,) of the velocities that are planned.
        checker: check of motions beside obstacles that stand; None for a robot without geometry among none.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        q0: ArrayLike,
        obstacles: Sequence[Obstacle] = (),
        *,
        selection: PairSelection | None = None,
        clearance: float = 0.01,
        settings: WaySettings = _DEFAULT,
    ) -> None:
        if not 0.0 <= clearance < np.inf:
            raise InputError(f"clearance: expected a number of at least 0 m, found {clearance!r}")
        if not isinstance(settings, WaySettings):
            raise ConfigurationError(f"settings: expected WaySettings, found {short_text(settings)}")
        start = validated_configuration(reduced, q0)
        self._reduced, self._settings, self._reference = reduced, settings, start
        self.steering = _steering(reduced, start, settings)
        self.planned = planned_velocities(reduced, start) if self.steering is None else self.steering.planned
        self._speeds = speed_limits(reduced, self.planned)
        self._selection, self._apart = selection, clearance if self.steering else clearance + DEVIATION
        self._use(obstacles)

    def _use(self, obstacles: Sequence[Obstacle]) -> None:
        check_instances("obstacles", obstacles, Obstacle)
        self._obstacles = [each for each in obstacles if each.motion is None]
        self._moving = [each for each in obstacles if each.motion is not None]
        self.checker = way_checker(self._reduced.robot, self._reference, self._obstacles, self._selection, self._apart)

    def among(self, obstacles: Sequence[Obstacle]) -> WayFinder:
        """The same search among other obstacles."""
        other = copy(self)
        other._use(obstacles)
        return other

    def slices(
        self,
        q0: ArrayLike,
        goal: Mapping[OutputTarget, ArrayLike] | ArrayLike,
        seed: int = 0,
        slice_size: float = 100.0,
    ) -> Generator[Way | None, None, None]:
        """Search step by step: None after each slice, and each way that is faster than those before.

        Args:
            q0: start (nq,).
            goal: values by output, or a configuration (nq,).
            seed: seed of all random choices.
            slice_size: effort of a slice, about 1 for 0.1 ms. It is counted, so that slices do not depend on the
                computer.

        Raises:
            InfeasibleError: as for ``find_way``.
        """

        def work(hand: Callable[[Way | None], None]) -> None:
            for way in self.ways(q0, goal, seed, lambda: hand(None), slice_size):
                hand(way)

        return in_slices(work)

    def ways(
        self,
        q0: ArrayLike,
        goal: Mapping[OutputTarget, ArrayLike] | ArrayLike,
        seed: int = 0,
        pause: Callable[[], None] | None = None,
        slice_size: float = np.inf,
    ) -> Iterator[Way]:
        """Yield each way that is faster than those before.

        Args:
            q0: start (nq,).
            goal: values by output, or a configuration (nq,).
            seed: seed of all random choices.
            pause: called after each slice.
            slice_size: effort of a slice.

        Raises:
            InfeasibleError: as for ``find_way``.
        """
        budget = SearchBudget(self._settings.seconds, self._settings.motions, pause, slice_size)
        yield from self._timed(q0, goal, seed, budget) if self._moving else self._standing(q0, goal, seed, budget)

    def _timed(
        self, q0: ArrayLike, goal: Mapping[OutputTarget, ArrayLike] | ArrayLike, seed: int, budget: SearchBudget
    ) -> Iterator[Way]:
        """Ways among obstacles that move. One that crosses a way at any time stands there in the next search."""
        links, every = PairSelection(links=False), [*self._obstacles, *self._moving]
        moving, both = (CollisionDistances(self._reduced.robot, each, links) for each in (self._moving, every))
        wait, names = self._settings.wait, list[str]()
        timing = WayTiming(WayChecker(moving, self._apart, budget.spend), WayChecker(both, self._apart), wait)
        posed: list[Obstacle] = []
        best, timed = np.inf, TimedWay(None)
        while len(posed) <= _POSED:
            finder, again = self.among([*self._obstacles, *posed]), budget.renewed()
            try:
                for way in finder._standing(q0, goal, seed, again):
                    if way.duration < best:
                        timed = timing.timed(way)
                    if timed.way is not None and timed.way.duration < best:
                        best = timed.way.duration
                        yield timed.way
            except InfeasibleError as error:
                if not posed:
                    raise
                reason: InfeasibleError | None = error
                break
            if best < np.inf:
                return
            assert timed.crossing is not None
            names.append(timed.crossing.name)
            posed.append(replace(timed.crossing.at_rest(timed.at), name=f"{timed.crossing.name} at {timed.at:.4g} s"))
            reason = None
        crossed = ", ".join(dict.fromkeys(names))
        text = f"find_way: ways are crossed by {crossed}, and no wait of up to {wait:g} s helps"
        raise InfeasibleError(text) from reason

    def _standing(
        self, q0: ArrayLike, goal: Mapping[OutputTarget, ArrayLike] | ArrayLike, seed: int, budget: SearchBudget
    ) -> Iterator[Way]:
        """Ways among the obstacles that stand."""
        settings, reduced, checker = self._settings, self._reduced, self.checker
        start = validated_configuration(reduced, q0)
        if checker is not None:
            checker = WayChecker(checker.distances, checker.clearance, budget.spend)
        check_configuration(reduced, checker, start, "start")
        goals = WayGoals(reduced, self.steering, checker, budget, settings.goals, settings.hold)
        ends = goals.of(goal, start, seed)
        search = self._search(np.vstack([start, ends]), checker, budget)
        found, speeds, every = search.direct(), self._speeds, list(reduced.robot.model.names)[1:]
        direct, tight, attempt = found is not None, base_axes(reduced.robot.model) > 0, 0
        first, history = 0.0, list[tuple[int, float]]()
        while True:
            if found is None:
                # At first the joints of a mobile robot stay within the range of start and goals.
                held, most = (every, _FIRST) if tight else (settings.hold, _ATTEMPT)
                found = search.run(held, most, seed + attempt)
                attempt += 1
            if found is not None:
                first = first or float(drive_times(found.steps, speeds).sum())
                found = search.shortened(found, settings.shortcuts, seed)
                duration = float(drive_times(found.steps, speeds).sum())
                if not history:
                    budget.limit(settings.improve)
                if not history or duration < (1.0 - SHORTER) * history[-1][1]:
                    history.append((budget.motions, duration))
                    info = WayInfo(self._kind, budget.elapsed, budget.motions, len(ends), first, tuple(history))
                    yield self._way(found, start, checker, info)
                found = None
            tight = tight and bool(history)  # what led to a way may lead to a faster one
            if direct or budget.is_over:
                break
        if not history:
            raise _failure(search, checker, reduced, ends, budget)

    @property
    def _kind(self) -> str:
        return "propagated" if self.steering is None else self.steering.kind

    def _search(
        self, places: Float[Array, "n nq"], checker: WayChecker | None, budget: SearchBudget
    ) -> WaySearch | PropagatedSearch:
        """Search between configurations: the start and the goals."""
        radius = 0.0 if self.steering is None else self.steering.radius
        area = base_area(self._reduced, radius, places, self._obstacles, checker, self._settings.area)
        if self.steering is not None:
            return WaySearch(self.steering, checker, places, area, budget)
        flow = KinematicFlow(self._reduced)
        return PropagatedSearch(flow, self.planned, checker, places, area, self._speeds, budget)

    def along(self, motion: ExactMotion) -> Way:
        """Way along an exact motion that is free.

        Args:
            motion: motion of the planned joints.

        Raises:
            InfeasibleError: wheels that follow collide.
        """
        return self._way(motion, motion.q[0], self.checker, WayInfo(self._kind, 0.0, 0, 1, 0.0))

    def _way(self, motion: ExactMotion, start: Array, checker: WayChecker | None, info: WayInfo) -> Way:
        """Way along a motion, with the joints that follow."""
        steering = self.steering
        if steering is not None:
            motion = steering.completed(motion, start)
            follow = None if self.planned.all() else checker
            if follow is not None and not follow.holds_with(steering.along(start, motion.steps), ~self.planned):
                raise InfeasibleError("find_way: wheels that follow collide, because they are not round")
        return way_along(self._reduced, self.planned, checker, motion, info)


def _steering(reduced: ReducedModel, start: Array, settings: WaySettings) -> Steering | None:
    """Exact steering; None if none is known, so that motions have to be propagated."""
    try:
        steering = find_steering(reduced, start, reverse=settings.reverse, room=_ROOM)
    except ConfigurationError:
        if not settings.reverse:
            raise
        if reduced.affine:
            raise ConfigurationError("find_way: rows prescribe a motion, which cannot be driven backwards") from None
        if list(settings.hold):
            raise ConfigurationError(
                "find_way: hold needs an exact steering, which is not known for this system; lock these joints"
            ) from None
        return None
    check_extra("ompl", "find_way")
    for name in ("ompl.geometric", "numpy.ma"):  # here rather than in the first slice of a search, by np.unique
        import_module(name)
    return steering


def _failure(
    search: WaySearch | PropagatedSearch,
    checker: WayChecker | None,
    reduced: ReducedModel,
    ends: Array,
    budget: SearchBudget,
) -> InfeasibleError:
    """Error about a search without a way: how near it came, and what is in the way."""
    base, size, near = reduced.robot.model.joints[1], base_axes(reduced.robot.model), search.nearest.q
    text = f"no way found in {budget.elapsed:.0f} s, {budget.motions} motions checked"
    if size:
        places = slice(base.idx_q, base.idx_q + size)
        away = float(np.linalg.norm(ends[:, places] - near[places], axis=1).min())
        text += f"; nearest {away:.2g} m from the goal, with the base at {np.round(near[places], 2).tolist()}"
    if checker is not None and checker.blocks.any():
        worst = int(np.argmax(checker.blocks))
        pair, share = checker.distances.pairs[worst].label, checker.blocks[worst] / checker.blocks.sum()
        text += f"; {pair} block most motions ({share:.0%})"
    error = InfeasibleError(f"find_way: {text}")
    error.q = near
    return error
