"""Print-ready style of all plots: readable in greyscale and with colour vision deficiency."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from io import BytesIO
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from rnc_pin.io.atomic_write import atomic_file

# Palette of Okabe and Ito, ordered so that neighbours also differ in lightness.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")
MARKERS = "os^Dvp<>hPX*"
Dashes = tuple[int, tuple[float, ...]]
"""Offset of a dash pattern, and lengths of its lines and gaps [points]."""

DOTS: Dashes = (0, (1, 1.6))
DASHES: list[Dashes] = [(0, (6, 3)), (0, (6, 2, 1, 2)), (0, (3, 2)), (0, (8, 2, 1, 2, 1, 2)), (0, (1, 4)), (0, (10, 4))]
_MAX_LINE = 30  # characters per line of a legend; longer lines would leave too little room for the axes
_MAX_LAYOUTS = 3  # layouts of a figure at most
_SAME_DISTANCE = 0.01  # distance of labels that needs no other layout [inches]
_MARKERS_PER_LINE = 7  # number of markers on a line
STYLE: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.grid": True,
    "grid.color": "0.88",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "lines.linewidth": 1.8,
    "lines.markersize": 5.0,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "figure.dpi": 200,
    "savefig.dpi": 200,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}

P = ParamSpec("P")


class AlignedLayout(ConstrainedLayoutEngine):
    """Constrained layout with aligned labels of vertical axes.

    Matplotlib's ``align_ylabels`` measures all tick labels of a column for the label of each of its axes, several times
    for a picture. This layout measures each once before it places the axes, and once after. It repeats that if the
    size of the axes gave them wider tick labels, for which there was no room.
    """

    def __init__(self) -> None:
        super().__init__()
        self._columns: list[list[Axes]] = []

    def align(self, axes: Iterable[Axes]) -> None:
        """Align the labels of these axes, which start in one column of a grid or in several."""
        columns: dict[int, list[Axes]] = {}
        for each in axes:
            place = each.get_subplotspec()
            columns.setdefault(0 if place is None else place.colspan.start, []).append(each)
        self._columns += columns.values()

    def execute(self, fig: Figure) -> None:
        """Place the axes of a figure, and the labels of their vertical axes."""
        room = self._place_labels(fig)
        for _ in range(_MAX_LAYOUTS):
            super().execute(fig)
            needed = self._place_labels(fig)
            if all(distance <= given + _SAME_DISTANCE for distance, given in zip(needed, room, strict=True)):
                break
            room = needed

    def _place_labels(self, fig: Figure) -> list[float]:
        """Place the labels and return the distance of each column from its axes [inches]."""
        distances = []
        for column in self._columns:
            distance = max(_label_distance(axes) for axes in column) / fig.dpi
            distances.append(distance)
            for axes in column:
                away = ScaledTranslation(-distance, 0.0, fig.dpi_scale_trans)
                axes.yaxis.set_label_coords(0.0, 0.5, axes.transAxes + away)
        return distances


def _label_distance(axes: Axes) -> float:
    """Distance of the label of a vertical axis from the axes [pixels]."""
    axis = axes.yaxis
    axis.label.set_visible(False)
    ticks = axis.get_tightbbox()
    axis.label.set_visible(True)
    figure = axes.get_figure()
    assert figure is not None
    wide = 0.0 if ticks is None else max(0.0, float(axes.bbox.x0 - ticks.x0))
    return wide + axis.labelpad * figure.dpi / 72.0


class PrintFigure(Figure):
    """Figure that notebooks display automatically.

    Args:
        figsize: width and height [inches].
    """

    def __init__(self, figsize: tuple[float, float]) -> None:
        self._layout = AlignedLayout()
        super().__init__(figsize=figsize, layout=self._layout)

    def align_labels_of(self, axes: Iterable[Axes]) -> None:
        """Align the labels of the vertical axes of a column, or of several."""
        self._layout.align(axes)

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorator: draw the figure in this style, without changing Matplotlib's global settings."""

    @wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(STYLE):
            return draw(*args, **kwargs)

    return wrapped


def save(figure: Figure, path: str | Path, replace: bool = True) -> Path:
    """Write a figure as .png, .pdf or .svg, by the suffix of the name. A failure leaves no partial file."""
    layout = figure.get_layout_engine()
    with mpl.rc_context(STYLE), atomic_file(Path(path), replace) as partial:
        if layout is None:
            figure.savefig(partial)
            return Path(path)
        layout.execute(figure)
        figure.set_layout_engine("none")  # with an engine, Matplotlib draws twice, the first time for the layout only
        try:
            figure.savefig(partial)
        finally:
            figure.set_layout_engine(layout)
    return Path(path)


class LegendEntry(NamedTuple):
    """Legend entry: a name and its lines. The legend shows their colours and dashes."""

    name: str
    lines: Sequence[Line2D]


def line(axes: Axes, k: int, count: int, time: np.ndarray, values: np.ndarray) -> Line2D:
    """Draw the k-th of ``count`` series. Markers of different series are at different samples."""
    step = max(1, len(time) // _MARKERS_PER_LINE)
    color, marker = line_style(k)
    start = (2 * k + 1) * step // (2 * max(count, 1))
    return axes.plot(
        time, values, color=color, lw=1.6, marker=marker, markevery=(start, step), markeredgecolor="white",
        markeredgewidth=0.6,
    )[0]  # fmt: skip


def line_style(k: int) -> tuple[str, str]:
    """Colour and marker of the k-th line of a panel."""
    return COLORS[k % len(COLORS)], MARKERS[k % len(MARKERS)]


def color_of(k: int, count: int, run: int) -> str:
    """Colour of the k-th of ``count`` series of a compared run. A single series has the colour of its run."""
    return COLORS[k % len(COLORS)] if count > 1 else COLORS[(run + 1) % len(COLORS)]


def pale(color: str) -> str:
    """Colour half way to white."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"#{(red + 255) // 2:02x}{(green + 255) // 2:02x}{(blue + 255) // 2:02x}"


def scaled(style: Dashes, width: float) -> Dashes:
    """Dash pattern with dashes as long on a line of this width [points] as on one of 1.5 points."""
    return style[0], tuple(1.5 * length / width for length in style[1])


def dashes(labels: Iterable[str]) -> Iterable[tuple[Dashes, str]]:
    """Pairs of dash pattern and label."""
    return zip(cycle(DASHES), labels, strict=False)


def legend_beside(axes: Axes, entries: Sequence[LegendEntry], title: str = "") -> None:
    """Add a legend to the right of the axes. Lines of one entry are shown side by side."""
    if not entries:
        return
    handles = [entry.lines[0] if len(entry.lines) == 1 else tuple(entry.lines) for entry in entries]
    axes.legend(
        handles, [_broken(escape_dollars(entry.name)) for entry in entries],
        loc="center left", bbox_to_anchor=(1.01, 0.5),
        title=title or None, title_fontsize=8.0, columnspacing=1.0, labelspacing=0.35, handlelength=2.6,
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.4)},
    )  # fmt: skip


def _broken(name: str) -> str:
    """Break a long name into several lines."""
    return "\n".join(textwrap.wrap(name, _MAX_LINE)) or name


def escape_dollars(text: str) -> str:
    """Escape dollar signs, so that Matplotlib does not read a formula."""
    return text.replace("$", r"\$")
