"""``rnc-pin inspect``."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import click

from rnc_pin.analysis import analyze
from rnc_pin.app.analysis_tables import print_report
from rnc_pin.app.limit_states import examine_limits, sentences_of
from rnc_pin.app.messages import print_json, warn
from rnc_pin.app.sentences import sentences
from rnc_pin.errors import RncError
from rnc_pin.scenario.builder import build_reduced, build_task, start_of
from rnc_pin.scenario.files import apply_options, find_scenario, parse_options, read_yaml
from rnc_pin.scenario.loading import validate
from rnc_pin.scenario.start_findings import start_findings, warnings_of
from rnc_pin.verdict import Finding


def inspect_system(
    system: str, options: tuple[str, ...], samples: int, seed: int, details: bool, as_json: bool, run: Path | None
) -> None:
    """Print the analysis of a system."""
    path = find_scenario(system)
    checked = validate(apply_options(read_yaml(path), parse_options(options)), path.name)
    built, reduced = build_reduced(checked, path.parent)
    task = build_task(checked, reduced)
    report = analyze(reduced, task.primary_names, task.redundant_names, samples, seed, task.vertical_names)
    limits = examine_limits(checked, path.parent, run)
    found: tuple[Finding, ...] = ()
    with suppress(RncError):  # a start that cannot be assembled is an error of a run
        found = start_findings(checked, reduced, start_of(checked, reduced)[0])
    for message in warnings_of(found):
        warn(message)
    if not as_json:
        print_report(system, reduced, task, report, details)
        for line in sentences_of(limits):
            click.echo(line)
        return
    content = {
        "system": system,
        "sentences": list(sentences(reduced, report)),
        "robot": built.robot.name,
        "joints": list(built.robot.joint_names),
        "reducing": list(reduced.reducing.names),
        "vertical": list(reduced.vertical.names),
        "actuators": list(reduced.actuation.names),
        "primary": list(task.primary_names),
        "redundant": list(task.redundant_names),
        **report.to_dict(),
        "limit_effects": [asdict(each) for each in limits.effects],
        "limits_not_examined": limits.problem,
        "findings": [each.to_json() for each in found],
    }
    print_json(content)
