"""Tracking errors of a trial run relative to the motion of its reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rnc_pin.simulation import Trajectory, tracking_errors
from rnc_pin.verdict import Finding, Verdict

FAR = 0.2
"""Ratio of error to reference motion above which a run misses its reference."""
LOST = 0.5
"""Ratio of error to reference motion above which another kind of base is more likely."""
MEANINGFUL = 1.0
"""Duration of the shortest run with a meaningful displacement [s]: a controller that learns starts late."""
_LITTLE = 0.5  # motion assumed for an output with a constant reference, as a share of the largest motion
_SETTLED = 0.1  # final share of a run whose errors count for a balancing controller


@dataclass(frozen=True)
class Trial:
    """Worst output of a run.

    Attributes:
        duration: duration of the run [s].
        output: name of the output; empty if the run has no reference.
        error: largest error of the output [m or rad].
        motion: displacement of its reference; for a constant one, a share of the largest displacement [m or rad].
        findings: what the model and the run show beside the error.
        kept_share: share of the motion that would keep the velocities and efforts of the file, 1 if the run keeps them;
            1 too if no share would, because the weight alone needs more.
        share: share of the usual motion that the run makes.
    """

    duration: float
    output: str = ""
    error: float = 0.0
    motion: float = 1.0
    findings: tuple[Finding, ...] = ()
    kept_share: float = 1.0
    share: float = 1.0

    @property
    def verdict(self) -> Verdict:
        """Findings in the order of their weight."""
        return Verdict.of(self.findings)

    @property
    def rank(self) -> tuple[bool, float]:
        """Rank among candidates, the smallest first: those that succeed, then those with small errors."""
        return not self.verdict.succeeded, self.relative_error

    @property
    def relative_error(self) -> float:
        """Ratio of error to motion."""
        return self.error / self.motion

    @property
    def words(self) -> str:
        """Summary for the remark in the draft."""
        kept = (
            f", with {100 * self.share:.0f} % of the usual motion, which keeps the velocities and efforts of the file"
        )
        tried = f"tried for {self.duration:.3g} s{kept if self.share < 1.0 else ''}"
        if not self.output:
            return tried
        return (
            f"{tried}: the largest error is {self.error:.2g} where {self.motion:.2g} "
            f"{'is' if self.relative_error < FAR else 'is all that is'} asked for ({self.output})"
        )

    @property
    def failure_text(self) -> str:
        """Description of the tracking error; it continues a sentence that begins with "its run"."""
        return f"misses its reference: {self.output} is off by {self.error:.2g}, and should move by {self.motion:.2g}"


def worst_output(trajectory: Trajectory, motions: Mapping[str, float], *, settles: bool) -> Trial:
    """Return the worst output with a reference.

    Args:
        trajectory: the run.
        motions: displacement of each reference [m or rad], by output.
        settles: True if only the end of the run counts, as for a controller that first has to balance.
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
    return max(trials, key=lambda each: each.relative_error)
