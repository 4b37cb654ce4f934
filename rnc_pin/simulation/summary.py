"""Summary of a run: errors and invariants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import NotRequired, TypedDict, cast

import numpy as np

from rnc_pin.analysis import NormalForces, first_lift_off
from rnc_pin.io.json import Json
from rnc_pin.printing import Item, Line, ObjectSummary, SummaryMixin, described
from rnc_pin.simulation.judgement import forces_inside
from rnc_pin.simulation.limit_replay import LIMIT_KINDS, Clearance, LimitReplay
from rnc_pin.simulation.run_data import RunData, tracking_errors
from rnc_pin.simulation.run_info import OutputNames
from rnc_pin.verdict import Verdict

_CONSTANT = 1e-6  # range of the energy, relative to its size, that counts as the error of the integration

_LABELS = {
    "constraint_residual_max": "constraint residual, largest [m/s or rad/s]",
    "position_residual_max": "position residual, largest [m or rad]",
    "energy_drift": "energy less work, drift (relative)",
    "min_singular_value": "singular value of E, smallest (0: singular)",
    "max_input": "input, largest",
    "wall_time": "computing time [s]",
    "off_tracking_max": "trailer off the driven path, largest [m]",
    "lift_off": "lift off [s, N]",
    "smallest_distance": "smallest distance [m, s]",
}
_UNPRINTED = {"scenario", "outcome", "duration", "samples", "findings", "late", "versions", "files"}
_UNPRINTED |= {"verdict", "first_finding"}  # in the title


class Compared(TypedDict):
    """Outcome and absolute errors [m or rad] by output, of a run or of a comparison run.

    Of an adaptive controller also its results, where "late" means the second half of the run.
    """

    final_estimates: NotRequired[list[float]]
    late_prediction_error_rms: NotRequired[float]
    late_rms_error: NotRequired[dict[str, float]]

    outcome: str
    message: NotRequired[str]
    final_output: dict[str, float]
    final_error: dict[str, float]
    max_error: dict[str, float]
    rms_error: dict[str, float]
    off_tracking_max: NotRequired[float]


class NearestBodies(TypedDict):
    """Two links, or a link and an obstacle, at their smallest distance [m]; negative for penetration."""

    bodies: list[str]
    distance: float
    time: float


class Summary(Compared):
    """Errors and invariants of a run, as JSON content.

    ``energy_drift`` is the largest change of ``energy - work``, relative to the range of energy in the run, or to the
    energy itself where that is constant. It is None if the plant does not provide work.
    ``lift_off`` is None if no contact lifts off, or if normal forces are unknown.
    ``joint_limits`` has the worst limit of each kind. ``smallest_distance`` is that of a link and an obstacle;
    ``smallest_own_distance`` is that of two links whose distance changes. They are None if no such bodies come near.
    All three are in summaries of scenarios. ``limits_gave_way`` has the largest amounts by which limits of a
    whole-body program gave way to others; it is missing if none did. ``goal_error`` has the errors at the end of the
    goals of such a program, whose outputs the model need not have, or of a planner.
    ``goals_missed`` has the errors of goals that a completed run of a scenario did not reach within ``goal_tolerance``;
    it is missing if it reached all.
    ``verdict`` is "succeeded", "degraded" or "failed", with its ``findings`` and the kinds that are ``accepted``.
    ``first_finding`` fails or degrades the run; it is missing if no finding does.
    ``integration`` is missing if the plant does not estimate its error.
    ``phases`` and ``impacts`` are in summaries of runs whose contacts open and close.
    """

    scenario: str | None
    duration: float
    samples: int
    constraint_residual_max: float
    position_residual_max: float
    energy_drift: float | None
    integration: NotRequired[dict[str, object]]
    """Largest number of substeps, and the estimated errors of the samples, as of ``IntegrationAccuracy``."""
    min_singular_value: float | None
    lift_off: dict[str, object] | None
    """Contact with a negative normal force: its first negative value and its lowest [N]."""
    max_input: dict[str, float]
    wall_time: float | None
    realtime_factor: float | None
    late: NotRequired[dict[str, Json]]
    """Finding of samples that took longer to compute than the sampling period; like ``wall_time`` of this computer."""
    versions: Mapping[str, str]
    phases: NotRequired[list[dict[str, object]]]
    """Start of each phase [s], and the event that ended it."""
    impacts: NotRequired[list[dict[str, object]]]
    """Impulses of the constraint rows [N s or N m s] and lost kinetic energy [J], at the start of a phase."""
    joint_limits: NotRequired[dict[str, dict[str, object]]]
    """Largest excess of each kind, as a share of the joint's range; negative while the limit is kept."""
    smallest_distance: NotRequired[NearestBodies | None]
    smallest_own_distance: NotRequired[NearestBodies | None]
    touching_at_start: NotRequired[list[str]]
    verdict: NotRequired[str]
    findings: NotRequired[list[dict[str, Json]]]
    accepted: NotRequired[list[str]]
    first_finding: NotRequired[dict[str, str]]
    """Kind and message."""
    limits_gave_way: NotRequired[dict[str, float]]
    goal_tolerance: NotRequired[float]
    goal_error: NotRequired[dict[str, float]]
    goals_missed: NotRequired[dict[str, float]]
    comparisons: NotRequired[dict[str, Compared]]
    files: NotRequired[list[str]]


