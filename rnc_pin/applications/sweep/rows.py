"""Rows of a sweep: the values of a run and its results, and their Arrow tables with types and files."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, cast

from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.io import Json, atomic_file
from rnc_pin.simulation import Summary, Trajectory

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

Draw: TypeAlias = Mapping[str, object]
"""Values of a run by name; in sweeps of a scenario, options by dotted key."""

Row: TypeAlias = dict[str, Any]
"""One run of a sweep: number, drawn values and results by column."""

ERRORS = ("final_error", "max_error", "rms_error")
"""Results by output; a column has the name of the output behind a point."""
LIMITS = "limit_excess"
"""Largest excess over joint limits, as a share of their range; a column has the kind of the limit behind a point."""
_MEASURED = (
    "min_singular_value", "constraint_residual_max", "position_residual_max", "energy_drift", "off_tracking_max",
)  # fmt: skip
RESULTS = {
    **dict.fromkeys(("outcome", "verdict", "finding", "message", "warnings"), "text"),
    "redrawn": "integer",
    **dict.fromkeys(("duration", *_MEASURED, "lowest_normal_force"), "number"),
    **dict.fromkeys(("smallest_distance", "smallest_own_distance", "wall_time"), "number"),
    "goals_missed": "integer",
}
"""Kinds of the other columns of results, by name."""


Numbered: TypeAlias = tuple[int, Draw | None]
"""Number of a run, and its given values; None draws them by the number of the run."""


class Runs(Protocol):
    """Source of the rows of a sweep. It is pickled, and what it keeps between runs is not."""

    def rows(self, batch: Sequence[Numbered]) -> list[Row]:
        """Simulate a batch of runs and return their rows, none of which depends on the others."""
        ...


def is_result_column(column: str) -> bool:
    """True for columns of results; False for drawn values."""
    return column == "run" or column in RESULTS or column.partition(".")[0] in (*ERRORS, LIMITS)


def results_of(summary: Summary) -> Row:
    """Columns of results from the summary of a run."""
    found, lift_off, nearest = cast("Row", summary), summary["lift_off"], summary.get("smallest_distance")
    first = summary.get("first_finding", {"kind": "", "message": ""})
    return {
        "outcome": summary["outcome"],
        "verdict": summary["verdict"],
        "finding": first["kind"],
        "message": first["message"],
        "duration": summary["duration"],
        **{f"{kind}.{name}": value for kind in ERRORS for name, value in found[kind].items()},
        **{name: found[name] for name in _MEASURED if name in found},
        "goals_missed": len(summary.get("goals_missed", ())),
        "lowest_normal_force": None if lift_off is None else lift_off["lowest"],
        "smallest_distance": None if nearest is None else nearest["distance"],
        **{f"{LIMITS}.{kind}": worst["excess"] for kind, worst in summary.get("joint_limits", {}).items()},
    }


SUCCESSFUL = ("succeeded", "degraded")
"""Verdicts of runs that did not fail."""


def verdict_or_failure(verdict: str, finding: str) -> str:
    """Verdict of a run; the kind of the finding that failed it instead of "failed"."""
    return finding if verdict == "failed" else verdict


def refused(outcome: str, error: RncError) -> Row:
    """Columns of results of a run that could not start."""
    return {"outcome": outcome, "verdict": "failed", "finding": outcome, "message": str(error)}


def trajectory_file(folder: Path, run: int) -> Path:
    """File of the trajectory of a run, in the folder of its sweep."""
    return folder / "trajectories" / f"run_{run:07d}.npz"


def save_trajectory(trajectory: Trajectory, folder: str | None, run: int) -> None:
    """Write the trajectory of a run, complete or not at all; without a folder do nothing."""
    if folder is not None:
        path = trajectory_file(Path(folder), run)
        path.parent.mkdir(parents=True, exist_ok=True)
        trajectory.save(path)


def with_options_of_sweeps(options: Mapping[str, Json]) -> dict[str, Json]:
    """Options of every run of a sweep: no comparisons and plots, and preflight refuses instead of warning."""
    return {"preflight": "refuse", **options, "comparisons": {}, "plots": {}}


Kinds: TypeAlias = dict[str, str]
"""Kind of each drawn value: "bool", "integer", "number", "numbers", "text" or "json"."""

_HEAD = ("seed", *takewhile("duration".__ne__, RESULTS))
"""Columns between drawn values and results that are numbers."""


def kind_of(value: object) -> str | None:
    """Kind of a value; None of a missing one."""
    if value is None:
        return None
    for kind, types in (("bool", bool), ("integer", int), ("number", float), ("text", str)):
        if isinstance(value, types):
            return kind
    numbers = isinstance(value, list) and all(kind_of(each) in ("integer", "number") for each in value)
    return "numbers" if numbers and value else "json"


def common_kind(one: str | None, other: str | None) -> str | None:
    """Kind of a column with values of two kinds: "json" if no simpler one has both."""
    if one is None or other is None or one == other:
        return one or other
    if {one, other} == {"integer", "number"}:
        return "number"
    return "json"


def kind_of_all(values: Sequence[object]) -> str | None:
    """Kind of a column of values."""
    kind: str | None = None
    for value in values:
        kind = common_kind(kind, kind_of(value))
    return kind


def table_of(rows: Sequence[Row], kinds: Mapping[str, str]) -> pa.Table:
    """Rows as a table. Columns of drawn values know their kinds, so that ``plain_row`` returns the values.

    Args:
        rows: rows in order.
        kinds: kinds of drawn values; other kinds follow from the values.
    """
    import pyarrow as pa

    names = dict.fromkeys(key for row in rows for key in row)
    drawn = [name for name in names if not is_result_column(name) and name not in _HEAD]
    results = [name for name in names if is_result_column(name) and name not in ("run", "wall_time", *_HEAD)]
    ordered = ["run", *drawn, *(name for name in _HEAD if name in names), *results, "wall_time"]
    fields, columns = [], []
    for name in ordered:
        values = [row.get(name) for row in rows]
        kind = _kind_of_column(name, values, kinds)
        if kind == "json":
            values = [None if each is None else json.dumps(each) for each in values]
        note = None if is_result_column(name) else {"kind": kind or "null"}
        kind_type = _types()[kind]
        fields.append(pa.field(name, kind_type, metadata=note))
        columns.append(pa.array(values, kind_type))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _kind_of_column(name: str, values: Sequence[object], kinds: Mapping[str, str]) -> str | None:
    if name == "run":
        return "integer"
    if is_result_column(name):
        return RESULTS.get(name, "number")
    return kinds.get(name) or kind_of_all(values)


def _types() -> dict[str | None, pa.DataType]:
    import pyarrow as pa

    number, text = pa.float64(), pa.string()
    types: dict[str | None, pa.DataType] = {
        "bool": pa.bool_(),
        "integer": pa.int64(),
        "number": number,
        "numbers": pa.list_(number),
    }
    return {**types, "text": text, "json": text, None: pa.null()}


def write_part(table: pa.Table, path: Path) -> None:
    """Write a table as a Parquet file, complete or not at all."""
    import pyarrow.parquet as pq

    with atomic_file(path) as partial:
        pq.write_table(table, partial, compression="zstd")
        with partial.open("rb") as file:
            os.fsync(file.fileno())


@contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    """Parquet file, open inside the ``with`` block.

    Raises:
        ConfigurationError: the file cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            yield file
    except (OSError, pa.ArrowException) as error:
        raise ConfigurationError(f"{path}: cannot be read: {str(error).splitlines()[0]}") from None


