"""Solutions from guesses, one after the other or in several processes."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Generator, Iterator
from functools import lru_cache
from typing import NamedTuple

from rnc_pin.errors import RncError
from rnc_pin.optimal.bounds import DISTANCE
from rnc_pin.optimal.sequential_quadratic import SequentialQuadratic, Solution, SolverSettings
from rnc_pin.optimal.transcription import Iterate, Transcription

_RELAXED = ("straight line", "loop", "random")  # guesses that do not tell on which side of obstacles they pass


class Candidate(NamedTuple):
    """Solution of a guess."""

    name: str
    solution: Solution


class LimitSolver:
    """Solver that adds the limits of the robot's file only if a solution without them exceeds one.

    Most motions are far within them, and rows that do not matter would take time in every iteration.
    """

    def __init__(self, problem: Transcription, settings: SolverSettings) -> None:
        stated = [bound for bound in problem.bounds if not bound.of_file]
        self._problem, self._tolerance = problem, settings.tolerance
        self._whole = SequentialQuadratic(problem, settings)
        few = len(stated) < len(problem.bounds)
        self._without = SequentialQuadratic(problem.with_bounds(stated), settings) if few else None

    def solve(self, start: Iterate) -> Solution:
        """Solve the problem from a guess."""
        if self._without is None:
            return self._whole.solve(start)
        found = self._without.solve(start)
        values = self._problem.values(found.iterate)
        if self._problem.excess(values).max(initial=0.0) <= max(self._tolerance, found.violation.amount):
            return found
        within = self._whole.solve(found.iterate)
        within.iterations += found.iterations
        return within


class GuessSolver:
    """Solver of a problem from guesses. Each solution depends on its guess alone, whichever process finds it.

    Args:
        problem: the problem.
        settings: settings of the solver.
    """

    def __init__(self, problem: Transcription, settings: SolverSettings) -> None:
        self._made_of = problem, settings
        self._solver, self._relaxed = LimitSolver(problem, settings), _without_distances(problem, settings)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), self._made_of

    def solution(self, name: str, start: Iterate) -> Candidate | RncError:
        """Solution from a guess, or the error that ends its iterations."""
        try:
            if self._relaxed is not None and name.startswith(_RELAXED):
                start = self._relaxed.solve(start).iterate
            return Candidate(name, self._solver.solve(start))
        except RncError as error:
            return error

    def solutions(
        self, starts: Iterator[tuple[str, Iterate]], jobs: int
    ) -> Generator[Candidate | RncError, None, None]:
        """Solutions in the order of their guesses, which are made as they are needed.

        Args:
            starts: named guesses.
            jobs: number of processes; -1 for all cores. With one, this process solves.
        """
        if jobs == 1:
            for start in starts:
                yield self.solution(*start)
            return
        from joblib import Parallel, delayed

        pickled = pickle.dumps(self)
        calls = (delayed(_solution)(pickled, *start) for start in starts)
        found = Parallel(jobs, return_as="generator", pre_dispatch="n_jobs")(calls)
        try:
            for each in found:  # noqa: UP028  (it would close the generator outside of the lines below)
                yield each
        finally:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # about guesses under way that nobody needs any more
                found.close()


@lru_cache(maxsize=1)
def _unpickled(pickled: bytes) -> GuessSolver:
    found: GuessSolver = pickle.loads(pickled)
    return found


def _solution(pickled: bytes, name: str, start: Iterate) -> Candidate | RncError:
    """Solution in a worker, which unpickles a problem once."""
    return _unpickled(pickled).solution(name, start)


def _without_distances(problem: Transcription, settings: SolverSettings) -> SequentialQuadratic | None:
    """Solver without the bounds of distances, whose motions lead past obstacles; None if there are none.

    Its iterations cost a small part of those with distances, and its solution is a good start for them.
    """
    if all(bound.quantity != DISTANCE for bound in problem.bounds):
        return None
    kept = [bound for bound in problem.bounds if bound.quantity != DISTANCE and not bound.of_file]
    return SequentialQuadratic(problem.with_bounds(kept), settings)
