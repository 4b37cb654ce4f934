"""End of a run on the terminal: its verdict, and the exit status of the command."""

from __future__ import annotations

from pathlib import Path

from rnc_pin.app.messages import complain, warn
from rnc_pin.app.status import DONE, FAILED
from rnc_pin.scenario.execution import Result
from rnc_pin.scenario.pictures import Drawn
from rnc_pin.verdict import Severity


def report_verdict(result: Result, drawn: Drawn, folder: Path) -> int:
    """Print what degrades a run as warnings, and its first failure as an error. Return the exit status."""
    verdict = result.trajectory.verdict
    for finding in verdict.findings:
        if finding.severity is not Severity.NOTE and finding not in verdict.failures:
            warn(str(finding))
    if verdict.failures:
        more = len(verdict.failures) - 1
        others = f", and {more} more in summary.json" if more else ""
        complain(f"{verdict.failures[0]}{others}; results so far are in {folder}")
        return FAILED
    if result.interrupted or drawn.interrupted:
        complain(f"interrupted; results so far are in {folder}")
        return FAILED
    return DONE
