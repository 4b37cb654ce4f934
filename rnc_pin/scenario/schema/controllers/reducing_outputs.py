"""Reducing outputs alone, the vertical ones go where they will."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from rnc_pin.control import ReducingOutputController
from rnc_pin.planning import Joined, Reference, ReferencePoint
from rnc_pin.scenario.schema.controllers.base import Built, Context, chosen
from rnc_pin.scenario.schema.controllers.velocity import OUTER_GAIN, VelocitySettings


class ReducingOutputsSettings(VelocitySettings):
    """Every reducing output follows a reference of its own, the vertical ones go where they will."""

    # Vertical references left alone are what it is there to show.
    follows: ClassVar[frozenset[str]] = frozenset({"primary", "redundant", "vertical"})

    type: Literal["reducing_outputs"]
    """References for all reducing outputs, over a velocity tracker."""

    def make(self, context: Context) -> Built:
        task = context.task
        order = np.argsort(np.concatenate([task.primary, task.redundant]))
        reference = _Reordered(Joined([context.primary, context.redundant]), order)
        gain = chosen("k21", self.k21, OUTER_GAIN, task.r)
        return self.tracked(
            context, ReducingOutputController(context.reduced, reference, k2=gain, watched=context.watched)
        )


class _Reordered:
    """A reference with its outputs in another order."""

    def __init__(self, reference: Reference, order: np.ndarray) -> None:
        self._reference, self._order = reference, order
        self.size, self.duration = reference.size, reference.duration

    def at(self, t: float) -> ReferencePoint:
        point = self._reference.at(t)
        return ReferencePoint(*(each[self._order] for each in point))
