"""Global planning: a collision-free way of a reduced system from a configuration to a goal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Annotated

import numpy as np
import pinocchio as pin
from annotated_types import Ge
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection
from rnc_pin.collision.convex_shapes import bounding_box
from rnc_pin.errors import ConfigurationError, InfeasibleError, InputError
from rnc_pin.extras import check_extra
from rnc_pin.model.input_validation import ConfigurationValidator
from rnc_pin.model.parameter_types import NotNegative, Positive
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.planning.bounded_descent import TangentBounds
from rnc_pin.planning.exact_steering import CarSteering, ExactMotion, Steering
from rnc_pin.planning.inverse_kinematics import IkSearch, solve_ik
from rnc_pin.planning.kinematic_flow import KinematicFlow
from rnc_pin.planning.output_targets import OutputTarget
from rnc_pin.planning.steering_detection import find_steering, planned_velocities
from rnc_pin.planning.way import Way, WayInfo, way_along
from rnc_pin.planning.way_checking import WayChecker
from rnc_pin.planning.way_propagation import DEVIATION, PropagatedSearch
from rnc_pin.planning.way_search import Clock, WaySearch, speed_limits

_FIRST = 400  # motions of the first search, in which joints stay within the range of start and goals
_ATTEMPT = 4000  # motions of each further search, before it starts again with other random numbers
_DRAWN = 4  # random starts for each further goal configuration
_BASES = ("JointModelPlanar", "JointModelFreeFlyer")


@dataclass(frozen=True)
class WaySettings:
    """Settings of the search for a way.

    Attributes:
        seconds: time after which the search ends without a way [s].
        goals: largest number of configurations that are tried for a goal of outputs.
        shortcuts: number of attempts to shorten the first way.
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
    hold: Sequence[str] = ()
    area: ArrayLike | None = None
    reverse: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.seconds < np.inf:
            raise InputError(f"seconds: expected a positive number, found {self.seconds!r}")
        for name, value, least in (("goals", self.goals, 1), ("shortcuts", self.shortcuts, 0)):
            if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < least:
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

    The position limits of the robot's file hold. Wheels that follow end at any angle.

    Args:
        reduced: the model.
        q0: start (nq,).
        goal: values by output, as for ``solve_ik``, or a configuration (nq,).
        obstacles: obstacles that do not move.
        selection: rules for pairs of links; by default all pairs that are not adjacent.
        clearance: smallest distance to obstacles [m]. The check has a tolerance of 1 mm, or 1 % of the largest link.
        settings: settings of the search.
        seed: seed of all random choices.

    Raises:
        ConfigurationError: OMPL is not installed, rows prescribe a motion, or an obstacle moves.
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
    clock = Clock(settings.seconds)
    start = _validated(reduced, q0)
    for obstacle in obstacles:
        if obstacle.motion is not None:
            raise ConfigurationError(f"find_way: obstacle '{obstacle.name}' moves; a way is for obstacles that stand")
    steering = _steering(reduced, start, settings, seed)
    planned = planned_velocities(reduced, start, seed) if steering is None else steering.planned
    apart = clearance if steering else clearance + DEVIATION
    checker = _checker(reduced, start, obstacles, selection, apart)
    _check_configuration(reduced, checker, start, "start")
    ends = _Goals(reduced, steering, checker, settings, clock).of(goal, start, seed)
    places = np.vstack([start, ends])
    area = _area(reduced, 0.0 if steering is None else steering.radius, places, obstacles, checker, settings)
    if steering is None:
        flow, speeds = KinematicFlow(reduced), speed_limits(reduced, planned)
        propagated = PropagatedSearch(flow, planned, checker, places, area, speeds, clock)
        found = propagated.run(seed)
        if found is None:
            raise _failure(propagated, checker, reduced, ends, clock)
        first = float(propagated.durations(found.steps).sum())
        found = propagated.shortened(found, settings.shortcuts)
        info = WayInfo("propagated", clock.elapsed, propagated.edges, len(ends), first)
        return way_along(reduced, planned, checker, found, info)
    search = WaySearch(steering, checker, start, ends, clock)
    found = search.direct() or _searched(search, reduced, area, settings, seed, clock)
    if found is None:
        raise _failure(search, checker, reduced, ends, clock)
    first = float(search.durations(found.steps).sum())
    whole = steering.completed(search.shortened(found, settings.shortcuts, seed), start)
    if checker is not None and not planned.all() and not checker.is_free(steering.along(start, whole.steps)):
        raise InfeasibleError("find_way: wheels that follow collide, because they are not round")
    info = WayInfo(steering.kind, clock.elapsed, search.edges, len(ends), first)
    return way_along(reduced, planned, checker, whole, info)


