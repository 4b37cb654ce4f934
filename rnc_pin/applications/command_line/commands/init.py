"""``rnc-pin init``, and ``rnc-pin schema`` for editors of what it writes."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TypedDict, Unpack

import click

from rnc_pin.applications.init import DraftOptions, draft_with_decisions
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.applications.scenario.output_folder import check_new_file, one_line_errors
from rnc_pin.applications.scenario.schema.scenario import schema_text
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import atomic_file


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
    """Write a draft scenario for a robot, and print what the file leaves open."""
    path = out or Path(Path(robot).name.split(".")[0] + ".yaml")
    own = os.path.isfile(path) and path.resolve() == Path(robot).resolve()
    check_new_file("--out", path, force or own)
    xacro = parse_options(arguments)
    wishes = DraftOptions(xacro_arguments=xacro, lock=_held(lock), **stated)
    found = draft_with_decisions(robot, path.parent, wishes)
    for question in found.questions:
        click.echo(f"rnc-pin: question: {question}", err=True)
    if own:
        raise ConfigurationError(f"--out {path}: is the robot's own file; choose another name")
    with one_line_errors(f"--out {path}"), atomic_file(path, force) as partial:
        partial.write_text(found.text, encoding="utf-8")
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
    click.echo(schema_text(), nl=False)
