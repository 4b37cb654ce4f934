"""Finished runs of a sweep on disk, such that a kill loses none of them.

Runs with consecutive numbers form a block. Each finished run adds a line to the journal of its block; when the block is
complete, it is written as one Parquet file and its journal is deleted. Memory holds only the numbers of runs in open
blocks.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from itertools import groupby
from pathlib import Path

from rnc_pin.applications.sweep.row_tables import plain_rows, read_part, schema_of, table_of, write_part
from rnc_pin.applications.sweep.swept_run import Row
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import TEMPORARY_PREFIX

BLOCK = 5000
"""Runs of a block."""
_PART, _JOURNAL = re.compile(r"part_(\d{7,})\.parquet"), re.compile(r"journal_(\d{7,})\.jsonl")


def part_file(folder: Path, block: int) -> Path:
    """Parquet file of a block."""
    return folder / f"part_{block:07d}.parquet"


def journal_file(folder: Path, block: int) -> Path:
    """Journal of a block."""
    return folder / f"journal_{block:07d}.jsonl"


def blocks_of(folder: Path) -> tuple[set[int], set[int]]:
    """Blocks with a Parquet file, and blocks with a journal."""
    found: tuple[set[int], set[int]] = (set(), set())
    for path in folder.iterdir() if folder.is_dir() else ():
        for blocks, pattern in zip(found, (_PART, _JOURNAL), strict=True):
            match = pattern.fullmatch(path.name)
            if match is not None:
                blocks.add(int(match[1]))
    return found


def journal_rows(folder: Path, block: int) -> list[Row]:
    """Rows of a journal in order. A line that a kill cut off is left out.

    Raises:
        ConfigurationError: the journal cannot be read.
    """
    path = journal_file(folder, block)
    try:
        lines = path.read_bytes().split(b"\n")[:-1]  # what follows the last line break was cut off
        rows = {row["run"]: row for row in map(json.loads, lines)}
    except FileNotFoundError:
        return []
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from None
    return [rows[run] for run in sorted(rows)]


def block_rows(folder: Path, block: int) -> list[Row]:
    """Rows of a block in order, from its Parquet file and its journal."""
    path = part_file(folder, block)
    rows = {row["run"]: row for row in plain_rows(read_part(path))} if path.exists() else {}
    rows |= {row["run"]: row for row in journal_rows(folder, block)}
    return [rows[run] for run in sorted(rows)]


class RunStore:
    """Finished runs of a sweep in a folder, which it may complete.

    Args:
        folder: folder of the Parquet files.
        kinds: kinds of drawn values.
    """

    def __init__(self, folder: Path, kinds: Mapping[str, str]) -> None:
        self._folder, self.kinds = folder, dict(kinds)
        self._complete: set[int] = set()
        self._open: dict[int, set[int]] = {}
        self._unsealed: set[int] = set()  # open blocks with a journal
        folder.mkdir(parents=True, exist_ok=True)
        for leftover in folder.glob(f"{TEMPORARY_PREFIX}*"):
            leftover.unlink()
        parts, journals = blocks_of(folder)
        for block in parts:
            if schema_of(part_file(folder, block))[1] == BLOCK:
                self._complete.add(block)
                journal_file(folder, block).unlink(missing_ok=True)
            else:
                self._open[block] = set(read_part(part_file(folder, block), ["run"])["run"].to_pylist())
        for block in journals - self._complete:
            self._repair(block)
            self._open.setdefault(block, set()).update(row["run"] for row in journal_rows(folder, block))
            self._unsealed.add(block)
            self._seal_if_complete(block)

    def _repair(self, block: int) -> None:
        """Cut off an incomplete line, so that the next one begins on a line of its own."""
        with journal_file(self._folder, block).open("r+b") as file:
            content = file.read()
            file.truncate(content.rfind(b"\n") + 1)

    def __len__(self) -> int:
        return BLOCK * len(self._complete) + sum(map(len, self._open.values()))

    def __contains__(self, run: int) -> bool:
        return run // BLOCK in self._complete or run in self._open.get(run // BLOCK, ())

    def last(self) -> int:
        """Largest number of a finished run; -1 without any."""
        ends = [BLOCK * (block + 1) - 1 for block in self._complete]
        return max([*ends, *(run for runs in self._open.values() for run in runs)], default=-1)

    def add(self, rows: Iterable[Row]) -> None:
        """Record finished runs."""
        for block, group in groupby(rows, key=lambda row: int(row["run"]) // BLOCK):
            some = list(group)
            text = "".join(f"{json.dumps(row)}\n" for row in some)
            with journal_file(self._folder, block).open("a", encoding="utf-8") as file:
                file.write(text)
            self._open.setdefault(block, set()).update(row["run"] for row in some)
            self._unsealed.add(block)
            self._seal_if_complete(block)

    def finish(self) -> None:
        """Write the open blocks as Parquet files too: there are no further runs."""
        for block in sorted(self._unsealed):
            self._seal(block)

    def _seal_if_complete(self, block: int) -> None:
        if len(self._open[block]) == BLOCK:
            self._seal(block)
            self._complete.add(block)
            del self._open[block]

    def _seal(self, block: int) -> None:
        write_part(table_of(block_rows(self._folder, block), self.kinds), part_file(self._folder, block))
        journal_file(self._folder, block).unlink(missing_ok=True)
        self._unsealed.discard(block)
