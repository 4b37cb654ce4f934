"""Compare everything, print it, and write ``docs/data/validation.json`` and the pictures of its page.

Run ``python -m benchmarks.validation``; ``--check`` writes nothing. Exit status 1 if a row leaves its tolerance.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.validation import PROBLEMS, pictures
from benchmarks.validation.row import Row
from tools import tables

DOCS = Path(__file__).parents[2] / "docs"


def shown(values: np.ndarray, where: tuple[int, ...]) -> str:
    """The entry at ``where`` with all the digits it has."""
    entry = values[where]
    if np.iscomplexobj(values):
        return f"{entry.real:.12g} {'-' if entry.imag < 0 else '+'} {abs(entry.imag):.12g}i"
    return f"{entry:.15g}"


def cells(row: Row) -> tuple[str, str, str, str, str, str]:
    """Source, quantity, published, ours, difference, tolerance; of an array the entry that differs most."""
    published, ours = np.asarray(row.published), np.asarray(row.ours)
    where = np.unravel_index(int(np.argmax(np.abs(ours - published))), published.shape)
    index = f" ({', '.join(str(k) for k in where)})" if where else ""
    found = shown(ours, where) if row.scale is None else f"{float(ours):.1e}"
    known = row.source, row.quantity + index, shown(published, where)
    return *known, found, f"{row.difference:.1e}", f"{row.tolerance:.0e}"


HEADER = ("source", "quantity", "published", "rnc_pin", "difference", "tolerance")


def main(write: bool) -> int:
    """All problems in turn; how many rows leave their tolerance."""
    console, failures = Console(), 0
    written: dict[str, list[tables.Row]] = {}
    for name, rows_of in PROBLEMS.items():
        rows: list[Row] = rows_of()
        table = Table(title=name, title_justify="left")
        for column in HEADER:
            table.add_column(column, justify="left" if column in HEADER[:2] else "right", overflow="fold")
        for row in rows:
            table.add_row(*cells(row), style=None if row.holds else "bold red")
            failures += not row.holds
        console.print(table)
        written[name] = [dict(zip(HEADER, cells(row), strict=True)) for row in rows]
    if write:
        tables.write("validation", written)
        pictures.make(DOCS / "images")
    return failures


if __name__ == "__main__":
    sys.exit(1 if main(write="--check" not in sys.argv[1:]) else 0)
