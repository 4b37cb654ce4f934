"""Status of a driven run for its page: real-time factor, limits, and goals that cannot be reached."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.drive.controls import DriveControls
from rnc_pin.applications.drive.goals import DriveGoals
from rnc_pin.control.whole_body import LimitReport

_NEAR = 0.01  # distance from a goal that counts as reached [m]
_PATIENCE = 1.0  # time without progress after which a goal counts as not reachable [s]
_PROGRESS = 0.005  # [m] by which a frame comes closer in that time, if it does


class DriveStatus(NamedTuple):
    """Status at one sample."""

    time: float
    factor: float
    """Simulated time over real time."""
    goals: DriveGoals
    report: LimitReport
    stuck: Mapping[str, float]
    """Frames that come no closer to their goals, with the distances [m]."""
    refused: str
    """Last command that was refused; empty if there is none."""
    parking: str = ""
    """Reason why the base does not drive to its goal with a heading; empty without one."""

    @property
    def limits(self) -> list[str]:
        """Lines that name limits: those that gave way first. One line counts accelerations: every start needs them."""
        exceeded = {name: amount for name, amount in self.report.exceeded.items() if not _soft(name)}
        lines = [f"{name}: exceeded by {amount:.2g}" for name, amount in exceeded.items()]
        lines += [name for name in self.report.active if name not in exceeded and not _soft(name)]
        soft = sum(_soft(name) for name in {*self.report.active, *self.report.exceeded})
        return lines + ([f"acceleration of {soft} motion{'s' * (soft > 1)}"] if soft else [])

    @property
    def messages(self) -> list[str]:
        """Lines about goals and commands."""
        stuck = [f"{frame}: goal not reachable, {distance:.2f} m away" for frame, distance in self.stuck.items()]
        refused = [f"refused: {self.refused}"] if self.refused else []
        return [*stuck, *([f"base: {self.parking}"] if self.parking else []), *refused]


class ProgressMonitor:
    """Finds goals that are not reached and to which the distance does not decrease.

    Args:
        controls: what a user may set.
    """

    def __init__(self, controls: DriveControls) -> None:
        self._names = (*controls.frames, *(() if controls.base is None else (controls.base.frame,)))
        self._axes = [np.array(axes) for axes in controls.frames.values()]
        self._base = controls.base is not None
        self._best: dict[str, tuple[object, float, float]] = {}  # goal, smallest distance, and its time

    def update(self, t: float, goals: DriveGoals, points: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Return the frames without progress, with their distances [m].

        Args:
            t: time [s].
            goals: present goals.
            points: positions of the frames (3,) [m].
        """
        wanted: list[object] = [None if each is None else each.position for each in goals.frames]
        axes = [*self._axes]
        if self._base:
            wanted.append(goals.base_goal if goals.heading is None else None)  # maneuvers go away from it
            axes.append(np.array([True, True]))
        stuck: dict[str, float] = {}
        for name, goal, movable in zip(self._names, wanted, axes, strict=True):
            if goal is None:
                self._best.pop(name, None)
                continue
            target = np.array(goal)
            distance = float(np.linalg.norm((points[name][: len(target)] - target)[movable]))
            known = self._best.get(name)
            if known is None or known[0] != goal or distance < known[1] - _PROGRESS:
                self._best[name] = goal, distance, t
            elif distance > _NEAR and t - known[2] > _PATIENCE:
                stuck[name] = distance
        return stuck


def _soft(name: str) -> bool:
    return name.endswith(" acceleration")
