"""Legends beside or above axes, with the room that they need."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.legend_handler import HandlerTuple
from matplotlib.textpath import TextPath

from rnc_pin.figures.style import LegendEntry

_MAX_LINE = 30  # characters per line of a legend beside the axes; longer lines would leave them too little room
_CHARACTER = 0.55  # width of a character, over the size of the text
# Lengths in sizes of the legend's text:
_HANDLE, _HANDLE_GAP, _COLUMN_GAP, _ROW, _BORDER = 2.4, 0.6, 1.2, 1.45, 0.4


class Legend:
    """Legend of axes, measured before it is drawn.

    Args:
        axes: the axes.
        entries: entries; none for no legend.
        note: title of the legend, with escaped characters.
        beside: True beside the axes, False above them.
        width: width that a legend above the axes may have [inches].
    """

    def __init__(self, axes: Axes, entries: Sequence[LegendEntry], note: str, beside: bool, width: float) -> None:
        self._axes, self._entries, self._beside = axes, entries, beside
        self._size = float(mpl.rcParams["legend.fontsize"])
        room = width * 72.0 / self._size - 2 * _BORDER
        widest = _MAX_LINE if beside else int((room - _HANDLE - _HANDLE_GAP) / _CHARACTER)
        self._note = _broken(note, widest)
        self._texts = [_broken(entry.text, widest) for entry in entries]
        self._columns = 1 if beside else self._fitting_columns(room)

    @property
    def height(self) -> float:
        """Height above the axes, in sizes of the figure's text."""
        if self._beside or not self._entries:
            return 0.0
        lines = [1 + text.count("\n") for text in self._texts]
        rows = max(sum(part) for part in np.array_split(lines, self._columns))
        rows += 1 + self._note.count("\n") if self._note else 0
        return (rows * _ROW + 2 * _BORDER) * self._size / float(mpl.rcParams["font.size"])

    def draw(self) -> None:
        """Draw the legend; lines of one entry are side by side."""
        if not self._entries:
            return
        handles = [entry.lines[0] if len(entry.lines) == 1 else tuple(entry.lines) for entry in self._entries]
        legend = self._axes.legend(
            handles, self._texts, ncols=self._columns, title=self._note or None,
            loc="center left" if self._beside else "lower left",
            bbox_to_anchor=(1.01, 0.5) if self._beside else (0.0, 1.0),
            borderaxespad=0.5 if self._beside else 0.0, borderpad=_BORDER, alignment="left",
            columnspacing=_COLUMN_GAP, labelspacing=0.35, handlelength=_HANDLE, handletextpad=_HANDLE_GAP,
            handler_map={tuple: HandlerTuple(ndivide=None, pad=0.4)},
        )  # fmt: skip
        legend.set_in_layout(True)

    def _fitting_columns(self, room: float) -> int:
        """Largest number of columns within a width [sizes of the legend's text]."""
        widths = [_HANDLE + _HANDLE_GAP + _width(text) for text in self._texts]
        for columns in range(len(widths), 1, -1):
            parts = [max(part) for part in np.array_split(widths, columns)]
            if sum(parts) + _COLUMN_GAP * (columns - 1) <= room:
                return columns
        return 1


def _width(text: str) -> float:
    """Width of a text, over its size."""
    font = FontProperties(size=100.0)
    return max(
        float(TextPath((0.0, 0.0), line or " ", prop=font).get_extents().width) / 100.0 for line in text.split("\n")
    )


def _broken(text: str, widest: int) -> str:
    """Break a long text into several lines; a text with a formula is kept whole."""
    if "$" in text.replace("\\$", ""):
        return text
    return "\n".join(textwrap.wrap(text, max(8, widest))) or text
