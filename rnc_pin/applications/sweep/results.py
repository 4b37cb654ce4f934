"""Results of a sweep: its rows in its folder, the data set that they are, and pictures of their distributions."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rnc_pin.applications.scenario.files import one_line_yaml
from rnc_pin.applications.sweep.rows import (
    LIMITS,
    SUCCESSFUL,
    Row,
    common_schema,
    fitted,
    is_result_column,
    plain_rows,
    read_part,
    schema_of,
    table_of,
    trajectory_file,
    verdict_or_failure,
    with_options_of_sweeps,
)
from rnc_pin.applications.sweep.sweep_folder import (
    BLOCK,
    RUNS,
    Specification,
    block_rows,
    blocks_of,
    part_file,
    read_specification,
)
from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.extras import check_extra
from rnc_pin.io import atomic_file
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin, counted
from rnc_pin.simulation import Trajectory

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.figure import Figure

    from rnc_pin.figures import Size
    from rnc_pin.visualization import Histogram


class _Blocks(NamedTuple):
    """Blocks of the data set: numbers of those in Parquet files, tables of open ones, and the schema of all."""

    complete: list[int]
    open: dict[int, pa.Table]
    schema: pa.Schema
    rows: int


class SweepResults(SummaryMixin):
    """Results of a sweep, with one row a run. Rows are read from the folder when they are needed.

    ``results["final_error.tip_x"]`` is a column as an array, with NaN for missing numbers. Rows have the order of the
    runs. An unfinished sweep has the rows of its finished runs.

    Args:
        path: folder of the sweep.

    Attributes:
        path: folder of the sweep.
        specification: all that decides the results, as JSON content.

    Raises:
        ConfigurationError: the folder holds no sweep, or PyArrow is not installed.

    Example:
        >>> import tempfile
        >>> folder = tempfile.TemporaryDirectory()
        >>> draws = [{"initial.q.joint_2": angle} for angle in (1.6, 1.7)]
        >>> quick = {"simulation.duration": 0.01}
        >>> results = rnc.sweep("space-robot", draws, out=folder.name, options=quick)
        >>> isinstance(results, rnc.SweepResults), results.columns[:2]
        (True, ['run', 'initial.q.joint_2'])
        >>> results["initial.q.joint_2"]
        array([1.6, 1.7])
    """

    def __init__(self, path: str | Path) -> None:
        check_extra("sweep", "sweep")
        self.path = Path(path)
        found = read_specification(self.path)
        if found is None:
            raise ConfigurationError(f"{self.path}: holds no sweep")
        self.specification: Specification = found

    @cached_property
    def _blocks(self) -> _Blocks:
        folder = self.path / RUNS
        parts, journals = blocks_of(folder)
        kinds = self.specification.get("kinds", {})
        unfinished = {block: table_of(rows, kinds) for block in sorted(journals) if (rows := block_rows(folder, block))}
        complete = sorted(parts - unfinished.keys())
        described = [schema_of(part_file(folder, block)) for block in complete]
        tables = unfinished.values()
        count = sum(rows for _, rows in described) + sum(table.num_rows for table in tables)
        if not count:
            return _Blocks([], {}, table_of([], {}).schema, 0)
        schemas = [*(schema for schema, _ in described), *(table.schema for table in tables)]
        return _Blocks(complete, unfinished, common_schema(schemas), count)

    def __len__(self) -> int:
        return self._blocks.rows

    @property
    def complete(self) -> bool:
        """True if no run is missing."""
        return len(self) == self.specification["runs"]

    @property
    def columns(self) -> list[str]:
        """Names of the columns: number of the run, drawn values, results."""
        return list(self._blocks.schema.names)

    @property
    def table_schema(self) -> pa.Schema:
        """Arrow schema: names and types of the columns."""
        return self._blocks.schema

    @property
    def drawn(self) -> list[str]:
        """Names of the drawn values."""
        return [name for name in self.columns if not is_result_column(name)]

    def tables(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Yield Arrow tables with up to 5,000 runs each.

        Args:
            columns: names of columns; all by default.

        Raises:
            InputError: there is no such column.
        """
        import pyarrow as pa

        for name in columns or ():
            if name not in self.columns:
                raise InputError(f"no column '{name}'{nearest(name, self.columns)}")
        complete, unfinished, schema, _ = self._blocks
        chosen = schema if columns is None else pa.schema([schema.field(name) for name in columns])
        for block in sorted([*complete, *unfinished]):
            if block in unfinished:
                yield fitted(unfinished[block], chosen)
            else:
                yield fitted(read_part(part_file(self.path / RUNS, block), columns), chosen)

    def table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return an Arrow table, which has ``to_pandas``.

        Args:
            columns: names of columns; all by default.
        """
        import pyarrow as pa

        found = list(self.tables(columns))
        return pa.concat_tables(found) if found else self._blocks.schema.empty_table()

    def __getitem__(self, column: str) -> np.ndarray:
        found = [np.asarray(table.column(0).to_numpy()) for table in self.tables([column])]
        return np.concatenate(found) if found else np.zeros(0)

    def rows(self, columns: Sequence[str] | None = None) -> Iterator[Row]:
        """Yield runs as mappings by column.

        Args:
            columns: names of columns; all by default.
        """
        for table in self.tables(columns):
            yield from plain_rows(table)

    def failures(self) -> Iterator[Row]:
        """Runs that did not succeed."""
        return (row for row in self.rows() if row["verdict"] == "failed")

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of runs by outcome, such as "completed"."""
        return dict(sorted(self._counts(lambda outcome: outcome, "outcome").items()))

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of runs by verdict: "succeeded", "degraded", and of the others by the kind of their first failure."""
        found = self._counts(verdict_or_failure, "verdict", "finding")
        first = [name for name in SUCCESSFUL if name in found]
        return {name: found[name] for name in (*first, *sorted(set(found) - set(first)))}

    def _counts(self, label: Callable[..., str], *columns: str) -> dict[str, int]:
        """Number of runs by a label of the values in some columns."""
        counts: Counter[str] = Counter()
        for table in self.tables(columns) if len(self) else ():
            counts.update(label(*values) for values in zip(*(each.to_pylist() for each in table.columns), strict=True))
        return dict(counts)

    def row(self, run: int) -> Row:
        """Return a run as a mapping by column; columns without a value are missing.

        Args:
            run: number of the run.

        Raises:
            InputError: the run is not finished, or there is no such run.
        """
        for row in block_rows(self.path / RUNS, run // BLOCK) if run >= 0 else ():
            if row["run"] == run:
                return {name: value for name, value in row.items() if value is not None}
        raise InputError(f"no finished run {run} in {self.path}")

    def draw(self, run: int) -> dict[str, object]:
        """Return the drawn values of a run.

        Args:
            run: number of the run.
        """
        return {name: value for name, value in self.row(run).items() if not is_result_column(name)}

    def command(self, run: int | Row) -> str:
        """Return the command that repeats a run of a scenario.

        Args:
            run: number of the run, or its row.

        Raises:
            InputError: the sweep is one of a function; call it with ``draw(run)``.
        """
        if "scenario" not in self.specification:
            raise InputError(f"{self.specification['build']} built the runs; call it with draw(run)")
        row = self.row(run) if isinstance(run, int) else run
        shared = {key: value for key, value in self.specification["options"].items() if key not in ("sweep", "seed")}
        drawn = {name: value for name, value in row.items() if not is_result_column(name) and value is not None}
        options = {**with_options_of_sweeps(shared), **drawn}
        words = [f"--set {shlex.quote(f'{key}={one_line_yaml(value)}')}" for key, value in options.items()]
        return f"rnc-pin run {shlex.quote(self.specification['scenario'])} {' '.join(words)}"

    def trajectory(self, run: int) -> Trajectory:
        """Read the trajectory of a run; a sweep writes them if it is asked to.

        Args:
            run: number of the run.
        """
        return Trajectory.load(trajectory_file(self.path, run))

    def to_csv(self, path: str | Path) -> None:
        """Write all rows as CSV; numbers have all their digits.

        Args:
            path: the file.
        """
        import pyarrow as pa
        import pyarrow.csv

        listed = {field.name for field in self._blocks.schema if pa.types.is_list(field.type)}
        texts = [pa.field(each.name, pa.string()) if each.name in listed else each for each in self._blocks.schema]
        schema = pa.schema([each.remove_metadata() for each in texts])
        with atomic_file(Path(path)) as partial, pyarrow.csv.CSVWriter(partial, schema) as writer:
            for table in self.tables():
                columns = [
                    pa.array([None if each is None else str(each) for each in column.to_pylist()], pa.string())
                    if name in listed
                    else column
                    for name, column in zip(table.column_names, table.columns, strict=True)
                ]
                writer.write_table(pa.Table.from_arrays(columns, schema=schema))

    def plot(self, *, size: Size | None = None, file: str | Path | None = None) -> Figure:
        """Plot the distributions of results, and the share of each finding over drawn values.

        Args:
            size: size of the figure, as for ``rnc.Trajectory.plot``.
            file: file to write: .png, .pdf or .svg. An existing one is replaced.

        Raises:
            InputError: no column has two different numbers, or the panels do not fit the size.
            ConfigurationError: the file has another ending.
        """
        figure = draw_distributions(self, size, file)
        if figure is None:
            raise InputError(f"{self.path}: the runs are too few or too much alike to plot their distributions")
        return figure

    def _summary(self) -> ObjectSummary:
        outcomes = [Item(name, str(count)) for name, count in self.outcomes.items()]
        of = self.specification.get("scenario") or self.specification.get("build")
        title = f"SweepResults: {counted(len(self), 'run')} of {of}"
        return ObjectSummary(title, [("outcomes", outcomes), ("drawn", [Item(name) for name in self.drawn])])


def load_sweep(path: str | Path) -> SweepResults:
    """Read the results of a sweep, finished or not. The data set has one row a run.

    Args:
        path: folder of the sweep.

    Raises:
        ConfigurationError: the folder holds no sweep, or PyArrow is not installed.

    Example:
        >>> try:
        ...     rnc.load_sweep("nowhere")
        ... except rnc.ConfigurationError as error:
        ...     print(error)
        nowhere: holds no sweep
    """
    return SweepResults(path)


# ------------------------------------------------------------------ distributions

_MOST_PANELS = 24
_TITLES = {
    "smallest_distance": "smallest distance from obstacles [m]",
    "smallest_own_distance": "smallest distance between links [m]",
    "min_singular_value": "smallest singular value of E",
}
_BINS = (10, 40)  # smallest and largest number
_SHARES, _RUNS_IN_BIN = (4, 20), 10  # the same of shares, and the runs that one needs: a share of few runs is noise


def draw_distributions(results: SweepResults, size: Size | None, file: str | Path | None) -> Figure | None:
    """Figure of ``SweepResults.plot``, also as a file; None if no column has two different numbers."""
    from rnc_pin.figures import save
    from rnc_pin.visualization import plot_distributions

    names = [name for name in results.columns if name.startswith("final_error.")]
    names += [name for name in _TITLES if name in results.columns]
    names += [name for name in results.columns if name.startswith(LIMITS)]
    names += [name for name in results.drawn if name != "seed"]
    panels = [panel for name in names[:_MOST_PANELS] if (panel := _histogram(results, name)) is not None]
    if not panels:
        return None
    of = str(results.specification.get("scenario") or results.specification.get("build"))
    figure = plot_distributions(panels, f"{Path(of).stem}: {len(results)} runs" if size is None else "", size)
    if file is not None:
        save(figure, file)
    return figure


def _histogram(results: SweepResults, name: str) -> Histogram | None:
    """Histogram of a column of numbers by verdict; None if it has no two different numbers."""
    import pyarrow as pa

    from rnc_pin.visualization import Histogram

    kind = results.table_schema.field(name).type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
        return None

    def chunks() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for table in results.tables([name, "verdict", "finding"]):
            values = np.asarray(table.column(0).to_numpy(), dtype=float)
            pairs = zip(table.column(1).to_pylist(), table.column(2).to_pylist(), strict=True)
            labels = np.array([verdict_or_failure(*pair) for pair in pairs])
            fine = np.isfinite(values)
            yield values[fine], labels[fine]

    low, high, positive = np.inf, -np.inf, np.inf
    for values, _ in chunks():
        if len(values):
            low, high = min(low, values.min()), max(high, values.max())
            positive = min(positive, values[values > 0].min(initial=np.inf))
    if not low < high:
        return None
    logarithmic = low >= 0.0 and np.isfinite(positive) and high > 100.0 * positive
    shares, runs = name in results.drawn, len(results)
    bins = int(np.clip(runs / _RUNS_IN_BIN, *_SHARES) if shares else np.clip(np.sqrt(runs), *_BINS))
    edges = np.geomspace(positive, high, bins + 1) if logarithmic else np.linspace(low, high, bins + 1)
    counts = {label: np.zeros(bins, dtype=int) for label in results.verdicts}
    for values, labels in chunks():
        inside = np.clip(values, edges[0], edges[-1])  # zeros go into the first bin of a logarithmic axis
        for label, count in counts.items():
            count += np.histogram(inside[labels == label], edges)[0]
    shown = {label if label in SUCCESSFUL else f"failed: {label}": count for label, count in counts.items()}
    return Histogram(_title(name), edges, shown, logarithmic, shares)


def _title(name: str) -> str:
    """Title of the axis of a column: results in words, drawn values as their keys."""
    group, _, rest = name.partition(".")
    if group == "final_error":
        return f"final error of {rest} [m or rad]"
    if group == LIMITS:
        return f"excess over {rest} limits [share of range]"
    return _TITLES.get(name, name)
