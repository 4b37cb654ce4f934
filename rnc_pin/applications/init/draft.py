"""Draft of a scenario: base, wheels, actuators, outputs, a slow reference and a controller."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from rnc_pin.applications.init import omnidirectional_base as omnidirectional
from rnc_pin.applications.init import other_bases
from rnc_pin.applications.init.assumptions import BaseAssumptions
from rnc_pin.applications.init.evidence import GUESSED, LIKELY, Alternative, DraftDecision
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.scenario_candidate import ScenarioCandidate
from rnc_pin.applications.init.source import DraftOptions, Source
from rnc_pin.applications.init.start_values import start_values
from rnc_pin.applications.init.trial import Trial
from rnc_pin.applications.init.wheel_detection import Wheel, WheelSearch
from rnc_pin.applications.init.wheel_layout import WheelLayout, classify_wheels
from rnc_pin.applications.init.wheeled_base import knife_edge_base, wheeled_base
from rnc_pin.applications.scenario.builder import collected_model_warnings
from rnc_pin.errors import ConfigurationError, ModelError, RncError, few, warn
from rnc_pin.verdict import Finding, FindingKind


class BaseEvidence:
    """Evidence for the kind of a base: the robot of a file at its start values, and what it stands on.

    Args:
        source: the file, with the user's choices.

    Attributes:
        at_start: the robot.
        search: its wheels, and what is drawn as a wheel.
        layout: wheels on which it stands, by their function.
        axles: axles that are only drawn, if no wheel has a joint.
        drawn: wheels that are only drawn on pivots, beside such axles.
        balance: decision whether it balances on two wheels; None if the question does not arise.
        rollers: decision whether the wheels have rollers; None if the question does not arise.
    """

    def __init__(self, source: Source) -> None:
        robot, is_rigid = source.load_for_detection()
        source.remember_packages(robot)
        drives, options, names = source.drive_evidence(robot), source.options, source.names()
        at_start = RobotAtStart(robot, start_values(robot), names, drives, not source.is_mjcf, is_rigid)
        search = WheelSearch(at_start)
        wheels, axles, shapes = list[Wheel](), list[Wheel](), list[Wheel]()
        if options.base in (None, "planar"):  # bolted down or afloat, wheels do not carry it
            wheels = search.standing
            source.hold(search.virtual, "virtual wheels move no shape and nearly no mass")
            if other_bases.is_called_afloat(at_start) and not search.stands_below_body:  # propellers
                wheels = []
            # What moves over the ground without rolling may be drawn with wheels: they would hold it.
            if wheels or not (other_bases.moves_over_ground(at_start) or at_start.own_planar_joints):
                axles = [] if wheels else search.drawn_axles
                shapes = search.drawn_wheels(wheels or axles)
        layout, least = WheelLayout(), 3  # drawn wheels on which a robot without other wheels stands
        if wheels or (len(shapes) >= least and not axles):
            standing = [*wheels, *shapes]
            called = omnidirectional.wheels_called_omni(standing, at_start) if options.rollers is None else []
            layout = classify_wheels(standing, drives, search.raised if wheels else (), called)
            if layout.steered and not (layout.fixed or layout.is_swerve or layout.is_turret):
                # Drawn axles guide a base whose wheels only steer.
                layout.fixed += (axle for axle in search.drawn_axles if axle.joint == at_start.root_joint)
        self.source, self.at_start, self.search, self.layout, self.axles = source, at_start, search, layout, axles
        self.drawn = classify_wheels(shapes, drives)
        self.balance = other_bases.balance_decision(layout, at_start, options.balance) if options.base is None else None
        self.rollers = omnidirectional.rollers_decision(layout, at_start, options.rollers)

    def complete(self, mobility: BaseAssumptions) -> None:
        """Add the decisions on its wheels, the doubts about crossed axes, and locks of joints that nothing drives.

        Args:
            mobility: assumptions about the base; they are extended.
        """
        mobility.decisions[:0] = [each for each in (self.balance, self.rollers) if each is not None]
        if self.source.options.base is None and self.layout.wheels and self.search.guessed:
            evidence = "they turn on and on about one axle in pairs, and their meshes were not found"
            bolted, floats = Alternative("bolted down", {"base": "fixed"}), Alternative("afloat", {"base": "free"})
            mobility.decide(f"Are {few(self.search.guessed)} wheels?", "yes", GUESSED, evidence, bolted, floats)
        for each in self.search.crossed:
            mobility.doubts.append((each, 0.0, f"the axis of joint {each} is across that of its drawn cylinder"))
        loose = {each: q for each, q in self.at_start.free_joints.items() if each != self.at_start.root_joint}
        mobility.lock.update(loose)
        mobility.note("locked, because nothing drives them", [*loose])

    def likely_bases(self) -> Iterator[Callable[[], BaseAssumptions]]:
        """Yield functions that return the assumptions of each kind of base that fits, the most likely first.

        The first kind whose trial succeeds is taken, else the best trial.
        """
        layout, at_start, asked = self.layout, self.at_start, self.source.options.base
        balances, has_rollers = (each is not None and each.answer == "yes" for each in (self.balance, self.rollers))
        is_cart = bool(layout.fixed) and layout.is_straight and not has_rollers  # fixed wheels roll in one direction
        if asked is None and layout.is_on_one_track and not layout.is_bicycle:
            yield partial(other_bases.refuse_one_track, layout, self.search.crossed)
            return  # no other kind stands on these wheels
        on_wheels = (
            (asked is None and layout.is_bicycle, other_bases.bicycle_base),
            (balances, other_bases.balancing_base),
            (has_rollers, omnidirectional.omnidirectional_base),
            (layout.is_turret, omnidirectional.turret_base),
            (layout.is_swerve, omnidirectional.swerve_base),
            (is_cart, wheeled_base),
        )
        yield from (partial(kind, layout, at_start) for fits, kind in on_wheels if fits)
        if self.axles:
            yield partial(knife_edge_base, self.axles, self.drawn, at_start)
        without_wheels = partial(other_bases.without_wheels, at_start, self.source.mass_of_base)
        # Disks at right angles do not carry the base.
        if not layout.wheels or (layout.fixed and not layout.steered and not is_cart):
            yield partial(without_wheels, asked)
        if layout.wheels:
            yield partial(omnidirectional.force_driven_base, layout, at_start)
        elif asked is None:
            yield partial(without_wheels, "fixed", "taken to be bolted down, for lack of better")
            yield partial(other_bases.fixed_base_with_locked_joints, at_start)


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

    Args:
        source: a file, or the name of a shipped URDF or of a robot of example-robot-data.
        folder: folder of the scenario.
        wishes: user's choices that replace guesses.
    """
    choices = wishes or DraftOptions()
    taken = first = _tried(source, folder, choices)
    # A run beyond limits speaks against a guess; against what is sure it speaks against the file.
    wrong = [str(each) for each in first.trial.findings if _speaks_against(each)]
    for decision in first.scenario.questions if wrong else ():
        evidence = f"with the answer '{decision.answer}', its run has {wrong[0]}"
        for other in decision.alternatives if taken is first else ():
            decided = DraftDecision(decision.question, other.answer, LIKELY, evidence)
            with suppress(RncError):  # another answer may have no draft at all
                found = _tried(source, folder, choices.with_choices(other.choices), [decided])
                taken = first if found.trial.doubts else found
    for message in dict.fromkeys(taken.warnings):
        warn(message)
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
    with collected_model_warnings(show=False) as heard:
        source = Source(name, folder, choices)
        evidence = BaseEvidence(source)
    for kind in evidence.likely_bases():
        mobility: BaseAssumptions | None = None
        try:
            with collected_model_warnings(show=False) as said:  # those of rejected candidates are not of interest
                mobility = kind()
                evidence.complete(mobility)
                attempt = ScenarioCandidate(mobility, source, evidence.at_start)
                mobility.notes += [*source.remarks, *failures]
                mobility.decisions += decided
                text, trial = attempt.written()
        except RncError as error:
            first = first or error
            # Kinds of bases often fail for one reason, such as a joint without mass.
            if not any(str(error) in each for each in failures):
                failures.append(f"not '{mobility.kind}', which does not run: {error}" if mobility else str(error))
            continue
        if best is None or trial.rank < best.trial.rank:
            best = _Draft(DraftedScenario(text, tuple(mobility.decisions)), trial, said)
        if trial.verdict.succeeded:
            break
        failures.append(f"not '{mobility.kind}': {trial.verdict.first}")
    called = evidence.at_start.robot.name or source.name
    if best is not None:
        doubts = "; ".join(best.trial.doubts)
        doubted = [f"'{called}' is drafted, but {doubts}: CHECK the draft"] if doubts else []
        return best._replace(warnings=[*heard, *best.warnings, *doubted])
    if choices.base and isinstance(first, ModelError):
        raise first  # the file cannot have the base that the user asked for
    hint = "lock joints with --lock JOINT, or choose the base with --base"
    raise ConfigurationError(f"no scenario can be drafted for '{called}': {failures[0]}; {hint}")
