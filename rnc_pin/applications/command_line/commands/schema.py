"""``rnc-pin schema``."""

from __future__ import annotations

import click

from rnc_pin.applications.scenario.loading import schema_text


def print_schema() -> None:
    """Print the JSON Schema of scenario files."""
    click.echo(schema_text(), nl=False)
