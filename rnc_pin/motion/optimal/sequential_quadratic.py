"""Sequential quadratic programming over the nodes of an optimal control problem.

Every iteration linearises all nodes in one block and solves the subproblem. A line search on the merit function
``cost + weight * violations + gap weights * gaps``, with rows in units of their typical size, accepts the step. The
subproblem has the same elastic rows (Fletcher's Sl1QP; Nocedal and Wright, "Numerical Optimization" (2006), 18.5), so
its solution descends. A step that fails is repeated with more damping, which replaces what the Gauss-Newton Hessian
lacks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Lt
from numpy import ndarray as Array

from rnc_pin.errors import RncError, SimulationError
from rnc_pin.model.input_validation import Positive
from rnc_pin.motion.optimal.bounds import DISTANCE
from rnc_pin.motion.optimal.interior_point import Direction, InteriorPointSolver, LinearQuadratic
from rnc_pin.motion.optimal.transcription import Iterate, Transcription, Values, Violation

_LENGTHS = 0.5 ** np.arange(8)
_MOST_DAMPING, _LEAST_DAMPING, _FIRST_DAMPING = 1e6, 1e-8, 1e-3
_MOST_WEIGHT, _HEAVIER = 1e9, 30.0
_PATIENCE = 4  # iterations in which the violation has to be halved
_SLOW = 10  # iterations over which the cost of a solution that is improved has to fall
_REST = 1e-3  # part of the tolerance of the cost that later iterations may still change

SolverOutcome = Literal["solved", "feasible", "infeasible"]


@dataclass(frozen=True)
class SolverSettings:
    """Settings of the planner.

    Args:
        nodes: number of intervals with constant inputs.
        iterations: largest number of iterations from each guess. Refinements of its solution together take at most
            twice as many, where an iteration over halved intervals counts twice.
        tolerance: largest violation of bounds, goal and dynamics [their units].
        cost_tolerance: relative change of the cost at which the iterations end.
        penalty: first cost of a violation, in units of the row's typical size. It rises while violations remain.
        substeps: integrator steps of the verification in each interval.
        refinements: how often the planner may halve the intervals and solve again from the plan so far, because the
            verification finds a violation above ``accuracy``.
        accuracy: largest violation of bounds and goal that the verification of a plan accepts [their units]. Distances
            from obstacles are planned as much larger, so that the plan keeps its clearance.
        reserve: share of bounded ranges of outputs and of bounded velocities that a plan keeps free at its nodes,
            whatever states the bound: feedback needs it in the run. It ends where the start or the goal is.

    Example:
        >>> rnc.optimal.SolverSettings(nodes=60).iterations
        100
    """

    nodes: Annotated[int, Ge(2), Le(1000)] = 40
    iterations: Annotated[int, Ge(1), Le(10000)] = 100
    tolerance: float = 1e-5
    cost_tolerance: float = 1e-6
    penalty: float = 1e3
    substeps: int = 20
    refinements: Annotated[int, Ge(0), Le(4)] = 2
    accuracy: Positive = 5e-3
    reserve: Annotated[float, Ge(0), Lt(0.5)] = 0.005


@dataclass
class Solution:
    """Result of the iterations."""

    iterate: Iterate
    cost: float
    violation: Violation
    iterations: int
    outcome: SolverOutcome
    """Converged; within tolerance, but the cost still changes; or not within tolerance."""
    linear: LinearQuadratic | None = None
    """Linearization at the iterate, if the last step gave it."""
    weight: float = 0.0
    """Cost of a violation of one unit of a scaled row."""
    guess: str = ""
    """Name of the guess."""


class SequentialQuadratic:
    """Iterations on one problem from one guess.

    Args:
        problem: the problem.
        settings: settings.

    Attributes:
        linear: subproblem of the last iteration; None before the first one.
        interior: solver of the subproblems. Its multipliers of the bounds start the next one.
    """

    linear: LinearQuadratic | None = None
    _ahead: tuple[Iterate, LinearQuadratic, Values] | None = None
    """Linearization at the iterate of a whole step, in place of its values alone: the next iteration starts there."""

    def __init__(self, problem: Transcription, settings: SolverSettings) -> None:
        self.problem, self.settings, self.interior = problem, settings, InteriorPointSolver()
        self._damping, self._weight = _FIRST_DAMPING, self.settings.penalty
        self._gap_weights = np.zeros(self.problem.model.nx)
        self._whole = False  # the last step was whole, and damping did not shorten it

    def solve(self, guess: Iterate, weight: float = 0.0) -> Solution:
        """Improve a guess until it converges. Its first node becomes the start of the problem, which no step moves.

        Args:
            guess: the guess.
            weight: cost of a violation at which a similar problem converged, of which the guess is the solution: its
                iterations also end if the cost falls slowly. By default, the penalty of the settings, times the size
                of the gradient by inputs.
        """
        s, calm, count, done, before = self.settings, 0, 0, False, np.inf
        at = self.problem.from_start(guess)
        linear, values = self.problem.linearize(at)
        self._ahead = at, linear, values
        self._weight = weight or self._weight * (1.0 + float(np.abs(linear.g * linear.scales).max(initial=0.0)))
        costs = [np.inf] * _SLOW
        mark, age = np.inf, 0  # violation at the last time that it was halved, and iterations since
        while count < s.iterations:
            count += 1
            # Far from the optimum, the first change of the cost is infinite: the first subproblem is solved to the end.
            found = self.iterate(at, before if before < 1.0 else None)
            if found is None:
                done = not self._raise_penalty(values, at.duration)
                if done:
                    break
                continue
            change = abs(found[1].cost - values.cost) / max(1e-9, abs(values.cost))
            at, values = found
            amount = self.problem.worst(values, at.duration).amount
            mark, age = (amount, 0) if amount < 0.5 * mark else (mark, age + 1)
            # The penalty is exact once it exceeds the multipliers. Violations that stay say that it does not.
            if age > _PATIENCE and self._raise_penalty(values, at.duration):
                mark, age = amount, 0
            calm = calm + 1 if change < s.cost_tolerance else 0
            # Changes of whole steps fall as a geometric series, whose rest is known.
            rest = change**2 / (before - change) if change < before else np.inf
            before = change
            costs.append(values.cost)
            slow = weight and costs[-1 - _SLOW] - costs[-1] < 10 * _SLOW * s.cost_tolerance * abs(costs[-1])
            near = calm and self._whole and rest < _REST * s.cost_tolerance
            done = bool((slow or near) and amount <= s.tolerance)
            # Three calm iterations: damped steps change little without being near.
            done = done or (calm >= 3 and not self._raise_penalty(values, at.duration))
            if done:
                break
        violation = self.problem.worst(values, at.duration)
        within: SolverOutcome = "solved" if done else "feasible"
        outcome = within if violation.amount <= s.tolerance else "infeasible"
        last = self._ahead[1] if self._ahead is not None and self._ahead[0] is at else None
        return Solution(at, values.cost, violation, count, outcome, last, self._weight)

    def _raise_penalty(self, values: Values, duration: float) -> bool:
        """Raise the cost of violations if there are some; False if there are none or it is at its limit."""
        if self.problem.worst(values, duration).amount <= self.settings.tolerance or self._weight >= _MOST_WEIGHT:
            return False
        self._weight, self._damping = _HEAVIER * self._weight, _FIRST_DAMPING
        return True

    def iterate(self, at: Iterate, change: float | None = None) -> tuple[Iterate, Values] | None:
        """One iteration: the next iterate with its values; None if no step improves the merit function.

        Args:
            at: the iterate.
            change: relative change of the cost by the last iteration of a series that goes on; None for a single one.
        """
        known = self._ahead
        problem, values = known[1:] if known is not None and known[0] is at else self.problem.linearize(at)
        self.linear, self._ahead = problem, None
        sizes = problem.typical_sizes[1:, :-1] if self.problem.free else problem.typical_sizes
        while self._damping < _MOST_DAMPING:
            try:
                direction = self.interior.solve(problem, self._damping, self._weight, change)
            except SimulationError:  # not convex to rounding, because the Hessian lacks directions
                self._damping = max(10 * self._damping, 1e-3)
                continue
            found = self._searched(at, values, direction, sizes, change is not None)
            if found is not None:
                after, result, length = found
                self._whole = length == 1.0 and self._damping <= 1.0
                # Whole steps close the gaps, which damping does not hinder.
                self._damping = max(_LEAST_DAMPING, (0.2 if length == 1.0 else 4.0) * self._damping)
                return after, result
            self._damping = max(20 * self._damping, 1e-4)
        return None

    def _searched(
        self, at: Iterate, values: Values, direction: Direction, sizes: Array, ahead: bool
    ) -> tuple[Iterate, Values, float] | None:
        """Line search along a direction: the next iterate, its values, and the step length."""
        assert self.linear is not None
        # Weights of gaps exceed their multipliers, so that the direction descends. They fall by half at most: a merit
        # function that changes much from step to step accepts cycles.
        costate = np.abs(direction.costate[1:, : self.problem.model.nx]).max(axis=0)
        self._gap_weights = np.maximum(0.5 * self._gap_weights, 1.5 * costate)
        merit = self._merit(values, sizes)
        predicted = merit - _merit_of_subproblem(self.linear, direction, values.cost, sizes, self._weight)
        rounding = 1e-12 * max(1.0, abs(merit))
        for length in _LENGTHS:
            after = self.problem.moved(at, direction.x, direction.u, float(length))
            try:
                # Gaps of velocities grow with the square of the step, and so does the merit: closed, long steps pass.
                after = self.problem.closed(after, self.linear)
                # After a whole step the next one is probably whole too: derivatives cost little more than values, and
                # the next iteration has them already.
                if ahead and self._whole and length == 1.0:
                    linear, result = self.problem.linearize(after)
                    self._ahead = after, linear, result
                else:
                    result = self.problem.values(after)
            except RncError:  # a singular configuration: shorter steps may avoid it
                continue
            now = self._merit(result, sizes)
            sufficient = 1e-4  # part of the predicted decrease that a step has to reach
            if np.isfinite(now) and now <= merit - sufficient * length * max(0.0, predicted) + rounding:
                return after, result, float(length)
        return None

    def _merit(self, values: Values, sizes: Array) -> float:
        beyond = float((self.problem.excess(values) / sizes).sum())
        return values.cost + float((np.abs(values.gaps) * self._gap_weights).sum()) + self._weight * beyond


def _merit_of_subproblem(
    problem: LinearQuadratic, direction: Direction, cost: float, sizes: Array, weight: float
) -> float:
    """Merit function of the subproblem after the whole step; the linearised dynamics hold."""
    whole = np.concatenate([direction.x, np.pad(direction.u, ((0, 1), (0, 0)))], axis=1)  # the end has no input
    z, end = whole[:-1], direction.x[-1]
    cost += float((problem.g * z).sum() + problem.g_end @ end)
    cost += 0.5 * float((np.matvec(problem.H, z) * z).sum() + end @ problem.H_end @ end)
    value = np.matvec(problem.G, whole)
    beyond = np.maximum(0.0, np.maximum(problem.lower - value, value - problem.upper))
    shift = len(beyond) - len(sizes)  # a free duration adds a stage and a row, which always holds
    return cost + weight * float((beyond[shift:, : sizes.shape[1]] / sizes).sum())


def solve_bounded(problem: Transcription, settings: SolverSettings, start: Iterate, weight: float = 0.0) -> Solution:
    """Solve a problem with the limits of the robot's file only if a solution without them exceeds one.

    Most motions are far within them, and rows that do not matter would take time in every iteration. In the dynamic
    form, limits of joints matter: without them, motions of least effort swing and spin.

    Args:
        problem: the problem.
        settings: settings.
        start: a guess, or the solution of a similar problem.
        weight: weight of violations of the similar problem, as for ``SequentialQuadratic.solve``.
    """
    least = problem.model.form == "dynamic"
    stated = [bound for bound in problem.bounds if not bound.of_file or (least and bound.quantity != DISTANCE)]
    if len(stated) == len(problem.bounds):
        return SequentialQuadratic(problem, settings).solve(start, weight)
    found = SequentialQuadratic(problem.changed(bounds=stated), settings).solve(start, weight)
    excess = problem.excess(problem.values(found.iterate)).max(initial=0.0)
    if excess <= max(settings.tolerance, found.violation.amount):
        return found
    # Without the weight of the other problem: new rows change the multipliers.
    within = SequentialQuadratic(problem, settings).solve(found.iterate)
    within.iterations += found.iterations
    return within
