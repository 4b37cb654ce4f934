"""Trial run of a draft and its findings, and the YAML text that reports them in remarks.

Tracking errors are judged relative to the motion of the reference. Findings tell the abilities that a robot of its
kind must have, and judge the statements of the file.
"""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import numpy as np

from rnc_pin.applications.init.assumptions import DURATION, BaseAssumptions, Entry
from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.files import one_line_yaml
from rnc_pin.applications.scenario.plan_builder import frame_poses
from rnc_pin.errors import few, printable
from rnc_pin.io import Json
from rnc_pin.model import NonholonomicSystem
from rnc_pin.robots import Robot
from rnc_pin.simulation import LimitReplay, Trajectory, tracking_errors
from rnc_pin.verdict import Finding, FindingKind, Severity, Verdict

FAR = 0.2
"""Ratio of error to reference motion above which a run misses its reference."""
LOST = 0.5
"""Ratio of error to reference motion above which another kind of base is more likely."""
MEANINGFUL = 1.0
"""Duration of the shortest run with a meaningful displacement [s]: a controller that learns starts late."""


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
    def doubts(self) -> tuple[str, ...]:
        """Findings for which ``rnc-pin run`` would fail or complain."""
        return tuple(str(each) for each in self.findings if each.severity is not Severity.NOTE)

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
        tried = f"tried for {self.duration:.3g} s"
        if self.share < 1.0:
            share = f"{100 * self.share:.0f} % of the usual motion"
            tried += f", with {share}, which keeps the velocities and efforts of the file"
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


def judged_trial(
    result: Result, motions: Mapping[str, float], share: float, mobility: BaseAssumptions, robot: Robot
) -> Trial:
    """Return the trial of a run, with what the run shows.

    Args:
        result: the run.
        motions: displacement of each reference [m or rad], by output.
        share: share of the usual motion that the run makes.
        mobility: assumptions about the base.
        robot: the robot of the run.
    """
    trial = replace(_worst_output(result.trajectory, motions, settles=mobility.lean is not None), share=share)
    found = run_findings(trial, result.trajectory, mobility, robot)
    at_rest = mobility.lean is None and not mobility.v2
    kept = 1.0 if result.limits is None else _kept_share(result.trajectory, result.limits, at_rest=at_rest)
    return replace(trial, findings=tuple(found), kept_share=kept)


def _worst_output(trajectory: Trajectory, motions: Mapping[str, float], *, settles: bool) -> Trial:
    """Worst output with a reference; ``settles`` if only the end counts, as for one that first has to balance."""
    duration = float(trajectory.time[-1])
    largest = max((abs(length) for length in motions.values()), default=0.0)
    errors = {name: error for name, error in tracking_errors(trajectory).items() if name in motions}
    if not errors or not largest:
        return Trial(duration)
    trials = []
    little = 0.5  # motion assumed for an output with a constant reference, as a share of the largest motion
    settled = 0.1  # final share of a run whose errors count for a balancing controller
    for name, error in errors.items():
        # A balancing robot first goes the other way, to lean: its errors count when it has come to rest.
        first = int((1 - settled) * len(error)) if settles else 0
        # Infinite errors become large numbers, which compare; a NaN is no motion at all.
        worst = float(np.nan_to_num(np.abs(error[first:])).max(initial=0.0))
        trials.append(Trial(duration, name, worst, abs(motions[name]) or little * largest))
    return max(trials, key=lambda each: each.relative_error)


_OF_RUN = {*map(FindingKind, ("position", "velocity", "effort", "saturation", "collision", "lift_off"))}
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
    found = [_model(where, amount, Severity.DEGRADES, message) for where, amount, message in mobility.doubts]
    # A base on wheels has to drive; an arm may have rows and joints that a user judges better.
    severity = Severity.FAILS if mobility.travel else Severity.DEGRADES
    if system.nearly_dependent_rows:
        rows = few(system.nearly_dependent_rows)
        message = f"its rows are nearly dependent, so that the remaining motion may not be the intended one: {rows}"
        found.append(_model(rows, system.row_margin, severity, message))
    settings = [each for entry, _ in mobility.constraints for each in entry.values() if isinstance(each, Mapping)]
    radii = [float(radius) for each in settings if isinstance(radius := each.get("radius"), int | float)]
    # One odd wheel is no sign of wrong units.
    typical = median(radii) if radii else 1.0
    if not 0.002 < typical < 5.0:  # [m]: other radii are probably in other units
        message = f"its wheels have a radius of {typical:g} m: lengths in a robot's file are in metres"
        found.append(_model(mobility.frame, typical, Severity.DEGRADES, message))
    # Outputs of joints are always among its motions: only a speed or a pose tells that the base is free.
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
    s = min(trial.duration / DURATION, 1.0)
    # A short trial sees only the slow beginning of a minimum-jerk motion; a bicycle keeps its speed.
    asked = mobility.travel * (s if mobility.v2 else trial.share * s**3 * (10 - 15 * s + 6 * s**2))
    if asked and trial.duration >= MEANINGFUL:
        # Errors of its outputs may be small while the base stands: wheels that spin follow their angles.
        poses, _ = frame_poses(robot, mobility.frame, trajectory.q)
        moved = float(np.linalg.norm((poses - poses[0])[:, :2], axis=1).max())
        enough = 0.5  # smallest share of the displacement that was asked for
        if not moved >= enough * asked:
            message = f"its base moves {moved:.2g} m in the trial, and should move {asked:.2g} m"
            found.append(Finding(FindingKind.GOAL, mobility.frame, asked - moved, "m", None, Severity.FAILS, message))
    said = [each for each in trajectory.verdict.findings if each.kind in _OF_RUN and each.severity is not Severity.NOTE]
    # Limits and collisions may be mistakes of the file: no reason for another kind of base.
    return [*found, *(replace(each, severity=Severity.DEGRADES) for each in said)]


