"""Navigation: follow a way to a goal, wait for what crosses it, give way, and take another one where it is blocked."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from typing import ClassVar

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.collision import Obstacle, PairSelection
from rnc_pin.control.controller import DescribedMixin, Description, MissedGoal, VelocityTarget, elapsed_time
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model.parameter_types import NotNegative
from rnc_pin.model.reduced_kinematics import Measurement
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.optimal.bounds import Goal, GoalRows
from rnc_pin.optimal.giving_way import GivingWay, Refuge
from rnc_pin.optimal.way_following import (
    DriveChecks,
    NavigationState,
    Status,
    WayFollower,
    WayFollowing,
    WayProgress,
)
from rnc_pin.planning.action_models import KinematicModel
from rnc_pin.planning.way import Way
from rnc_pin.planning.way_finding import WayFinder, WaySettings

_SETTLE = 0.5  # [s] at rest until the measured configuration counts
_END = 1e-9  # [s] before a time that counts as the time
_APART = 0.5  # [s] along the way between places at which the robot may stop for something
_LONGER = 0.5  # [s] that another plan has to be free for longer, if nothing better is found
_IRREGULAR = 1e-3  # relative difference of steps after which predictions begin anew
_STEP = 0.02  # [s]; time of a step of predictions before the first step
_ALWAYS = 1e9  # [s]; searches end by motions, not by time

_DRIVES: Container[Status] = ("following", "waiting", "stopping", "giving way")


class NavigationController(DescribedMixin):
    """Follow a way to a goal, wait or stop before it is blocked, and search for another one: a kinematic controller.

    A search is that of ``rnc.planning.find_way``, for systems with exact steering. While the robot stands, each step
    makes one slice of it. Then it follows the way within an acceleration, with feedback in proportion to its speed. It
    stops at the nodes where the velocity of the way jumps. Where it can stop depends on the acceleration alone:
    ``v^2 / (2 a)``.

    ``set_obstacles`` changes the world. If the rest of the way is no longer free, the robot brakes on the way, and
    searches from where it stops.

    Obstacles with a motion count where they will be. The robot always has a plan, to drive to a place and to stand
    there, which nothing reaches until the horizon: bounds show it, between the steps too. As time goes on, each look
    shows the next part. Where something reaches the plan, the robot waits at another place of its way, or gives way:
    it backs off, or drives to a drawn place, and searches for a way to its goal again. What appears nearer than the
    robot can stop, or leaves it no place to go, cannot be avoided; ``reason`` says so.

    Each part of the way has a clearance. A robot that is farther than ``tube`` from it stops and plans again from where
    it is; so the clearance should cover the tube.

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
        status: of the last step: "following", "waiting", "stopping", "replanning", "giving way", "no way" or "arrived".
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
        self._model = KinematicModel(reduced)
        self._rows = GoalRows(self._model, goal, at_rest=False)
        self._reference = reduced.robot.configuration() if isinstance(goal, Mapping) else np.array(goal, dtype=float)
        self._finder = WayFinder(
            reduced,
            self._reference,
            selection=selection,
            clearance=clearance,
            settings=replace(settings, seconds=_ALWAYS, motions=settings.motions or self.search.motions),
        )
        if self._finder.steering is None:
            raise ConfigurationError(
                "navigation: no exact steering is known for this system, see rnc.planning.find_steering"
            )
        self._follower = WayFollower(self._model, self._finder.planned, following)
        self._running: tuple[tuple[object, ...], int, Iterator[Way | Refuge | None]] | None = None
        self._world = -1
        self.set_obstacles(obstacles)
        self._searched_world = self._world, self._obstacles
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
        self._checks = DriveChecks(self._follower, self._obstacles, self.clearance)

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
        return NavigationState(self._follower.standing(q), start=q, since=_STEP)

    def step(
        self, t: float, measurement: Measurement, state: NavigationState
    ) -> tuple[VelocityTarget, NavigationState]:
        q, since = np.asarray(measurement.q, dtype=float), elapsed_time(t, state.t)
        progress = self._follower.moved(state.way, state.progress, state.end, since)
        if abs(since - state.since) > _IRREGULAR * since and not state.threat:
            state = state._replace(safe=-np.inf)  # what was predicted had other steps
        state = state._replace(t=t, progress=progress, since=since or state.since)
        if state.status in _DRIVES:
            state = self._along(t, q, state)
        elif state.status == "no way":
            later = t >= state.begin + self.following.check - _END
            if state.world != self._world or (later and self._checks.have_moved(state.begin, t)):
                state = self._begun(t, state.start, state)
        elif state.status == "arrived" and t >= state.begin + _SETTLE and self.missed_goals(q, measurement.v2):
            state = self._begun(t, q, state)
        watched, seen, state = state.watched, state.seen, self._watched(t, state)
        alone = state.watched != watched  # a look at the whole horizon takes a step of its own
        if state.threat:
            state = state if alone else self._avoided(t, state)
        elif state.status == "replanning" and not (alone and seen < t - since - _END):  # but not each step
            state = self._searched(t, state)
        self.status, self.reason = state.status, state.reason
        v2, v2_dot = self._follower.command(state.way, state.progress, q)
        return VelocityTarget(v2=v2, v2_dot=v2_dot), state

    def _errors(self, q: Array) -> dict[str, float]:
        """Errors of a configuration by name of the goal's rows [m or rad]."""
        errors = self._rows.errors(q)
        if self._rows.configuration is None:
            return errors
        return {name: errors[name] for name, planned in zip(errors, self._finder.planned, strict=True) if planned}

    # ------------------------------------------------------------------ the world

    def _crossing(
        self, t: float, end: float, state: NavigationState, first: float = -np.inf, last: float = np.inf
    ) -> tuple[str, float]:
        """Obstacle that crosses a drive to a place, or the robot that stands there, and when; "" for none."""
        drive = self._follower.predicted(state.way, state.progress, end, state.since)
        return self._checks.crossing(t, state.way, drive, max(first, t), last)

    def _watched(self, t: float, state: NavigationState) -> NavigationState:
        """State after a look at what comes towards the robot, at the part of the horizon that it has not seen."""
        new = state.watched != self._world
        if not new and (t < state.seen + self.following.check - _END or (state.threat and t < state.safe)):
            return state
        first = t if new or state.threat else state.safe
        name, at = self._crossing(t, state.end, state, first)
        tries = state.tries if name == state.threat else 0
        state = state._replace(watched=self._world, seen=t, threat=name, tries=tries)
        return state._replace(safe=at if name else t + self.following.horizon)

    # ------------------------------------------------------------------ along the way

    def _along(self, t: float, q: Array, state: NavigationState) -> NavigationState:
        """State that follows its way, waits on it, or leaves it."""
        lost = state.status == "stopping" and not len(state.start)
        if not lost and self._follower.away(state.way, state.progress.place, q) > self.following.tube:
            return self._stopping(t, "the robot is off its way", state)._replace(start=np.empty(0))
        if not lost and state.world != self._world:
            state = self._looked(t, state)
        if state.status == "stopping" and not state.progress.speed:
            return self._stopped(t, q, state)
        if state.status == "waiting" and not state.threat:
            state = self._waited(t, state)
        if state.progress.place >= state.end and not state.threat:
            if state.status == "following":
                return state._replace(status="arrived", begin=t)
            if state.status == "giving way":
                return self._begun(t, self._follower.at(state.way, state.end)[0], state)
        return state

    def _looked(self, t: float, state: NavigationState) -> NavigationState:
        """State after a look at other obstacles that stand: the robot stops on its way, or drives on."""
        free = self._checks.is_free(state.way, state.progress.place, state.way.end)
        state = state._replace(world=self._world)
        if state.status == "stopping" and free:
            return state._replace(status="following", begin=t, end=state.way.end, safe=t, reason="")
        if state.status == "stopping" or free:
            return state
        braked = self._follower.braked(state.way, state.progress)
        late = not self._checks.is_free(state.way, state.progress.place, braked)
        return self._stopping(t, f"the way is blocked{' nearer than the robot can stop' if late else ''}", state)

    def _waited(self, t: float, state: NavigationState) -> NavigationState:
        """State that goes on if nothing crosses the way any more, or takes another one if it stays blocked."""
        if t >= state.begin + state.tries * self.following.horizon:
            name = self._checks.stays_blocked(t, state.way, state.end)
            if name:
                return self._stopping(t, f"{name} will block the way", state)
            return state._replace(tries=state.tries + 1)
        halfway = state.seen + 0.5 * self.following.check - _END  # between the looks at what comes to the robot
        if not t - state.since < halfway <= t or self._crossing(t, state.way.end, state)[0]:
            return state
        return self._driving(t, state.way.end, state)

    def _driving(self, t: float, end: float, state: NavigationState, safe: float = np.inf) -> NavigationState:
        """State that drives to a place of its way, at which nothing reaches it until a time, or the horizon."""
        status: Status = "following" if end >= state.way.end else "waiting"
        reason = f"waits for {state.threat}" if status == "waiting" else ""
        if state.status == "giving way":
            status, reason = state.status, state.reason
        begin = state.begin if status == state.status else t
        state = state._replace(status=status, begin=begin, end=end, reason=reason, threat="", tries=0)
        return state._replace(safe=min(safe, t + self.following.horizon), seen=t)

    def _avoided(self, t: float, state: NavigationState) -> NavigationState:
        """State that has looked for another place to stop, on its way or elsewhere.

        A robot that drives keeps its plan until a better one is found.
        """
        drives = state.progress.place < state.end
        if state.status in ("following", "waiting") or (state.status == "giving way" and drives):
            choices = self._choices(t, state)
            if state.tries < len(choices):
                end, safe = choices[state.tries]
                if self._crossing(t, end, state, last=safe)[0]:
                    return state._replace(tries=state.tries + 1)
                return self._driving(t, end, state, safe)
            state = state._replace(tries=0)
        if drives or (state.status == "stopping" and not len(state.start)):
            return state
        return self._given_way(t, state)

    def _choices(self, t: float, state: NavigationState) -> list[tuple[float, float]]:
        """Places of the way at which a robot could stop, and times until which nothing may reach it there.

        A robot that drives also stops where it is reached later than now. One that does not give way yet stops where it
        has half of the horizon for giving way.
        """
        drives, horizon = state.progress.place < state.end, self.following.horizon
        braked = self._follower.braked(state.way, state.progress)
        first, half = (t + horizon, state.safe + _LONGER)[: 1 + drives], (t + 0.5 * horizon,) * drives
        ahead = np.arange(braked + _APART, min(braked + horizon, state.way.end), _APART).tolist()
        now, last = [braked] * drives, [state.way.end] * (state.end < state.way.end)
        found = [*product(last, first[:1]), *product(now, first), *product(ahead, first)]
        return found if state.status == "giving way" else [*found, *product([*now, *ahead], half)]

    def _given_way(self, t: float, state: NavigationState) -> NavigationState:
        """State of a robot at rest after one slice of the search for a place where nothing reaches it."""
        if state.status != "giving way" or state.slices < 0 or state.world != self._world:
            state = state._replace(status="giving way", begin=t, end=state.progress.place, world=self._world)
            state = state._replace(slices=0, searches=state.searches + 1, reason=f"gives way to {state.threat}")
        found = self._slice(state)
        state = state._replace(slices=state.slices + 1)
        if not isinstance(found, Refuge):
            late = f"{state.threat} comes nearer than the robot can avoid"
            return state._replace(reason=late) if t >= state.safe else state
        away = state._replace(way=found.way, progress=WayProgress(), end=found.way.end, slices=-1)
        if self._crossing(t, away.end, away, last=found.free)[0]:
            return state
        return self._driving(t, away.end, away, found.free)

    def _stopping(self, t: float, reason: str, state: NavigationState) -> NavigationState:
        end = self._follower.braked(state.way, state.progress)
        start = self._follower.at(state.way, end)[0]
        return state._replace(status="stopping", begin=t, end=end, safe=t, threat="", start=start, reason=reason)

    def _stopped(self, t: float, q: Array, state: NavigationState) -> NavigationState:
        """State that begins to search where the robot stands."""
        if len(state.start):
            return self._begun(t, state.start, state)
        if state.progress.rate or t < state.begin + _SETTLE:  # the measured configuration counts after it has settled
            return state
        here = self._follower.standing(q)
        return self._begun(t, q, state._replace(way=here, progress=WayProgress(), end=0.0, safe=t))

    # ------------------------------------------------------------------ the search

    def _begun(self, t: float, start: Array, state: NavigationState, ahead: float | None = None) -> NavigationState:
        """State that searches from a configuration, beside obstacles as they will stand at the horizon."""
        posed = t + (self.following.horizon if ahead is None else ahead)
        self._searched_world = self._world, self._obstacles
        state = state._replace(slices=0, searches=state.searches + 1, world=self._world, posed=posed, least_slices=0)
        return state._replace(status="replanning", begin=t, start=np.array(start))

    def _renewed(self, t: float, state: NavigationState) -> NavigationState:
        """State of a search after a change of the world.

        The search begins again, but each time only after twice as many slices. So one of them ends, however often the
        world changes. Its way counts if it is free in the world of now.
        """
        if state.slices < 0:
            if self._checks.is_free(state.way, 0.0, state.way.end):
                return state._replace(world=self._world)
        elif state.slices < state.least_slices:
            return state
        least = max(state.least_slices, 2 * state.slices)
        return self._begun(t, state.start, state)._replace(least_slices=least)

    def _searched(self, t: float, state: NavigationState) -> NavigationState:
        """State after one slice of the search, or at the start of the way that it found."""
        if state.world != self._world:
            state = self._renewed(t, state)
        if state.slices < 0:
            name = self._crossing(t, state.way.end, state)[0]
            if not name:
                return self._driving(t, state.way.end, state)
            return state._replace(status="waiting", begin=t, tries=0, reason=f"waits for {name}")
        try:
            way = self._slice(state)
        except RncError as error:
            if self._checks.moving is not None and state.posed > t:  # not before the horizon, but perhaps now
                return self._begun(t, state.start, state, 0.0)
            return state._replace(status="no way", begin=t, reason=str(error))
        if not isinstance(way, Way):
            return state._replace(slices=state.slices + 1)
        followed = self._follower.followed(way)
        state = state._replace(way=followed, progress=WayProgress(), end=0.0, ways=state.ways + 1, slices=-1)
        return self._searched(t, state) if self._checks.moving is None else state

    def _slice(self, state: NavigationState) -> Way | Refuge | None:
        """Result of the next slice of a search; a state from elsewhere repeats the slices before it."""
        key = state.status, state.world, state.posed, state.start.tobytes(), state.searches
        if self._running is None or self._running[:2] != (key, state.slices):
            slices = self._slices(state)
            for _ in range(state.slices):
                next(slices)
            self._running = key, state.slices, slices
        slices = self._running[2]
        self._running = key, state.slices + 1, slices
        return next(slices)

    def _slices(self, state: NavigationState) -> Iterator[Way | Refuge | None]:
        """Search for a way to the goal, or for a place to give way."""
        seed, size = self.seed + state.searches, self.following.slice_size
        if state.status == "giving way":
            still = self._finder.among([each for each in self._obstacles if each.motion is None])
            giving = GivingWay(still, self._checks, self._follower, self.following)
            return giving.slices(state.begin, state.since, state.safe, (state.way, state.progress.place), seed)
        world, obstacles = self._searched_world
        known = obstacles if world == state.world else self._obstacles
        finder = self._finder.among([each.at_rest(state.posed) for each in known])
        return _best(finder.slices(state.start, self.goal, seed, size))


def _best(slices: Iterator[Way | None]) -> Iterator[Way | None]:
    """None for each slice of a search, then the last way that it found."""
    best = None
    for way in slices:
        best = way or best
        yield None
    yield best
