"""Desired outputs of tasks, for the record of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy import ndarray as Array

from rnc_pin.control.whole_body.tasks.control_task import BoundTask
from rnc_pin.model.reduced_model import ReducedModel


class DesiredOutputs:
    """Desired values of a model's outputs, as far as tasks have them.

    Args:
        tasks: tasks of the model.
        reduced: the model.
    """

    def __init__(self, tasks: Sequence[BoundTask], reduced: ReducedModel) -> None:
        self._sizes = reduced.vertical.size, reduced.r
        self._goals = [
            (task.goal, own, where, place)
            for task in tasks
            for place, names in enumerate((reduced.vertical.names, reduced.reducing.names))
            for own, where in [_matches(task.goal_names, names)]
            if own
        ]

    def at(self, t: float) -> tuple[Array | None, Array | None]:
        """Return x1 and x2 at a time [s], NaN for outputs without a task; None if no task has an output."""
        if not self._goals:
            return None, None
        found = np.full(self._sizes[0], np.nan), np.full(self._sizes[1], np.nan)
        for goal, own, where, place in self._goals:
            found[place][where] = goal(t)[own]
        return found


def _matches(names: Sequence[str], among: Sequence[str]) -> tuple[list[int], list[int]]:
    """Indices of common names in both sequences."""
    own = [index for index, name in enumerate(names) if name in among]
    return own, [list(among).index(names[index]) for index in own]
