"""Findings of a trial run: abilities that a robot of its kind must have, and statements of the file."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from rnc_pin.applications.init.base_assumptions import BaseAssumptions, Entry
from rnc_pin.applications.init.trial import FAR, LOST, MEANINGFUL, Trial
from rnc_pin.applications.scenario.frame_poses import frame_poses
from rnc_pin.errors import few
from rnc_pin.model import NonholonomicSystem
from rnc_pin.robots import Robot
from rnc_pin.simulation import Trajectory
from rnc_pin.verdict import Finding, FindingKind, Severity

_MOVED = 0.5  # smallest share of the displacement that a base on wheels makes of the one that was asked for
_AT_LIMIT = 1 - 1e-6  # share of an effort limit that counts as the limit
_LONG = 0.05  # share of a run at an effort limit that is reported


def model_findings(
    system: NonholonomicSystem, mobility: BaseAssumptions, chosen: Iterable[Entry], against: Collection[str]
) -> list[Finding]:
    """Return what the model of a draft shows before any run.

    Args:
        system: the robot with its constraints.
        mobility: assumptions about the base.
        chosen: entries of the reducing outputs.
        against: passive joints that are driven, because the other actuators are not enough.
    """
    found = []
    severity = Severity.FAILS if mobility.travel else Severity.DEGRADES
    if system.nearly_dependent_rows:
        rows = few(system.nearly_dependent_rows)
        message = f"its rows are nearly dependent, so that the remaining motion may not be the intended one: {rows}"
        found.append(_model(rows, system.row_margin, severity, message))
    given = [entry for entry, step in mobility.outputs if step and "joint" not in entry]
    if mobility.travel and given and not any(entry in given for entry in chosen):
        message = "its constraints lock the base: no speed of the base is among its motions"
        found.append(Finding(FindingKind.GOAL, mobility.frame, mobility.travel, "m", None, Severity.FAILS, message))
    idle = [joint for joint in against if joint in mobility.passive and joint not in mobility.without_effort]
    if idle:
        message = f"joints that it takes to be passive are driven: {few(idle)}"
        found.append(_model(idle[0], float(len(idle)), severity, message))
    return found


def run_findings(
    trial: Trial, trajectory: Trajectory, limits: np.ndarray, mobility: BaseAssumptions, robot: Robot
) -> list[Finding]:
    """Return what a run shows: errors, displacement of the base, efforts at their limits.

    Args:
        trial: worst output of the run.
        trajectory: the run.
        limits: effort limits of the actuators (p,) [N or N m].
        mobility: assumptions about the base.
        robot: the robot of the run.
    """
    found = []
    if trial.relative_error >= FAR:
        severity = Severity.FAILS if trial.relative_error >= LOST else Severity.DEGRADES
        message = f"its run {trial.failure_text}"
        found.append(Finding(FindingKind.GOAL, trial.output, trial.error, "", None, severity, message))
    asked = mobility.travel * _share(trial.duration / mobility.duration, steady=bool(mobility.v2))
    if asked and trial.duration >= MEANINGFUL:
        path = frame_poses(robot, mobility.frame, trajectory.q).planar[:, :2]
        moved = float(np.linalg.norm(path - path[0], axis=1).max())
        if not moved >= _MOVED * asked:
            message = f"its base moves {moved:.2g} m in the trial, and should move {asked:.2g} m"
            missing = asked - moved
            found.append(Finding(FindingKind.GOAL, mobility.frame, missing, "m", None, Severity.FAILS, message))
    return [*found, *_effort_findings(trajectory, limits)]


def _effort_findings(trajectory: Trajectory, limits: np.ndarray) -> list[Finding]:
    """Actuators that are at or beyond the effort of the file for a part of the run."""
    found = []
    efforts = np.abs(trajectory.T)
    info = trajectory.info.outputs
    for column, (name, unit) in enumerate(zip(info.T, info.T_units, strict=True)):
        limit = limits[column]
        share = float(np.mean(efforts[:, column] >= _AT_LIMIT * limit)) if np.isfinite(limit) else 0.0
        largest = int(np.argmax(efforts[:, column]))
        beyond = float(efforts[largest, column] - limit)
        if share < _LONG and not beyond > 1e-6 * limit:
            continue
        message = f"{name} is at the effort of the file, {limit:.3g} {unit}, for {100 * share:.0f} % of the trial"
        if beyond > 1e-6 * limit:
            message = f"{name} gives {beyond + limit:.3g} {unit} in the trial, and the file allows {limit:.3g} {unit}"
        time = float(trajectory.time[largest])
        found.append(Finding(FindingKind.EFFORT, name, max(beyond, 0.0), unit, time, Severity.DEGRADES, message))
    return found


def _share(elapsed: float, *, steady: bool) -> float:
    """Share of the displacement after a share of the duration: of a minimum-jerk motion, or at a steady speed."""
    s = min(elapsed, 1.0)
    return s if steady else s**3 * (10 - 15 * s + 6 * s**2)


def _model(where: str, amount: float, severity: Severity, message: str) -> Finding:
    return Finding(FindingKind.MODEL, where, amount, "", None, severity, message)
