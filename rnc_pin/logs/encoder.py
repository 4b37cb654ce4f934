"""Encoder counts that wrap around or overflow."""

from __future__ import annotations

import numpy as np

from rnc_pin.errors import ConfigurationError

_MOST = 0.4  # largest step as a fraction of the range; near one half, its direction is not known


def unwrapped(counts: np.ndarray, span: float, what: str = "encoder") -> np.ndarray:
    """Return continuous counts (N,) of a counter that returns to its start after ``span`` counts.

    A step is the shortest of all that agree with the counter: it is less than half the span. The first count keeps its
    value, less the span if that is nearer to zero: an absolute encoder begins within half a turn of its zero.

    Args:
        counts: counts (N,) in the order of time.
        span: number of counts after which the counter returns, e.g. 8192 or ``2**32``.
        what: name of the counter, for messages.

    Raises:
        ConfigurationError: a count is outside the span, or a step is so large that its direction is not known.

    Example:
        >>> rnc.logs.unwrapped(np.array([6.0, 7.0, 1.0, 7.0]), span=8)
        array([-2., -1.,  1., -1.])
    """
    if not len(counts):
        return counts.astype(float)
    low, high = float(np.min(counts)), float(np.max(counts))
    if high - low > span:
        raise ConfigurationError(f"{what}: counts from {low:g} to {high:g} do not wrap after {span:g}")
    steps = np.diff(counts.astype(float))
    steps -= span * np.round(steps / span)
    if len(steps) and np.abs(steps).max() > _MOST * span:
        place = int(np.argmax(np.abs(steps)))
        raise ConfigurationError(
            f"{what}: step {place + 1} is {steps[place]:g} of {span:g} counts, so that its direction is not known; "
            f"expected at most {_MOST:g} of the range between two samples"
        )
    first = float(counts[0])
    first -= span * np.round(first / span)
    return np.asarray(first + np.concatenate([[0.0], np.cumsum(steps)]))
