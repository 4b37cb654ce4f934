"""The command in a process, and its output without its progress."""

import sys

_WITHOUT_PICTURES = """
from rnc_pin.applications.command_line.cli import main
from rnc_pin.applications.command_line import report
from rnc_pin.applications.scenario.execution import Drawn
report.draw_pictures = lambda *_: Drawn()
main()
"""
UNDRAWN = [sys.executable, "-c", _WITHOUT_PICTURES]
"""Command rnc-pin in a process of its own, whose runs draw no pictures: these take longer than a short simulation."""


def results(out: str) -> str:
    """Standard output without the lines that say what a command is doing: those end in dots."""
    return "".join(line for line in out.splitlines(keepends=True) if not line.endswith(" ...\n"))
