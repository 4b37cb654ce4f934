"""One print-ready style for all plots: readable in grey, and by people who see colours differently."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from io import BytesIO
from itertools import cycle
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rnc_pin.simulation import Trajectory
from rnc_pin.whole_files import written_whole

# Okabe and Ito, in an order in which neighbours differ in lightness too.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")
MARKERS = "os^Dvp<>hPX*"
Dashes = tuple[int, tuple[float, ...]]
"""Where a pattern begins, and lengths of lines and gaps [points]."""

DOTS: Dashes = (0, (1, 1.6))
DASHES: list[Dashes] = [(0, (6, 3)), (0, (6, 2, 1, 2)), (0, (3, 2)), (0, (8, 2, 1, 2, 1, 2)), (0, (1, 4)), (0, (10, 4))]
_NAMED = 9  # lines in a column of a legend
_COLUMNS = 2
_ROWS = 11  # in two columns of smaller print
_WIDENED = 3.0  # [inches] for a second column
_BELOW = 4  # columns of a legend under its axes, at most
_LETTERS = 90  # in a line of it, those that the sign of an entry takes included
_SIGN = 9
_LONGEST_NAME = 60
_MARKS = 7  # markers on a line
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
    "lines.linewidth": 1.8,
    "lines.markersize": 5.0,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "figure.dpi": 200,
    "savefig.dpi": 200,
    "figure.constrained_layout.use": True,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}

P = ParamSpec("P")


class PrintFigure(Figure):
    """A figure that notebooks show by themselves."""

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw in this style, whatever else the process plots."""

    @wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with mpl.rc_context(STYLE):
            return draw(*args, **kwargs)

    return wrapped


def save(figure: Figure, path: str | Path, replace: bool = True) -> Path:
    """Write a figure; the ending of the name says what: .png, .pdf, .svg. Nothing half-written is left on failure."""
    with mpl.rc_context(STYLE), written_whole(Path(path), replace) as partial:
        figure.savefig(partial)
    return Path(path)


def line(axes: Axes, k: int, count: int, time: np.ndarray, values: np.ndarray, label: str, **others: float) -> Line2D:
    """Draw the k-th of so many series: its colour, and its marker at places of its own."""
    step = max(1, len(time) // _MARKS)
    color, marker = look(k)
    style: dict[str, Any] = {"color": color, "marker": marker, "label": literal(label), **others}
    start = (2 * k + 1) * step // (2 * max(count, 1))
    return axes.plot(time, values, markevery=(start, step), markeredgecolor="white", markeredgewidth=0.6, **style)[0]


def look(k: int) -> tuple[str, str]:
    """Colour and marker of the k-th series: no two of the first 72 share both."""
    # Where colours come round again the markers are one further on, so that neighbours differ in both.
    return COLORS[k % len(COLORS)], MARKERS[(k + k // len(COLORS)) % len(MARKERS)]


def shade(k: int) -> str:
    """Colour of the k-th series where there are no markers: those that come round again are darker, then paler."""
    toward, share = ((0.0, 0.0), (0.0, 0.45), (1.0, 0.5))[k // len(COLORS) % 3]
    red, green, blue = ((1 - share) * each + share * toward for each in mpl.colors.to_rgb(COLORS[k % len(COLORS)]))
    return mpl.colors.to_hex((red, green, blue))


def widened(width: float, most: int) -> float:
    """Width of a figure [inches] whose longest legend has so many lines."""
    return width + (_WIDENED if most > _NAMED else 0.0)


def _columns(labels: Sequence[str]) -> int:
    """How many columns a legend under its axes has room for."""
    letters = max(map(len, labels), default=0) + _SIGN
    return int(np.clip(_LETTERS // letters, 1, min(_BELOW, max(len(labels), 1))))


def heightened(height: float, labels: Sequence[str]) -> float:
    """Height of a figure [inches] with these lines in a legend below."""
    return height + 0.18 * max(0, -(-len(labels) // _columns(labels)) - 2)


def dashes(labels: Iterable[str]) -> Iterable[tuple[Dashes, str]]:
    """A dash pattern for each label."""
    return zip(cycle(DASHES), labels, strict=False)


def dashed(labels: Iterable[str], width: float) -> list[Line2D]:
    """Entries of a legend for runs that are compared."""
    return [Line2D([], [], color="0.3", ls=style, lw=width, label=literal(label)) for style, label in dashes(labels)]


def desired_entry() -> Line2D:
    """Entry of a legend for what is desired."""
    return Line2D([], [], color="black", ls=DOTS, lw=1.3, label="desired")


def legend_below(axes: Axes, handles: Sequence[Line2D]) -> None:
    """A legend under the axis of time."""
    columns = _columns([str(each.get_label()) for each in handles])
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=columns)


def legend_beside(axes: Axes, handles: Sequence[Line2D] | None = None) -> None:
    """A legend to the right, for axes one above the other."""
    shown = list(handles) if handles is not None else axes.get_legend_handles_labels()[0]
    title = None
    if len(shown) > _COLUMNS * _ROWS:  # or it would leave the axes no room
        title, most = f"largest of {len(shown)}", _COLUMNS * (_ROWS - 1)
        shown = sorted(shown, key=lambda line: -float(np.max(np.abs(line.get_ydata()), initial=0.0)))[:most]
    if shown:
        many = len(shown) > _NAMED
        axes.legend(
            handles=shown, loc="center left", bbox_to_anchor=(1.01, 0.5), title=title, ncols=_COLUMNS if many else 1,
            fontsize=7.5 if many else None, title_fontsize=7.5 if many else None, columnspacing=1.0, labelspacing=0.35,
        )  # fmt: skip


def words(name: str) -> str:
    """A name as people read it; of a long one, its ends."""
    if len(name) > _LONGEST_NAME:
        name = f"{name[: _LONGEST_NAME // 2]}...{name[-_LONGEST_NAME // 2 :]}"
    return name.replace("_", " ").strip()


def literal(text: str) -> str:
    """A text from a file, whose dollar signs are no formula."""
    return text.replace("$", r"\$")


def quantity(units: Sequence[str]) -> str:
    """Label of an axis for values in these units."""
    kinds = {"m": "position", "rad": "angle"}
    return " / ".join(dict.fromkeys(f"{kinds.get(unit, 'value')} [{unit}]" if unit else "value" for unit in units))


def series(trajectory: Trajectory, name: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Actual and desired values of an output, and its unit."""
    for kind in ("x2", "x1"):
        columns = trajectory.info.outputs.of(kind)
        if name in columns.names:
            column = columns.names.index(name)
            unit = columns.units[column]
            return getattr(trajectory, kind)[:, column], getattr(trajectory, f"{kind}_desired")[:, column], unit
    raise KeyError(name)


def outputs_of(trajectory: Trajectory) -> list[str]:
    """Names of all outputs of a run, those with goals first."""
    outputs = trajectory.info.outputs
    return sorted((*outputs.x2.names, *outputs.x1.names), key=lambda name: name not in trajectory.info.goals)
