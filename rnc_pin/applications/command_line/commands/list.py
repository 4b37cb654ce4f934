"""``rnc-pin list``."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from rnc_pin.applications.command_line.messages import print_json
from rnc_pin.applications.scenario.files import built_in_names, find_scenario, read_yaml


def list_scenarios(as_json: bool) -> None:
    """Print names and titles of the built-in scenarios."""
    titles = {name: read_yaml(find_scenario(name)).get("title") or "" for name in built_in_names()}
    if as_json:
        print_json(titles)
        return
    table = Table(box=None, pad_edge=False)
    table.add_column("scenario", style="bold")
    table.add_column("what it shows")
    for name, title in titles.items():
        table.add_row(name, str(title))
    Console(markup=False, emoji=False).print(table)
