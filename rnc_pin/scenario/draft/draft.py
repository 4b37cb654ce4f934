"""Draft of a scenario: base, wheels, actuators, outputs, a slow reference and a controller."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from rnc_pin.errors import ConfigurationError, ModelError, ModelWarning, RncError
from rnc_pin.scenario.draft.attempt import Attempt
from rnc_pin.scenario.draft.balancing import balances, is_bicycle, on_a_bicycle, on_two_wheels
from rnc_pin.scenario.draft.ball import find_shell, in_a_shell
from rnc_pin.scenario.draft.chassis import Chassis, chassis
from rnc_pin.scenario.draft.drawn_axles import find_drawn_axles
from rnc_pin.scenario.draft.joints import start_values
from rnc_pin.scenario.draft.mobility import Mobility
from rnc_pin.scenario.draft.on_rollers import has_rollers, in_any_direction, on_rollers
from rnc_pin.scenario.draft.on_wheels import on_drawn_axles, on_wheels
from rnc_pin.scenario.draft.site import Site
from rnc_pin.scenario.draft.snake import find_snake, on_a_snake
from rnc_pin.scenario.draft.source import Source, Wishes
from rnc_pin.scenario.draft.trial import FAR, LOST, Trial
from rnc_pin.scenario.draft.wheels import find_wheels
from rnc_pin.scenario.draft.without_wheels import held_fast, without_wheels

_Way = Callable[[], Mobility]


def draft(source: str, folder: Path, wishes: Wishes | None = None) -> str:
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
        text = _drafted(Source(source, folder, wishes or Wishes()), folder, (wishes or Wishes()).base)
    for message in dict.fromkeys(str(each.message) for each in said if issubclass(each.category, ModelWarning)):
        warnings.warn(message, ModelWarning, stacklevel=2)
    return text


def _drafted(source: Source, folder: Path, asked: str | None) -> str:
    robot, is_rigid = source.lying()
    source.remember_packages(robot)
    site = Site(robot, start_values(robot), source.words(), "mjcf" not in source.entry, is_rigid)
    failures: list[str] = []
    first: RncError | None = None
    best: tuple[Trial, str] | None = None
    for way in _ways(site, asked, source, source.driven()):
        mobility = way()
        if site.loose:
            mobility.lock.update(site.loose)
            mobility.notes.append(f"locked, because nothing drives them: {', '.join(site.loose)}")
        try:
            attempt = Attempt(mobility, source, site.start, folder)
            mobility.notes += source.remarks + failures
            text = attempt.text()
        except RncError as error:
            first = first or error
            if not any(str(error) in each for each in failures):
                failures.append(f"not '{mobility.kind}', which does not run: {error}")
            continue
        if best is None or attempt.trial.share < best[0].share:
            best = attempt.trial, text
        if attempt.trial.share < LOST:
            break
        failures.append(f"not '{mobility.kind}': its run {attempt.trial.complaint}")
    if best is not None:
        trial, text = best
        if trial.share >= FAR:
            said = f"'{robot.name or source.name}' is drafted, but its run {trial.complaint}"
            warnings.warn(f"{said}: CHECK actuators and gains", ModelWarning, stacklevel=2)
        return text
    if asked and isinstance(first, ModelError):
        raise first  # the file cannot have the base that the user asked for
    hint = "lock joints with --lock JOINT, or choose the base with --base"
    raise ConfigurationError(f"no scenario can be drafted for '{robot.name or source.name}': {failures[0]}; {hint}")


def _ways(site: Site, asked: str | None, source: Source, driven: frozenset[str]) -> Iterator[_Way]:
    """Candidate bases, the most likely first; only one if the user chose the base."""
    shell = find_shell(site, driven) if asked in (None, "free") else None
    if shell is not None:
        yield lambda: in_a_shell(shell, site, driven)
    if asked in (None, "planar"):
        wheels = find_wheels(site)
        axles = find_drawn_axles(site)
        segments = find_snake(wheels, [] if wheels else axles, site, driven)
        if segments:
            yield lambda: on_a_snake(segments, site)
        if wheels:
            yield from _ways_on_wheels(chassis(wheels), site, asked, source, driven)
            return
        if axles and not site.own_base:
            yield lambda: on_drawn_axles(axles, site)
    yield lambda: without_wheels(site, asked, source.mass_of_base)
    if asked is None:
        yield lambda: without_wheels(site, "fixed", source.mass_of_base, "taken to be bolted down, for lack of better")
        yield lambda: held_fast(site)


def _ways_on_wheels(
    found: Chassis, site: Site, asked: str | None, source: Source, driven: frozenset[str]
) -> Iterator[_Way]:
    if asked is None and balances(found, site):
        yield lambda: on_two_wheels(found, site)
    if asked is None and is_bicycle(found):
        yield lambda: on_a_bicycle(found, site)
    if has_rollers(found, site):
        yield lambda: on_rollers(found, site)
    elif found.fixed and found.is_straight:
        yield lambda: on_wheels(found, site, driven)
    elif found.fixed and not found.steered:  # disks at right angles that do not carry the base
        yield lambda: without_wheels(site, asked, source.mass_of_base)
    why = "every wheel is steered by itself" if found.steered else "all wheels are casters"
    if found.fixed:
        why = "these wheels cannot roll together as they are read"
    yield lambda: in_any_direction(found, site, why)
