"""``rnc-pin sweep``."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from rnc_pin.app.messages import complain, print_json
from rnc_pin.app.progress import ProgressBar
from rnc_pin.app.status import DONE, FAILED
from rnc_pin.app.tables import print_sweep_statistics
from rnc_pin.errors import ConfigurationError
from rnc_pin.interruption import interruptible, uninterrupted
from rnc_pin.io.json import dump_json
from rnc_pin.scenario.files import parse_options, plant_option
from rnc_pin.scenario.output_folder import OutputFolder
from rnc_pin.scenario.seeded_sweep import drawn_keys, run_files, run_folders, sweep
from rnc_pin.scenario.sweep_table import Row, sweep_statistics, write_table

_TABLES = 100  # tables written during a sweep, so that an abort loses little


def sweep_scenario(
    scenario: str,
    runs: int,
    jobs: int,
    scheduler: str | None,
    out: Path,
    options: tuple[str, ...],
    plant: str | None,
    as_json: bool,
    force: bool,
) -> int:
    """Run a scenario many times with drawn values, write a table and return the exit status."""
    if jobs == 0:
        raise ConfigurationError("--jobs 0: expected a number of processes, or -1 for all cores")
    parsed = {**plant_option(scenario, plant), **parse_options(options)}
    drawn_keys(scenario, parsed)
    rows: list[Row] = []
    folders, names = run_folders(runs), [*run_files(runs), "sweep.csv", "sweep.json"]
    with uninterrupted(), OutputFolder(out, force, names) as folder:
        interrupted = False
        bar = ProgressBar(Console(stderr=True), runs, f"{scenario} x {runs}", quiet=as_json)
        try:
            with bar as advance, interruptible():
                for row in sweep(scenario, parsed, runs, folder.fresh, jobs, scheduler):
                    with uninterrupted():
                        rows.append(row)
                        if len(rows) % max(1, runs // _TABLES) == 0:
                            with folder.writing() as fresh:
                                write_table(rows, fresh / "sweep.csv")
                            folder.keep_so_far(without=folders[len(rows) :])
                    advance(len(rows))
        except KeyboardInterrupt:
            interrupted = True
        if interrupted and not rows:
            complain("interrupted before the end of the first run")
            return FAILED
        figures = sweep_statistics(rows)
        summary = {"scenario": scenario, **figures}
        with folder.writing() as fresh:
            write_table(rows, fresh / "sweep.csv")
            (fresh / "sweep.json").write_text(dump_json(summary) + "\n", encoding="utf-8")
        folder.keep(without=folders[len(rows) :])
    if as_json:
        print_json(summary)
    else:
        print_sweep_statistics(scenario, figures, folder.path)
    if interrupted:
        complain(f"interrupted after {len(rows)} of {runs} runs; results so far are in {folder.path}")
    return DONE if figures["outcomes"].get("completed", 0) == runs else FAILED