def summarize(trajectory: RunData, wall_time: float | None = None) -> Summary:
    """Errors and invariants of a run.

    Args:
        trajectory: the run.
        wall_time: computing time [s]; None omits it.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> figures = rnc.summarize(rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=1.0))
        >>> figures["outcome"], figures["samples"]
        ('completed', 51)
        >>> figures["constraint_residual_max"] < 1e-12
        True
    """
    info = trajectory.info
    errors = {name: error[~np.isnan(error)] for name, error in tracking_errors(trajectory).items()}
    duration = float(trajectory.time[-1]) if len(trajectory.time) else 0.0
    balance = trajectory.energy - trajectory.work
    names, grounds = info.outputs.normal_forces.names, trajectory.grounds
    inside = forces_inside(trajectory, NormalForces(grounds.reduced)) if names and grounds is not None else ()
    lifted = first_lift_off(trajectory.time, trajectory.normal_forces, names, inside)
    outputs = info.outputs.x2.names + info.outputs.x1.names
    values = zip(outputs, (*trajectory.x2.T, *trajectory.x1.T), strict=True)
    inputs = zip(info.outputs.T.names, trajectory.T.T, strict=True)
    summary: Summary = {
        "scenario": info.provenance.scenario,
        "outcome": str(trajectory.outcome),
        "duration": duration,
        "samples": len(trajectory.time),
        "final_output": {name: float(column[-1]) for name, column in values if len(column)},
        "final_error": {name: float(abs(error[-1])) for name, error in errors.items() if len(error)},
        "max_error": {name: float(np.abs(error).max()) for name, error in errors.items() if len(error)},
        "rms_error": {name: _rms(error) for name, error in errors.items() if len(error)},
        "constraint_residual_max": float(trajectory.constraint_residual.max(initial=0.0)),
        "position_residual_max": float(trajectory.position_residual.max(initial=0.0)),
        "energy_drift": _drift(balance, trajectory.energy),
        "min_singular_value": float(trajectory.singular_value.min()) if len(balance) else None,
        "lift_off": None if lifted is None else asdict(lifted),
        "max_input": {name: float(np.abs(column).max()) for name, column in inputs if len(column)},
        "wall_time": wall_time,
        "realtime_factor": None if not wall_time else duration / wall_time,
        "versions": dict(info.versions),
    }
    if info.message is not None:
        summary["message"] = info.message
    if info.integration is not None:
        found = info.integration
        summary["integration"] = {"substeps": found.substeps, "largest_per_second": found.rate, "sum": found.total}
    if info.phases:
        summary["phases"] = [{"name": each.name, "start": each.start, "end": each.end} for each in info.phases]
        summary["impacts"] = [
            {"time": each.start, "phase": each.name, "impulses": each.impulses, "energy_loss": each.energy_loss}
            for each in info.phases
            if each.impulses
        ]
    # A run without samples has no second half.
    if trajectory.estimates.shape[1] and len(trajectory.time):
        late = trajectory.time >= 0.5 * trajectory.time[-1]
        errors = {name: error[late] for name, error in tracking_errors(trajectory).items()}
        summary["final_estimates"] = trajectory.estimates[-1].tolist()
        summary["late_prediction_error_rms"] = _rms(trajectory.prediction_error[late])
        summary["late_rms_error"] = {name: _rms(error) for name, error in errors.items()}
    # A TypedDict has no methods: the mapping that prints itself has the same keys.
    return cast(Summary, PrintedSummary(summary, info.outputs))


