"""Live view of the option ``--show``."""

from __future__ import annotations

import click

from rnc_pin.applications.command_line.messages import warn
from rnc_pin.interruption import interruptible
from rnc_pin.simulation import Provenance, RunInfo
from rnc_pin.visualization import DrawnModel, LiveView, View
from rnc_pin.visualization.browser import is_loopback


def live_view(
    model: DrawnModel, view: View, info: RunInfo | Provenance, title: str, speed: float, browser: bool, host: str
) -> LiveView:
    """Serve a live view, print its address, and wait for the browser."""
    if not is_loopback(host):
        warn(f"--host {host}: everyone who can reach this address can watch")
    live = LiveView(model, view, info, speed, browser, host, title)
    click.echo(f"showing on {live.url}", err=True)
    try:
        with interruptible():
            live.wait_for_browser(10.0)
    except BaseException:
        live.close()
        raise
    return live


def close(live: LiveView) -> None:
    """Close a live view; warn if it stopped before the run."""
    live.close()
    if live.problem is not None:
        warn(f"the live view stopped: {type(live.problem).__name__}: {live.problem}")
