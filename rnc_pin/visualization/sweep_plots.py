"""Distributions over the runs of a sweep."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from rnc_pin.figures.style import COLORS, PrintFigure, escape, styled

_TICKS = 5
_COLUMNS, _SIZE = 3, (3.4, 2.2)  # panels side by side, and the size of one [inches]


class Histogram(NamedTuple):
    """Histogram of a column: edges (bins + 1,), and counts (bins,) by verdict or by kind of failure."""

    name: str
    edges: np.ndarray
    counts: Mapping[str, np.ndarray]
    logarithmic: bool
    shares: bool = False
    """True to draw the share of each verdict in a bin, such as over a drawn value."""


@styled
def plot_distributions(panels: Sequence[Histogram], title: str) -> Figure:
    """Plot histograms side by side, with the kinds of failures on top of the runs that succeeded.

    Args:
        panels: one or more histograms.
        title: title above the plot.
    """
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    labels = list(dict.fromkeys(label for panel in panels for label in panel.counts))
    several = len(labels) > 1
    figure = PrintFigure((columns * _SIZE[0], rows * _SIZE[1] + (0.9 if several else 0.5)))
    figure.suptitle(escape(title), fontweight="bold")
    colors = dict(zip(labels, itertools.cycle(COLORS), strict=False))
    for number, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, number + 1)
        widths, left = np.diff(panel.edges), panel.edges[:-1]
        below, total = np.zeros(len(left)), sum(panel.counts.values(), np.zeros(len(left)))
        for label, count in panel.counts.items():
            height = 100.0 * count / np.maximum(total, 1) if panel.shares else count
            axes.bar(left, height, widths, bottom=below, align="edge", color=colors[label], label=label)
            below = below + height
        if panel.logarithmic:
            axes.set_xscale("log")
        else:  # labels of small differences would overlap
            axes.locator_params(axis="x", nbins=_TICKS)
            axes.ticklabel_format(axis="x", scilimits=(-3, 4))
        axes.set_xlabel(escape(panel.name), fontsize=8 if len(panel.name) > 30 else None)
        if panel.shares:
            axes.set_ylabel("share of runs [%]")
        else:
            axes.set_ylabel("runs" if number % columns == 0 else "")
            axes.locator_params(axis="y", integer=True)
    if several:
        handles = [Patch(color=colors[label], label=label) for label in labels]
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(labels), 2 * columns))
    return figure