def _kept_share(trajectory: Trajectory, replay: LimitReplay, *, at_rest: bool) -> float:
    """Share of the motion of a run that would keep the velocities and efforts of the file.

    Rates and efforts are taken as proportional to the motion, apart from the efforts at rest, which the weight needs:
    those of the first sample of a run that starts at rest.
    """
    # The first sample stands at the start, before the reference moves.
    resting = dict(zip(trajectory.info.outputs.T.names, np.abs(trajectory.T[0]), strict=True)) if at_rest else {}
    share = 1.0
    spared = 0.9  # share of a limit that a reduced motion aims at
    for use in replay.violations:
        rest = float(resting.get(use.name, 0.0)) if use.kind == "effort" else 0.0
        # If the weight alone is beyond the limit, no smaller motion helps.
        if use.kind in ("velocity", "effort") and use.limit > rest:
            share = min(share, spared * (use.limit - rest) / (abs(use.value) - rest))
    return share


def _model(where: str, amount: float, severity: Severity, message: str) -> Finding:
    return Finding(FindingKind.MODEL, where, amount, "", None, severity, message)


_WORDS = {Severity.FAILS: "NOT CONFIRMED", Severity.DEGRADES: "CHECK", Severity.NOTE: "Note"}


def write_draft(name: str, scenario: Mapping[str, Any], remark: str, trial: Trial, mobility: BaseAssumptions) -> str:
    """Return the text of a scenario file.

    Args:
        name: name of the robot.
        scenario: content of the file.
        remark: remark on the controller.
        trial: result of the trial run.
        mobility: assumptions about the base, with remarks on its constraints and actuators.
    """
    labels, initial = {True: "QUESTION", False: "Decided"}, scenario["initial"]
    lines = [
        *_remark(f"First draft for {name}, guessed from its file by rnc-pin init: read it before you believe it."),
        *(line for each in trial.verdict.findings for line in _remark(f"{_WORDS[each.severity]}: {each}.")),
        *(line for each in mobility.decisions for line in _remark(f"{labels[each.is_open]}: {each}.")),
        *(line for note in mobility.notes for line in _remark(f"Assumed: {note}.")),
        f"title: {one_line_yaml(f'First draft for {name}')}",
        *_section(scenario, "robot", f"base {mobility.base or 'as in the file'}: {mobility.kind}"),
        *_entries("constraints", mobility.constraints, _of_rows(mobility.constraints)),
        *_entries("actuators", mobility.actuators, "# joint torques and forces"),
        "outputs:",
        *_remark("one row for each degree of freedom that the constraints leave; controllers move these", "  "),
        *_entries("reducing", [(each, "") for each in scenario["outputs"]["reducing"]], "", "  "),
    ]
    if mobility.vertical:
        lines += _remark("these follow from the reducing outputs, and are monitored", "  ")
        lines += _entries("vertical", [(each, "") for each in mobility.vertical], "", "  ")
    lines += _section(scenario, "task")
    if any(initial.values()):
        loops = any("loop_closure" in entry for entry, _ in mobility.constraints)
        usual = "at zero, or in the middle of limits that do not contain zero" + "; loops start closed" * loops
        lines += _section(scenario, "initial", f"joints start {usual}")
    if "reference" in scenario:
        words = "displacements in the order of task.primary: m along the ground or a slide, rad for angles"
        lines += _section(scenario, "reference", f"a slow motion, {words}")
    lines += _section(scenario, "controller", remark) + _section(scenario, "simulation", trial.words)
    return "\n".join([*lines, *_section(scenario, "view")]) + "\n"


def _section(scenario: Mapping[str, object], key: str, remark: str = "") -> list[str]:
    return [*_remark(remark), f"{key}: {one_line_yaml(scenario[key])}"]


def _of_rows(constraints: Sequence[tuple[Mapping[str, Json], str]]) -> str:
    """Remark on the constraints."""
    wheels = [entry.get("rolling_wheel") for entry, _ in constraints]
    shares = any(isinstance(wheel, Mapping) and wheel.get("lateral") is False for wheel in wheels)
    return "# A(q) v = 0" + ("; wheels of one axle line share a lateral row" if shares else "")


def _entries(key: str, entries: Sequence[tuple[Entry, str]], remark: str, indent: str = "") -> list[str]:
    if not entries:
        return [f"{indent}{key}: []"]
    head = f"{indent}{key}:" + (f"  {remark}" if remark else "")
    return [head, *(f"{indent}  - {one_line_yaml(each)}" + (f"  # {said}" if said else "") for each, said in entries)]


def _remark(text: str, indent: str = "") -> list[str]:
    text = printable(text, longest=len(text))  # names come from files, and YAML refuses control characters
    return textwrap.wrap(text, 118, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")
