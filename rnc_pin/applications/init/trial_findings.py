"""Findings of a trial run: abilities that a robot of its kind must have, and statements of the file."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace

import numpy as np

from rnc_pin.applications.init.base_assumptions import BaseAssumptions, Entry
from rnc_pin.applications.init.trial import FAR, LOST, MEANINGFUL, Trial
from rnc_pin.applications.scenario.output_references import frame_poses
from rnc_pin.errors import few
from rnc_pin.model import NonholonomicSystem
from rnc_pin.robots import Robot
from rnc_pin.simulation import LimitReplay, Trajectory
from rnc_pin.verdict import Finding, FindingKind, Severity

_MOVED = 0.5  # smallest share of the displacement that a base on wheels makes of the one that was asked for
_SPARED = 0.9  # share of a limit that a reduced motion aims at
_OF_RUN = {
    FindingKind.POSITION,
    FindingKind.VELOCITY,
    FindingKind.EFFORT,
    FindingKind.SATURATION,
    FindingKind.COLLISION,
    FindingKind.LIFT_OFF,
}
"""Kinds for which ``rnc-pin run`` would fail or complain, beside the errors, which are judged by the motion here."""


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


def run_findings(trial: Trial, trajectory: Trajectory, mobility: BaseAssumptions, robot: Robot) -> list[Finding]:
    """Return what a run shows: errors, displacement of the base, limits of the file, collisions.

    Args:
        trial: worst output of the run.
        trajectory: the run.
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
    said = [each for each in trajectory.verdict.findings if each.kind in _OF_RUN and each.severity is not Severity.NOTE]
    return [*found, *(replace(each, severity=Severity.DEGRADES) for each in said)]


def kept_share(trajectory: Trajectory, replay: LimitReplay, *, at_rest: bool) -> float:
    """Share of the motion of a run that would keep the velocities and efforts of the file.

    Rates and efforts are taken as proportional to the motion, apart from the efforts at rest, which the weight needs.

    Args:
        trajectory: the run.
        replay: its use of limits.
        at_rest: True if it starts at rest, so that its first efforts are those at rest.
    """
    resting = dict(zip(trajectory.info.outputs.T, np.abs(trajectory.T[0]), strict=True)) if at_rest else {}
    share = 1.0
    for use in replay.violations:
        rest = float(resting.get(use.name, 0.0)) if use.kind == "effort" else 0.0
        if use.kind in ("velocity", "effort") and use.limit > rest:
            share = min(share, _SPARED * (use.limit - rest) / (abs(use.value) - rest))
    return share


def _share(elapsed: float, *, steady: bool) -> float:
    """Share of the displacement after a share of the duration: of a minimum-jerk motion, or at a steady speed."""
    s = min(elapsed, 1.0)
    return s if steady else s**3 * (10 - 15 * s + 6 * s**2)


def _model(where: str, amount: float, severity: Severity, message: str) -> Finding:
    return Finding(FindingKind.MODEL, where, amount, "", None, severity, message)
