"""Goals of a way: configurations that reach them, beside obstacles and within limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array
from numpy.typing import ArrayLike

from rnc_pin.array_shapes import Float
from rnc_pin.collision import CollisionDistances, PairSelection
from rnc_pin.errors import InfeasibleError, InputError
from rnc_pin.model.input_validation import ConfigurationValidator
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.task import OutputTarget
from rnc_pin.planning.bounded_descent import TangentBounds
from rnc_pin.planning.exact_steering import Steering
from rnc_pin.planning.inverse_kinematics import IkSearch, solve_ik
from rnc_pin.planning.way_checking import WayChecker
from rnc_pin.planning.way_search import SearchBudget

_DRAWN = 4  # random starts for each further goal configuration
_ALIKE = 3  # random configurations at a goal with the same distance to the same obstacle: all others have it too


def validated_configuration(reduced: ReducedModel, q: ArrayLike) -> Float[Array, " nq"]:
    """Copy of one configuration (nq,)."""
    found = ConfigurationValidator(reduced.robot).validate(np.asarray(q, dtype=float))
    if found.ndim != 1:
        raise InputError(f"q has shape {found.shape}, expected ({reduced.robot.nq},)")
    return np.array(found)


def check_configuration(reduced: ReducedModel, checker: WayChecker | None, q: Array, what: str) -> None:
    """Raise an error if a configuration is beyond a limit or too near to something."""
    problem = _problem_of(reduced, checker, q)
    if problem:
        raise InfeasibleError(f"find_way: the {what} {problem}")


def _problem_of(reduced: ReducedModel, checker: WayChecker | None, q: Array) -> str:
    """Text about a configuration that is beyond a limit or too near to something; "" for others."""
    bounds = position_limits(reduced)
    moved = np.abs(bounds.clip(q) - q)
    if moved.max() > 1e-9:
        worst = int(np.flatnonzero(bounds.q_index == int(np.argmax(moved)))[0])
        name = reduced.robot.velocity_names[int(bounds.v_index[worst])]
        return f"is beyond the position limit of joint '{name}' by {moved.max():.3g}"
    near = None if checker is None else checker.violation(q)
    if near is None:
        return ""
    return f"is too near: {near[0]} are {near[1]:.3g} m apart"


def _prepared(steering: Steering | None, q: Array) -> Array:
    """The configuration as the end of an exact motion."""
    return np.array(q) if steering is None else steering.prepared(q)


def position_limits(reduced: ReducedModel) -> TangentBounds:
    """Position limits of the robot's file.

    Args:
        reduced: the model.
    """
    model = reduced.robot.model
    return TangentBounds(model, model.lowerPositionLimit, model.upperPositionLimit, np.zeros(model.nv, dtype=bool))


class WayGoals:
    """Goal configurations of a search.

    Args:
        reduced: the model.
        steering: exact steering; None if motions are propagated.
        checker: check of motions.
        budget: what the search may take; without a goal configuration, half of its time is for finding one.
        most: largest number of configurations for a goal of outputs.
        hold: names of joints that keep their positions.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        steering: Steering | None,
        checker: WayChecker | None,
        budget: SearchBudget,
        most: int,
        hold: Sequence[str],
    ) -> None:
        self._reduced, self._steering, self._checker = reduced, steering, checker
        self._budget, self._most, self._hold = budget, most, hold

    def of(self, goal: Mapping[OutputTarget, ArrayLike] | ArrayLike, start: Array, seed: int) -> Float[Array, "n nq"]:
        """Configurations (n, nq) that reach a goal, without collisions."""
        if not isinstance(goal, Mapping):
            end = validated_configuration(self._reduced, goal)
            check_configuration(self._reduced, self._checker, end, "goal")
            return end[None]
        beside = None
        if self._checker is not None and self._checker.distances.obstacles:
            obstacles = self._checker.distances.obstacles
            beside = CollisionDistances(self._reduced.robot, obstacles, PairSelection(links=False))
        found: list[Array] = []
        generator = np.random.default_rng(seed)
        why = ""
        for attempt in count():
            enough = self._most if attempt < _DRAWN * self._most else 1
            if len(found) >= enough or (attempt and self._budget.elapsed > self._budget.seconds / 2):
                break  # without a goal configuration, half of the time is for finding one
            begin = start if not attempt else self._drawn(start, generator)
            result = solve_ik(
                self._reduced,
                begin,
                goal,
                hold=self._hold,
                collisions=beside,
                clearance=0.0 if self._checker is None else self._checker.clearance + 2 * self._checker.tolerance,
                search=IkSearch(starts=20 if not attempt else 1, seed=seed),
            )
            if not result.converged:
                if not attempt and (same := self._same_problem(goal, start, seed)):
                    raise InfeasibleError(f"find_way: the goal {same}")
                why = why or f"no configuration reaches {', '.join(result.unreachable) or 'the goal beside obstacles'}"
                continue
            q = _prepared(self._steering, result.q)
            problem = _problem_of(self._reduced, self._checker, q)
            why = problem and f"the goal {problem}"
            if not problem and all(np.abs(q - other).max() > 1e-3 for other in found):
                found.append(q)
        if not found:
            raise InfeasibleError(f"find_way: {why}")
        return np.array(found)

    def _same_problem(self, goal: Mapping[OutputTarget, ArrayLike], start: Array, seed: int) -> str:
        """Problem that configurations from random starts share: the goal leaves no choice; "" if they differ."""
        generator, problems = np.random.default_rng(seed), set()
        for _ in range(_ALIKE):
            begin = self._drawn(start, generator)
            result = solve_ik(self._reduced, begin, goal, hold=self._hold, search=IkSearch(starts=20, seed=seed))
            if not result.converged:
                return ""
            problems.add(_problem_of(self._reduced, self._checker, _prepared(self._steering, result.q)))
        return problems.pop() if len(problems) == 1 else ""

    def _drawn(self, start: Array, generator: np.random.Generator) -> Array:
        """Random configuration near the start: joints within their limits."""
        model = self._reduced.robot.model
        step = generator.uniform(-np.pi, np.pi, model.nv)
        for name in self._hold:
            step[self._reduced.robot.velocity_indices(name)] = 0.0
        return position_limits(self._reduced).clip(pin.integrate(model, start, step))
