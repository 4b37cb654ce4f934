"""Tracking of the reducing outputs alone; the vertical ones are not controlled."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from rnc_pin.control import ReducingOutputController
from rnc_pin.planning import Joined, Reference, ReferencePoint
from rnc_pin.scenario.schema.controllers.base import Built, Context, chosen
from rnc_pin.scenario.schema.controllers.velocity import OUTER_GAIN, VelocitySettings


class ReducingOutputsSettings(VelocitySettings):
    """Each reducing output follows its own reference; the vertical outputs are not controlled."""

    # Comparisons show the error of vertical outputs without control, so their reference is accepted.
    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant", "vertical"})

    type: Literal["reducing_outputs"]
    """Tracking of all reducing outputs, over a velocity tracker."""

    def make(self, context: Context) -> Built:
        task = context.task
        order = np.argsort(np.concatenate([task.primary, task.redundant]))
        reference = _Reordered(Joined([context.primary, context.redundant]), order)
        gain = chosen("k21", self.k21, OUTER_GAIN, task.r)
        return self.tracked(
            context, ReducingOutputController(context.reduced, reference, k2=gain, watched=context.watched)
        )


class _Reordered:
    """Reference with its outputs in another order."""

    def __init__(self, reference: Reference, order: np.ndarray) -> None:
        self._reference, self._order = reference, order
        self.size, self.duration = reference.size, reference.duration

    def at(self, t: float) -> ReferencePoint:
        point = self._reference.at(t)
        return ReferencePoint(*(each[self._order] for each in point))
