"""Terminal output: JSON, progress lines, warnings and errors; and exit statuses."""

from __future__ import annotations

import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click

from rnc_pin.errors import ModelWarning, printable
from rnc_pin.io import dump_json

DONE, FAILED, USAGE = 0, 1, 2
_MINUTE = 60.0  # between the lines of a log [s]


def print_json(content: object) -> None:
    """Print JSON on standard output.

    Args:
        content: JSON content.
    """
    click.echo(dump_json(content))


def announce(text: str, quiet: bool = False) -> None:
    """Print the current activity before a long operation: on stderr if it is a terminal, else on stdout.

    Args:
        text: the activity.
        quiet: print nothing on stdout, because a program reads the results.
    """
    # A terminal shows both streams; in a pipe, a program reads one of them.
    if sys.stderr.isatty():
        click.echo(f"{printable(text)} ...", err=True)
    elif not quiet:
        click.echo(f"{printable(text)} ...")


@contextmanager
def told_each_minute(activity: Callable[[], str], quiet: bool) -> Iterator[None]:
    """Print the activity each minute inside, if the output is a log and no terminal.

    Args:
        activity: function that returns the present activity.
        quiet: True to print nothing.
    """
    over = threading.Event()

    def tell() -> None:
        begin = time.perf_counter()
        while not over.wait(_MINUTE):
            announce(f"{activity()}, {(time.perf_counter() - begin) / 60:.0f} min", quiet)

    if not (quiet or sys.stderr.isatty()):
        # A daemon: a command that fails does not wait for the next minute.
        threading.Thread(target=tell, daemon=True).start()
    try:
        yield
    finally:
        over.set()


def seconds_since_start() -> float:
    """Return the wall time since the start of the command [s]."""
    # Since before the imports, for which a user waits too.
    return time.perf_counter() - float(click.get_current_context().find_root().obj)


def complain(message: str) -> None:
    """Print an error in one line.

    Args:
        message: the error.
    """
    # Messages quote files and pages: control characters could write anywhere on the terminal.
    click.echo(f"rnc-pin: error: {printable(message)}", err=True)


def warn(message: str) -> None:
    """Print a warning in one line.

    Args:
        message: the warning.
    """
    click.echo(f"rnc-pin: warning: {printable(message)}", err=True)


@contextmanager
def told_warnings() -> Iterator[None]:
    """Print each ``ModelWarning`` once and in one line."""
    told: set[str] = set()
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def tell(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if not issubclass(category, ModelWarning):
                usual(message, category, *place, **more)
            elif str(message) not in told:
                told.add(str(message))
                warn(str(message))

        # Python counts the place of a warning, and one place warns of many joints: here the text counts.
        warnings.simplefilter("always", ModelWarning)
        warnings.showwarning = tell
        yield
