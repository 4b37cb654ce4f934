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


def distance_findings(replay: LimitReplay, clearance: float | None = None) -> list[Finding]:
    """Findings about the distances of a run, one for each pair of bodies.

    Penetrations and shortfalls of the clearance fail. The clearance is that from obstacles: links of one robot are near
    each other by design. Pairs that touch or overlap at the start by design of the robot's own file are notes: their
    distance is not checked.

    Args:
        replay: result of ``replay_limits``.
        clearance: smallest distance from obstacles that was asked for [m]; None if none was.

    Returns:
        Findings with the depth or the shortfall as amount [m], the largest first, then notes.

    Raises:
        InputError: the clearance is larger than the distance up to which the replay is exact.

    Example:
        >>> import coal
        >>> robot = rnc.Robot.from_urdf("unicycle.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("base")]).reduce()
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.0, 0.0], duration=2.0)
        >>> post = rnc.collision.Obstacle(coal.Cylinder(0.1, 2.0), position=(1.0, 0.0, 0.0), name="post")
        >>> replay = rnc.simulation.replay_limits(robot, run, [post])
        >>> {str(each.kind) for each in rnc.simulation.distance_findings(replay)}
        {'collision'}
    """
    if clearance is not None and clearance > replay.within:
        raise InputError(
            f"the clearance is {clearance:g} m, but the replay knows distances up to {replay.within:g} m: "
            "replay with a larger 'within'"
        )
    return [*_of_pairs(replay, clearance), *_uncertain(replay), *_notes(replay)]


def _of_pairs(replay: LimitReplay, clearance: float | None) -> Iterator[Finding]:
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
            yield _failure(FindingKind.COLLISION, each, depth, words)
        elif clearance is not None and each.obstacle and each.distance < clearance - SHORTFALL:
            near = f"{one} comes within {max(each.distance, 0.0):.3g} m of {other} {at}"
            words = f"{near}, {clearance:g} m was asked for"
            yield _failure(FindingKind.CLEARANCE, each, clearance - each.distance, words)


def _failure(kind: FindingKind, pair: Clearance, amount: float, message: str) -> Finding:
    return Finding(kind, " / ".join(pair.names), amount, "m", pair.time, Severity.FAILS, message)


def _uncertain(replay: LimitReplay) -> Iterator[Finding]:
    for where in dict.fromkeys(" / ".join(each.names) for each in replay.clearances if each.uncertain):
        message = f"the smallest distance of {where} is not certain: the motion is too fast between its samples"
        yield Finding(FindingKind.COLLISION, where, replay.tolerance, "m", None, Severity.DEGRADES, message)


def _notes(replay: LimitReplay) -> Iterator[Finding]:
    for each in replay.omitted:
        where, (one, other) = " / ".join(each.names), each.names
        message = f"{one} and {other} overlap by {each.depth:.3g} m at the start: they are not checked"
        yield Finding(FindingKind.COLLISION, where, each.depth, "m", None, Severity.NOTE, message)