def read_part(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Read a Parquet file of ``write_part``; columns that it does not have are missing.

    Raises:
        ConfigurationError: the file cannot be read.
    """
    with _opened(path) as file:
        known = set(file.schema_arrow.names)
        return file.read(None if columns is None else [name for name in columns if name in known])


def schema_of(path: Path) -> tuple[pa.Schema, int]:
    """Schema and number of rows of a Parquet file.

    Raises:
        ConfigurationError: the file cannot be read.
    """
    with _opened(path) as file:
        return file.schema_arrow, file.metadata.num_rows


def common_schema(schemas: Sequence[pa.Schema]) -> pa.Schema:
    """Schema of all parts. Drawn integers become numbers where another part has numbers.

    Raises:
        ConfigurationError: a column has incompatible types.
    """
    import pyarrow as pa

    try:
        return pa.unify_schemas(schemas, promote_options="permissive")
    except pa.ArrowException as error:
        raise ConfigurationError(f"parts of the sweep do not fit together: {str(error).splitlines()[0]}") from None


def fitted(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """Table with the columns of a schema; missing ones are null."""
    import pyarrow as pa

    columns = [
        table.column(field.name).cast(field.type)
        if field.name in table.column_names
        else pa.nulls(table.num_rows, field.type)
        for field in schema
    ]
    return pa.Table.from_arrays(columns, schema=schema)


def plain_rows(table: pa.Table) -> list[Row]:
    """Rows of a table with their values as they were drawn."""
    notes = {field.name: (field.metadata or {}).get(b"kind") for field in table.schema}
    encoded = [name for name, kind in notes.items() if kind == b"json"]
    rows: list[Row] = table.to_pylist()
    for row in rows:
        for name in encoded:
            if row[name] is not None:
                row[name] = json.loads(row[name])
    return rows