class PrintedSummary(SummaryMixin, dict[str, object]):
    """Mapping of a summary that prints itself, with units of outputs and actuators; ``summarize`` makes it."""

    def __init__(self, content: Mapping[str, object], outputs: OutputNames) -> None:
        super().__init__(content)
        self._outputs = outputs

    def __reduce__(self) -> tuple[object, ...]:
        return PrintedSummary, (dict(self), self._outputs)

    @property
    def units(self) -> dict[str, str]:
        """Units of the outputs by name; "" if unknown."""
        x2, x1 = self._outputs.x2, self._outputs.x1
        return dict(zip(x2.names + x1.names, x2.units + x1.units, strict=True))

    def _summary(self) -> ObjectSummary:
        return self.summary_of("Summary")

    def summary_of(self, kind: str) -> ObjectSummary:
        """Return the title and lines of the run as those of a kind of object.

        Args:
            kind: first word of the title.
        """
        of = f" of '{self['scenario']}'" if self["scenario"] else ""
        headline = str(self.get("verdict", self["outcome"]))
        if "first_finding" in self:
            headline += f": {cast('dict[str, str]', self['first_finding'])['message']}"
        time = f"{self['duration']:g} s in {self['samples']} samples"
        lines: list[Line] = [("run", [Item(f"{self['outcome']}, {time}")])]
        lines += [
            (_LABELS.get(name, name.replace("_", " ")), self._described(name, value))
            for name, value in sorted(self.items(), key=lambda item: item[0] != "message")  # first why it ended
            if name not in _UNPRINTED and not (value is None or value in ({}, []))
        ]
        return ObjectSummary(f"{kind}{of}: {headline}, {time}", lines)

    def _described(self, key: str, value: object) -> Sequence[Item]:
        if isinstance(value, Mapping) and all(isinstance(each, float) for each in value.values()):
            outputs = self._outputs
            units = dict(zip(outputs.T.names, outputs.T.units, strict=False)) if key == "max_input" else self.units
            return [Item(name, f"{each:.4g} {units.get(name, '')}".rstrip()) for name, each in value.items()]
        return described(value)


def add_verdict(summary: Summary, verdict: Verdict) -> None:
    """Add the verdict of a run, its findings and the accepted kinds to a summary.

    Args:
        summary: summary that receives them.
        verdict: findings about its run.
    """
    summary["verdict"] = verdict.word
    summary["findings"] = [each.to_json() for each in verdict.findings]
    summary["accepted"] = sorted(map(str, verdict.accepted))
    # Times of a clock only for a caller who asks for them: apart from these, equal runs have equal summaries.
    if verdict.late is not None and summary["wall_time"] is not None:
        summary["late"] = verdict.late.to_json()
    if verdict.first is not None:
        summary["first_finding"] = {"kind": str(verdict.first.kind), "message": str(verdict.first)}


def add_limits(summary: Summary, replay: LimitReplay) -> None:
    """Add the largest use of joint limits and the smallest distances of a replay to a summary.

    Args:
        summary: summary that receives them.
        replay: replay of its run.
    """
    # The worst of each kind: a humanoid has a hundred limits.
    summary["joint_limits"] = {
        kind: {"joint": use.name, "excess": use.excess, "time": use.time}
        for kind in LIMIT_KINDS
        if (use := replay.worst(kind)) is not None
    }
    summary["smallest_distance"] = _nearest(replay.nearest(obstacle=True))
    summary["smallest_own_distance"] = _nearest(replay.nearest(obstacle=False))
    if replay.omitted:
        summary["touching_at_start"] = [str(each) for each in replay.omitted]


def _nearest(found: Clearance | None) -> NearestBodies | None:
    return None if found is None else {"bodies": list(found.names), "distance": found.distance, "time": found.time}


def _drift(balance: np.ndarray, energy: np.ndarray) -> float | None:
    if not len(balance):
        return 0.0
    if np.isnan(balance).all():
        return None
    # A share of the range: an error of 1 J says nothing without the energy that the motion exchanges.
    scale, size = float(np.ptp(energy)), float(np.abs(energy).max())
    if scale < _CONSTANT * size:
        scale = size
    return float(np.abs(balance - balance[0]).max() / max(scale, 1e-12))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
