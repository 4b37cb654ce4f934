"""Draft of a scenario: base, wheels, actuators, outputs, a slow reference and a controller."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from rnc_pin.applications.init import other_bases
from rnc_pin.applications.init.assumptions import BaseAssumptions
from rnc_pin.applications.init.evidence import LIKELY, DraftDecision
from rnc_pin.applications.init.omnidirectional_base import (
    force_driven_base,
    is_swerve,
    is_turret,
    omnidirectional_base,
    rollers_decision,
    swerve_base,
    turret_base,
    wheels_called_omni,
)
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.scenario_candidate import ScenarioCandidate
from rnc_pin.applications.init.source import DraftOptions, Source, with_choices
from rnc_pin.applications.init.start_values import start_values
from rnc_pin.applications.init.trial import Trial
from rnc_pin.applications.init.wheel_detection import (
    find_raised_wheels,
    find_virtual_joints,
    find_wheels,
    stand_below_body,
)
from rnc_pin.applications.init.wheel_layout import (
    WheelLayout,
    classify_wheels,
    find_crossed_wheels,
    find_drawn_axles,
    find_drawn_wheels,
)
from rnc_pin.applications.init.wheeled_base import knife_edge_base, wheeled_base
from rnc_pin.errors import ConfigurationError, ModelError, ModelWarning, RncError
from rnc_pin.verdict import Finding, FindingKind

_STANDS = 3  # smallest number of drawn wheels on which a robot without other wheels stands
_BaseBuilder = Callable[[], BaseAssumptions]


@dataclass(frozen=True)
class DraftedScenario:
    """Draft of a scenario.

    Attributes:
        text: text of the scenario file.
        decisions: decisions behind it, with evidence and alternatives.
    """

    text: str
    decisions: tuple[DraftDecision, ...]

    @property
    def questions(self) -> list[DraftDecision]:
        """Decisions whose confidence is too low to be taken without asking."""
        return [each for each in self.decisions if each.is_open]


def draft(source: str, folder: Path, wishes: DraftOptions | None = None) -> str:
    """Return the text of a scenario, tested by a trial run, that ``rnc-pin inspect`` and ``rnc-pin run`` accept.

    Args:
        source: a URDF, xacro or MJCF file, the name of a URDF shipped with rnc_pin or of a robot of example-robot-data.
        folder: folder of the scenario: paths in the scenario are relative to it.
        wishes: user's choices that replace guesses.

    Raises:
        RncError: the robot does not exist, or no draft of it runs.
    """
    return draft_with_decisions(source, folder, wishes).text


def draft_with_decisions(source: str, folder: Path, wishes: DraftOptions | None = None) -> DraftedScenario:
    """Return a scenario as ``draft`` does, with the decisions behind it.

    If its run exceeds limits or collides and a decision is open, another answer that leaves no doubts is taken.
    """
    choices = wishes or DraftOptions()
    taken = first = _tried(source, folder, choices)
    wrong = [str(each) for each in first.trial.findings if _speaks_against(each)]
    for decision in first.scenario.questions if wrong else ():
        evidence = f"with the answer '{decision.answer}', its run has {wrong[0]}"
        for other in decision.alternatives if taken is first else ():
            decided = DraftDecision(decision.question, other.answer, LIKELY, evidence)
            with suppress(RncError):
                found = _tried(source, folder, with_choices(choices, other.options), [decided])
                taken = first if found.trial.doubts else found
    for message in dict.fromkeys(taken.warnings):
        warnings.warn(message, ModelWarning, stacklevel=3)
    return taken.scenario


def _speaks_against(finding: Finding) -> bool:
    """True for a finding of a run that another answer may avoid; a small excess of an effort is none."""
    if finding.kind is FindingKind.EFFORT:
        return finding.amount is None or finding.amount > 1.0
    return finding.kind in (FindingKind.POSITION, FindingKind.COLLISION)


class _Draft(NamedTuple):
    """A draft, its trial run, and the warnings on the way."""

    scenario: DraftedScenario
    trial: Trial
    warnings: list[str]


def _tried(name: str, folder: Path, choices: DraftOptions, decided: Iterable[DraftDecision] = ()) -> _Draft:
    """Return the draft with the first kind of base whose run succeeds, else the best one."""
    failures: list[str] = []
    first: RncError | None = None
    best: _Draft | None = None
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        source = Source(name, folder, choices)
        at_start = _at_start(source)
        for way in _candidate_bases(at_start, source):
            mobility: BaseAssumptions | None = None
            begun = len(heard)
            try:
                mobility = way()
                for each in find_crossed_wheels(at_start):
                    mobility.doubts.append(
                        (each, 0.0, f"the axis of joint {each} is across that of its drawn cylinder")
                    )
                if at_start.loose:
                    mobility.lock.update(at_start.loose)
                    mobility.notes.append(f"locked, because nothing drives them: {', '.join(at_start.loose)}")
                attempt = ScenarioCandidate(mobility, source, at_start, folder)
                mobility.notes += [*source.remarks, *failures]
                mobility.decisions += decided
                scenario = DraftedScenario(attempt.written(), tuple(mobility.decisions))
            except RncError as error:
                first = first or error
                if not any(str(error) in each for each in failures):
                    failures.append(f"not '{mobility.kind}', which does not run: {error}" if mobility else str(error))
                continue
            finally:
                said = _messages(heard[begun:])
                del heard[begun:]  # those of rejected candidates are not of interest
            verdict = attempt.trial.verdict
            if best is None or attempt.trial.rank < best.trial.rank:
                best = _Draft(scenario, attempt.trial, said)
            if verdict.succeeded:
                break
            failures.append(f"not '{mobility.kind}': {verdict.first}")
    called = at_start.robot.name or source.name
    if best is not None:
        doubts = (
            [f"'{called}' is drafted, but {'; '.join(best.trial.doubts)}: CHECK the draft"] if best.trial.doubts else []
        )
        return best._replace(warnings=[*_messages(heard), *best.warnings, *doubts])
    if choices.base and isinstance(first, ModelError):
        raise first  # the file cannot have the base that the user asked for
    hint = "lock joints with --lock JOINT, or choose the base with --base"
    raise ConfigurationError(f"no scenario can be drafted for '{called}': {failures[0]}; {hint}")


def _messages(heard: Iterable[warnings.WarningMessage]) -> list[str]:
    return [str(each.message) for each in heard if issubclass(each.category, ModelWarning)]


def _at_start(source: Source) -> RobotAtStart:
    """Return the robot of a file at its start values."""
    robot, is_rigid = source.load_for_detection()
    source.remember_packages(robot)
    drives = source.drive_evidence(robot)
    return RobotAtStart(robot, start_values(robot), source.names(), drives, not source.is_mjcf, is_rigid)


def _candidate_bases(at_start: RobotAtStart, source: Source) -> Iterator[_BaseBuilder]:
    """Candidate bases, the most likely first; only one if the user chose the base."""
    asked = source.options.base
    if asked in (None, "planar"):
        wheels = find_wheels(at_start)
        source.hold(find_virtual_joints(at_start), "virtual wheels move no shape and nearly no mass")
        if other_bases.is_called_afloat(at_start) and not stand_below_body(wheels, at_start):
            wheels = []
        on_ice = bool(not wheels and (other_bases.moves_over_ground(at_start) or at_start.own_planar_joints))
        axles = [] if wheels or on_ice else find_drawn_axles(at_start)
        drawn = [] if on_ice else find_drawn_wheels(at_start, wheels or axles)
        if wheels or (len(drawn) >= _STANDS and not axles):
            wheels += drawn
            called = wheels_called_omni(wheels, at_start) if source.options.rollers is None else []
            sliding = called if len(called) < len(wheels) else []
            layout = classify_wheels(wheels, at_start.drives, find_raised_wheels(at_start, wheels), sliding)
            if layout.steered and not (layout.fixed or is_swerve(layout) or is_turret(layout)):
                layout.fixed += (axle for axle in find_drawn_axles(at_start) if axle.joint == at_start.root_joint)
            yield from _candidate_wheeled_bases(layout, at_start, source)
            return
        if axles:
            yield lambda: knife_edge_base(axles, classify_wheels(drawn, at_start.drives), at_start)
    yield lambda: other_bases.without_wheels(at_start, asked, source.mass_of_base)
    if asked is None:
        why = "taken to be bolted down, for lack of better"
        yield lambda: other_bases.without_wheels(at_start, "fixed", source.mass_of_base, why)
        yield lambda: other_bases.fixed_base_with_locked_joints(at_start)


def _candidate_wheeled_bases(found: WheelLayout, at_start: RobotAtStart, source: Source) -> Iterator[_BaseBuilder]:
    wishes = source.options
    if wishes.base is None and other_bases.is_bicycle(found):
        yield lambda: other_bases.bicycle_base(found, at_start)
    elif wishes.base is None and found.is_on_one_track:
        yield lambda: other_bases.refuse_one_track(found, find_crossed_wheels(at_start))
        return
    balance = other_bases.balance_decision(found, at_start, wishes.balance) if wishes.base is None else None
    rollers = rollers_decision(found, at_start, wishes.rollers)
    if balance is not None and balance.answer == "yes":
        yield lambda: other_bases.balancing_base(found, at_start, balance)
    elif rollers is not None and rollers.answer == "yes":
        yield lambda: omnidirectional_base(found, at_start, rollers)
    if is_turret(found):
        yield lambda: turret_base(found, at_start)
    elif is_swerve(found):
        yield lambda: swerve_base(found, at_start)
    elif found.fixed and found.is_straight and (rollers is None or rollers.answer != "yes"):
        yield lambda: wheeled_base(found, at_start, [each for each in (balance, rollers) if each is not None])
    elif found.fixed and not found.steered:  # disks at right angles that do not carry the base
        yield lambda: other_bases.without_wheels(at_start, wishes.base, source.mass_of_base)
    yield lambda: force_driven_base(found, at_start, _why_not_on_wheels(found))


def _why_not_on_wheels(found: WheelLayout) -> str:
    if found.fixed:
        return "these wheels cannot roll together as they are read"
    if not found.steered:
        return "all wheels are casters"
    if len(found.steered) == 1 and found.casters:
        still = " ".join(f"--lock {each.pivot.joint}" for each in found.casters)
        pivot = found.steered[0].pivot.joint
        return f"{pivot} alone steers, and casters do not hold the heading of the base (if they are fixed: {still})"
    return "every wheel is steered by itself"
