"""Errors of a trial run beside the motion that was asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rnc_pin.simulation import Trajectory
from rnc_pin.simulation.summary import tracking_errors

FAR = 0.2
"""Share of the motion that is asked for, above which a run misses its reference."""
LOST = 0.5
"""The same, above which another kind of base is more likely."""
_LITTLE = 0.5  # share of the largest motion that counts for an output that should stay where it is
_SETTLED = 0.1  # last part of a run in which a controller that has to balance first is judged


@dataclass(frozen=True)
class Trial:
    """The worst output of a run.

    Attributes:
        duration: of the run [s].
        output: its name; nothing where the run follows no reference.
        error: its largest error [m or rad].
        motion: how far it should go, or others where it should stay [m or rad].
    """

    duration: float
    output: str = ""
    error: float = 0.0
    motion: float = 1.0

    @property
    def share(self) -> float:
        """Error beside motion."""
        return self.error / self.motion

    @property
    def words(self) -> str:
        """Half a sentence."""
        if not self.output:
            return f"tried for {self.duration:.3g} s"
        return (
            f"tried for {self.duration:.3g} s: the largest error is {self.error:.2g} where {self.motion:.2g} "
            f"{'is' if self.share < FAR else 'is all that is'} asked for ({self.output})"
        )

    @property
    def complaint(self) -> str:
        """What is wrong with it, in words that can follow "its run"."""
        return f"misses its reference: {self.output} is off by {self.error:.2g}, and should move by {self.motion:.2g}"


def judged(trajectory: Trajectory, motions: Mapping[str, float], *, settles: bool) -> Trial:
    """The worst of the outputs that follow a reference.

    Args:
        trajectory: the run.
        motions: how far each of them goes [m or rad], by output.
        settles: whether only the end counts, as of a controller that has to balance first.
    """
    duration = float(trajectory.time[-1])
    largest = max((abs(length) for length in motions.values()), default=0.0)
    errors = {name: error for name, error in tracking_errors(trajectory).items() if name in motions}
    if not errors or not largest:
        return Trial(duration)
    trials = []
    for name, error in errors.items():
        first = int((1 - _SETTLED) * len(error)) if settles else 0
        worst = float(np.nan_to_num(np.abs(error[first:])).max(initial=0.0))
        trials.append(Trial(duration, name, worst, abs(motions[name]) or _LITTLE * largest))
    return max(trials, key=lambda each: each.share)
