"""``rnc-pin export``."""

from __future__ import annotations

import os
from pathlib import Path

import click

from rnc_pin.applications.scenario.output_folder import check_new_file
from rnc_pin.errors import ConfigurationError
from rnc_pin.simulation import Trajectory, export_run


def export_file(source: Path, file: Path, arrays: tuple[str, ...], force: bool) -> None:
    """Write the arrays of a run for other programs."""
    check_new_file("FILE", file, force)
    run = Trajectory.load(source / "trajectory.npz" if os.path.isdir(source) else source)
    try:
        written = export_run(run, file, arrays or None, force)
    except OSError as error:
        raise ConfigurationError(f"{error.filename}: cannot be written: {error.strerror}") from None
    click.echo(f"wrote {written}")
