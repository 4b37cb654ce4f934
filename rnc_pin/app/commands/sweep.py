"""``rnc-pin sweep``."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from rnc_pin.app.messages import print_json
from rnc_pin.app.progress import ProgressBar
from rnc_pin.app.status import DONE, FAILED
from rnc_pin.app.tables import print_spread
from rnc_pin.errors import ConfigurationError
from rnc_pin.scenario.files import parse_options
from rnc_pin.scenario.output import OutputFolder
from rnc_pin.scenario.sweep import drawn_keys, run_names, sweep
from rnc_pin.scenario.sweep_table import Row, spread, write_table


def sweep_scenario(
    scenario: str,
    runs: int,
    jobs: int,
    scheduler: str | None,
    out: Path,
    options: tuple[str, ...],
    as_json: bool,
    force: bool,
) -> int:
    """Run a scenario many times with drawn values and write a table; the exit status."""
    if jobs == 0:
        raise ConfigurationError("--jobs 0: expected a number of processes, or -1 for all cores")
    parsed = parse_options(options)
    drawn_keys(scenario, parsed)
    rows: list[Row] = []
    names = [*run_names(runs), "sweep.csv", "sweep.json"]
    bar = ProgressBar(Console(stderr=True), runs, f"{scenario} x {runs}", quiet=as_json)
    with OutputFolder(out, force, names) as folder:
        with bar as advance:
            for row in sweep(scenario, parsed, runs, folder, jobs, scheduler):
                rows.append(row)
                advance(len(rows))
        write_table(rows, folder.file("sweep.csv"))
        figures = spread(rows)
        summary = {"scenario": scenario, **figures}
        folder.write_json("sweep.json", summary)
        folder.keep()
    if as_json:
        print_json(summary)
    else:
        print_spread(scenario, figures, folder.path)
    return DONE if figures["outcomes"].get("completed", 0) == runs else FAILED
