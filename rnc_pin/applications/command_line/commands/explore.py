"""``rnc-pin explore``."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from rnc_pin.applications.command_line.messages import FAILED, print_json, warn
from rnc_pin.applications.init import best_rows, find_uses, scenario_of
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.applications.scenario.output_folder import check_new_file, one_line_errors
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import atomic_file

_MOST = 18  # rows of the table


def explore_system(
    system: str, options: tuple[str, ...], primary: str | None, as_json: bool, write: Path | None, row: int | None
) -> int | None:
    """Print what the redundancy of a robot can do, and write the scenario of one use."""
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
    made, verdict = scenario_of(scenario, found[(row or 1) - 1])
    with one_line_errors(f"--write {write}"), atomic_file(write, replace=False) as partial:
        made.save(partial)
    if not verdict.succeeded:
        warn(f"the run of {write} fails: {verdict.first}")
        return FAILED
    click.echo(f"wrote {write}, whose run succeeded: rnc-pin run {shlex.quote(str(write))}", err=as_json)
    return None
