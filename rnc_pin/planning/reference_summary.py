"""Printed references: size, duration, and the positions at both ends."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Protocol

import numpy as np

from rnc_pin.printing import ObjectSummary, SummaryMixin, counted, described


class _Point(Protocol):
    @property
    def position(self) -> np.ndarray: ...


class ReferenceSummary(SummaryMixin):
    """Mixin of references that prints them: positions have the units of the outputs that the reference is for."""

    size: int
    duration: float

    @abstractmethod
    def at(self, t: float) -> _Point: ...

    def _summary(self) -> ObjectSummary:
        end = "never rests" if math.isinf(self.duration) else f"rests from t = {self.duration:g} s on"
        times = [0.0] if math.isinf(self.duration) or not self.duration else [0.0, self.duration]
        lines = [(f"position at t = {t:g} s", described(self.at(t).position)) for t in times]
        return ObjectSummary(f"{type(self).__name__} of {counted(self.size, 'output')}, {end}", lines)
