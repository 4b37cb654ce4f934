"""Results of a sweep: its rows, and pictures of their distributions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rnc_pin.applications.sweep.swept_runs import SweptRuns
from rnc_pin.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rnc_pin.figures import Size


class SweepResults(SweptRuns):
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

    def plot(self, *, size: Size | None = None, file: str | Path | None = None) -> Figure:
        """Plot the distributions of results, and the share of each finding over drawn values.

        Args:
            size: size of the figure, as for ``rnc.Trajectory.plot``.
            file: file to write: .png, .pdf or .svg. An existing one is replaced.

        Raises:
            InputError: no column has two different numbers, or the panels do not fit the size.
            ConfigurationError: the file has another ending.
        """
        from rnc_pin.applications.sweep.reports import draw_distributions

        figure = draw_distributions(self, size, file)
        if figure is None:
            raise InputError(f"{self.path}: the runs are too few or too much alike to plot their distributions")
        return figure


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
