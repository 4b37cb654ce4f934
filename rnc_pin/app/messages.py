"""Lines in the terminal: JSON, warnings, and what is wrong."""

from __future__ import annotations

import re
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

import click

from rnc_pin.errors import ModelWarning, printable
from rnc_pin.plain import json_text


def print_json(content: object) -> None:
    """Print JSON on standard output."""
    click.echo(json_text(content))


_SPELLINGS = (
    (re.compile(r"\bbase='(\w+)'( or '(\w+)')?"), r"--base \1\2 (in a scenario: robot: {base: \1})"),
    (re.compile(r"\b(lock|masses)=(\{[^{}]*\})"), r"robot: {\1: \2} in the scenario"),
    (re.compile(r"\bmimic=False\b"), "mimic: false"),
    (re.compile(r"\bsnap=False\b"), "robot: {snap: false}"),
)
"""Arguments in Python, as remedies in errors have them, and how options and scenario files spell them."""


def announce(text: str, quiet: bool = False) -> None:
    """Say what is being done, before it takes its time: on the terminal, or among the results where there is none.

    Args:
        text: what is being done.
        quiet: whether the results are for a program to read.
    """
    if sys.stderr.isatty():
        click.echo(f"{printable(text)} ...", err=True)
    elif not quiet:
        click.echo(f"{printable(text)} ...")


def elapsed_time() -> float:
    """Wall time since the command began [s]."""
    return time.perf_counter() - float(click.get_current_context().find_root().obj)


def complain(message: str) -> None:
    """Say in one line what is wrong."""
    click.echo(f"rnc-pin: error: {printable(_as_typed(message))}", err=True)


def warn(message: str) -> None:
    """Say in one line what to look out for."""
    click.echo(f"rnc-pin: warning: {printable(_as_typed(message))}", err=True)


def _as_typed(message: str) -> str:
    """A message with remedies as options of the command line, or as a scenario file says them."""
    for python, typed in _SPELLINGS:
        message = python.sub(typed, message)
    return message


@contextmanager
def told_warnings() -> Iterator[None]:
    """Say what a robot's file left open, once and in one line."""
    told: set[str] = set()
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def tell(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if not issubclass(category, ModelWarning):
                usual(message, category, filename, lineno, file, line)
            elif str(message) not in told:
                told.add(str(message))
                warn(str(message))

        warnings.simplefilter("always", ModelWarning)
        warnings.showwarning = tell
        yield
