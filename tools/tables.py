"""Tables that commands measure and pages show: rows in ``docs/data``, a mapping from heading to cell each."""

from __future__ import annotations

import json
from pathlib import Path

DATA = Path(__file__).parents[1] / "docs" / "data"

Row = dict[str, str]


def read(name: str) -> dict[str, list[Row]]:
    """Return the tables of a file ``docs/data/NAME.json``, by name."""
    return json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))


def write(name: str, tables: dict[str, list[Row]]) -> None:
    """Write the tables of a file, a row in a line."""
    parts = [
        f" {json.dumps(key)}: [\n" + ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in rows) + "\n ]"
        for key, rows in tables.items()
    ]
    (DATA / f"{name}.json").write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")


def markdown(rows: list[Row]) -> str:
    """Return a table in Markdown; its head is that of the first row."""
    head = list(rows[0])
    lines = [head, ["---"] * len(head), *([row[key] for key in head] for row in rows)]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
