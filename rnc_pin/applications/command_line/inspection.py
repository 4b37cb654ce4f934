"""Commands about a robot or a system: ``rnc-pin init``, ``inspect`` and ``explore``, and ``schema`` for editors."""

from __future__ import annotations

import json
import os
import shlex
from contextlib import suppress
from pathlib import Path
from typing import TypedDict, Unpack

import click

from rnc_pin.analysis import analyze
from rnc_pin.applications.command_line.messages import FAILED, print_json, warn
from rnc_pin.applications.command_line.report import print_object
from rnc_pin.applications.init import DraftOptions, best_rows, draft_with_decisions, find_uses, scenario_of
from rnc_pin.applications.scenario.builder import start_findings, warnings_of
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.applications.scenario.output_folder import check_new_file, one_line_errors
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import schema
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.io import atomic_file
from rnc_pin.printing import items
from rnc_pin.verdict import Finding


class Stated(TypedDict):
    """Choices of a ``DraftOptions`` that need no reading."""

    base: str | None
    package_dirs: tuple[Path, ...]
    driven: tuple[str, ...]
    passive: tuple[str, ...]
    balance: bool | None
    rollers: bool | None


def draft_scenario(
    robot: str,
    out: Path | None,
    arguments: tuple[str, ...],
    lock: tuple[str, ...],
    force: bool,
    **stated: Unpack[Stated],
) -> None:
    """Write a draft scenario for a robot, and print what the file leaves open.

    Args:
        robot: file or name of a robot.
        out: file to write; ROBOT.yaml if it is None.
        arguments: arguments of a xacro file in the form ``a=b``.
        lock: joints to lock: ``JOINT`` or ``JOINT=VALUE``.
        force: True to replace an existing file.
        **stated: choices of the user.
    """
    path = out or Path(Path(robot).name.split(".")[0] + ".yaml")
    own = os.path.isfile(path) and path.resolve() == Path(robot).resolve()
    check_new_file("--out", path, force or own)
    wishes = DraftOptions(xacro_arguments=parse_options(arguments), lock=_held(lock), **stated)
    found = draft_with_decisions(robot, path.parent, wishes)
    for question in found.questions:
        click.echo(f"rnc-pin: question: {question}", err=True)
    if own:
        raise ConfigurationError(f"--out {path}: is the robot's own file; choose another name")
    # Whole or not at all, also if the disk is full.
    with one_line_errors(f"--out {path}"), atomic_file(path, force) as partial:
        partial.write_text(found.text, encoding="utf-8")
    # The commands can be copied, whatever the path is.
    quoted = shlex.quote(str(path))
    click.echo(f"wrote {path}: read it, then try: rnc-pin inspect {quoted}; rnc-pin run {quoted}")


def _held(lock: tuple[str, ...]) -> dict[str, float]:
    """Parse the joints to lock: ``JOINT`` at zero, or ``JOINT=VALUE``."""
    held: dict[str, float] = {}
    for each in lock:
        joint, _, value = each.partition("=")
        try:
            held[joint] = float(value or 0.0)
        except ValueError:
            raise ConfigurationError(f"--lock {each}: expected JOINT or JOINT=NUMBER [rad or m]") from None
    return held


def print_schema() -> None:
    """Print the JSON Schema of scenario files."""
    click.echo(json.dumps(schema(), indent=2, ensure_ascii=False))


def inspect_system(system: str, options: tuple[str, ...], samples: int, seed: int, as_json: bool) -> None:
    """Print the analysis of a system.

    Args:
        system: a built-in name or a file.
        options: options in the form ``a.b=c``.
        samples: number of sampled configurations.
        seed: random seed of the samples.
        as_json: True to print JSON.
    """
    scenario = Scenario.load(system, parse_options(options))
    reduced, task = scenario.model.reduced, scenario.task
    report = analyze(reduced, task.primary_names, task.redundant_names, samples, seed, task.vertical_names)
    found: tuple[Finding, ...] = ()
    with suppress(RncError):  # a start that cannot be assembled is an error of a run
        found = start_findings(scenario.content, reduced, scenario.q0)
    for message in warnings_of(found):
        warn(message)
    if not as_json:
        names = {
            "primary motions": task.primary_names,
            "redundant motions": task.redundant_names,
            "actuators": reduced.actuation.names,
        }
        lines = [(label, items(listed or ["none"])) for label, listed in names.items()]
        print_object(report, f"{system} ({reduced.robot.name})", lines)
        uses, _ = find_uses(scenario)
        # The best three: the analysis fits on a page, and ``explore`` has all.
        for k in best_rows(uses, 3):
            click.echo(uses[k].title)
        click.echo(f"more: rnc-pin explore {shlex.quote(system)}")
        return
    print_json(
        {
            "system": system,
            "robot": reduced.robot.name,
            "joints": list(reduced.robot.joint_names),
            "reducing": list(reduced.reducing.names),
            "vertical": list(reduced.vertical.names),
            "actuators": list(reduced.actuation.names),
            "primary": list(task.primary_names),
            "redundant": list(task.redundant_names),
            **report.to_dict(),
            "findings": [each.to_json() for each in found],
        }
    )


_MOST = 18  # rows of the table


def explore_system(
    system: str, options: tuple[str, ...], primary: str | None, as_json: bool, write: Path | None, row: int | None
) -> int | None:
    """Print what the redundancy of a robot can do, and write the scenario of one use.

    Args:
        system: a built-in name or a file.
        options: options in the form ``a.b=c``.
        primary: names of primary outputs, with commas; None for those of the scenario.
        as_json: True to print JSON.
        write: file for the scenario of a row.
        row: number of that row; the best one if it is None.
    """
    # First: a search of minutes should not end at a file that exists.
    if write is not None:
        check_new_file("--write", write, force=False)
    scenario = Scenario.load(system, parse_options(options))
    found, failures = find_uses(scenario, [name.strip() for name in primary.split(",")] if primary else [])
    shown = best_rows(found, _MOST)
    if as_json:
        rows = [
            {"row": k + 1, "primary": each.exploration.primary, **each.use.to_dict()} for k, each in enumerate(found)
        ]
        print_json({"system": system, "rows": rows, "failures": failures})
    else:
        for k in shown:
            click.echo(f"{k + 1:3d}  {found[k].title}")
        hidden = len(found) - len(shown)
        for line in [*([f"{hidden} more: --json"] if hidden else []), *failures][: _MOST + 2 - len(shown)]:
            click.echo(line)
    if write is None:
        return None
    if not 1 <= (row or 1) <= len(found):
        raise ConfigurationError(f"--row {row or 1}: expected a row from 1 to {len(found)}")
    # A row is a use of the redundancy at samples; whether a run of it succeeds, only a run shows.
    made, verdict = scenario_of(found[(row or 1) - 1])
    with one_line_errors(f"--write {write}"), atomic_file(write, replace=False) as partial:
        made.save(partial)
    if not verdict.succeeded:
        warn(f"the run of {write} fails: {verdict.first}")
        return FAILED
    # Beside JSON on the other stream: a program reads standard output.
    click.echo(f"wrote {write}, whose run succeeded: rnc-pin run {shlex.quote(str(write))}", err=as_json)
    return None