def _steering(reduced: ReducedModel, start: Array, settings: WaySettings, seed: int) -> Steering | None:
    """Exact steering; None if none is known, so that motions have to be propagated."""
    try:
        steering = find_steering(reduced, start, seed, reverse=settings.reverse)
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
    return steering


def _searched(
    search: WaySearch, reduced: ReducedModel, area: Array, settings: WaySettings, seed: int, clock: Clock
) -> ExactMotion | None:
    """First way; the joints of a mobile robot first stay within the range of start and goals."""
    mobile = reduced.robot.model.joints[1].shortname() in _BASES
    names = list(reduced.robot.model.names)[1:]
    for attempt in count():
        tight = mobile and attempt == 0
        held = names if tight else settings.hold
        found = search.run(area, held, _FIRST if tight else _ATTEMPT, seed + attempt)
        if found is not None or clock.is_over:
            return found
    return None


def _validated(reduced: ReducedModel, q: ArrayLike) -> Float[Array, " nq"]:
    found = ConfigurationValidator(reduced.robot).validate(np.asarray(q, dtype=float))
    if found.ndim != 1:
        raise InputError(f"q has shape {found.shape}, expected ({reduced.robot.nq},)")
    return np.array(found)


def _checker(
    reduced: ReducedModel,
    q0: Array,
    obstacles: Sequence[Obstacle],
    selection: PairSelection | None,
    clearance: float,
) -> WayChecker | None:
    """Check of motions; None for a robot without geometry among no obstacles."""
    geometry = reduced.robot.collision_model
    if not obstacles and (geometry is None or not len(geometry.geometryObjects)):
        return None
    distances = CollisionDistances(reduced.robot, obstacles, selection, q0)
    return WayChecker(distances, clearance) if distances.pairs else None


def _check_configuration(reduced: ReducedModel, checker: WayChecker | None, q: Array, what: str) -> None:
    """Raise an error if a configuration is beyond a limit or too near to something."""
    problem = _problem_of(reduced, checker, q)
    if problem:
        raise InfeasibleError(f"find_way: the {what} {problem}")


def _problem_of(reduced: ReducedModel, checker: WayChecker | None, q: Array) -> str:
    """Text about a configuration that is beyond a limit or too near to something; "" for others."""
    model = reduced.robot.model
    none = np.zeros(model.nv, dtype=bool)
    bounds = TangentBounds(model, model.lowerPositionLimit, model.upperPositionLimit, none)
    moved = np.abs(bounds.clip(q) - q)
    if moved.max() > 1e-9:
        worst = int(np.flatnonzero(bounds.q_index == int(np.argmax(moved)))[0])
        name = reduced.robot.velocity_names[int(bounds.v_index[worst])]
        return f"is beyond the position limit of joint '{name}' by {moved.max():.3g}"
    near = None if checker is None else checker.violation(q)
    if near is None:
        return ""
    return f"is too near: {near[0]} are {near[1]:.3g} m apart"


