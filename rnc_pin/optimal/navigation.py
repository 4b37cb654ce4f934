"""Navigation: follow a way to a goal, stop before what blocks it, and search for another way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float
from rnc_pin.collision import Obstacle, PairSelection
from rnc_pin.control.controller import DescribedMixin, MissedGoal, VelocityTarget, elapsed_time
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model.measurement import Measurement
from rnc_pin.model.parameter_types import NotNegative, Positive, check_positive_settings
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.optimal.action_models import KinematicModel, Nodes
from rnc_pin.optimal.bounds import Goal, GoalRows
from rnc_pin.optimal.node_data import NodeData
from rnc_pin.optimal.plan_feedback import regulator_gains
from rnc_pin.planning.exact_steering import ExactMotion
from rnc_pin.planning.way import Way
from rnc_pin.planning.way_finding import WayFinder, WaySettings

_SPACING = 0.05  # [m or rad]; largest displacement between two gains of the feedback
_MOVED = 1e-3  # [m]; a moving obstacle that is farther from where it was seen is seen again
_SETTLE = 0.5  # [s] at rest until the measured configuration counts
_SAME = 1e-9  # relative difference of velocities without a stop between them
_END = 1e-9  # [s] before a place of the way that counts as the place
_MOTIONS = 20_000  # checked motions after which a search ends without a way
_ALWAYS = 1e9  # [s]; searches end by motions, not by time
_DEFAULT = WaySettings(seconds=_ALWAYS, motions=_MOTIONS, improve=300)

Status = Literal["following", "stopping", "replanning", "no way", "arrived"]


class NavigationState(NamedTuple):
    """Way with its feedback, the place on it, and the search for the next one."""

    status: Status
    """"following" a way, "stopping" on it, "replanning" at rest, "no way", or "arrived"."""
    t: float | None
    """Time of the last step [s]."""
    begin: float
    """Time at which the status began [s]."""
    time: Float[Array, " n"]
    """Times of the nodes of the way, at its largest speeds [s]; places are given by it."""
    q: Float[Array, "n nq"]
    v: Float[Array, "k nv"]
    places: Float[Array, " m"]
    """Places of the gains."""
    gains: Float[Array, "m r nv"]
    place: float
    """Place at which the robot should be."""
    speed: float
    """Its rate: 1 at the largest speeds of the way."""
    rate: float
    """Rate of the speed in the last step [1/s]."""
    end: float
    """Place at which the robot stops."""
    world: int
    """Number of the obstacles that were set last, as far as the way was checked."""
    seen: float
    """Time at which obstacles that move were seen [s]."""
    start: Float[Array, " s"]
    """Configuration from which the search starts; empty if the measured one counts, after the stop."""
    slices: int
    """Slices of the search that were made."""
    searches: int
    ways: int
    reason: str
    """Why the robot does not follow a way; "" if it does."""


class NavigationController(DescribedMixin):
    """Follow a way to a goal, stop on it before it is blocked, and search for another one: a kinematic controller.

    A search is that of ``rnc.planning.find_way``, for systems with exact steering. While the robot stands, each step
    makes one slice of it. Then it follows the way within ``acceleration``, with feedback in proportion to its speed. It
    stops at the nodes where the velocity of the way jumps. ``set_obstacles`` changes the world. If the rest of the
    way is no longer free, the robot brakes on the way, and searches from where it stops. Where it can stop depends on
    the acceleration alone: ``v^2 / (2 a)``. Obstacles with a motion count where they are, every ``check`` seconds.
    Obstacles that appear nearer than that, or that move into the robot, cannot be avoided; ``reason`` says so.

    Each part of the way is shown to be free before the robot is on it, with a clearance. A robot that is farther than
    ``tube`` from it stops and plans again from where it is; so the clearance should cover the tube.

    In ``rnc.VelocityLoop``, it drives a robot of your own; trackers, such as ``VelocityTracker``, give forces. Reads
    from the measurement ``q, v2``. One state at a time. The same measurements give the same commands: searches end by
    numbers of motions. The time of a step is that of ``slice_size`` motions, or of the check of a way.

    Args:
        reduced: the model.
        goal: values by output, or a configuration (nq,).
        obstacles: obstacles at the start.
        selection: rules for pairs of links.
        clearance: smallest distance of the way to obstacles [m].
        settings: settings of the search; its ``seconds`` do not count.
        acceleration: largest rate of each entry of the velocity along the way [m/s^2 or rad/s^2].
        speed: share of the velocity limits of the robot's file that the way uses.
        tube: distance of the robot from the way from which it plans again [m or rad].
        tolerance: error at the goal above which it plans again [m or rad].
        check: time between two looks at obstacles that move [s].
        slice_size: number of motions that one step checks.
        state_cost: weight of the distance from the way in the gains of the feedback.
        seed: seed of the searches.

    Attributes:
        status: of the last step: "following", "stopping", "replanning", "no way" or "arrived".
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

    described = ("clearance", "acceleration", "speed", "tube", "tolerance", "check", "slice_size", "state_cost", "seed")

    def __init__(
        self,
        reduced: ReducedModel,
        goal: Goal,
        obstacles: Sequence[Obstacle] = (),
        *,
        selection: PairSelection | None = None,
        clearance: NotNegative = 0.05,
        settings: WaySettings = _DEFAULT,
        acceleration: Positive = 0.5,
        speed: Positive = 0.8,
        tube: Positive = 0.05,
        tolerance: Positive = 0.02,
        check: Positive = 0.1,
        slice_size: Positive = 60.0,
        state_cost: Positive = 10.0,
        seed: int = 0,
    ) -> None:
        check_positive_settings(acceleration=acceleration, speed=speed, tube=tube, tolerance=tolerance, check=check)
        check_positive_settings(slice_size=slice_size, state_cost=state_cost)
        if speed > 1.0:
            raise ConfigurationError(f"speed: expected a share of the velocity limits up to 1, found {speed:g}")
        self.acceleration, self.speed, self.tube, self.tolerance = acceleration, speed, tube, tolerance
        self.clearance, self.check, self.slice_size = clearance, check, slice_size
        self.state_cost, self.seed, self.goal = state_cost, seed, goal
        motions = _MOTIONS if settings.motions is None else settings.motions
        self._search_settings = replace(settings, seconds=_ALWAYS, motions=motions)
        self._reduced, self._model, self._selection = reduced, KinematicModel(reduced), selection
        self._rows = GoalRows(self._model, goal, at_rest=False) if isinstance(goal, Mapping) else None
        self._obstacles, self._world = tuple(obstacles), 0
        self._known: tuple[tuple[int, float], WayFinder] | None = None
        self._running: tuple[tuple[int, float, bytes, int], int, Iterator[Way | None]] | None = None
        self._reference = reduced.robot.configuration() if isinstance(goal, Mapping) else np.array(goal, dtype=float)
        first = WayFinder(reduced, self._reference, clearance=clearance, settings=self._search_settings)
        if first.steering is None:
            raise ConfigurationError(
                "navigation: no exact steering is known for this system, see rnc.planning.find_steering"
            )
        self._planned = first.planned
        self.status: Status = "replanning"
        self.reason = ""

    def __getstate__(self) -> dict[str, object]:
        """State for copies, without the search that runs: they repeat it from the state of the controller."""
        return {**vars(self), "_running": None, "_known": None}

    def set_obstacles(self, obstacles: Sequence[Obstacle]) -> None:
        """Replace the obstacles; the next step checks the rest of the way among them.

        Args:
            obstacles: all obstacles that are known now.
        """
        self._obstacles, self._world = tuple(obstacles), self._world + 1

    def missed_goals(self, q: Float[Array, " nq"], v2: Float[Array, " r"]) -> tuple[MissedGoal, ...]:
        """Rows of the goal that a run misses which ends in this state, for its verdict.

        Args:
            q: configuration (nq,).
            v2: reduced velocity (r,).
        """
        reason = self.reason or ("the run ends on the way" if self.status == "following" else "")
        errors = sorted(self._errors(q).items(), key=lambda item: -item[1])
        return tuple(
            MissedGoal(name, error, self.tolerance, reason) for name, error in errors if error > self.tolerance
        )

    def initial_state(self, measurement: Measurement) -> NavigationState:
        """Return a state that searches for a way from the measured configuration."""
        q = np.array(measurement.q, dtype=float)
        r, nv = self._reduced.r, self._reduced.n
        self.status, self.reason = "replanning", ""
        return NavigationState(
            status="replanning",
            t=None,
            begin=0.0,
            time=np.zeros(1),
            q=q[None],
            v=np.zeros((0, nv)),
            places=np.zeros(1),
            gains=np.zeros((1, r, nv)),
            place=0.0,
            speed=0.0,
            rate=0.0,
            end=0.0,
            world=-1,
            seen=-np.inf,
            start=q,
            slices=0,
            searches=0,
            ways=0,
            reason="",
        )

    def step(
        self, t: float, measurement: Measurement, state: NavigationState
    ) -> tuple[VelocityTarget, NavigationState]:
        q = np.asarray(measurement.q, dtype=float)
        state = self._moved(elapsed_time(t, state.t), state)._replace(t=t)
        if state.status == "following":
            state = self._checked(t, q, state)
        elif state.status == "stopping" and not state.speed:
            state = self._stopped(t, q, state)
        elif state.status == "replanning":
            state = self._searched(t, state)
        elif state.status == "no way" and self._is_new(t, state):
            state = self._begun(t, state.start, state)
        elif (
            state.status == "arrived" and t >= state.begin + _SETTLE and max(self._errors(q).values()) > self.tolerance
        ):
            state = self._begun(t, q, state)
        self.status, self.reason = state.status, state.reason
        return self._target(q, state), state

    # ------------------------------------------------------------------ along the way

    def _segment(self, state: NavigationState) -> int:
        """Segment after the place of the robot."""
        return int(np.clip(np.searchsorted(state.time, state.place + _END, "right") - 1, 0, len(state.v) - 1))

    def _limits(self, state: NavigationState) -> tuple[float, float]:
        """Next place at which the velocity of the way jumps, and the largest rate of the speed until there [1/s]."""
        k, v = self._segment(state), np.where(self._planned, state.v, 0.0)
        largest = float(np.abs(v[k]).max())
        jumps = np.flatnonzero(np.abs(np.diff(v[k:], axis=0)).max(axis=1, initial=0.0) > _SAME * largest)
        last = k + int(jumps[0]) if len(jumps) else len(v) - 1
        return float(state.time[last + 1]), self.acceleration / largest

    def _moved(self, since: float, state: NavigationState) -> NavigationState:
        """State after a time [s]: the speed rises, stays, or falls so that the robot stops at the end of its run."""
        if not len(state.v) or state.place >= state.end:
            return state._replace(speed=0.0, rate=0.0)
        jump, most = self._limits(state)
        end, s, speed = min(jump, state.end), state.place, state.speed
        room = max(end - s - 0.5 * speed * since, 0.0)
        top = most * (np.sqrt(0.25 * since**2 + 2.0 * room / most) - 0.5 * since)
        new = max(min(self.speed, speed + most * since, top), speed - most * since, 0.0)
        place = s + 0.5 * (speed + new) * since
        if place >= end - _END:
            return state._replace(place=end, speed=0.0, rate=0.0)
        rate = (new - speed) / since if since else 0.0
        return state._replace(place=place, speed=new, rate=rate)

    def _at(self, places: ArrayLike, state: NavigationState) -> Float[Array, "k nq"]:
        """Configurations (k, nq) at places of the way."""
        s = np.atleast_1d(np.asarray(places, dtype=float))
        if not len(state.v):
            return np.repeat(state.q[:1], len(s), axis=0)
        k = np.clip(np.searchsorted(state.time, s, "right") - 1, 0, len(state.v) - 1)
        return self._model.manifold.integrate(state.q[k], (s - state.time[k])[:, None] * state.v[k])

    def _target(self, q: Array, state: NavigationState) -> VelocityTarget:
        if not state.speed:
            still = np.zeros(self._reduced.r)
            return VelocityTarget(v2=still, v2_dot=still)
        desired = self._at(state.place, state)
        along = self._reduced.at(desired[0]).J2 @ state.v[self._segment(state)]
        K = state.gains[min(int(np.searchsorted(state.places, state.place, "right")), len(state.gains)) - 1]
        correction = K @ self._model.manifold.difference(desired, q[None])[0]
        return VelocityTarget(v2=state.speed * (along + correction), v2_dot=state.rate * along)

    def _away(self, q: Array, state: NavigationState) -> float:
        """Distance of the planned joints from the way [m or rad]."""
        step = self._model.manifold.difference(self._at(state.place, state), q[None])[0]
        return float(np.abs(step[self._planned]).max(initial=0.0))

    def _errors(self, q: Array) -> dict[str, float]:
        """Errors of a configuration by name of the goal's rows [m or rad]."""
        if self._rows is None:
            step = np.abs(self._model.manifold.difference(self._reference[None], np.asarray(q)[None])[0])
            every = zip(self._reduced.robot.velocity_names, step.tolist(), self._planned, strict=True)
            return {name: error for name, error, planned in every if planned}
        at = Nodes(np.asarray(q)[None], np.empty((1, 0)))
        found = self._rows.rows(NodeData(self._model, at, None, np.zeros(1)), False).value[0]
        names = (name.removeprefix("goal ") for name in self._rows.names)
        return dict(zip(names, np.abs(found).tolist(), strict=True))

    # ------------------------------------------------------------------ the world

    def _finder(self, world: int, seen: float) -> WayFinder:
        """Searches among the obstacles as they were seen."""
        if self._known is None or self._known[0] != (world, seen):
            standing = [_as_seen(each, seen) for each in self._obstacles]
            finder = WayFinder(
                self._reduced,
                self._reference,
                standing,
                selection=self._selection,
                clearance=self.clearance,
                settings=self._search_settings,
            )
            self._known = (world, seen), finder
        return self._known[1]

    def _is_new(self, t: float, state: NavigationState) -> bool:
        """True if the obstacles are others than those that were seen last, or elsewhere."""
        if state.world != self._world:
            return True
        if t < state.seen + self.check - _END:
            return False
        return any(_distance(each, t, state.seen) > _MOVED for each in self._obstacles if each.motion is not None)

    def _is_free(self, state: NavigationState, first: float, last: float, finder: WayFinder) -> bool:
        """True if the way is free between two places."""
        if finder.checker is None or not len(state.v):
            return True
        inside = state.time[(state.time > first + _END) & (state.time < last - _END)]
        places = np.concatenate([[first], inside, [last]])
        k = np.searchsorted(state.time, 0.5 * (places[1:] + places[:-1]), "right") - 1
        return finder.checker.is_free(ExactMotion(self._at(places, state), np.diff(places)[:, None] * state.v[k]))

    # ------------------------------------------------------------------ status

    def _checked(self, t: float, q: Array, state: NavigationState) -> NavigationState:
        """State that follows its way, or that leaves it."""
        if self._away(q, state) > self.tube:
            return self._stopping(t, np.empty(0), "the robot is off its way", state)
        if self._is_new(t, state):
            state = state._replace(world=self._world, seen=t)
            finder = self._finder(self._world, t)
            if not self._is_free(state, state.place, state.end, finder):
                stop = self._braked(state)
                reason = "the way is blocked"
                if not self._is_free(state, state.place, stop, finder):
                    reason = "the way is blocked nearer than the robot can stop"
                return self._stopping(t, self._at(stop, state)[0], reason, state)
        if state.place >= state.end:
            return state._replace(status="arrived", begin=t, reason="")
        return state

    def _braked(self, state: NavigationState) -> float:
        """Place at which the robot stops if it brakes now."""
        if not state.speed:
            return state.place
        jump, most = self._limits(state)
        return min(state.place + 0.5 * state.speed**2 / most, jump)

    def _stopping(self, t: float, start: Array, reason: str, state: NavigationState) -> NavigationState:
        end = self._braked(state)
        return state._replace(status="stopping", begin=t, end=end, start=start, reason=reason)

    def _stopped(self, t: float, q: Array, state: NavigationState) -> NavigationState:
        """State that begins to search where the robot stands."""
        if len(state.start):
            return self._begun(t, state.start, state)
        if state.rate or t < state.begin + _SETTLE:  # the measured configuration counts after the robot has settled
            return state
        return self._begun(t, q, state)

    def _begun(self, t: float, start: Array, state: NavigationState) -> NavigationState:
        """State that searches from a configuration, among the obstacles as they are now."""
        state = state._replace(slices=0, searches=state.searches + 1, world=self._world, seen=t)
        return state._replace(status="replanning", begin=t, start=np.array(start))

    def _searched(self, t: float, state: NavigationState) -> NavigationState:
        """State after one slice of the search."""
        if state.world != self._world:
            state = self._begun(t, state.start, state)
        try:
            way = self._slice(state)
        except RncError as error:
            return state._replace(status="no way", begin=t, reason=str(error))
        state = state._replace(slices=state.slices + 1)
        if way is None:
            return state
        started = self._started(t, way, state)
        if self._is_new(t, state):  # the obstacles moved since the search began
            started = started._replace(seen=t)
            if not self._is_free(started, 0.0, way.duration, self._finder(self._world, t)):
                return self._begun(t, state.start, state)
        return started

    def _slice(self, state: NavigationState) -> Way | None:
        """Result of the next slice of a search; a state from elsewhere repeats the slices before it."""
        key = state.world, state.seen, state.start.tobytes(), state.searches
        if self._running is None or self._running[:2] != (key, state.slices):
            finder = self._finder(state.world, state.seen)
            best = _best(finder.slices(state.start, self.goal, self.seed + state.searches, self.slice_size))
            for _ in range(state.slices):
                next(best)
            self._running = key, state.slices, best
        slices = self._running[2]
        self._running = key, state.slices + 1, slices
        return next(slices)

    def _started(self, t: float, way: Way, state: NavigationState) -> NavigationState:
        """State that follows a way from its start."""
        places, gains = self._feedback(way)
        state = state._replace(time=way.time, q=way.q, v=way.v, places=places, gains=gains, end=way.duration)
        state = state._replace(status="following", begin=t, place=0.0, speed=0.0, rate=0.0)
        return state._replace(ways=state.ways + 1, reason="")

    def _feedback(self, way: Way) -> tuple[Float[Array, " m"], Float[Array, "m r nv"]]:
        """Places, and the gains of a linear-quadratic regulator from each to the next, at the speeds of the way."""
        r, nv = self._reduced.r, self._reduced.n
        if not len(way.v):
            return np.zeros(1), np.zeros((1, r, nv))
        durations = np.diff(way.time)
        sizes = np.abs(np.where(self._planned, way.v, 0.0)).max(axis=1) * durations
        counts = np.maximum(np.ceil(sizes / _SPACING), 1.0).astype(int)
        h, k = np.repeat(durations / counts, counts), np.repeat(np.arange(len(way.v)), counts)
        places = np.concatenate([[0.0], np.cumsum(h)[:-1]])
        q = way.at(places)
        u = np.matvec(self._reduced.at(q).J2, way.v[k])
        weights = np.where(self._planned, self.state_cost, 0.0)
        gains = regulator_gains(
            self._model, Nodes(q, np.empty((len(q), 0))), u, h, (weights, np.ones(r), 10.0 * weights)
        )
        return places, gains


def _best(slices: Iterator[Way | None]) -> Iterator[Way | None]:
    """None for each slice of a search, then the last way that it found."""
    best = None
    for way in slices:
        best = way or best
        yield None
    yield best


def _as_seen(obstacle: Obstacle, t: float) -> Obstacle:
    """The obstacle at rest where it is at a time."""
    if obstacle.motion is None:
        return obstacle
    pose = np.asarray(obstacle.motion.at(t).position, dtype=float)
    return replace(obstacle, motion=None, position=pose[:3], yaw=float(pose[3]))


def _distance(obstacle: Obstacle, t: float, before: float) -> float:
    """Largest change of a pose between two times [m or rad]."""
    if not np.isfinite(before):
        return np.inf
    assert obstacle.motion is not None
    now, then = (np.asarray(obstacle.motion.at(each).position) for each in (t, before))
    return float(np.abs(now - then).max())
