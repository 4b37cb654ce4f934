"""``rnc-pin sweep``."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import click

from rnc_pin.applications.command_line.messages import DONE, FAILED, complain, print_json
from rnc_pin.applications.command_line.report import print_object, progress_bar
from rnc_pin.applications.scenario.files import parse_options
from rnc_pin.applications.sweep import sweep
from rnc_pin.applications.sweep.results import SUCCESSFUL, failure_lines, sweep_statistics
from rnc_pin.errors import SimulationError

_SHOWN = 5  # failures on the terminal


def sweep_scenario(
    scenario: str, runs: int, out: Path, options: tuple[str, ...], jobs: int | str, as_json: bool, force: bool
) -> int:
    """Run a scenario many times with drawn values, write a data set and return the exit status.

    Args:
        scenario: a built-in name or a file.
        runs: number of runs.
        out: folder of the results.
        options: options in the form ``a.b=c``.
        jobs: number of processes, or the address of a Dask scheduler.
        as_json: True to print JSON.
        force: True to replace another sweep.
    """
    chosen = parse_options(options)
    reached = 0
    try:
        # A sweep that continues has runs already: the estimate of the time counts only its own.
        with progress_bar(runs, f"{scenario} x {runs}", as_json, restarts=True) as advance:

            def progress(done: int, total: int | None) -> None:
                nonlocal reached
                reached = done
                advance(done, f"{scenario}: {done} of {runs} runs")

            results = sweep(scenario, runs, out=out, options=chosen, jobs=jobs, progress=progress, force=force)
    except KeyboardInterrupt:
        complain(f"interrupted after {reached} of {runs} runs, which are in {out}; the same command continues")
        return FAILED
    # A worker has died: the input is right, so the status is 1 and not 2.
    except SimulationError as error:
        complain(str(error))
        return FAILED
    figures = sweep_statistics(results)
    succeeded = sum(figures["verdicts"].get(word, 0) for word in SUCCESSFUL)
    if as_json:
        print_json({"scenario": results.specification["scenario"], **figures})
    else:
        print_object(results, f"{scenario}: {len(results)} runs")
        click.echo(f"in {out}: runs.jsonl, sweep.json")
        for row in islice(results.failures(), _SHOWN):
            click.echo("\n".join(failure_lines(results, row)))
        if runs - succeeded > _SHOWN:
            click.echo(f"# and {runs - succeeded - _SHOWN} more in {results.path / 'failures.txt'}")
    return DONE if succeeded == runs else FAILED
