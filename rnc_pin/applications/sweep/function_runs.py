"""Runs that a function of the user builds from drawn values."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.sweep.seeded_draws import Draw, SeededDraws
from rnc_pin.applications.sweep.swept_run import Numbered, Row, is_result_column, refused, results_of, save_trajectory
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.simulation import Outcome, Summary, Trajectory, add_verdict, simulate, summarize

Build: TypeAlias = Callable[[dict[str, Any]], "Mapping[str, object] | Trajectory | Scenario"]
"""Function of drawn values that returns the arguments of ``simulate`` by name, or a finished run."""


class FunctionRuns:
    """Runs that a function builds from drawn values.

    Args:
        build: function of the drawn values.
        draws: seeded draws; None if every run gets its values.
        trajectories: folder of the sweep, for trajectories; None writes none.
    """

    advance_together = False

    def __init__(self, build: Build, draws: SeededDraws | None, trajectories: str | None = None) -> None:
        self._build, self._draws, self._trajectories = build, draws, trajectories

    def rows(self, batch: Sequence[Numbered]) -> list[Row]:
        """Simulate the runs one after the other and return their rows."""
        return [self.row(run, draw) for run, draw in batch]

    def row(self, run: int, draw: Draw | None = None) -> Row:
        """Simulate a run and return its row."""
        start = time.perf_counter()
        if draw is None:
            assert self._draws is not None
            draw = next(self._draws.of_run(run))
        check_names(draw)
        with np.errstate(over="ignore", invalid="ignore"):  # diverged values
            results = self._results(run, draw)
        return {"run": run, **canonical(draw), **results, "wall_time": time.perf_counter() - start}

    def _results(self, run: int, draw: Draw) -> Row:
        try:
            summary, trajectory = _simulated(self._build(dict(draw)))
        except RncError as error:
            if not isinstance(error.trajectory, Trajectory):
                return refused("refused", error)
            trajectory = error.trajectory
            summary = _judged(trajectory)
        if trajectory.outcome is Outcome.INTERRUPTED:
            raise KeyboardInterrupt
        save_trajectory(trajectory, self._trajectories, run)
        return results_of(summary)


def _simulated(built: object) -> tuple[Summary, Trajectory]:
    if isinstance(built, Scenario):
        result = execute(built)
        return result.summary, result.trajectory
    if isinstance(built, Mapping):
        built = simulate(**built)
    if not isinstance(built, Trajectory):
        raise TypeError(
            f"build returned {type(built).__name__}, expected the arguments of rnc.simulate by name, or a Trajectory"
        )
    return _judged(built), built


def _judged(run: Trajectory) -> Summary:
    """Summary of a run with its verdict."""
    summary = summarize(run)
    add_verdict(summary, run.verdict)
    return summary


def check_names(draw: Draw) -> None:
    """Raise an error if a drawn value has the name of a result."""
    for name in draw:
        if not isinstance(name, str) or is_result_column(name):
            raise ConfigurationError(f"draws: {name!r} is the name of a result; choose another one")


def canonical(draw: Draw) -> dict[str, object]:
    """Drawn values as JSON content: arrays become lists, and NumPy's numbers those of Python."""
    return {name: _plain(value) for name, value in draw.items()}


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value
