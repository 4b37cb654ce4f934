"""Findings of a plan, from its verification."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rnc_pin.optimal.motion_plan import PlanVerification
from rnc_pin.optimal.transcription import Iterate, Transcription
from rnc_pin.optimal.verification import Excess
from rnc_pin.verdict import Finding, FindingKind, Severity

_CONTACT = 1e-6  # [m], error of a measured distance
_INPUTS = {
    "kinematic": FindingKind.VELOCITY,
    "acceleration": FindingKind.ACCELERATION,
    "dynamic": FindingKind.EFFORT,
}
_KINDS = {"goal": FindingKind.GOAL, "velocity": FindingKind.VELOCITY, "output": FindingKind.POSITION}


def plan_findings(
    problem: Transcription, at: Iterate, excesses: Sequence[Excess], verification: PlanVerification, accuracy: float
) -> tuple[Finding, ...]:
    """Findings of a plan: rows that it exceeds by more than the accuracy fail, and assumptions are notes."""
    form = problem.model.form
    return (
        *(_of_row(each, form) for each in excesses if each.amount > accuracy),
        *_of_instability(verification, accuracy),
        *_of_unknown_efforts(problem, at),
    )


def excess_text(excess: Excess) -> str:
    """Sentence about a row that a plan exceeds."""
    unit, when = f" {excess.unit}" if excess.unit else "", f"at t = {excess.time:.4g} s"
    if excess.quantity == "integration":
        return f"the {excess.title} ({when})"
    if excess.quantity == "goal":
        return f"{excess.title} is missed by {excess.amount:.3g}{unit} {when}"
    if excess.quantity == "distance" and excess.value < -_CONTACT:
        return f"{excess.title}: they penetrate each other by {-excess.value:.3g} m {when}"
    return (
        f"{excess.title} is {excess.value:.4g}{unit} {when}, beyond the limit {excess.limit:.4g} by {excess.amount:.3g}"
    )


def _of_row(excess: Excess, form: str) -> Finding:
    if excess.quantity == "distance":
        kind = FindingKind.COLLISION if excess.value < -_CONTACT else FindingKind.CLEARANCE
    else:
        kind = _INPUTS[form] if excess.quantity == "input" else _KINDS.get(excess.quantity, FindingKind.PLAN)
    where = excess.title.removeprefix("goal ").removeprefix("distance of ")
    message = f"in the verified plan, {excess_text(excess)}"
    return Finding(kind, where, excess.amount, excess.unit, excess.time, Severity.FAILS, message)


def _of_instability(verification: PlanVerification, accuracy: float) -> Iterator[Finding]:
    """Note that only feedback keeps the motion on its plan."""
    alone, followed = verification.inputs, verification.feedback
    if followed is not None and followed.violation <= accuracy < alone.violation:
        text = f"without feedback, {alone.name} is violated by {alone.violation:.3g}; with feedback by"
        message = f"{text} {followed.violation:.3g}: drive the plan with feedback"
        yield Finding(FindingKind.PLAN, alone.name, alone.violation, "", alone.at, Severity.NOTE, message)


def _of_unknown_efforts(problem: Transcription, at: Iterate) -> Iterator[Finding]:
    """Efforts of joints for which the robot's file states 0: they are unknown, so nothing bounds them."""
    model = problem.model
    robot, names = model.reduced.robot, model.input_names
    bounded = {name for bound in problem.bounds if bound.quantity == "input" for name in bound.names}
    if model.form != "dynamic":
        return
    for column, (name, unit) in enumerate(zip(names, model.reduced.actuation.units, strict=True)):
        if name in bounded or name not in robot.joint_names:
            continue
        if robot.model.upperEffortLimit[robot.velocity_indices(name).start] != 0:
            continue
        largest = int(np.abs(at.u[:, column]).argmax())
        amount, time = float(abs(at.u[largest, column])), float(largest * at.duration / problem.K)
        if amount > 0:
            text = f"the plan uses {amount:.3g} {unit} at '{name}', whose effort limit in the robot's file is 0"
            message = f"{text} and counts as not stated; state it in the file or as an InputBound"
            yield Finding(FindingKind.EFFORT, name, amount, unit, time, Severity.DEGRADES, message)
