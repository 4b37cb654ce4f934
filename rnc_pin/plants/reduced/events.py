"""Events within a step of a plant: times at which values of its state cross zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import scipy

from rnc_pin.plants.reduced.reduced_plant import ReducedPlant

_PRECISION = 1e-12  # of the time of an event, relative to the end of its bracket
_HALVINGS = 40


class EventStep(Protocol):
    """Step of a plant under constant inputs, to whose instants the plant can move."""

    dt: float
    """Duration of the step [s]."""

    def move_to(self, elapsed: float) -> None:
        """Move the plant to a time after the start of the step [s]."""


class ReducedStep:
    """Step of a ``ReducedPlant``.

    Args:
        plant: plant at the start of the step. It advances to the end.
        dt: duration of the step [s].

    Raises:
        DivergenceError: as ``ReducedPlant.advance``.
    """

    def __init__(self, plant: ReducedPlant, dt: float) -> None:
        self._plant, self.dt, self._start = plant, dt, plant.checkpoint()
        plant.advance(dt)
        self._end = plant.checkpoint()
        self._steps = self._end.errors.used  # one number, so that the state depends continuously on the time

    def move_to(self, elapsed: float) -> None:
        """Move the plant to a time after the start of the step [s]."""
        self._plant.rollback(self._end if elapsed == self.dt else self._start)
        if 0.0 < elapsed < self.dt:
            self._plant.advance_part(elapsed, self._steps)


class Watched(NamedTuple):
    """Value of the present state of a plant that falls through zero at an event.

    Attributes:
        value: function of the value.
        rate: function of its rate, for a value that may rise again within the step, such as a gap.
        rounding: absolute value that counts as zero where a step with a ``rate`` starts.
    """

    value: Callable[[], float]
    rate: Callable[[], float] | None = None
    rounding: float = 0.0


def first_event(step: EventStep, watched: Sequence[Watched]) -> tuple[float, int] | None:
    """Time after the start of a step [s] and index of the first event within it; None without any."""
    step.move_to(0.0)
    before = [each.value() for each in watched]
    rates = [0.0 if each.rate is None else each.rate() for each in watched]
    step.move_to(step.dt)
    after = [each.value() for each in watched]
    found: list[tuple[float, int]] = []
    for index, each in enumerate(watched):
        if each.rate is not None:
            time = _fall(step, each, each.rate, before[index], rates[index])
            found += [] if time is None else [(time, index)]
        elif before[index] > 0 >= after[index]:
            found.append((_crossing(step, each.value, 0.0, step.dt), index))
    return min(found, default=None)


def _fall(step: EventStep, watched: Watched, rate: Callable[[], float], before: float, falls: float) -> float | None:
    """Time at which a value becomes negative; None if it does not."""
    value, rounding, end = watched.value, watched.rounding, step.dt
    leaves = before <= rounding  # it starts at zero
    step.move_to(end)
    if value() >= (-rounding if leaves else 0.0):
        # It may be negative in between, such as the gap of a corner of a body that turns.
        if not falls < 0.0 < rate():
            return None
        end = _crossing(step, rate, 0.0, end)
        step.move_to(end)
        if value() >= -rounding:
            return None
    if not leaves:
        return _crossing(step, value, 0.0, end)
    for halving in range(1, _HALVINGS):
        start = end * 0.5**halving
        step.move_to(start)
        if value() > 0.0:
            return _crossing(step, value, start, end)
    return 0.0


def _crossing(step: EventStep, value: Callable[[], float], start: float, end: float) -> float:
    """Time after the start of a step at which a value crosses zero between two times [s]."""

    def at(elapsed: float) -> float:
        step.move_to(elapsed)
        return value()

    return float(scipy.optimize.brentq(at, start, end, xtol=_PRECISION * end, rtol=1e-14))
