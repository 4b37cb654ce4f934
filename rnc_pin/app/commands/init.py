"""``rnc-pin init``."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import click

from rnc_pin.app.new_file import check_new_file
from rnc_pin.errors import ConfigurationError
from rnc_pin.io.atomic_write import atomic_file
from rnc_pin.scenario.draft import DraftOptions, draft
from rnc_pin.scenario.files import parse_options


def draft_scenario(
    robot: str,
    out: Path | None,
    base: str | None,
    arguments: tuple[str, ...],
    package_dirs: tuple[Path, ...],
    lock: tuple[str, ...],
    force: bool,
) -> None:
    """Write a draft scenario for a robot."""
    path = out or Path(Path(robot).name.split(".")[0] + ".yaml")
    own = os.path.isfile(path) and path.resolve() == Path(robot).resolve()
    check_new_file("--out", path, force or own)
    wishes = DraftOptions(base, parse_options(arguments), package_dirs, _held(lock))
    text = draft(robot, path.parent, wishes)
    if own:
        raise ConfigurationError(f"--out {path}: is the robot's own file; choose another name")
    try:
        with atomic_file(path, force) as partial:
            partial.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"--out {path}: cannot be written: {error.strerror}") from None
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
