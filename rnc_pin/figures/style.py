"""Style of every picture, for screen and print: readable in greyscale and with colour vision deficiency."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from io import BytesIO
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from rnc_pin.errors import ConfigurationError
from rnc_pin.io.json import atomic_file

# Palette of Okabe and Ito, ordered so that neighbours also differ in lightness.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")
FORMATS = (".png", ".pdf", ".svg")
MARKERS = "os^Dvp<>hPX*"
Dashes = tuple[int, tuple[float, ...]]
"""Offset of a dash pattern, and lengths of its lines and gaps [points]."""

DOTS: Dashes = (0, (1, 1.6))
DASHES: list[Dashes] = [(0, (6, 3)), (0, (6, 2, 1, 2)), (0, (3, 2)), (0, (8, 2, 1, 2, 1, 2)), (0, (1, 4)), (0, (10, 4))]

_SCREEN = 10.0  # size of text for which lengths in points are given [points]
_DPI = 160
_QUICKLY = {"compress_level": 1}  # of PNG files: a fifth less time, and a fifth more bytes


def style(font: float = _SCREEN) -> dict[Any, object]:
    """Settings of Matplotlib for text of a size [points]. Sizes are numbers, so that a later ``savefig`` keeps them.

    Args:
        font: size of the text [points].
    """
    part = font / _SCREEN
    sizes = ("font.size", "axes.labelsize", "xtick.labelsize", "ytick.labelsize")
    print_dpi = 300  # of figures with smaller text
    return {
        **dict.fromkeys(sizes, font),
        **dict.fromkeys(("axes.titlesize", "figure.titlesize"), 1.1 * font),
        **dict.fromkeys(("axes.titleweight", "figure.titleweight"), "bold"),
        **dict.fromkeys(("legend.fontsize", "legend.title_fontsize"), 0.9 * font),
        "axes.grid": True,
        "grid.color": "0.88",
        "grid.linewidth": 0.6 * part,
        "axes.linewidth": 0.8 * part,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.axisbelow": True,
        "axes.formatter.useoffset": False,
        **{f"{axis}tick.major.{part_of}": length * part for axis in "xy"
           for part_of, length in (("size", 3.5), ("width", 0.8), ("pad", 3.5))},
        "lines.linewidth": 1.8 * part,
        "lines.markersize": 5.0 * part,
        "legend.frameon": False,
        "figure.dpi": _DPI if font >= _SCREEN else print_dpi,
        "savefig.dpi": "figure",
        "pdf.fonttype": 42,
        "svg.fonttype": "none",
    }  # fmt: skip


STYLE = style()


def points(length: float) -> float:
    """Length of a line, a dash or a marker [points] in the current style, from that beside text of 10 points.

    Args:
        length: length beside text of 10 points [points].
    """
    return length * float(mpl.rcParams["font.size"]) / _SCREEN


class PrintFigure(Figure):
    """Figure that notebooks display automatically.

    Args:
        figsize: width and height [inches].
    """

    def __init__(self, figsize: tuple[float, float]) -> None:
        super().__init__(figsize=figsize)
        FigureCanvasAgg(self)  # keeps its renderer; each measurement of a text would make one

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        notebook_width = 800  # of small figures [pixels]
        self.savefig(buffer, format="png", dpi=float(np.clip(notebook_width / self.get_figwidth(), 100, _DPI)))
        return buffer.getvalue()


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as .png, .pdf or .svg, by the suffix of the name. A failure leaves no partial file.

    Args:
        figure: the figure.
        path: name of the file.

    Raises:
        ConfigurationError: the name has another suffix.
        OSError: the file cannot be written.
    """
    if Path(path).suffix not in FORMATS:
        raise ConfigurationError(f"{path}: expected a name that ends in .png, .pdf or .svg")
    with mpl.rc_context(STYLE), atomic_file(Path(path)) as partial:
        options: dict[str, Any] = {"pil_kwargs": _QUICKLY} if Path(path).suffix == ".png" else {}
        figure.savefig(partial, **options)
    return Path(path)


class LegendEntry(NamedTuple):
    """Legend entry: its text, with escaped characters, and its lines or bodies. The legend shows their colours."""

    text: str
    lines: Sequence[Line2D | Patch]


def line(axes: Axes, k: int, count: int, time: np.ndarray, values: np.ndarray) -> Line2D:
    """Draw the k-th of ``count`` series. Markers of different series are at different samples.

    Args:
        axes: axes to draw into.
        k: number of the series, from zero.
        count: number of series in the axes.
        time: times (N,) [s].
        values: values (N,).
    """
    markers = 7  # enough to tell lines in greyscale, too few to hide them
    step = max(1, len(time) // markers)
    color, marker = COLORS[k % len(COLORS)], MARKERS[k % len(MARKERS)]
    # Evenly shifted: markers of lines that coincide stay visible.
    start = (2 * k + 1) * step // (2 * max(count, 1))
    return axes.plot(
        time, values, color=color, lw=points(1.6), marker=marker, markevery=(start, step), markeredgecolor="white",
        markeredgewidth=points(0.6),
    )[0]  # fmt: skip


def color_of(k: int, count: int, run: int) -> str:
    """Colour of the k-th of ``count`` series of a compared run. A single series has the colour of its run.

    Args:
        k: number of the series, from zero.
        count: number of series in the axes.
        run: number of the compared run, from zero.
    """
    return COLORS[k % len(COLORS)] if count > 1 else COLORS[(run + 1) % len(COLORS)]


def pale(color: str) -> str:
    """Colour half way to white.

    Args:
        color: "#rrggbb".
    """
    red, green, blue = to_rgb(color)
    return to_hex(((1.0 + red) / 2.0, (1.0 + green) / 2.0, (1.0 + blue) / 2.0))


def scaled(style: Dashes, width: float) -> Dashes:
    """Dash pattern with dashes as long on a line of this width [points] as on one of 1.5 points.

    Args:
        style: dash pattern for a line of 1.5 points.
        width: width of the line [points].
    """
    return style[0], tuple(1.5 * length / width for length in style[1])


def dashes(labels: Iterable[str]) -> Iterable[tuple[Dashes, str]]:
    """Pairs of dash pattern and label.

    Args:
        labels: labels of the compared runs.
    """
    return zip(cycle(DASHES), labels, strict=False)


def unit_text(unit: str) -> str:
    """Unit of an axis in upright letters, with powers: "rad/s^2" becomes "rad/s$^2$".

    Args:
        unit: unit as in the names of this package.
    """
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", escape(unit))


def escape(text: str) -> str:
    """Escape the characters that Matplotlib, or LaTeX if ``text.usetex`` is on, would read as commands.

    Args:
        text: any text.
    """
    special = "&%$#_{}" if mpl.rcParams["text.usetex"] else "$"
    return "".join("\\" + each if each in special else each for each in text)
