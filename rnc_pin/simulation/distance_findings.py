"""Findings of distances in a replay."""

from __future__ import annotations

from rnc_pin.simulation.limit_replay import LimitReplay
from rnc_pin.verdict import Finding, FindingKind, Severity


def distance_findings(replay: LimitReplay, clearance: float | None) -> list[Finding]:
    """Temporary."""
    found = []
    for each in replay.clearances:
        a, b = each.names
        if each.distance < -1e-6:
            found.append(
                Finding(
                    FindingKind.COLLISION,
                    f"{a} / {b}",
                    each.distance,
                    "m",
                    each.time,
                    Severity.FAILS,
                    f"{a} and {b} penetrate each other by {-each.distance:.3g} m at t = {each.time:.2f} s",
                )
            )
        elif clearance is not None and each.obstacle and each.distance < clearance - 1e-4:
            found.append(
                Finding(
                    FindingKind.CLEARANCE,
                    f"{a} / {b}",
                    each.distance,
                    "m",
                    each.time,
                    Severity.FAILS,
                    f"{a} comes within {each.distance:.3g} m of {b} at t = {each.time:.2f} s, {clearance:g} m was asked for",
                )
            )
    return found
