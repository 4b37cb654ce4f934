"""Findings about the distances of a run: collisions, and bodies that come nearer than a stated clearance."""

from __future__ import annotations

from collections.abc import Iterator

from rnc_pin.errors import InputError
from rnc_pin.simulation.limit_replay import Clearance, LimitReplay
from rnc_pin.verdict import Finding, FindingKind, Severity

PENETRATION = 1e-6
"""Depth of a penetration that counts as a collision [m]."""
SHORTFALL = 1e-4
"""Shortfall of a clearance that counts [m]."""


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
    done: set[tuple[str, str]] = set()
    for each in replay.clearances:  # nearest first
        one, other = each.names
        if each.names in done:
            continue  # other shapes of the same bodies, which are farther
        done.add(each.names)
        at = f"at t = {each.time:.4g} s"
        if each.distance < -PENETRATION:
            depth = -each.distance
            words = f"{one} and {other} penetrate each other by {depth:.3g} m {at}"
            yield _finding(FindingKind.COLLISION, each, depth, Severity.FAILS, words)
        elif clearance is not None and each.obstacle and each.distance < clearance - SHORTFALL:
            near = f"{one} comes within {max(each.distance, 0.0):.3g} m of {other} {at}"
            words = f"{near}, {clearance:g} m was asked for"
            shortfall = clearance - each.distance
            severity = Severity.FAILS if shortfall > tolerance else Severity.NOTE
            yield _finding(FindingKind.CLEARANCE, each, shortfall, severity, words)


def _finding(kind: FindingKind, pair: Clearance, amount: float, severity: Severity, message: str) -> Finding:
    return Finding(kind, " / ".join(pair.names), amount, "m", pair.time, severity, message)


def _uncertain(replay: LimitReplay) -> Iterator[Finding]:
    """Pairs that may have come nearer: a doubt about obstacles degrades, one about links of one robot is a note."""
    pairs = {" / ".join(each.names): each.obstacle for each in replay.clearances if each.uncertain}
    for where, obstacle in pairs.items():
        severity = Severity.DEGRADES if obstacle else Severity.NOTE
        message = f"the smallest distance of {where} is not certain: the motion is too fast between its samples"
        yield Finding(FindingKind.COLLISION, where, replay.tolerance, "m", None, severity, message)


def _notes(replay: LimitReplay) -> Iterator[Finding]:
    for each in replay.omitted:
        where, (one, other) = " / ".join(each.names), each.names
        how = "touch" if each.depth < PENETRATION else f"overlap by {each.depth:.3g} m"
        message = f"{one} and {other} {how} at the start: they are not checked"
        yield Finding(FindingKind.COLLISION, where, each.depth, "m", None, Severity.NOTE, message)
