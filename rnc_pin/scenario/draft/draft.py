"""Draft of a scenario: base, wheels, actuators, outputs, a slow reference and a controller."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from rnc_pin.errors import ConfigurationError, ModelError, ModelWarning, RncError
from rnc_pin.scenario.draft.balancing_base import balances, balancing_base, bicycle_base, is_bicycle
from rnc_pin.scenario.draft.base_assumptions import BaseAssumptions
from rnc_pin.scenario.draft.base_without_wheels import fixed_base_with_locked_joints, without_wheels
from rnc_pin.scenario.draft.drawn_axles import find_drawn_axles
from rnc_pin.scenario.draft.joint_properties import start_values
from rnc_pin.scenario.draft.omnidirectional_base import force_driven_base, has_rollers, omnidirectional_base
from rnc_pin.scenario.draft.robot_at_start import RobotAtStart
from rnc_pin.scenario.draft.scenario_candidate import ScenarioCandidate
from rnc_pin.scenario.draft.snake_base import find_snake, snake_base
from rnc_pin.scenario.draft.source import DraftOptions, Source
from rnc_pin.scenario.draft.spherical_base import find_shell, spherical_base
from rnc_pin.scenario.draft.trial import Trial
from rnc_pin.scenario.draft.wheel_detection import find_wheels
from rnc_pin.scenario.draft.wheel_layout import WheelLayout, classify_wheels
from rnc_pin.scenario.draft.wheeled_base import knife_edge_base, wheeled_base
from rnc_pin.verdict import Severity

_BaseBuilder = Callable[[], BaseAssumptions]


def draft(source: str, folder: Path, wishes: DraftOptions | None = None) -> str:
    """Return the text of a scenario, tested by a trial run, that ``rnc-pin inspect`` and ``rnc-pin run`` accept.

    Args:
        source: a URDF, xacro or MJCF file, the name of a URDF shipped with rnc_pin or of a robot of example-robot-data.
        folder: folder of the scenario: paths in the scenario are relative to it.
        wishes: user's choices that replace guesses.

    Raises:
        RncError: the robot does not exist, or no draft of it runs.
    """
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        text = _drafted(Source(source, folder, wishes or DraftOptions()), folder, (wishes or DraftOptions()).base)
    for message in dict.fromkeys(str(each.message) for each in said if issubclass(each.category, ModelWarning)):
        warnings.warn(message, ModelWarning, stacklevel=2)
    return text


def _drafted(source: Source, folder: Path, asked: str | None) -> str:
    robot, is_rigid = source.load_for_detection()
    source.remember_packages(robot)
    at_start = RobotAtStart(robot, start_values(robot), source.words(), "mjcf" not in source.entry, is_rigid)
    failures: list[str] = []
    first: RncError | None = None
    best: tuple[Trial, str, list[warnings.WarningMessage]] | None = None
    for way in _candidate_bases(at_start, asked, source, source.driven()):
        mobility = way()
        if at_start.loose:
            mobility.lock.update(at_start.loose)
            mobility.notes.append(f"locked, because nothing drives them: {', '.join(at_start.loose)}")
        try:
            with warnings.catch_warnings(record=True) as heard:  # those of rejected candidates are not of interest
                warnings.simplefilter("always")
                attempt = ScenarioCandidate(mobility, source, at_start.start, folder)
                mobility.notes += source.remarks + failures
                text = attempt.text()
        except RncError as error:
            first = first or error
            if not any(str(error) in each for each in failures):
                failures.append(f"not '{mobility.kind}', which does not run: {error}")
            continue
        verdict = attempt.trial.verdict
        if best is None or attempt.trial.rank < best[0].rank:
            best = attempt.trial, text, heard
        if verdict.succeeded:
            break
        failures.append(f"not '{mobility.kind}': {verdict.first}")
    if best is not None:
        trial, text, heard = best
        for each in heard:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
        doubts = [str(each) for each in trial.findings if each.severity is not Severity.NOTE]
        if doubts:
            said = f"'{robot.name or source.name}' is drafted, but {'; '.join(doubts)}"
            warnings.warn(f"{said}: CHECK actuators and gains", ModelWarning, stacklevel=2)
        return text
    if asked and isinstance(first, ModelError):
        raise first  # the file cannot have the base that the user asked for
    hint = "lock joints with --lock JOINT, or choose the base with --base"
    raise ConfigurationError(f"no scenario can be drafted for '{robot.name or source.name}': {failures[0]}; {hint}")


def _candidate_bases(
    at_start: RobotAtStart, asked: str | None, source: Source, driven: frozenset[str]
) -> Iterator[_BaseBuilder]:
    """Candidate bases, the most likely first; only one if the user chose the base."""
    shell = find_shell(at_start, driven) if asked in (None, "free") else None
    if shell is not None:
        yield lambda: spherical_base(shell, at_start, driven)
    if asked in (None, "planar"):
        wheels = find_wheels(at_start)
        axles = find_drawn_axles(at_start)
        segments = find_snake(wheels, [] if wheels else axles, at_start, driven)
        if segments:
            yield lambda: snake_base(segments, at_start)
        if wheels:
            yield from _candidate_wheeled_bases(classify_wheels(wheels), at_start, asked, source, driven)
            return
        if axles and not at_start.own_planar_joints:
            yield lambda: knife_edge_base(axles, at_start)
    yield lambda: without_wheels(at_start, asked, source.mass_of_base)
    if asked is None:
        yield lambda: without_wheels(
            at_start, "fixed", source.mass_of_base, "taken to be bolted down, for lack of better"
        )
        yield lambda: fixed_base_with_locked_joints(at_start)


def _candidate_wheeled_bases(
    found: WheelLayout, at_start: RobotAtStart, asked: str | None, source: Source, driven: frozenset[str]
) -> Iterator[_BaseBuilder]:
    if asked is None and balances(found, at_start):
        yield lambda: balancing_base(found, at_start)
    if asked is None and is_bicycle(found):
        yield lambda: bicycle_base(found, at_start)
    if has_rollers(found, at_start):
        yield lambda: omnidirectional_base(found, at_start)
    elif found.fixed and found.is_straight:
        yield lambda: wheeled_base(found, at_start, driven)
        if len(found.steered) > 1:
            yield lambda: wheeled_base(found, at_start, driven, toe=True)
    elif found.fixed and not found.steered:  # disks at right angles that do not carry the base
        yield lambda: without_wheels(at_start, asked, source.mass_of_base)
    why = "every wheel is steered by itself" if found.steered else "all wheels are casters"
    if found.fixed:
        why = "these wheels cannot roll together as they are read"
    yield lambda: force_driven_base(found, at_start, why)
