"""Results of many runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy import ndarray as Array

from rnc_pin.errors import InputError
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.simulation.trajectory import Trajectory


class RunResult:
    """Result of one run of a batch.

    Args:
        outcome: outcome of the run.
        error: error that ended it early, if any.
        trajectory: the run, or a function that returns it; None if the run could not start.
    """

    def __init__(
        self, outcome: Outcome, error: Exception | None, trajectory: Trajectory | Callable[[], Trajectory] | None
    ) -> None:
        self.outcome, self.error, self._trajectory = outcome, error, trajectory

    @property
    def started(self) -> bool:
        """True if the run has a trajectory."""
        return self._trajectory is not None

    @property
    def trajectory(self) -> Trajectory:
        """The run so far.

        Raises:
            Exception: the error of a run that could not start.
        """
        if self._trajectory is None:
            assert self.error is not None
            raise self.error
        if not isinstance(self._trajectory, Trajectory):
            self._trajectory = self._trajectory()
        return self._trajectory

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_trajectory": None if self._trajectory is None else self.trajectory}


class TrajectoryBatch(SummaryMixin, Sequence[Trajectory]):
    """Runs of ``simulate`` with many initial states, controllers or plants, in their order.

    ``runs[3]`` is a ``Trajectory``, and ``runs[:4]`` a batch. Forces, energies and residuals of a run are computed when
    they are first read.

    Args:
        results: result of each run.

    Attributes:
        outcomes: outcome of each run.
        errors: error that ended each run early; None for the others.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> actuators = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")], actuators)
        >>> reduced = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
        >>> target = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold([0.5, 0.0]))
        >>> starts, tracker = [[0.1, 0.0], [0.2, 0.0], [2e3, 0.0]], rnc.control.VelocityTracker(target)
        >>> runs = rnc.simulate(reduced, tracker, robot.configuration(), 1.0, dt=0.01, v2_0=starts)
        >>> runs
        TrajectoryBatch of 3 runs: 2 completed, 1 diverged
        >>> [str(outcome) for outcome in runs.outcomes], runs[1].v2[0].tolist()
        (['completed', 'completed', 'diverged'], [0.2, 0.0])
        >>> runs.stack("v2").shape  # NaN after the end of a run
        (3, 101, 2)
    """

    def __init__(self, results: Sequence[RunResult]) -> None:
        self._results = tuple(results)
        self.outcomes = tuple(result.outcome for result in self._results)
        self.errors = tuple(result.error for result in self._results)

    def __len__(self) -> int:
        return len(self._results)

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...

    @overload
    def __getitem__(self, index: slice) -> TrajectoryBatch: ...

    def __getitem__(self, index: int | slice) -> Trajectory | TrajectoryBatch:
        if isinstance(index, slice):
            return TrajectoryBatch(self._results[index])
        return self._results[index].trajectory

    def __iter__(self) -> Iterator[Trajectory]:
        return (result.trajectory for result in self._results)

    def stack(self, name: str) -> Array:
        """Array (B, N, ...) of all runs, such as "q" or "time"; NaN after the end of a run, and if it could not start.

        Raises:
            InputError: no run has an array of that name, or their shapes differ.
        """
        started = [result for result in self._results if result.started]
        arrays = {id(result): getattr(result.trajectory, name, None) for result in started}
        found = [array for array in arrays.values() if isinstance(array, np.ndarray)]
        if not found or len(found) < len(started) or len({array.shape[1:] for array in found}) > 1:
            raise InputError(f"no array '{name}' of one shape in all runs")
        stacked = np.full((len(self), max(map(len, found)), *found[0].shape[1:]), np.nan)
        for row, result in zip(stacked, self._results, strict=True):
            array = arrays.get(id(result))
            if array is not None:
                row[: len(array)] = array
        return stacked

    def _summary(self) -> ObjectSummary:
        counts = {str(outcome): self.outcomes.count(outcome) for outcome in Outcome}
        said = ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count)
        errors = [Item(f"run {run}", str(error)) for run, error in enumerate(self.errors) if error is not None]
        title = f"TrajectoryBatch of {len(self)} runs: {said or 'none'}"
        return ObjectSummary(title, [("errors", errors[:20])] if errors else [])
