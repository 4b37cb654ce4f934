"""Navigation: follow a way to a goal, wait for what crosses it, stop before what blocks it, and take another one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.control.controller import DescribedMixin, Description, MissedGoal, VelocityTarget, elapsed_time
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model.parameter_types import NotNegative
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.optimal.action_models import KinematicModel
from rnc_pin.optimal.bounds import Goal, GoalRows
from rnc_pin.optimal.way_following import FollowedWay, WayFollower, WayFollowing, WayProgress
from rnc_pin.planning.exact_steering import ExactMotion
from rnc_pin.planning.way import Way
from rnc_pin.planning.way_checking import WayChecker
from rnc_pin.planning.way_finding import WayFinder, WaySettings

_MOVED = 1e-3  # [m or rad]; an obstacle that is farther from where it was seen has moved
_SETTLE = 0.5  # [s] at rest until the measured configuration counts
_END = 1e-9  # [s] before a time that counts as the time
_STEP = 0.02  # [s]; time of a step of predictions before the first step
_ALWAYS = 1e9  # [s]; searches end by motions, not by time

Status = Literal["following", "waiting", "stopping", "replanning", "no way", "arrived"]


class NavigationState(NamedTuple):
    """Way, the place on it, and the search for the next one."""

    status: Status
    """"following" a way, "waiting" or "stopping" on it, "replanning" at rest, "no way", or "arrived"."""
    t: float | None
    """Time of the last step [s]."""
    begin: float
    """Time at which the status began [s]."""
    way: FollowedWay
    progress: WayProgress
    since: float
    """Time between the last steps [s]."""
    end: float
    """Place at which the robot stops."""
    doubt: float | None
    """Place that is crossed, for which the robot brakes, until the next step decides where it waits."""
    world: int
    """Number of the obstacles that were set last, as far as the way was checked."""
    seen: float
    """Time at which obstacles that move were seen [s]."""
    posed: float
    """Time of the poses of these obstacles in the search [s]."""
    start: Float[Array, " s"]
    """Configuration from which the search starts; empty if the measured one counts, after the stop."""
    slices: int
    """Slices of the search that were made."""
    searches: int
    ways: int
    reason: str
    """Why the robot does not follow a way; "" if it does."""


class NavigationController(DescribedMixin):
    """Follow a way to a goal, wait or stop before it is blocked, and search for another one: a kinematic controller.

    A search is that of ``rnc.planning.find_way``, for systems with exact steering. While the robot stands, each step
    makes one slice of it. Then it follows the way within an acceleration, with feedback in proportion to its speed. It
    stops at the nodes where the velocity of the way jumps. Where it can stop depends on the acceleration alone:
    ``v^2 / (2 a)``.

    ``set_obstacles`` changes the world. If the rest of the way is no longer free, the robot brakes on the way, and
    searches from where it stops. Obstacles with a motion count where they will be: the drive along the way is predicted
    until the horizon, and bounds show that it is free, between the steps too. Else the robot waits at a place of its
    way that nothing reaches, and goes on as soon as the prediction is free. If the way is not free at the
    horizon either, the robot takes another one. What appears nearer than the robot can stop, or moves into a robot at
    rest, cannot be avoided; ``reason`` says so.

    Each part of the way is shown to be free before the robot is on it, with a clearance. A robot that is farther than
    ``tube`` from it stops and plans again from where it is; so the clearance should cover the tube.

    In ``rnc.VelocityLoop``, it drives a robot of your own; trackers, such as ``VelocityTracker``, give forces. Reads
    from the measurement ``q, v2``. One state at a time. The same measurements give the same commands: searches end by
    numbers of motions, and their slices by counted efforts.

    Args:
        reduced: the model.
        goal: values by output, or a configuration (nq,).
        obstacles: obstacles at the start.
        selection: rules for pairs of links.
        clearance: smallest distance of the way to obstacles [m].
        settings: settings of the search; its ``seconds`` do not count.
        following: settings of the motion along the way.
        seed: seed of the searches.

    Attributes:
        search: default settings of the searches.
        status: of the last step: "following", "waiting", "stopping", "replanning", "no way" or "arrived".
        reason: why the robot does not follow a way.

    Raises:
        ConfigurationError: the system has no exact steering, or an argument is out of range.
        InputError: wrong shapes.

    Example:
        >>> import coal
        >>> robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
        >>> goal = {rnc.FramePosition("axle", "xy"): [3.0, 0.0], rnc.FrameYaw("axle"): 0.0}
        >>> wall = rnc.collision.Obstacle(coal.Box(0.1, 3.0, 2.0), position=(1.5, 0.0, 0.0), name="wall")
        >>> controller = rnc.control.NavigationController(reduced, goal, [wall])
        >>> measured = reduced.at(robot.configuration(), np.zeros(3)).measure(np.zeros(3))
        >>> state = controller.initial_state(measured)
        >>> while controller.status == "replanning":
        ...     target, state = controller.step(0.0, measured, state)
        >>> controller.status, target.v2
        ('following', array([0., 0., 0.]))
    """

    described = ("clearance", "seed")
    search: ClassVar[WaySettings] = WaySettings(seconds=_ALWAYS, motions=20_000, improve=100)

    def __init__(
        self,
        reduced: ReducedModel,
        goal: Goal,
        obstacles: Sequence[Obstacle] = (),
        *,
        selection: PairSelection | None = None,
        clearance: NotNegative = 0.05,
        settings: WaySettings = search,
        following: WayFollowing = WayFollowing(),  # noqa: B008
        seed: int = 0,
    ) -> None:
        self.clearance, self.following, self.seed, self.goal = clearance, following, seed, goal
        motions = self.search.motions if settings.motions is None else settings.motions
        self._model = KinematicModel(reduced)
        self._rows = GoalRows(self._model, goal, at_rest=False)
        self._reference = reduced.robot.configuration() if isinstance(goal, Mapping) else np.array(goal, dtype=float)
        self._finder = WayFinder(
            reduced,
            self._reference,
            selection=selection,
            clearance=clearance,
            settings=replace(settings, seconds=_ALWAYS, motions=motions),
        )
        if self._finder.steering is None:
            raise ConfigurationError(
                "navigation: no exact steering is known for this system, see rnc.planning.find_steering"
            )
        self._planned = self._finder.planned
        self._follower = WayFollower(self._model, self._planned, following)
        self._running: tuple[tuple[int, float, bytes, int], int, Iterator[Way | None]] | None = None
        self._world = -1
        self.set_obstacles(obstacles)
        self.status: Status = "replanning"
        self.reason = ""

    def __getstate__(self) -> dict[str, object]:
        """State for copies, without the search that runs: they repeat it from the state of the controller."""
        return {**vars(self), "_running": None}

    def describe(self) -> Description:
        """Return the type and all settings."""
        return {**super().describe(), **asdict(self.following)}

    def set_obstacles(self, obstacles: Sequence[Obstacle]) -> None:
        """Replace the obstacles; the next step checks the rest of the way among them.

        Args:
            obstacles: all obstacles that are known now.
        """
        self._obstacles, self._world = tuple(obstacles), self._world + 1
        self._standing, self._moving = (
            self._checker([each for each in obstacles if (each.motion is not None) == moves]) for moves in (False, True)
        )

    def _checker(self, obstacles: Sequence[Obstacle]) -> WayChecker | None:
        """Check of the way beside obstacles; the search has checked the links against each other."""
        if not obstacles:
            return None
        robot, links = self._model.reduced.robot, PairSelection(links=False)
        return WayChecker(CollisionDistances(robot, obstacles, links), self.clearance)

    def missed_goals(self, q: Float[Array, " nq"], v2: Float[Array, " r"]) -> tuple[MissedGoal, ...]:
        """Rows of the goal that a run misses which ends in this state, for its verdict.

        Args:
            q: configuration (nq,).
            v2: reduced velocity (r,).
        """
        reason = self.reason or ("the run ends on the way" if self.status in ("following", "waiting") else "")
        return MissedGoal.of_errors(self._errors(q), self.following.tolerance, reason)

    def initial_state(self, measurement: Measurement) -> NavigationState:
        """Return a state that searches for a way from the measured configuration."""
        q = np.array(measurement.q, dtype=float)
        self.status, self.reason = "replanning", ""
        return NavigationState(
            status="replanning",
            t=None,
            begin=0.0,
            way=self._follower.standing(q),
            progress=WayProgress(),
            since=_STEP,
            end=0.0,
            doubt=None,
            world=-1,
            seen=-np.inf,
            posed=0.0,
            start=q,
            slices=0,
            searches=0,
            ways=0,
            reason="",
        )

    def step(
        self, t: float, measurement: Measurement, state: NavigationState
    ) -> tuple[VelocityTarget, NavigationState]:
        q, since = np.asarray(measurement.q, dtype=float), elapsed_time(t, state.t)
        progress = self._follower.moved(state.way, state.progress, state.end, since)
        state = state._replace(t=t, progress=progress, since=since or state.since)
        if state.status in ("following", "waiting", "stopping"):
            state = self._along(t, q, state)
        elif state.status == "replanning":
            state = self._searched(t, state)
        elif state.status == "no way" and self._is_new(t, state):
            state = self._begun(t, state.start, state)
        elif state.status == "arrived" and t >= state.begin + _SETTLE and self._is_away(q):
            state = self._begun(t, q, state)
        self.status, self.reason = state.status, state.reason
        v2, v2_dot = self._follower.command(state.way, state.progress, q)
        return VelocityTarget(v2=v2, v2_dot=v2_dot), state

    def _errors(self, q: Array) -> dict[str, float]:
        """Errors of a configuration by name of the goal's rows [m or rad]."""
        errors = self._rows.errors(q)
        if self._rows.configuration is None:
            return errors
        return {name: error for (name, error), planned in zip(errors.items(), self._planned, strict=True) if planned}

    def _is_away(self, q: Array) -> bool:
        """True if a configuration is not at the goal."""
        return max(self._errors(q).values()) > self.following.tolerance

    # ------------------------------------------------------------------ the world

    def _is_new(self, t: float, state: NavigationState) -> bool:
        """True if the obstacles are others than those that were seen last, or elsewhere."""
        if state.world != self._world:
            return True
        if self._moving is None or t < state.seen + self.following.check - _END:
            return False
        return any(_distance(each, t, state.seen) > _MOVED for each in self._moving.distances.obstacles)

    def _is_free(self, state: NavigationState, first: float, last: float) -> bool:
        """True if the way is free between two places, among obstacles that stand."""
        if self._standing is None or not len(state.way.v):
            return True
        places = self._places(state.way, first, last)
        k = np.searchsorted(state.way.time, 0.5 * (places[1:] + places[:-1]), "right") - 1
        steps = np.diff(places)[:, None] * state.way.v[k]
        return self._standing.is_free(ExactMotion(self._follower.at(state.way, places), steps))

    def _stays_blocked(self, t: float, first: float, state: NavigationState) -> str:
        """Obstacle that blocks the rest of the way from a place, as it will stand at a time; "" for none."""
        places = self._places(state.way, first, state.way.end)
        q = self._follower.at(state.way, places)
        return "" if self._moving is None else self._moving.crossing(np.full(len(places), t), q)[0]

    @staticmethod
    def _places(way: FollowedWay, first: float, last: float) -> Float[Array, " n"]:
        """Two places, and the nodes between them."""
        return np.concatenate([[first], way.time[(way.time > first + _END) & (way.time < last - _END)], [last]])

    def _crossing(self, t: float, end: float, state: NavigationState) -> tuple[str, float]:
        """Obstacle that crosses a drive to a place before the horizon, and the place of the robot then; "" for none."""
        if self._moving is None:
            return "", end
        times, places = self._follower.predicted(state.way, state.progress, end, state.since)
        name, at = self._moving.crossing(t + times, self._follower.at(state.way, places))
        return name, float(np.interp(at - t, times, places))

    # ------------------------------------------------------------------ along the way

    def _along(self, t: float, q: Array, state: NavigationState) -> NavigationState:
        """State that follows its way, waits on it, or leaves it."""
        lost = state.status == "stopping" and not len(state.start)
        if not lost and self._follower.away(state.way, state.progress.place, q) > self.following.tube:
            reason = "the robot is off its way"
            end = self._follower.braked(state.way, state.progress)
            return state._replace(status="stopping", begin=t, end=end, start=np.empty(0), reason=reason)
        looks = state.world != self._world or (
            self._moving is not None and t >= state.seen + self.following.check - _END
        )
        if not lost and looks:
            state = self._looked(t, state)
        elif state.status == "waiting" and state.doubt is not None:
            state = self._chosen(t, state.doubt, state)
        if state.status == "stopping" and not state.progress.speed:
            return self._stopped(t, q, state)
        if state.status == "following" and state.progress.place >= state.end:
            return state._replace(status="arrived", begin=t)
        return state

    def _looked(self, t: float, state: NavigationState) -> NavigationState:
        """State after a look at the world: the robot drives on, waits, or stops."""
        blocked = state.status == "stopping"  # unless the world has changed
        if state.world != self._world:
            blocked = not self._is_free(state, state.progress.place, state.way.end)
        state = state._replace(world=self._world, seen=t)
        braked = self._follower.braked(state.way, state.progress)
        if blocked:
            if state.status == "stopping":
                return state
            late = not self._is_free(state, state.progress.place, braked)
            return self._stopping(t, f"the way is blocked{' nearer than the robot can stop' if late else ''}", state)
        name, place = self._crossing(t, state.way.end, state)
        if not name:
            begin = state.begin if state.status == "following" else t
            return state._replace(status="following", begin=begin, end=state.way.end, doubt=None, reason="")
        begin = state.begin if state.status == "waiting" else t
        state = state._replace(status="waiting", begin=begin, end=braked, doubt=place)
        return state._replace(reason=f"waits for {name}")

    def _chosen(self, t: float, place: float, state: NavigationState) -> NavigationState:
        """State that waits where nothing reaches the robot, before a place that is crossed, or gives the way up."""
        state = state._replace(doubt=None)
        name = self._stays_blocked(t + self.following.horizon, state.end, state)
        if name:
            return self._stopping(t, f"{name} will block the way", state)
        between = 0.5 * (state.end + place)
        for end in [state.end, between] if between > state.end + _END else [state.end]:
            name = self._crossing(t, end, state)[0]
            if not name:
                return state._replace(end=end)
        return state._replace(reason=f"{name} comes nearer than the robot can avoid")

    def _stopping(self, t: float, reason: str, state: NavigationState) -> NavigationState:
        end = self._follower.braked(state.way, state.progress)
        start = self._follower.at(state.way, end)[0]
        return state._replace(status="stopping", begin=t, end=end, start=start, reason=reason)

    def _stopped(self, t: float, q: Array, state: NavigationState) -> NavigationState:
        """State that begins to search where the robot stands."""
        if len(state.start):
            return self._begun(t, state.start, state)
        if state.progress.rate or t < state.begin + _SETTLE:  # the measured configuration counts after it has settled
            return state
        return self._begun(t, q, state)

    # ------------------------------------------------------------------ the search

    def _begun(self, t: float, start: Array, state: NavigationState, ahead: float | None = None) -> NavigationState:
        """State that searches from a configuration, beside obstacles as they will stand at the horizon."""
        posed = t + (self.following.horizon if ahead is None else ahead)
        state = state._replace(slices=0, searches=state.searches + 1, world=self._world, seen=t, posed=posed)
        return state._replace(status="replanning", begin=t, start=np.array(start))

    def _searched(self, t: float, state: NavigationState) -> NavigationState:
        """State after one slice of the search."""
        if state.world != self._world:
            state = self._begun(t, state.start, state)
        try:
            way = self._slice(state)
        except RncError as error:
            if self._moving is not None and state.posed > t:  # not before the horizon, but perhaps now
                return self._begun(t, state.start, state, 0.0)
            return state._replace(status="no way", begin=t, reason=str(error))
        state = state._replace(slices=state.slices + 1)
        if way is None:
            return state
        followed = self._follower.followed(way)
        state = state._replace(way=followed, progress=WayProgress(), end=0.0, ways=state.ways + 1, reason="")
        return self._looked(t, state)

    def _slice(self, state: NavigationState) -> Way | None:
        """Result of the next slice of a search; a state from elsewhere repeats the slices before it."""
        key = state.world, state.posed, state.start.tobytes(), state.searches
        if self._running is None or self._running[:2] != (key, state.slices):
            finder = self._finder.among([each.at_rest(state.posed) for each in self._obstacles])
            seed, size = self.seed + state.searches, self.following.slice_size
            best = _best(finder.slices(state.start, self.goal, seed, size))
            for _ in range(state.slices):
                next(best)
            self._running = key, state.slices, best
        slices = self._running[2]
        self._running = key, state.slices + 1, slices
        return next(slices)


def _best(slices: Iterator[Way | None]) -> Iterator[Way | None]:
    """None for each slice of a search, then the last way that it found."""
    best = None
    for way in slices:
        best = way or best
        yield None
    yield best


def _distance(obstacle: Obstacle, t: float, before: float) -> float:
    """Largest change of a pose between two times [m or rad]."""
    assert obstacle.motion is not None
    now, then = (np.asarray(obstacle.motion.at(each).position) for each in (t, before))
    return float(np.abs(now - then).max())