class _Goals:
    """Goal configurations of a search."""

    def __init__(
        self,
        reduced: ReducedModel,
        steering: Steering | None,
        checker: WayChecker | None,
        settings: WaySettings,
        clock: Clock,
    ) -> None:
        self._reduced, self._steering, self._checker = reduced, steering, checker
        self._settings, self._clock = settings, clock

    def of(self, goal: Mapping[OutputTarget, ArrayLike] | ArrayLike, start: Array, seed: int) -> Float[Array, "n nq"]:
        """Configurations (n, nq) that reach a goal, without collisions."""
        if not isinstance(goal, Mapping):
            end = _validated(self._reduced, goal)
            _check_configuration(self._reduced, self._checker, end, "goal")
            return end[None]
        beside = None
        if self._checker is not None and self._checker.distances.obstacles:
            obstacles = self._checker.distances.obstacles
            beside = CollisionDistances(self._reduced.robot, obstacles, PairSelection(links=False))
        found: list[Array] = []
        generator = np.random.default_rng(seed)
        why = ""
        for attempt in count():
            enough = self._settings.goals if attempt < _DRAWN * self._settings.goals else 1
            if len(found) >= enough or (attempt and self._clock.elapsed > self._settings.seconds / 2):
                break  # without a goal configuration, half of the time is for finding one
            begin = start if not attempt else self._drawn(start, generator)
            result = solve_ik(
                self._reduced,
                begin,
                goal,
                hold=self._settings.hold,
                collisions=beside,
                clearance=0.0 if self._checker is None else self._checker.clearance + 2 * self._checker.tolerance,
                search=IkSearch(starts=20 if not attempt else 1, seed=seed),
            )
            if not result.converged:
                why = why or f"no configuration reaches {', '.join(result.unreachable) or 'the goal beside obstacles'}"
                continue
            q = self._prepared(result.q)
            problem = _problem_of(self._reduced, self._checker, q)
            why = problem and f"the goal {problem}"
            if not problem and all(np.abs(q - other).max() > 1e-3 for other in found):
                found.append(q)
        if not found:
            raise InfeasibleError(f"find_way: {why}")
        return np.array(found)

    def _prepared(self, q: Array) -> Array:
        """The configuration with straight wheels, if the robot is a car."""
        if isinstance(self._steering, CarSteering):
            return self._steering.at_angle(q, self._steering.straight)
        return np.array(q)

    def _drawn(self, start: Array, generator: np.random.Generator) -> Array:
        """Random configuration near the start: joints within their limits."""
        model = self._reduced.robot.model
        step = generator.uniform(-np.pi, np.pi, model.nv)
        for name in self._settings.hold:
            step[self._reduced.robot.velocity_indices(name)] = 0.0
        none = np.zeros(model.nv, dtype=bool)
        bounds = TangentBounds(model, model.lowerPositionLimit, model.upperPositionLimit, none)
        return bounds.clip(pin.integrate(model, start, step))


def _area(
    reduced: ReducedModel,
    radius: float,
    configurations: Float[Array, "n nq"],
    obstacles: Sequence[Obstacle],
    checker: WayChecker | None,
    settings: WaySettings,
) -> Float[Array, "2 3"]:
    """Smallest and largest coordinates of the base."""
    if settings.area is not None:
        area = np.asarray(settings.area, dtype=float)
        if area.shape != (2, 3) or not (area[0] < area[1]).all():
            raise InputError(f"area: expected smallest and largest x, y and z (2, 3), found {area.tolist()}")
        return area
    base = reduced.robot.model.joints[1]
    size = {"JointModelPlanar": 2, "JointModelFreeFlyer": 3}.get(base.shortname(), 0)
    points = np.zeros((len(configurations), 3))
    points[:, :size] = configurations[:, base.idx_q : base.idx_q + size]
    corners = [points]
    for obstacle in obstacles:
        if not obstacle.unbounded:
            center, halves = bounding_box(obstacle.shape, obstacle.name)
            pose = obstacle.placement(0.0)
            middle, reach = pose.act(center), np.abs(pose.rotation) @ halves
            corners.append(np.array([middle - reach, middle + reach]))
    every = np.concatenate(corners)
    room = 1.0 + 2.0 * radius
    if checker is not None:
        room += 2.0 * float(checker.distances.radii[: checker.distances.link_shapes].max())
    return np.array([every.min(axis=0) - room, every.max(axis=0) + room])


def _failure(
    search: WaySearch | PropagatedSearch,
    checker: WayChecker | None,
    reduced: ReducedModel,
    ends: Array,
    clock: Clock,
) -> InfeasibleError:
    """Error about a search without a way: how near it came, and what is in the way."""
    base, near = reduced.robot.model.joints[1], search.nearest.q
    size = {"JointModelPlanar": 2, "JointModelFreeFlyer": 3}.get(base.shortname(), 0)
    text = f"no way found in {clock.elapsed:.0f} s, {search.edges} motions checked"
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
