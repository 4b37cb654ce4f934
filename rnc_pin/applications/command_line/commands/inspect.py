"""``rnc-pin inspect``."""

from __future__ import annotations

import shlex
from contextlib import suppress

import click

from rnc_pin.analysis import analyze
from rnc_pin.applications.command_line.messages import print_json, warn
from rnc_pin.applications.command_line.report import print_object
from rnc_pin.applications.init import best_rows, find_uses
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.applications.scenario.plant_builder import start_findings, warnings_of
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import RncError
from rnc_pin.printing import items
from rnc_pin.verdict import Finding


def inspect_system(system: str, options: tuple[str, ...], samples: int, seed: int, as_json: bool) -> None:
    """Print the analysis of a system."""
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
