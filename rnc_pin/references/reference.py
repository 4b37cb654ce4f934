"""References: desired positions of outputs, with three time derivatives, and references that consist of others.

Every reference has ``size`` and ``at(t)``.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from rnc_pin.array_shapes import Array, Float
from rnc_pin.printing import ObjectSummary, SummaryMixin, counted, described, printed


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


@printed()
class ReferencePoint(NamedTuple):
    """Value of a reference at one time, (k,) each."""

    position: Float[Array, " k"]
    velocity: Float[Array, " k"]
    acceleration: Float[Array, " k"]
    jerk: Float[Array, " k"]


@runtime_checkable
class Reference(Protocol):
    """Desired trajectory of k outputs; any object with these two attributes and this method is one.

    Attributes:
        size: number of outputs, k.
        duration: time after which the reference rests [s]; infinite if it never rests, zero for a constant.

    Example:
        >>> class Ramp:
        ...     size, duration = 1, np.inf
        ...     def at(self, t):
        ...         zero = np.zeros(1)
        ...         return rnc.planning.ReferencePoint(np.array([0.1 * t]), np.array([0.1]), zero, zero)
        >>> isinstance(Ramp(), rnc.planning.Reference), Ramp().at(2.0).position
        (True, array([0.2]))
    """

    size: int
    duration: float

    def at(self, t: float) -> ReferencePoint:
        """Return position, velocity, acceleration and jerk, (k,) each.

        Args:
            t: time [s].
        """


@printed()
class TaskReference(NamedTuple):
    """References of a task."""

    primary: Reference
    """Reference of x21."""
    vertical: Reference
    """Reference of x1."""

    @property
    def duration(self) -> float:
        """Time after which both references rest [s]."""
        return max(self.primary.duration, self.vertical.duration)


class Joined(ReferenceSummary):
    """Concatenation of several references: outputs of all parts in one vector.

    Args:
        references: references of the parts, in the order of the outputs.

    Example:
        >>> parts = [rnc.planning.Hold([1.0]), rnc.planning.Hold([2.0, 3.0])]
        >>> rnc.planning.Joined(parts).at(0.0).position
        array([1., 2., 3.])
    """

    def __init__(self, references: Sequence[Reference]) -> None:
        self._parts = list(references)
        self.size = sum(part.size for part in self._parts)
        # Outputs of parts that end earlier rest until the last one does.
        self.duration = max((part.duration for part in self._parts), default=0.0)

    def at(self, t: float) -> ReferencePoint:
        points = [part.at(t) for part in self._parts]
        return ReferencePoint(*(np.concatenate(each) for each in zip(*points, strict=True)))


class InTurn(ReferenceSummary):
    """Sequence of references of the same outputs; each runs until it rests, then the next one takes over.

    Args:
        references: each begins at the end position and end time of the one before it.

    Example:
        >>> out = rnc.planning.MinimumJerk([0.0], [1.0], duration=2.0)
        >>> back = rnc.planning.MinimumJerk([1.0], [0.0], duration=2.0, begin=2.0)
        >>> reference = rnc.planning.InTurn([out, back])
        >>> reference.duration, reference.at(1.0).velocity, reference.at(3.0).velocity
        (4.0, array([0.9375]), array([-0.9375]))
    """

    def __init__(self, references: Sequence[Reference]) -> None:
        self._parts = list(references)
        self.size, self.duration = self._parts[0].size, self._parts[-1].duration

    def at(self, t: float) -> ReferencePoint:
        # The last part also holds the end.
        return next((part for part in self._parts if t < part.duration), self._parts[-1]).at(t)
