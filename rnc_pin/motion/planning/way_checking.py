"""Motions without collisions, between samples too, and goal configurations beside obstacles and within limits."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from itertools import count
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Bool, Float
from rnc_pin.collision import CollisionDistances, Obstacle, PairSelection, continuous_distances
from rnc_pin.collision.continuous_distances import default_tolerance, too_near
from rnc_pin.errors import InfeasibleError
from rnc_pin.model.coordinates import ConfigurationManifold
from rnc_pin.model.input_validation import ConfigurationValidator
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget
from rnc_pin.motion.planning.exact_steering import ExactMotion, Steering
from rnc_pin.motion.planning.inverse_kinematics import IkResult, IkSearch, TangentBounds, solve_ik
from rnc_pin.robots.robot import Robot

_HALVED = 1.0 - np.array([int(f"{k:04b}"[::-1], 2) for k in range(16)]) / 16.0
"""Fractions of a motion, in an order that finds collisions early: the end, the middle, the quarters, ..."""


class NarrowPlace(NamedTuple):
    """Smallest distance of a way.

    Attributes:
        distance: [m].
        pair: names of both bodies.
        q: configuration (nq,).
        time: [s].
    """

    distance: float
    pair: str
    q: Float[Array, " nq"]
    time: float


class WayChecker:
    """Check of motions: obstacles stay beyond a clearance, links do not touch each other.

    A motion is free only if bounds of the distances show it, between samples too. The bounds have a tolerance, so that
    gaps that are narrower than the robot, the clearances and the tolerance count as closed. Links may overlap by the
    tolerance: links of many robots are nearer to each other than it.

    Args:
        distances: pairs of the robot and obstacles.
        clearance: smallest distance to obstacles [m].
    """

    def __init__(self, distances: CollisionDistances, clearance: float) -> None:
        self.distances, self.clearance = distances, clearance
        self.tolerance = default_tolerance(distances)
        self._beside = distances.shape_pairs[1] >= distances.link_shapes
        self._least = np.where(self._beside, clearance + self.tolerance, 0.0)
        self.manifold = ConfigurationManifold(distances.robot.model)
        self.blocks = np.zeros(len(distances.pairs), dtype=int)

    def violation(self, q: Float[Array, " nq"]) -> tuple[str, float] | None:
        """Pair that is too near at a configuration, and its distance [m]; None if all are far enough."""
        found = self.distances.smallest(q, 0.0, self.clearance + self.tolerance)
        # Obstacles and links have different limits: the pair that lacks most is named, not the nearest one.
        if not len(found) or found[worst := int(np.argmin(found - self._least))] > self._least[worst]:
            return None
        self.blocks[worst] += 1
        return self.distances.pairs[worst].label, float(found[worst])

    def is_free(self, motion: ExactMotion) -> bool:
        """True if bounds show that no distance of a motion is too small."""
        # A few samples cost less than bounds, and most motions of a search in a narrow place are not free.
        if any(self.violation(q) is not None for q in self._samples(motion)):
            return False
        time = np.arange(len(motion.q), dtype=float)
        found = too_near(self.distances, time, motion.q, self._least, self.tolerance)
        if found is not None:
            self.blocks[found] += 1
        return found is None

    def holds_with(self, motion: ExactMotion, followers: Bool[Array, " nv"]) -> bool:
        """True if a motion that ``is_free`` has accepted stays free where joints that follow move too.

        Only pairs count whose distance depends on these joints. Other samples find other distances, as far as the
        tolerance: what the first check has left of it has to cover the finer tolerance here.

        Args:
            motion: the motion of all joints.
            followers: mask of the velocities of joints that follow.
        """
        moved = self.distances.depends_on(followers)
        finer = 0.1  # tolerance of the second check of wheels that follow, in tolerances of the first one
        tolerance = finer * self.tolerance
        least = self._least - self.tolerance + tolerance
        time, within = np.arange(len(motion.q), dtype=float), self.clearance + self.tolerance
        found = continuous_distances(self.distances, time, motion.q, within, tolerance)
        return not (((found.smallest < least) | found.uncertain) & moved).any()

    def _samples(self, motion: ExactMotion) -> Float[Array, "k nq"]:
        """Configurations along a motion."""
        if not motion.steps.any():
            return motion.q[:1]
        lengths = np.abs(motion.steps).max(axis=1)
        spacing = 0.1  # [m or rad] between the samples that are looked at before the bounds
        count = int(np.clip(lengths.sum() / spacing, 2, len(_HALVED)))
        return motion.at(self.manifold, lengths, _HALVED[:count] * lengths.sum())

    def narrowest(self, time: Float[Array, " n"], q: Float[Array, "n nq"], within: float) -> NarrowPlace | None:
        """Narrowest place beside obstacles along a motion; None if no obstacle is nearer than ``within`` [m]."""
        found = continuous_distances(self.distances, time, q, within, self.tolerance)
        beside = np.where(self._beside, found.smallest, np.inf)
        if not len(beside) or beside.min() >= within:
            return None
        nearest = int(np.argmin(beside))
        at = float(found.time[nearest])
        k = int(np.clip(np.searchsorted(time, at, "right") - 1, 0, len(time) - 2))
        part = (at - time[k]) / max(float(time[k + 1] - time[k]), 1e-300)
        place = self.manifold.interpolate(q[k : k + 1], q[k + 1 : k + 2], np.array([part]))[0]
        return NarrowPlace(float(beside[nearest]), self.distances.pairs[nearest].label, place, at)


def way_checker(
    robot: Robot,
    q0: Float[Array, " nq"],
    obstacles: Sequence[Obstacle],
    selection: PairSelection | None,
    clearance: float,
) -> WayChecker | None:
    """Check of motions; None for a robot without geometry among no obstacles."""
    if not obstacles and not robot.has_collision_shapes:
        return None
    distances = CollisionDistances(robot, obstacles, selection, q0)
    return WayChecker(distances, clearance) if distances.pairs else None


# ------------------------------------------------------------------ goals

_DRAWN = 4  # random starts for each further goal configuration


def check_configuration(reduced: ReducedModel, checker: WayChecker | None, q: Array, what: str) -> None:
    """Raise an error if a configuration is beyond a limit or too near to something."""
    problem = _problem_of(reduced, checker, q)
    if problem:
        raise InfeasibleError(f"find_way: the {what} {problem}")


def _problem_of(reduced: ReducedModel, checker: WayChecker | None, q: Array) -> str:
    """Text about a configuration that is beyond a limit or too near to something; "" for others."""
    bounds = position_limits(reduced)
    moved = np.abs(bounds.clip(q) - q)
    rounding = 1e-9  # [rad or m]; inverse kinematics and integrations end at a limit to rounding
    if moved.max() > rounding:
        worst = int(np.flatnonzero(bounds.q_index == int(np.argmax(moved)))[0])
        name = reduced.robot.velocity_names[int(bounds.v_index[worst])]
        return f"is beyond the position limit of joint '{name}' by {moved.max():.3g}"
    near = None if checker is None else checker.violation(q)
    return "" if near is None else f"is too near: {near[0]} are {near[1]:.3g} m apart"


def position_limits(reduced: ReducedModel) -> TangentBounds:
    """Position limits of the robot's file.

    Args:
        reduced: the model.
    """
    model = reduced.robot.model
    return TangentBounds(model, model.lowerPositionLimit, model.upperPositionLimit, np.zeros(model.nv, dtype=bool))


def goal_configurations(
    goal: Mapping[OutputTarget, ArrayLike] | ArrayLike,
    start: Array,
    steering: Steering | None,
    reduced: ReducedModel,
    checker: WayChecker | None,
    seconds: float,
    most: int,
    hold: Sequence[str],
    seed: int,
) -> Float[Array, "n nq"]:
    """Configurations (n, nq) that reach a goal, without collisions.

    Args:
        goal: values by output, or a configuration (nq,).
        start: start (nq,).
        steering: exact steering; None if motions are propagated.
        reduced: the model.
        checker: check of motions.
        seconds: time after which the search ends [s].
        most: largest number of configurations for a goal of outputs.
        hold: names of joints that keep their positions.
        seed: seed of random starts.
    """
    if not isinstance(goal, Mapping):
        end = ConfigurationValidator(reduced.robot).validate_one(goal, "goal")
        check_configuration(reduced, checker, end, "goal")
        return end[None]
    beside = None
    if checker is not None and checker.distances.obstacles:
        # Obstacles alone repel: links that touch each other at a goal are left to the check below.
        beside = CollisionDistances(reduced.robot, checker.distances.obstacles, PairSelection(links=False))
    begun, found, why = time.monotonic(), list[Array](), ""
    # The check asks for one tolerance beyond the clearance; at its very limit, rounding would decide about a goal.
    clearance = 0.0 if checker is None else checker.clearance + 2 * checker.tolerance

    bounds, (low, high) = position_limits(reduced), np.full((2, reduced.n), [[-np.pi], [np.pi]])
    ends = [bounds.lower, bounds.upper] - start[bounds.q_index]
    low[bounds.v_index], high[bounds.v_index] = np.clip(ends, -np.pi, np.pi)

    def drawn(generator: np.random.Generator) -> Array:
        """Random configuration near the start: joints within their limits, and not at them."""
        step = generator.uniform(low, high)
        for name in hold:
            step[reduced.robot.velocity_indices(name)] = 0.0
        return np.asarray(pin.integrate(reduced.robot.model, start, step))

    def reached(begin: Array, starts: int, besides: CollisionDistances | None = None) -> tuple[IkResult, Array, str]:
        """Result of inverse kinematics, its configuration as the end of an exact motion, and the problem with it."""
        search = IkSearch(starts=starts, seed=seed)
        result = solve_ik(reduced, begin, goal, hold=hold, search=search, collisions=besides, clearance=clearance)
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
        enough = most if attempt < _DRAWN * most else 1  # a goal that few configurations reach is satisfied with one
        if len(found) >= enough or (attempt and time.monotonic() - begun > seconds):
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
