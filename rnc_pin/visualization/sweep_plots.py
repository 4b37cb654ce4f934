"""Distributions over the runs of a sweep."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from rnc_pin.errors import InputError
from rnc_pin.figures import Sheet, Size
from rnc_pin.figures.style import COLORS, PrintFigure, escape, style

_TICKS = 4
_MAX_LABEL = 34  # characters per line of a label
_COLUMNS, _WIDTH, _HEIGHT = 3, 24.0, 15.8  # most panels side by side, and the size of one, over that of the text
_ENTRY, _LINE = 14.0, 1.6  # width of an entry of the legend and height of a line, over the size of the text


class Histogram(NamedTuple):
    """Histogram of a column: edges (bins + 1,), and counts (bins,) by verdict or by kind of failure."""

    name: str
    edges: np.ndarray
    counts: Mapping[str, np.ndarray]
    logarithmic: bool
    shares: bool = False
    """True to draw the share of each verdict in a bin, such as over a drawn value."""


def plot_distributions(panels: Sequence[Histogram], title: str, size: Size | None = None) -> Figure:
    """Plot histograms side by side, with the kinds of failures on top of the runs that succeeded.

    Args:
        panels: one or more histograms.
        title: title above the plot; "" for none.
        size: size of the figure, as for ``Trajectory.plot``.

    Raises:
        InputError: the panels do not fit the size.
    """
    sheet = Sheet.of(size)
    with mpl.rc_context(style(sheet.font)):
        return _figure(panels, title, sheet)


def _figure(panels: Sequence[Histogram], title: str, sheet: Sheet) -> Figure:
    labels = list(dict.fromkeys(label for panel in panels for label in panel.counts))
    several, text = len(labels) > 1, sheet.font / 72.0  # size of the text [inches]
    most = _COLUMNS if sheet.width is None else max(1, int(sheet.in_text(sheet.width) // (0.8 * _WIDTH)))
    columns = min(most, len(panels))
    rows = -(-len(panels) // columns)
    width = sheet.width or columns * _WIDTH * text
    beside = max(1, int(sheet.in_text(width) // _ENTRY))
    around = _LINE * (2 * bool(title) + (1 + -(-len(labels) // beside)) * several)
    needed = (0.8 * rows * _HEIGHT + around) * text
    if sheet.height is not None and sheet.height < needed:
        raise InputError(f"size: {len(panels)} panels need a height of {np.ceil(10 * needed) / 10:g} inches")
    figure = PrintFigure((width, sheet.height or (rows * _HEIGHT + around) * text))
    if title:
        figure.suptitle(escape(title))
    colors = dict(zip(labels, itertools.cycle(COLORS), strict=False))
    for number, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, number + 1)
        power = 0 if panel.logarithmic else _power(panel.edges)
        edges = panel.edges / 10.0**power
        widths, left = np.diff(edges), edges[:-1]
        below, total = np.zeros(len(left)), sum(panel.counts.values(), np.zeros(len(left)))
        for label, count in panel.counts.items():
            height = 100.0 * count / np.maximum(total, 1) if panel.shares else count
            axes.bar(left, height, widths, bottom=below, align="edge", color=colors[label], label=label)
            below = below + height
        if panel.logarithmic:
            axes.set_xscale("log")
        else:  # labels of small differences would overlap
            axes.locator_params(axis="x", nbins=_TICKS)
        axes.set_xlabel(_label(panel.name, power))
        if panel.shares:
            axes.set_ylabel("share of runs [%]")
        else:
            axes.set_ylabel("runs" if number % columns == 0 else "")
            axes.locator_params(axis="y", integer=True)
    if several:
        handles = [Patch(color=colors[label], label=label) for label in labels]
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(labels), beside))
    return figure


def _power(edges: np.ndarray) -> int:
    """Power of ten that the label of an axis has instead of its ticks; 0 for numbers of ordinary size."""
    largest = float(np.abs(edges).max())
    power = int(np.floor(np.log10(largest))) if largest > 0.0 else 0
    return 0 if -3 <= power <= 4 else power


def _label(name: str, power: int) -> str:
    """Label of an axis in lines, with the power of ten before the unit."""
    lines = textwrap.wrap(escape(name), _MAX_LABEL)
    if power:
        ten = f"10$^{{{power}}}$"
        words, bracket, unit = escape(name).partition(" [")
        lines = [*textwrap.wrap(words, _MAX_LABEL), f"[{ten} {unit}" if bracket else f"[{ten}]"]
    return "\n".join(lines)
