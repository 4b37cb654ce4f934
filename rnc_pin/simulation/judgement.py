"""Judgement of a run: findings from its samples, its model, its goals, and the replay of its limits and distances."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rnc_pin.analysis import NormalForces, first_lift_off, near_lift_off
from rnc_pin.array_shapes import Float
from rnc_pin.constraints.wheeled_base import SIDE_SLIP, missing_lateral_rows
from rnc_pin.control.controller import MissedGoal
from rnc_pin.errors import ConfigurationError, InputError, RncError, few
from rnc_pin.math.linear_algebra import apply
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.simulation.limit_replay import ROUNDING, Clearance, LimitReplay, LimitUse, replay_limits
from rnc_pin.simulation.run_data import RunData, blocks, columns_of_array
from rnc_pin.simulation.run_info import Outcome
from rnc_pin.verdict import GOAL_TOLERANCE, MOSTLY, SHORTFALL, Finding, FindingKind, Severity, Verdict

if TYPE_CHECKING:  # a run without friction of the ground starts without it
    from rnc_pin.analysis import Grip

PENETRATION = 1e-6
"""Depth of a penetration that counts as a collision [m]."""
_SATURATED = 0.2  # share of a run at a bound from which an input counts as saturated
_REVERSED = 0.05  # of a limit: a change that counts as a reversal; noise of a few per cent is smaller
_OFTEN_REVERSED = 0.01  # share of samples with reversals that degrades: more than a few at a start or a switch
_VIOLENT, _OFTEN_VIOLENT = 0.5, 0.1  # of a limit, and share of samples above it that fails: it wears a drive out
_AT_LIMIT = 0.99  # use of friction of a contact that slides, if its plant does not know the speed
_CREEP = 1e-3  # [m/s]; slower contacts stick: those of MuJoCo are soft
_MOMENT = 0.01  # share of a run at the limit of friction that fails: more than a landing
_SLIDING = 0.01  # [m/s or rad/s]; contacts of MuJoCo that stick creep by less than 1e-3
_SLID = 0.05  # [m] sideways of a steered wheel without a lateral row, that fails
_SLIPS = 1.0 + 1e-3  # use of friction that is beyond the stated friction, and not rounding


def judge(
    run: RunData,
    replay: LimitReplay | None = None,
    *,
    goal_errors: Mapping[str, float] | None = None,
    goal_tolerance: float = GOAL_TOLERANCE,
    grip: Grip | None = None,
    reduced: ReducedModel | None = None,
    more: Iterable[Finding] = (),
    accepted: Iterable[FindingKind | str] = (),
) -> Verdict:
    """Verdict of a run.

    Args:
        run: the run; its ``info.findings`` are those of its controller, by ``controller.findings_of``.
        replay: replay of its limits and distances, by ``replay_limits``; without it they are not judged.
        goal_errors: errors at the end by name [m or rad]; None if the run has no goals.
        goal_tolerance: error above which a goal is missed [m or rad].
        grip: stated friction of the ground, for the forces that the constraints of the run need.
        reduced: model of the run. Without it, steered wheels and lift-off inside samples are not judged.
        more: findings that others made, such as a plan that is not verified.
        accepted: kinds of findings that the user accepts; they degrade where they would fail.

    Raises:
        ConfigurationError: there is no such kind of finding.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=1.0)
        >>> missed = rnc.simulation.judge(run, goal_errors={"place": 0.3})
        >>> print(missed.word, "-", missed.first)
        failed - the goal of place is missed by 0.3, allowed is 0.02
    """
    findings = [
        *_end(run),
        *_finite(run),
        *_fallback(run),
        *run.info.findings,
        *_integration(run),
        *missed_goal_findings(run, MissedGoal.of_errors(goal_errors or {}, goal_tolerance)),
        *(() if replay is None else map(_exceeded, replay.violations)),
        *_contacts(run, grip, reduced),
        *(() if replay is None else (*_saturation(run, replay), *_reversals(run, replay))),
        *(() if reduced is None else _side_slips(run, reduced)),
        *more,
    ]
    return replace(Verdict.of(findings, accepted), late=_late(run))


def _graded(fails: bool) -> Severity:
    return Severity.FAILS if fails else Severity.DEGRADES


def _late(run: RunData) -> Finding | None:
    """Note of samples that took longer to compute than the sampling period."""
    # Beside the findings: it depends on the computer, and equal runs have equal verdicts.
    late = run.info.late
    if late is None:
        return None
    share, severity = late.late / max(late.ticks, 1), Severity.NOTE
    return Finding(FindingKind.LATE, "control loop", share, "", late.first, severity, str(late))


def _end(run: RunData) -> Iterator[Finding]:
    """Finding of a run that did not reach its end."""
    if run.outcome is Outcome.COMPLETED:
        return
    time = float(run.time[-1]) if len(run.time) else 0.0  # the last sample; a message has the time of its error
    kind = FindingKind.SINGULAR if run.outcome is Outcome.SINGULAR else FindingKind.ENDED_EARLY
    message = run.info.message or f"{run.outcome} at t = {time:.3f} s"
    yield Finding(kind, str(run.outcome), time, "s", time, Severity.FAILS, message)


def _finite(run: RunData) -> Iterator[Finding]:
    """Findings of states and inputs that are not numbers."""
    for name, values in (("q", run.q), ("v", run.v), ("T", run.T)):
        # Other arrays have NaN by design, where a value is unknown.
        wrong = ~np.isfinite(values).all(axis=1)
        if wrong.any():
            time, count = float(run.time[int(wrong.argmax())]), int(wrong.sum())
            message = f"{name} is not finite in {count} samples, the first at t = {time:.3f} s"
            yield Finding(FindingKind.NOT_FINITE, name, count, "", time, Severity.FAILS, message)


def _fallback(run: RunData) -> Iterator[Finding]:
    """Finding of fallback commands: it fails if they last to the end, or for most of the run."""
    used = run.info.fallback
    if used is None:
        return
    share = used.samples / max(len(run.time), 1)
    # A robot that ends or mostly moves by safe commands does not do what it was told.
    fails = used.at_the_end or share > MOSTLY
    until = ", and until the end" if used.at_the_end else ""
    message = (
        f"the loop gave a fallback command in {100 * share:.3g} % of the samples, first at t = {used.first:.3f} s"
        f"{until}: {used.reason}"
    )
    yield Finding(FindingKind.FALLBACK, "control loop", share, "", used.first, _graded(fails), message)


def _integration(run: RunData) -> Iterator[Finding]:
    """Finding of an integration that is less accurate than its tolerance."""
    found = run.info.integration
    if found is None or found.is_kept:
        return
    # The plant chose the number and could do no more: a note. A number that the user fixed can be mended.
    if found.enough == found.substeps:
        severity, remedy = Severity.NOTE, f"{found.substeps} substeps do not suffice: reduce the sampling period"
    else:
        severity = Severity.DEGRADES
        remedy = f"substeps {found.substeps} is too small: remove it, or set {found.enough}"
    message = (
        f"the integration adds an error of up to {found.rate:.2g} per second [m, rad, m/s or rad/s], allowed is "
        f"{found.tolerance:g}: {remedy}"
    )
    yield Finding(FindingKind.INTEGRATION, "plant", found.rate, "1/s", None, severity, message)


def _exceeded(use: LimitUse) -> Finding:
    """Finding of a limit; positions and accelerations have two, the others one of the absolute value."""
    # Their limits have signs; those of velocities and efforts bound the size.
    two = use.kind in ("position", "acceleration")
    amount = abs(use.value - use.limit) if two else abs(use.value) - use.limit
    return Finding(FindingKind(use.kind), use.name, amount, "", use.time, Severity.FAILS, str(use))


def _contacts(run: RunData, grip: Grip | None, reduced: ReducedModel | None) -> Iterator[Finding]:
    """Findings of contacts that pull, that need more friction than is stated, or that slide at its limit."""
    names = run.info.outputs.normal_forces.names
    normal = grip.normal if grip is not None else None if reduced is None or not names else NormalForces(reduced)
    # Friction may be used up at any time, while a contact lifts off only where its load is small.
    inside = forces_inside(run, normal, every=grip is not None)
    lifted = first_lift_off(run.time, run.normal_forces, names, inside)
    if lifted is not None:
        message = f"{lifted}{'' if normal is None else normal.remedy(lifted.contact)}"
        kind, amount = FindingKind.LIFT_OFF, -lifted.lowest
        yield Finding(kind, lifted.contact, amount, "N", lifted.time, Severity.FAILS, message)
    unknown = np.isnan(run.normal_forces).all(axis=0)
    if len(run.time) and unknown.any():
        where = few([name for name, each in zip(names, unknown, strict=True) if each])
        message = f"the loads of {where} are unknown: a force on the planar base is a user's function of q and v"
        yield Finding(FindingKind.MODEL, where, None, "N", None, Severity.DEGRADES, message)
    if grip is not None:
        yield from _demands(grip, (run.time, run.q, run.contact_forces, run.normal_forces), *inside)
    # In addition: what a plant told about slip, whatever the forces of the model are.
    yield from _slips(run)


def forces_inside(run: RunData, normal: NormalForces | None, every: bool = False) -> list[tuple[np.ndarray, ...]]:
    """Times, configurations, contact and normal forces inside sampling intervals; none for a run of other contacts.

    Args:
        run: the run.
        normal: normal forces of its model; None if it is unknown.
        every: True for all intervals; else those in which a contact may lift off.
    """
    outputs = run.info.outputs
    # Of a plant with contacts of its own the model here knows nothing between the samples.
    if normal is None or (normal.names, normal.rows) != (outputs.normal_forces.names, outputs.contact_forces.names):
        return []
    chosen = np.arange(len(run.time) - 1) if every else near_lift_off(run.normal_forces)
    known = (run.q, run.v, run.T), run.contact_forces, run.normal_forces
    with suppress(RncError):  # between the samples of a run that ends in a singular configuration
        return list(normal.between(run.time, *known, chosen)) if len(chosen) else []
    return []


def _demands(grip: Grip, *loads: tuple[np.ndarray, ...]) -> Iterator[Finding]:
    """Findings of contacts whose constraints need more than the stated friction: where a real wheel slips."""
    time, q = (np.concatenate([each[k] for each in loads]) for k in (0, 1))
    # NaN is a contact that carries nothing and needs nothing; infinity one that needs and carries nothing.
    used = np.nan_to_num(np.concatenate([grip.used_by_forces(*each) for _, *each in loads]), posinf=np.inf)
    for column, (name, demand) in enumerate(zip(grip.names, used.T, strict=True)):
        if demand.max(initial=0.0) > _SLIPS:
            most = int(demand.argmax())
            # The forces of wheels that share a load are not unique: the finding says that the best share was taken.
            chosen = demand[most] < np.inf and grip.is_choice(q[most])[column]
            yield _beyond(time, name, demand, ", at the best share that rigid bodies leave open" if chosen else "")


def _beyond(times: Float[np.ndarray, " N"], contact: str, used: Float[np.ndarray, " N"], share: str = "") -> Finding:
    """Finding of a contact that needs more than its friction at some time, and how it shares the force."""
    most = int(used.argmax())
    need, time = float(used[most]), float(times[most])
    words = f"needs {need:.3g} times the stated friction" if need < np.inf else "needs friction, but carries no load,"
    message = f"contact '{contact}' {words} at t = {time:.2f} s{share}"
    return Finding(FindingKind.SLIP, contact, need, "", time, Severity.FAILS, message)


def _slips(run: RunData) -> Iterator[Finding]:
    """Findings of contacts at the limit of their friction, where a plant lets them slide, and of rows that slip."""
    used, slip = np.nan_to_num(run.friction_used), np.abs(np.nan_to_num(run.slip))
    # A plant that knows the speed tells what slides; of others only the use of friction is known.
    slides = np.where(np.isnan(run.slip_speed), used > _AT_LIMIT, run.slip_speed > _CREEP)
    for column, name in enumerate(run.info.outputs.friction_used.names if len(used) else ()):
        share = float(slides[:, column].mean())
        # One finding a contact: more than its friction is worse than sliding at it.
        if used[:, column].max() > _SLIPS:
            yield _beyond(run.time, name, used[:, column])
        elif share > 0.0:
            first = float(run.time[int(slides[:, column].argmax())])
            message = (
                f"contact '{name}' slides at the limit of the stated friction, or its drive force is cut, in "
                f"{100 * share:.3g} % of the samples, first at t = {first:.2f} s"
            )
            yield Finding(FindingKind.SLIP, name, share, "", first, _graded(share > _MOMENT), message)
    for column, name in enumerate(run.info.outputs.multipliers.names if len(slip) else ()):
        most = int(slip[:, column].argmax())
        speed, time = float(slip[most, column]), float(run.time[most])
        if speed > _SLIDING:
            unit = columns_of_array(run, "slip")[column].unit
            message = f"row '{name}' slips by up to {f'{speed:.3g} {unit}'.rstrip()}, at t = {time:.2f} s"
            yield Finding(FindingKind.SLIP, name, speed, unit, time, Severity.DEGRADES, message)


def _side_slips(run: RunData, reduced: ReducedModel) -> Iterator[Finding]:
    """Findings of steered wheels without a lateral row that slide sideways: they are not aimed.

    More than 0.01 m/s at some time degrades a run, and more than 0.05 m in all fails it.
    """
    rows = missing_lateral_rows(reduced, steered=True)
    # In blocks: rows of many wheels over a long run would fill the memory.
    kinematics, speeds = Kinematics(reduced.robot), np.zeros((len(run.time), rows.size))
    for block in blocks(len(run.time), rows.size * reduced.n) if rows.size else ():
        # Samples that are not numbers have a finding of their own.
        q, v = np.nan_to_num(run.q[block]), np.nan_to_num(run.v[block])
        with suppress(RncError):  # a wheel that lies flat
            speeds[block] = np.abs(apply(rows.jacobian(kinematics.position(q)), v))
    for name, speed in zip(rows.names, speeds.T, strict=True):
        most, way = int(speed.argmax()) if len(speed) else 0, float(np.trapezoid(speed, run.time))
        if speed.max(initial=0.0) > SIDE_SLIP:
            wheel, time = name.removeprefix("lateral(").removesuffix(")"), float(run.time[most])
            message = (
                f"steered wheel '{wheel}' is not aimed: it slides sideways by {way:.3g} m in all, with up to "
                f"{speed[most]:.3g} m/s at t = {time:.2f} s"
            )
            yield Finding(FindingKind.SLIP, wheel, float(speed[most]), "m/s", time, _graded(way > _SLID), message)


def _saturation(run: RunData, replay: LimitReplay) -> Iterator[Finding]:
    """Findings of actuators that are at their bound for a large part of the run."""
    # A limit of zero is kept at rest, which is no saturation.
    limits = {use.name: use.limit for use in replay.uses if use.kind == "effort" and use.limit > 0}
    for column, name in enumerate(run.info.outputs.T.names):
        if name not in limits or not len(run.time):
            continue
        used = np.abs(np.nan_to_num(run.T[:, column])) / limits[name]
        # Inputs are clipped to the bound itself, so equality up to rounding tells them.
        at_bound = (used >= 1.0 - ROUNDING) & (used <= 1.0 + ROUNDING)  # what exceeds the limit has a finding already
        share = float(at_bound.mean())
        if share > _SATURATED:
            time = float(run.time[int(at_bound.argmax())])
            message = f"actuator {name} is at its effort limit for {100 * share:.0f} % of the run"
            yield Finding(FindingKind.SATURATION, name, share, "", time, Severity.DEGRADES, message)


def _reversals(run: RunData, replay: LimitReplay) -> Iterator[Finding]:
    """Finding of inputs and joint velocities that reverse three times in a row: four changes of alternating sign.

    The size of such a reversal is the smallest of its four changes, as a share of the limit.
    """
    limits: dict[tuple[str, str], float] = {(use.kind, use.name): use.limit for use in replay.uses if use.limit > 0}
    outputs = run.info.outputs
    signals = [
        (kind, name, column / limits[kind, name])
        for kind, columns, values in (("effort", outputs.T, run.T), ("velocity", outputs.v, run.v))
        for name, column in zip(columns.names, values.T, strict=False)
        if (kind, name) in limits
    ]
    last = len(run.time) - 4
    if last < 1 or not signals:
        return
    # Shares of limits: noise of a strong drive and of a weak one count alike.
    shares = np.array([each for *_, each in signals])
    changes = np.diff(np.where(np.isfinite(shares), shares, np.nan))
    changes[:, ::2] *= -1.0  # changes that alternate have one sign now
    four = [changes[:, k : k + last] for k in range(4)]
    # The smallest of four changes in alternation: one large change alone is a step of a reference.
    sizes = np.nan_to_num(np.maximum(np.minimum.reduce(four), -np.maximum.reduce(four)), nan=0.0)
    largest = sizes.max(axis=0)
    share, violent = (float((largest > least).sum()) / len(run.time) for least in (_REVERSED, _VIOLENT))
    if share > _OFTEN_REVERSED:
        kind, name, _ = signals[int(sizes.max(axis=1).argmax())]
        first = float(run.time[int((largest > _REVERSED).argmax())])
        message = (
            f"inputs or velocities reverse three times in a row in {100 * share:.3g} % of the samples, first at "
            f"t = {first:.3f} s: the {kind} of {name} by up to {largest.max():.3g} of its limit"
        )
        severity = _graded(violent > _OFTEN_VIOLENT)
        yield Finding(FindingKind.REVERSAL, name, float(largest.max()), "", first, severity, message)


def verdict_of(run: RunData) -> Verdict:
    """Verdict of a run: the one it has, else by its grounds, with the limits and links of the robot's file.

    The grounds have the goals that its controller missed, by ``controller.missed_goals``.

    Args:
        run: the run.

    Raises:
        ConfigurationError: the run is from a file, and nothing could judge it before it was saved.
    """
    if run.info.verdict is not None:
        return run.info.verdict
    if run.grounds is None:
        raise ConfigurationError(
            "the run was saved before it was judged: call rnc.simulation.judge(run, "
            "rnc.simulation.replay_limits(robot, run))"
        )
    if not len(run.time):
        return judge(run)
    reduced, _, missed = run.grounds
    # Only contact is judged here: distances of bodies that stay apart may be bounds, which is faster.
    replay = replay_limits(reduced.robot, run, exact=0.0)
    return judge(run, replay, reduced=reduced, more=missed_goal_findings(run, missed))


def missed_goal_findings(run: RunData, missed: Sequence[MissedGoal]) -> list[Finding]:
    """Findings of goals that the controller of a run has missed at its end.

    Args:
        run: the run.
        missed: the goals, as of ``rnc.control.missed_goals``.
    """
    found = []
    # A run that ended early has its finding, and its goals were not due.
    for name, error, tolerance, reason in missed if run.outcome is Outcome.COMPLETED else ():
        message = f"the goal of {name} is missed by {error:.3g}, allowed is {tolerance:g}"
        message += f": {reason}" if reason else ""
        found.append(Finding(FindingKind.GOAL, name, error, "m or rad", float(run.time[-1]), Severity.FAILS, message))
    return found


def distance_findings(
    replay: LimitReplay, clearance: float | None = None, tolerance: float = SHORTFALL
) -> list[Finding]:
    """Findings about the distances of a run, one for each pair of bodies.

    Penetrations fail, and so do shortfalls of the clearance beyond the tolerance; smaller ones are notes. The
    clearance is that from obstacles: links of one robot are near each other by design. Pairs that touch or overlap at
    the start by design of the robot's own file are notes: their distance is not checked.

    Args:
        replay: result of ``replay_limits``.
        clearance: smallest distance from obstacles that was asked for [m]; None if none was.
        tolerance: shortfall that does not fail [m], such as the accuracy of a plan.

    Returns:
        Findings with the depth or the shortfall as amount [m], the largest first, then notes.

    Raises:
        InputError: the clearance is larger than the distance up to which the replay is exact.

    Example:
        >>> import coal
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> outputs = [rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")]
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce(outputs)
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.0], duration=2.0)
        >>> post = rnc.collision.Obstacle(coal.Cylinder(0.1, 2.0), position=(1.0, 0.0, 0.0), name="post")
        >>> (found,) = rnc.simulation.distance_findings(rnc.simulation.replay_limits(robot, run, [post]))
        >>> str(found.kind), found.where
        ('collision', 'sleigh / post')
    """
    if clearance is not None and clearance > replay.within:
        raise InputError(
            f"the clearance is {clearance:g} m, but the replay knows distances up to {replay.within:g} m: "
            "replay with a larger 'within'"
        )
    return [*_of_pairs(replay, clearance, tolerance), *_uncertain(replay), *_notes(replay)]


def _of_pairs(replay: LimitReplay, clearance: float | None, tolerance: float) -> Iterator[Finding]:
    nearest: dict[tuple[str, str], Clearance] = {}
    for each in replay.clearances:
        # Bodies have several shapes: the nearest pair, which is the first, stands for all of them.
        nearest.setdefault(each.names, each)
    for (one, other), each in nearest.items():
        where, at = f"{one} / {other}", f"at t = {each.time:.4g} s"
        if each.distance < -PENETRATION:
            depth = -each.distance
            words = f"{one} and {other} penetrate each other by {depth:.3g} m {at}"
            yield Finding(FindingKind.COLLISION, where, depth, "m", each.time, Severity.FAILS, words)
        elif clearance is not None and each.obstacle and each.distance < clearance - SHORTFALL:
            touches = each.distance < PENETRATION
            near = f"{one} {'touches' if touches else f'comes within {each.distance:.3g} m of'} {other} {at}"
            words = f"{near}, {clearance:g} m was asked for"
            if touches:  # such as a wheel on the floor
                words += f"; links that may touch it belong in the ignored_links of {other}"
            # A plan keeps its clearance up to its accuracy: a shortfall below it is told, and does not fail.
            shortfall = clearance - each.distance
            severity = Severity.FAILS if shortfall > tolerance else Severity.NOTE
            yield Finding(FindingKind.CLEARANCE, where, shortfall, "m", each.time, severity, words)


def _uncertain(replay: LimitReplay) -> Iterator[Finding]:
    """Pairs that may have come nearer: a doubt about obstacles degrades, one about links of one robot is a note."""
    pairs = {" / ".join(each.names): each.obstacle for each in replay.clearances if each.uncertain}
    for where, obstacle in pairs.items():
        # Obstacles were placed by the user, who asks for them; links are near each other in many robots.
        severity = Severity.DEGRADES if obstacle else Severity.NOTE
        message = f"the smallest distance of {where} is not certain: the motion is too fast between its samples"
        yield Finding(FindingKind.COLLISION, where, replay.tolerance, "m", None, severity, message)


def _notes(replay: LimitReplay) -> Iterator[Finding]:
    for each in replay.omitted:
        where, (one, other) = " / ".join(each.names), each.names
        how = f"{'touch' if each.depth < PENETRATION else f'overlap by {each.depth:.3g} m'} at the start"
        # A reason of the robot's own description says more than a depth.
        how = each.reason if each.reason.startswith("overlap in") else how
        message = f"{one} and {other} {how}: they are not checked"
        yield Finding(FindingKind.COLLISION, where, each.depth, "m", None, Severity.NOTE, message)
