"""Summary and verdict of the run of a scenario."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress

import numpy as np

from rnc_pin import simulation
from rnc_pin.analysis import Grip
from rnc_pin.applications.scenario.builder import Experiment
from rnc_pin.applications.scenario.controllers.feedback import SetPointSettings
from rnc_pin.applications.scenario.plan_builder import frame_poses
from rnc_pin.applications.scenario.schema.motions import MotionProblem
from rnc_pin.errors import ConfigurationError
from rnc_pin.motion.planning import continued_back, path_distances
from rnc_pin.motion.whole_body import InverseDynamicsQP
from rnc_pin.motion.whole_body.limits import CollisionAvoidance
from rnc_pin.simulation import SHORTFALL, LimitReplay, Outcome, Summary, Trajectory
from rnc_pin.verdict import Finding, FindingKind, Severity

REPLAY_DISTANCE = 0.2
"""Distance up to which the replay of a run computes exact distances [m]."""
_REPLAY_STEP, _REPLAYED = 0.02, 500  # smallest step between distances [s], and largest number of them


def judged_summary(
    experiment: Experiment, run: Trajectory, wall_time: float | None = None, *, goals: bool = True
) -> tuple[Trajectory, Summary, LimitReplay | None]:
    """Judge a run of a scenario. Return the run with its verdict, its summary, which has the verdict too, and limits.

    The replay of limits and distances is None for a run without samples.

    Args:
        experiment: objects of the run.
        run: the run.
        wall_time: computing time [s].
        goals: False for a run whose end is not in the scenario, such as one that a user drives.
    """
    scenario, chosen = experiment.scenario, experiment.scenario.controller
    summary = run_summary(experiment, run, wall_time)
    asked = _asked(experiment)
    replay = _replay(experiment, run, asked) if len(run.time) else None  # a run may fail before its first sample
    shortfall = chosen.tolerance if isinstance(chosen, SetPointSettings) else SHORTFALL  # of where it rests
    ended = goals and run.outcome is Outcome.COMPLETED
    # A run that stopped early has missed everything: that it stopped is the finding.
    errors = _goal_errors(experiment, run, summary) if ended else {}
    # Goals of a whole-body program are among the errors.
    missed = () if run.grounds is None or experiment.program is not None else run.grounds.missed
    more = [
        *experiment.findings,
        *(_unfinished(experiment, run) if ended else ()),
        *(simulation.missed_goal_findings(run, missed) if goals else ()),
        *(() if replay is None else simulation.distance_findings(replay, asked, shortfall)),
    ]
    verdict = simulation.judge(
        run,
        replay,
        goal_errors=errors,
        goal_tolerance=scenario.goal_tolerance,
        grip=_grip(experiment, run),
        reduced=experiment.reduced,
        more=more,
        accepted=scenario.accept,
    )
    simulation.add_verdict(summary, verdict)
    if replay is not None:
        simulation.add_limits(summary, replay)
    gave_way = [each for each in run.info.findings if each.kind is FindingKind.LIMIT_GAVE_WAY]
    excluded = {each.where: each.amount or 0.0 for each in gave_way if each.severity is Severity.DEGRADES}
    if excluded:
        summary["limits_gave_way"] = excluded
    if goals:
        summary["goal_tolerance"] = scenario.goal_tolerance
        if errors and (experiment.program is not None or scenario.planner is not None):
            summary["goal_error"] = errors
        # "not <=": a NaN is missed, too.
        beyond = {name: error for name, error in errors.items() if not error <= scenario.goal_tolerance}
        if beyond:
            summary["goals_missed"] = beyond
    return run.with_verdict(verdict), summary, replay


def run_summary(experiment: Experiment, run: Trajectory, wall_time: float | None = None) -> Summary:
    """Errors and invariants of a run, with those that only its scenario knows.

    Args:
        experiment: objects of the run.
        run: the run.
        wall_time: computing time [s].
    """
    summary = simulation.summarize(run, wall_time)
    path, robot = experiment.scenario.reference.path, experiment.reduced.robot
    if path is not None and path.trailer is not None and len(run.q):
        some = run.q[::10]  # every tenth sample is dense enough
        driven, axle = (frame_poses(robot, frame, some)[0] for frame in (path.frame, path.trailer.frame))
        # Before the start the driven path is straight. There the axle is behind it: as a chord, twice its distance
        # reaches beyond it at any angle.
        behind = 2.0 * float(np.linalg.norm(driven[0, :2] - axle[0, :2]))
        summary["off_tracking_max"] = float(path_distances(axle[:, :2], continued_back(driven, behind)).max())
    return summary


def _goal_errors(experiment: Experiment, run: Trajectory, summary: Summary) -> dict[str, float]:
    """Errors of the goals at the end by name: those of whole-body tasks, of a planner, or the ends of references."""
    if (program := experiment.program) is not None:
        return program.goal_errors(float(run.time[-1]), run.q[-1], run.v[-1])
    planner, plan = experiment.scenario.planner, experiment.plan
    if planner is None or plan is None or not planner.goal:
        return dict(summary["final_error"])
    if run.time[-1] < plan.duration - experiment.simulation.dt:  # the ends of references have the goal
        return {name: error for name, error in summary["final_error"].items() if name in planner.goal}
    # What moves at its goal goes on after it.
    end = int(np.searchsorted(run.time[:-1], plan.duration - 1e-9))  # the last sample of a run that ends before
    return _away(run, planner.goal, -1 if planner.at_rest else end)


def _away(run: Trajectory, ends: Mapping[str, float], sample: int = -1) -> dict[str, float]:
    """Distances of outputs from given values at a sample, by name."""
    found: dict[str, float] = {}
    for kind, values in (("x2", run.x2), ("x1", run.x1)):
        names = run.info.outputs.of(kind).names
        wanted = np.array([ends.get(name, 0.0) for name in names])
        away = np.abs(run.coordinates(kind).difference(wanted, values[sample])).tolist()
        found |= {name: each for name, each in zip(names, away, strict=True) if name in ends}
    return found


def _unfinished(experiment: Experiment, run: Trajectory) -> Iterator[Finding]:
    """Finding of a run that ends before its references: what it follows was kept, where they lead was not reached.

    Who states the duration of a reference and a shorter one of the run wants that. A planned motion may be longer.
    """
    ends = _later_ends(experiment)
    errors = _away(run, ends) if ends and len(run.time) else {}
    worst = max(errors, key=errors.__getitem__, default="")
    if worst and errors[worst] > experiment.scenario.goal_tolerance:
        time, rest = float(run.time[-1]), f"{worst} is {errors[worst]:.3g} away from where its reference leads"
        message = f"the run ends at t = {time:.4g} s, before its references: {rest}"
        severity = Severity.NOTE if experiment.scenario.planner is None else Severity.DEGRADES
        yield Finding(FindingKind.GOAL, worst, errors[worst], "m or rad", time, severity, message)


def _later_ends(experiment: Experiment) -> dict[str, float]:
    """Values at which references or the plan end after the run, by output."""
    found, duration = dict[str, float](), experiment.simulation.seconds
    plan, planner = experiment.plan, experiment.scenario.planner
    if plan is not None and planner is not None and duration < plan.duration:
        found |= planner.goal
    for role, reference in experiment.references.items():
        # An infinite duration, as of a harmonic motion, leads nowhere.
        if duration < reference.duration < np.inf:
            ends = reference.at(reference.duration).position.tolist()
            found |= zip(experiment.names[role], ends, strict=True)
    return found


def _replay(experiment: Experiment, run: Trajectory, asked: float | None) -> LimitReplay:
    # Distances are slow: at most 500 of them, between which the motion of the links is bounded.
    step = max(_REPLAY_STEP, float(run.time[-1]) / _REPLAYED)
    near = asked or 0.0
    within = max(REPLAY_DISTANCE, near)
    robot, obstacles = experiment.reduced.robot, experiment.obstacles
    return simulation.replay_limits(robot, run, obstacles, step=step, within=within, exact=near)


def _grip(experiment: Experiment, run: Trajectory) -> Grip | None:
    """Stated friction of the ground; None without one, or if contacts appear and vanish."""
    grip, program, reduced = experiment.grip, experiment.program, experiment.reduced
    if grip is None and isinstance(program, InverseDynamicsQP) and program.friction is not None:
        with suppress(ConfigurationError):  # nothing grips
            grip = Grip(reduced, program.friction)
    names = run.info.outputs
    # Recorded forces belong to the rows of this model, or none can be compared: a plant with contacts has others.
    same = grip is not None and names.normal_forces.names == grip.normal.names
    return grip if same and names.contact_forces.names == reduced.all_constraints.names else None


def _asked(experiment: Experiment) -> float | None:
    """Distance from obstacles that the planner or the controller has to keep [m]; None if none is asked for."""
    program, scenario = experiment.program, experiment.scenario
    limits = () if program is None else program.limits
    asked = [each.clearance for each in limits if isinstance(each, CollisionAvoidance) and each.obstacles]
    problems = [each for each in (scenario.planner, scenario.controller) if isinstance(each, MotionProblem)]
    asked += [each.clearance for each in problems if each.clearance is not None and experiment.obstacles]
    return max(asked, default=None)
