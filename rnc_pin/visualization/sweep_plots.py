"""Distributions over the runs of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from rnc_pin.visualization.plot_style import COLORS, PrintFigure, escape_dollars, styled

_COLUMNS, _SIZE = 3, (3.4, 2.2)  # panels side by side, and the size of one [inches]


class Histogram(NamedTuple):
    """Histogram of a column: edges (bins + 1,), and counts of completed and of other runs (bins,)."""

    name: str
    edges: np.ndarray
    completed: np.ndarray
    others: np.ndarray
    logarithmic: bool


@styled
def plot_distributions(panels: Sequence[Histogram], title: str) -> Figure:
    """Plot histograms side by side; runs that did not complete are on top of the others.

    Args:
        panels: one or more histograms.
        title: title above the plot.
    """
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = PrintFigure((columns * _SIZE[0], rows * _SIZE[1] + 0.5))
    figure.suptitle(escape_dollars(title), fontweight="bold")
    failed = any(panel.others.any() for panel in panels)
    for number, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, number + 1)
        widths, left = np.diff(panel.edges), panel.edges[:-1]
        axes.bar(left, panel.completed, widths, align="edge", color=COLORS[0], label="completed")
        if failed:
            label = "not completed"
            axes.bar(left, panel.others, widths, bottom=panel.completed, align="edge", color=COLORS[1], label=label)
        if panel.logarithmic:
            axes.set_xscale("log")
        axes.set_xlabel(escape_dollars(panel.name), fontsize=8 if len(panel.name) > 30 else None)
        axes.set_ylabel("runs" if number % columns == 0 else "")
        axes.locator_params(axis="y", integer=True)
        if failed and number == 0:
            axes.legend()
    return figure
