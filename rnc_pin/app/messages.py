"""Lines in the terminal: JSON, warnings, and what is wrong."""

from __future__ import annotations

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


def complain(message: str) -> None:
    """Say in one line what is wrong."""
    click.echo(f"rnc-pin: error: {printable(message)}", err=True)


def warn(message: str) -> None:
    """Say in one line what to look out for."""
    click.echo(f"rnc-pin: warning: {printable(message)}", err=True)


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
