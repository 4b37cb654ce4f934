"""Verdict of a motion: findings, each with its kind, place, amount, time and severity.

A run is *completed* if it reached its end. It *succeeded* only if no finding fails that the user did not accept.
Most findings of runs, and their thresholds, are in ``simulation/judgement.py``.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

from rnc_pin.errors import place_of
from rnc_pin.io.json import Json
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin, printed

SHORTFALL = 1e-4
"""Shortfall of a clearance, or excess over a limit of a program, that counts [m, rad, and per second]."""
GOAL_TOLERANCE = 0.02
"""Error at the end of a run above which a goal is missed, where nothing else is stated [m, rad, and per second]."""
MOSTLY = 0.5
"""Share of a run under fallback commands, unsolved programs or old motions, above which it fails."""


class Severity(StrEnum):
    """Weight of a finding: a motion with one that fails has not succeeded."""

    FAILS = "fails"
    DEGRADES = "degrades"
    NOTE = "note"


class FindingKind(StrEnum):
    """Kinds of findings. Their values are the names for ``accept`` in scenario files."""

    ENDED_EARLY = "ended_early"
    """The run did not reach its end: it diverged, met a stop condition, failed or was interrupted."""
    SINGULAR = "singular"
    """The run ended with the error of a state where the outputs do not determine the motion."""
    NOT_FINITE = "not_finite"
    """A measurement, a state or an input was not a finite number."""
    GOAL = "goal"
    """The motion ended away from its goal."""
    POSITION = "position"
    """A joint left the range of the robot's file."""
    VELOCITY = "velocity"
    """A joint was faster than the robot's file allows."""
    EFFORT = "effort"
    """An actuator gave more than the robot's file allows."""
    ACCELERATION = "acceleration"
    """A joint accelerated more than a stated limit."""
    COLLISION = "collision"
    """Two bodies penetrate each other."""
    CLEARANCE = "clearance"
    """Two bodies came nearer than the distance that was asked for."""
    LIFT_OFF = "lift_off"
    """A contact that cannot pull had to pull."""
    SLIP = "slip"
    """A contact needed more friction than was stated."""
    LATE = "late"
    """Steps took longer to compute than their sampling period, by the clock of this computer."""
    FALLBACK = "fallback"
    """A fallback command was in use, because the loop had a fault or a program was late or failed."""
    UNSOLVED = "unsolved"
    """A whole-body program was not solved; inputs that keep limits alone, or come to rest, took its place."""
    BRAKING = "braking"
    """A program braked to keep its limits, or no braking motion could be verified."""
    SATURATION = "saturation"
    """An input was at its bound for a large part of the run."""
    REVERSAL = "reversal"
    """An input or a joint velocity reversed from sample to sample by a large share of its limit."""
    PLAN = "plan"
    """A plan was driven whose re-integration does not confirm it."""
    MODEL = "model"
    """A property of the model was assumed or is not trusted, e.g. nearly dependent rows or an assumed radius."""
    INTEGRATION = "integration"
    """The integration of the motion was less accurate than its tolerance."""
    LIMIT_GAVE_WAY = "limit_gave_way"
    """A limit of a whole-body program gave way to others."""


@printed()
@dataclass(frozen=True)
class Finding:
    """One result of a check.

    Attributes:
        kind: what was checked.
        where: row, joint, actuator, output or pair of bodies.
        amount: size of the excess, error or distance, in ``unit``; None if it is not finite.
        unit: unit of the amount; "" for a share or a count.
        time: time of the largest amount [s]; None if it has none.
        severity: weight of the finding.
        message: one line for a reader.

    Example:
        >>> from rnc_pin.simulation import Finding, FindingKind, Severity, Verdict
        >>> message = "the goal of tip is missed by 0.03 m"
        >>> missed = Finding(FindingKind.GOAL, "tip", 0.03, "m", 2.0, Severity.FAILS, message)
        >>> print(Verdict.of([missed]).word, "-", missed)
        failed - the goal of tip is missed by 0.03 m
    """

    kind: FindingKind
    where: str
    amount: float | None
    unit: str
    time: float | None
    severity: Severity
    message: str

    def __post_init__(self) -> None:
        if self.amount is not None:  # a plain number, or None as in JSON
            object.__setattr__(self, "amount", float(self.amount) if math.isfinite(self.amount) else None)

    def __str__(self) -> str:
        return self.message

    def to_json(self) -> dict[str, Json]:
        """Return the finding as JSON content."""
        return {**asdict(self), "kind": str(self.kind), "severity": str(self.severity)}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Finding:
        """Read the content of ``to_json``.

        Raises:
            KeyError, ValueError, TypeError: a field is missing, or has an unknown value.
        """
        return cls(**{**content, "kind": FindingKind(content["kind"]), "severity": Severity(content["severity"])})


