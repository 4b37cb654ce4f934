"""Search for a way by OMPL's planner RRTConnect, whose edges are exact motions that bounds show to be free.

The space of OMPL consists of subspaces of the planned joints, with states from configurations and back.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Array, Bool, Float
from rnc_pin.collision import Obstacle
from rnc_pin.collision.shapes import bounding_box
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.motion.planning.exact_steering import ExactMotion, Steering, base_axes
from rnc_pin.motion.planning.way import WayChecker, drive_times, speed_limits
from rnc_pin.robots.joint_values import NO_LIMIT

if TYPE_CHECKING:
    from ompl import base as ob


_REACH = 0.3  # [m]; metric of joints: a turn by 1 rad counts as a path of this length
_TURN = np.pi  # [rad]; range of revolute joints without limits, to both sides


class WaySpace:
    """State space of the planned joints, in which OMPL samples, and measures distances.

    Args:
        steering: exact steering; its radius gives the metric of a car.
        task: start and goals, which the space contains, and the area of the base.
        held: names of joints that stay within the range of start and goals.

    Attributes:
        space: OMPL's compound space; its states have numbers after its ``setup``.

    Raises:
        ConfigurationError: the space does not support a joint.
    """

    def __init__(self, steering: Steering, task: WayTask, held: Sequence[str] = ()) -> None:
        from ompl import base as ob

        self._ob, self._model, self._task = ob, steering.reduced.robot.model, task
        self._coupled = steering.couplings.applied
        self.space = ob.CompoundStateSpace()
        self._parts: list[tuple[int, int, bool]] = []
        """First entry of each joint in q, their number, and True if the last two are cosine and sine of an angle."""
        reals: list[tuple[int, float, float]] = []
        for index, joint in enumerate(self._model.joints):
            # Other joints are not sampled: they follow, or are aimed at each motion.
            if not index or not steering.sampled[joint.idx_v : joint.idx_v + joint.nv].all():
                continue
            kind, entry = joint.shortname(), int(joint.idx_q)
            if kind == "JointModelPlanar":
                # RRT's neighbours of a car are those that it reaches by short paths, not those beside it.
                plane = ob.ReedsSheppStateSpace(steering.radius) if steering.radius else ob.SE2StateSpace()
                self._add(plane, 1.0, task.area[:, :2], (entry, 4, True))
            elif kind == "JointModelFreeFlyer":
                self._add(ob.SE3StateSpace(), 1.0, task.area, (entry, 7, False))
            elif kind == "JointModelSpherical":
                self._add(ob.SO3StateSpace(), _REACH, None, (entry, 4, False))
            # An angle without an end: the shorter way round counts.
            elif joint.nq == 2 and joint.nv == 1:
                self._add(ob.SO2StateSpace(), _REACH, None, (entry, 2, True))
            elif joint.nq == joint.nv:
                tight = self._model.names[index] in held
                reals += [(entry + k, *self._range(entry + k, kind, tight)) for k in range(joint.nq)]
            else:
                raise ConfigurationError(
                    f"ways: joint '{self._model.names[index]}' is a {kind}, which ways do not support"
                )
        if reals:
            parts = [(entry, 1, False) for entry, _, _ in reals]
            self._add(ob.RealVectorStateSpace(len(reals)), _REACH, np.array(reals)[:, 1:].T, *parts)

    def _add(self, space: ob.StateSpace, weight: float, area: Array | None, *parts: tuple[int, int, bool]) -> None:
        """Add the space of some joints, in which smallest and largest coordinates (2, k) bound an area."""
        if area is not None:
            bounds = self._ob.RealVectorBounds(area.shape[1])
            for k, (low, high) in enumerate(area.T.tolist()):
                bounds.setLow(k, low)
                bounds.setHigh(k, high)
            space.setBounds(bounds)
        self.space.addSubspace(space, weight)
        self._parts += parts

    def _range(self, entry: int, kind: str, tight: bool) -> tuple[float, float]:
        """Range of a joint in the space: its limits, which start and goals are within."""
        own = np.append(self._task.goals[:, entry], self._task.start[entry])
        first, last = float(own.min()), float(own.max())
        if tight:  # OMPL refuses a range of length zero
            return first - 1e-9, last + 1e-9
        low, high = float(self._model.lowerPositionLimit[entry]), float(self._model.upperPositionLimit[entry])
        slide = 1.0  # [m]; range of prismatic joints without limits, to both sides
        # A joint without limits has a range all the same: samples need one.
        room = slide if kind.startswith("JointModelP") else _TURN
        if not low < high:
            low, high = -np.inf, np.inf
        low = low if low > -NO_LIMIT else first - room
        high = high if high < NO_LIMIT else last + room
        # A start may be beyond a limit by rounding, and OMPL would refuse it.
        return min(low, first), max(high, last)

    def write(self, state: ob.State, q: Float[Array, " nq"]) -> None:
        """Set a state to a configuration."""
        values: list[float] = []
        for entry, size, turns in self._parts:
            own = q[entry : entry + size].tolist()
            values += [*own[:-2], float(np.arctan2(own[-1], own[-2]))] if turns else own
        self.space.copyFromReals(state, values)

    def read(self, state: ob.State) -> Float[Array, " nq"]:
        """Configuration of a state; joints that follow are as at the start."""
        q, value, k = self._task.start.copy(), self.space.getValueAddressAtIndex, 0
        for entry, size, turns in self._parts:
            own = [value(state, k + place) for place in range(size - turns)]  # numbers, in spite of the name
            q[entry : entry + size] = [*own[:-1], np.cos(own[-1]), np.sin(own[-1])] if turns else own
            k += len(own)
        return self._coupled(pin.normalize(self._model, q))


def base_area(
    reduced: ReducedModel,
    radius: float,
    configurations: Float[Array, "n nq"],
    obstacles: Sequence[Obstacle],
    checker: WayChecker | None,
    given: ArrayLike | None,
) -> Float[Array, "2 3"]:
    """Smallest and largest coordinates of the base."""
    if given is not None:
        area = np.asarray(given, dtype=float)
        if area.shape != (2, 3) or not (area[0] < area[1]).all():
            raise InputError(f"area: expected smallest and largest x, y and z (2, 3), found {area.tolist()}")
        return area
    size = base_axes(reduced.robot.model)
    points = np.zeros((len(configurations), 3))
    points[:, :size] = configurations[:, :size]
    corners = [points]
    for obstacle in obstacles:
        if not obstacle.unbounded:
            center, halves = bounding_box(obstacle.shape, obstacle.name)
            pose = obstacle.placement(0.0)
            middle, reach = pose.act(center), np.abs(pose.rotation) @ halves
            corners.append(np.array([middle - reach, middle + reach]))
    every = np.concatenate(corners)
    room = 1.0 + 2.0 * radius  # a car turns round beside its goal
    if checker is not None:
        room += 2.0 * float(checker.distances.radii[: checker.distances.link_shapes].max())
    return np.array([every.min(axis=0) - room, every.max(axis=0) + room])


# ---------------------------------------------------------------------- way search


SHORTER = 1e-3
"""Relative decrease of the duration that is worth a change."""


class SearchBudget:
    """Time and motions that a search may take.

    Args:
        seconds: [s].
        motions: number of motions that may be checked; None for any number.

    Attributes:
        motions: number of motions that were checked.
    """

    def __init__(self, seconds: float, motions: int | None = None) -> None:
        self._start, self.seconds = time.monotonic(), seconds
        self._most = np.inf if motions is None else motions
        self.motions = 0

    @property
    def elapsed(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self._start

    @property
    def is_over(self) -> bool:
        """True if time or motions are used up."""
        return self.motions >= self._most or self.elapsed > self.seconds

    def limit(self, further: int) -> None:
        """Allow a number of further motions at most."""
        self._most = min(self._most, self.motions + further)


@dataclass(frozen=True, eq=False)
class WayTask:
    """Task of a search: what moves from where to where, and what the search may take.

    Args:
        reduced: the model.
        planned: mask (nv,) of the velocities whose joints end at the goal; all others follow.
        checker: check of motions.
        start: start (nq,).
        goals: goals (n, nq).
        area: smallest and largest coordinates (2, 3) of the base [m].
        budget: what the search may take; it counts the motions that are checked.
    """

    reduced: ReducedModel
    planned: Bool[Array, " nv"]
    checker: WayChecker | None
    start: Float[Array, " nq"]
    goals: Float[Array, "n nq"]
    area: Float[Array, "2 3"]
    budget: SearchBudget

    @cached_property
    def speeds(self) -> Float[Array, " nv"]:
        """Largest speeds: joints that follow stand in the search, and slow down the finished way."""
        return speed_limits(self.reduced, self.planned)


class WaySearch:
    """Search between configurations, and shortening of what it finds.

    Args:
        steering: exact steering.
        task: start, goals, and what the search may take.

    Attributes:
        nearest: configuration that was reached from the start, nearest to a goal so far.
    """

    def __init__(self, steering: Steering, task: WayTask) -> None:
        self._steering, self._task = steering, task
        # RRT asks for a motion once to add it, and the path for it again: each is checked once.
        self._known: dict[tuple[bytes, bytes], ExactMotion | None] = {}
        self._reached = {task.start.tobytes()}
        self.nearest, self._nearest_distance = task.start, np.inf

    def direct(self) -> ExactMotion | None:
        """Fastest free motion to a goal that needs no search; None if there is none."""
        found = [self.connect(self._task.start, goal) for goal in self._task.goals]
        free = [motion for motion in found if motion is not None]
        return min(free, key=lambda motion: drive_times(motion.steps, self._task.speeds).sum(), default=None)

    def run(self, held: Sequence[str], most: int, seed: int) -> ExactMotion | None:
        """Search for a way; None if none is found.

        Args:
            held: joints that stay within the range of start and goals.
            most: largest number of motions that are checked.
            seed: seed of OMPL's random numbers.
        """
        from ompl import base as ob
        from ompl import geometric as og
        from ompl import util as ou

        task, budget, level = self._task, self._task.budget, ou.getLogLevel()
        ou.setLogLevel(ou.LogLevel.LOG_NONE)
        ou.RNG.setSeed(seed + 1)  # zero is none
        try:
            space = WaySpace(self._steering, task, held)
            information = ob.SpaceInformation(space.space)
            # Motions and not seconds end an attempt: the same seed then gives the same way on any computer.
            last = budget.motions + most
            failed: list[BaseException] = []

            def safely(answer: Callable[..., bool], states: list[ob.State]) -> bool:
                """Answer for the configurations of states; an exception ends the search: it must not cross OMPL's code.

                The states leave the list, and no frame keeps them: the frames of an exception live on when OMPL has
                freed the states, and its bindings take a Python object for the new state at the same address.
                """
                try:
                    return not failed and answer(*[space.read(states.pop(0)) for _ in range(len(states))])
                except BaseException as error:
                    failed.append(error)
                    return False

            class Validator(ob.MotionValidator):  # type: ignore[misc]
                """Exact motions as the edges of OMPL's trees."""

                def checkMotion(self, first: ob.State, second: ob.State) -> bool:
                    states = [first, second]
                    del first, second
                    return safely(connects, states)

            def is_valid(state: ob.State) -> bool:
                states = [state]
                del state
                return safely(self._is_valid, states)

            def connects(first: Array, second: Array) -> bool:
                return self.connect(first, second) is not None

            validator = Validator(information)
            information.setMotionValidator(validator)
            information.setStateValidityChecker(is_valid)
            information.setup()
            problem = ob.ProblemDefinition(information)
            start = _state(information, space, task.start)
            named = dict[bytes, Array]()  # a state of OMPL has lost digits and full turns of the goal
            problem.addStartState(start)
            ends = ob.GoalStates(information)
            for goal in task.goals:
                ends.addState(end := _state(information, space, goal))
                named[space.read(end).tobytes()] = goal
            problem.setGoal(ends)
            self._reached.add(space.read(start).tobytes())
            planner = og.RRTConnect(information)
            planner.setProblemDefinition(problem)
            planner.setup()
            over = ob.PlannerTerminationCondition(lambda: bool(failed) or budget.is_over or budget.motions >= last)
            planner.solve(over)
            if failed:
                raise failed.pop()  # callbacks of OMPL hold the list: with its frames it would stay in memory
            if not problem.hasExactSolution():
                return None
            q = [space.read(state) for state in problem.getSolutionPath().getStates()]
        finally:
            ou.setLogLevel(level)
            _release(information)
        # The way begins and ends in what was given, to the bit.
        q[0], q[-1] = task.start, named[q[-1].tobytes()]
        return self._joined(q)

    def _joined(self, q: Sequence[Array]) -> ExactMotion | None:
        """Motion along configurations."""
        motions = [self.connect(*pair) for pair in pairwise(q)]
        steps = [motion.steps for motion in motions if motion is not None]
        return self._steering.along(self._task.start, np.concatenate(steps)) if len(steps) == len(motions) else None

    def connect(self, first: Array, second: Array) -> ExactMotion | None:
        """Free motion between two configurations; None if there is none."""
        key = first.tobytes(), second.tobytes()
        if key not in self._known:
            free = (each for each in self._steering.motions(first, second) if self.is_free(each))
            self._known[key] = next(free, None)
        # Of what hangs together with the start, the nearest to a goal is what the message of a failure names.
        if self._known[key] is not None and key[0] in self._reached and key[1] not in self._reached:
            self._reached.add(key[1])
            goals = self._task.goals
            away = self._steering.manifold.difference(np.repeat(second[None], len(goals), axis=0), goals)
            distance = float(np.linalg.norm(away[:, self._steering.planned], axis=1).min())
            if distance <= self._nearest_distance:
                self.nearest, self._nearest_distance = second, distance
        return self._known[key]

    def is_free(self, motion: ExactMotion) -> bool:
        """True if no distance of a motion is too small."""
        self._task.budget.motions += 1
        return self._task.checker is None or self._task.checker.is_free(motion)

    def _is_valid(self, q: Array) -> bool:
        return self._task.checker is None or self._task.checker.violation(q) is None

    # ------------------------------------------------------------------ shorter ways

    def shortened(self, motion: ExactMotion, tries: int, seed: int) -> ExactMotion:
        """The same or a faster motion: two places on it are connected directly, as often as this helps.

        Args:
            motion: a free motion.
            tries: number of pairs of places.
            seed: seed of their choice.
        """
        generator, speeds = np.random.default_rng(seed), self._task.speeds
        for _ in range(tries):
            if self._task.budget.is_over or len(motion.steps) < 2:
                break
            # Places by time, not by node: long straight pieces are cut as often as they take.
            ends = np.cumsum(drive_times(motion.steps, speeds))
            # Random pairs: the best cut of a way with many obstacles is not found by halving.
            first, last = np.sort(generator.uniform(0.0, ends[-1], 2))
            (start, begin, _), (end, _, rest) = self._cut(motion, ends, first), self._cut(motion, ends, last)
            now = last - first
            for between in self._steering.motions(start, end):
                # The duration is known without a check of distances, which costs far more.
                faster = drive_times(between.steps, speeds).sum() < (1.0 - SHORTER) * now
                if faster and self.is_free(between):
                    steps = np.concatenate([begin, between.steps, rest])
                    motion = self._steering.along(motion.q[0], steps)
                    break
        return motion

    def _cut(self, motion: ExactMotion, ends: Array, at: float) -> tuple[Array, Array, Array]:
        """Configuration of a motion at a time [s], and the steps before and after it."""
        k = min(int(np.searchsorted(ends, at)), len(ends) - 1)
        start = ends[k - 1] if k else 0.0
        part = (at - start) / max(ends[k] - start, 1e-300)
        step = motion.steps[k]
        place = self._steering.manifold.integrate(motion.q[k : k + 1], part * step[None])
        rest = np.vstack([(1.0 - part) * step, motion.steps[k + 1 :]])
        return place[0], np.vstack([motion.steps[:k], part * step]), rest


def _release(information: ob.SpaceInformation) -> None:
    """Replace the callbacks of OMPL's space: they refer to it, and the cycle would stay in memory."""
    from ompl import base as ob

    other = ob.SpaceInformation(ob.SO2StateSpace())
    other.setStateValidityChecker(lambda state: False)
    other.setup()
    information.setMotionValidator(other.getMotionValidator())
    information.setStateValidityChecker(other.getStateValidityChecker())


def _state(information: object, space: WaySpace, q: Array) -> object:
    state = information.allocState()  # type: ignore[attr-defined]
    space.write(state, q)
    information.enforceBounds(state)  # type: ignore[attr-defined]  # the angle pi is out of OMPL's [-pi, pi)
    return state
