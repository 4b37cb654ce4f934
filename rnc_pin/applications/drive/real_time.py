"""Clock of a driven run: simulated time follows real time, and falls behind visibly if samples take too long."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

_WINDOW = 1.0  # [s] of real time over which the factor is measured


class RealTimeClock:
    """Clock that waits for the real time of a sample.

    A sample that is late is never skipped. The clock does not catch up either: lost time stays lost, so that the robot
    never moves faster than in reality.

    Args:
        now: monotonic clock [s].
        sleep: function that waits [s].
    """

    def __init__(
        self, now: Callable[[], float] = time.monotonic, sleep: Callable[[float], object] = time.sleep
    ) -> None:
        self._now, self._sleep = now, sleep
        self._start: float | None = None
        self._window: deque[tuple[float, float]] = deque()
        self.lost = 0.0
        """Real time by which the run has fallen behind [s]."""

    def wait(self, t: float) -> None:
        """Wait until simulated time t [s] is due."""
        now = self._now()
        if self._start is None:
            self._start = now - t
        early = self._start + t - now
        if early > 0:
            self._sleep(early)
            now += early
        else:
            self.lost -= early
            self._start -= early
        self._window.append((now, t))
        while len(self._window) > 2 and self._window[1][0] < now - _WINDOW:
            self._window.popleft()

    @property
    def factor(self) -> float:
        """Simulated time over real time in the last second; 1 at the start."""
        (first, begin), (last, end) = self._window[0], self._window[-1]
        return (end - begin) / (last - first) if last > first else 1.0