@dataclass(frozen=True, repr=False)
class Verdict(SummaryMixin):
    """Findings about a motion, and whether it succeeded.

    Attributes:
        findings: all findings, those that fail first.
        accepted: kinds of findings that the user accepts: they do not fail.
        late: note of samples that took longer to compute than the sampling period. It depends on the computer, so it is
            in no file, print or comparison, and it decides nothing.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> run = rnc.free_motion(reduced, robot.configuration(), [1.0, 0.5], duration=1.0)
        >>> run.verdict.succeeded, run.verdict.first
        (True, None)
    """

    findings: tuple[Finding, ...] = ()
    accepted: frozenset[FindingKind] = frozenset()
    late: Finding | None = field(default=None, compare=False)

    @classmethod
    def of(cls, findings: Iterable[Finding], accepted: Iterable[FindingKind | str] = ()) -> Verdict:
        """Verdict with its findings in the order of their weight.

        Args:
            findings: findings in any order.
            accepted: kinds that the user accepts.

        Raises:
            ConfigurationError: there is no such kind.
        """
        # The first line of a print is the one that decides: findings that fail come first.
        order = list(Severity)
        ordered = sorted(findings, key=lambda each: order.index(each.severity))
        return cls(tuple(ordered), frozenset(finding_kind(each) for each in accepted))

    @cached_property
    def failures(self) -> tuple[Finding, ...]:
        """Findings that fail and are not accepted."""
        failing = (each for each in self.findings if each.severity is Severity.FAILS)
        return tuple(each for each in failing if each.kind not in self.accepted)

    @property
    def succeeded(self) -> bool:
        """True if no finding fails, apart from accepted ones."""
        return not self.failures

    @property
    def degraded(self) -> bool:
        """True if the motion succeeded, but with findings that degrade it or that were accepted."""
        return self.succeeded and any(each.severity is not Severity.NOTE for each in self.findings)

    @property
    def first(self) -> Finding | None:
        """The finding that decides: the first that fails; else the first that degrades; None without both."""
        # A failure that the user accepted still degrades, and is told if nothing else is.
        found = [*self.failures, *(each for each in self.findings if each.severity is not Severity.NOTE)]
        return found[0] if found else None

    @property
    def word(self) -> str:
        """The verdict in one word: "succeeded", "degraded" or "failed"."""
        return "degraded" if self.degraded else "succeeded" if self.succeeded else "failed"

    @property
    def headline(self) -> str:
        """The verdict and the finding that decides: "failed: the goal of tip is missed by 0.03 m"."""
        return self.word if self.first is None else f"{self.word}: {self.first}"

    def to_json(self) -> dict[str, Json]:
        """Return the verdict as JSON content."""
        return {
            "verdict": self.word,
            "succeeded": self.succeeded,
            "findings": [each.to_json() for each in self.findings],
            "accepted": sorted(map(str, self.accepted)),
        }

    def _summary(self) -> ObjectSummary:
        kinds: dict[str, list[Item]] = {}
        for each in self.findings:
            kinds.setdefault(weight_of(each.kind, each.severity, self.accepted), []).append(Item(each.message))
        return ObjectSummary(self.headline, list(kinds.items()))


def weight_of(kind: str, severity: str, accepted: Collection[str]) -> str:
    """Severity of a finding in words: "accepted" in place of "fails" if its kind is accepted."""
    # Severities stay as they were judged: a record read later shows what was accepted.
    return "accepted" if severity == Severity.FAILS and kind in accepted else str(severity)


def finding_kind(name: FindingKind | str) -> FindingKind:
    """Kind of a finding by its name.

    Raises:
        ConfigurationError: there is no such kind.
    """
    return list(FindingKind)[place_of(str(name), list(map(str, FindingKind)), "no kind of finding")]
