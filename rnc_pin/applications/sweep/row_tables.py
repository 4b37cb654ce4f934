"""Rows of a sweep as Arrow tables: types of the columns, and files."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from rnc_pin.applications.sweep.swept_run import RESULTS, Row, is_result_column
from rnc_pin.errors import ConfigurationError
from rnc_pin.io import atomic_file

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

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
