"""Velocities that reverse at every sample, in runs with drawn scenes at 25 ms.

The measure is the largest change of a joint's velocity that reverses in three samples in a row, as a share of the
velocity limit of the joint. It is at most 2.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.drawn_scenes import drawn_options
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.robots.joint_values import NO_LIMIT
from rnc_pin.simulation import Trajectory


def reversal(run: Trajectory, limits: np.ndarray) -> float:
    """Largest change that reverses in three samples in a row, of velocities (N, nv) over their limits (nv,)."""
    change = np.diff(run.v / limits, axis=0)
    parts = np.stack([change[:-2], -change[1:-1], change[2:]])
    return float(np.maximum(parts.min(axis=0), (-parts).min(axis=0)).max(initial=0.0))


def main(draws: list[int]) -> None:
    """Print the measure of each draw of the free-flying arm."""
    for draw in draws:
        prepared = Scenario.load(
            "free-flying-arm-limits", {**drawn_options("free-flying-arm-limits", draw), "preflight": "warn"}
        ).build()
        limits = prepared.experiment.reduced.robot.model.upperVelocityLimit
        limits = np.where((limits > 0) & (limits < NO_LIMIT), limits, np.inf)
        print(f"draw {draw}: {reversal(execute(prepared).trajectory, limits):.2f}")


if __name__ == "__main__":
    main([int(each) for each in sys.argv[1:]] or [0, 1, 6, 9])
