"""End of a run on the terminal: its verdict, and the exit status of the command."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from rnc_pin.applications.command_line.messages import complain, warn
from rnc_pin.applications.command_line.termination import DONE, FAILED
from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.pictures import Drawn
from rnc_pin.verdict import Severity, Verdict


def report_findings(verdict: Verdict, ending: str, others: str = "", told: Collection[str] = ()) -> int:
    """Print what degrades a run as warnings, and its first failure as an error. Return the exit status.

    Args:
        verdict: verdict of the run.
        ending: end of the error, such as where the results are.
        others: where the other failures are.
        told: warnings that were printed before.
    """
    for finding in verdict.findings:
        if finding.severity is not Severity.NOTE and finding not in verdict.failures and str(finding) not in told:
            warn(str(finding))
    if not verdict.failures:
        return DONE
    more = len(verdict.failures) - 1
    complain(f"{verdict.failures[0]}{f', and {more} more{others}' if more else ''}; {ending}")
    return FAILED


def report_verdict(result: Result, drawn: Drawn, folder: Path, told: Collection[str]) -> int:
    """Print the findings of a run that wrote a folder, and whether it was interrupted. Return the exit status.

    Args:
        result: the run.
        drawn: its pictures.
        folder: its folder.
        told: warnings that were printed before.
    """
    where = f"results so far are in {folder}"
    if report_findings(result.trajectory.verdict, where, " in summary.json", told) == FAILED:
        return FAILED
    if result.interrupted or drawn.interrupted:
        complain(f"interrupted; results so far are in {folder}")
        return FAILED
    return DONE
