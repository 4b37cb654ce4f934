"""Panels over time, and the sheet that they lie on. All lengths follow from the size of the text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from rnc_pin.errors import InputError, nearest, place_of

MAX_LINES = 6  # largest number of lines in a panel
AXIS_NAMES = {
    "m": "position",
    "rad": "angle",
    "m/s": "speed",
    "rad/s": "angular velocity",
    "m/s^2": "acceleration",
    "rad/s^2": "angular acceleration",
    "N": "force",
    "N m": "torque",
}
"""Names of axes by unit."""
INTEGRAL_NAMES = {"m": "distance", "rad": "turned angle"}
"""Names of axes of integrals of rates by unit."""


@dataclass(frozen=True)
class Series:
    """Line of a panel, with its reference and the same line of compared runs.

    Attributes:
        name: name of the quantity.
        values: values (N,) over the time of the figure.
        desired: reference (N,), if any.
        compared: values of the compared runs by label, over their own time.
        is_integral: True for the integral of the named quantity.
        active: samples (N,) with a wide pale line, if any.
    """

    name: str
    values: np.ndarray
    desired: np.ndarray | None = None
    compared: Mapping[str, np.ndarray] = field(default_factory=dict)
    is_integral: bool = False
    active: np.ndarray | None = None


@dataclass(frozen=True)
class Panel:
    """Lines that share an axis.

    Attributes:
        quantity: what the axis shows.
        unit: its unit, "-" for a number.
        series: lines, at most ``MAX_LINES`` if there are no compared runs.
        note: title of the legend, for example about lines that the panel omits.
        log: True if the axis is logarithmic; it begins at ``bottom``.
        bottom: fixed lower limit of the axis, if any.
        mark: value at which a black line is drawn, if any.
    """

    quantity: str
    unit: str
    series: tuple[Series, ...]
    note: str = ""
    log: bool = False
    bottom: float | None = None
    mark: float | None = None


@dataclass(frozen=True)
class Labels:
    """Texts of a figure by the names that they replace. Formulas are between dollar signs, as in LaTeX.

    Attributes:
        given: text by name of a quantity, a line or an axis.
    """

    given: Mapping[str, str] = field(default_factory=dict)

    def check(self, valid: Iterable[str]) -> None:
        """Raise an error if a label replaces no name of the figure.

        Args:
            valid: names in the figure.

        Raises:
            InputError: unknown name.
        """
        known = list(dict.fromkeys(valid))
        for name in self.given:
            place_of(name, known, "labels: nothing is named", InputError)

    def text(self, name: str) -> str:
        """Text of a name: the given one, or the readable name; dots replace the middle of a long one.

        Args:
            name: name of a quantity, a line or an axis.
        """
        from rnc_pin.figures.style import escape  # Matplotlib takes a second to import

        most = 60  # characters
        short = name if len(name) <= most else f"{name[: most // 2]}...{name[-most // 2 :]}"
        return self.given[name] if name in self.given else escape(short.replace("_", " ").strip())

    def of(self, series: Series) -> str:
        """Text of a line.

        Args:
            series: the line.
        """
        return f"integral of {self.text(series.name)}" if series.is_integral else self.text(series.name)


Size: TypeAlias = Literal["column", "page"] | tuple[float, float]
"""Width of a column or of a page of a paper, or width and height [inches]."""

_PRINT, _SCREEN, _SLIDE = 8.0, 10.0, 14.0  # sizes of text [points]; the text of a slide is the largest
# Lengths in sizes of the text:
_AXES = {True: 13.5, False: 11.0}  # height of axes with the legend beside and above them
LABEL_ROOM = 7.2  # width of the label and the ticks of a vertical axis
GAP, TIME = 1.5, 3.0  # height between panels, and of the labels of the time


@dataclass(frozen=True)
class Grid:
    """Places of panels, filled column by column.

    Attributes:
        rows, columns: numbers of places.
        width: width of the figure [inches].
        place_width: width of a place, in sizes of the text.
    """

    rows: int
    columns: int
    width: float
    place_width: float

    @property
    def beside(self) -> bool:
        """True if legends are beside the axes, False if they are above."""
        return self.place_width >= 45.0  # from here on a legend beside the axes leaves them room


@dataclass(frozen=True)
class Sheet:
    """Size of a figure, and the layout that follows from it.

    Attributes:
        width: width [inches]; None for the screen, where it follows from the number of panels.
        height: height [inches]; None if it follows from the panels.
        font: size of the text [points].
    """

    width: float | None = None
    height: float | None = None
    font: float = _SCREEN

    @classmethod
    def of(cls, size: Size | None) -> Sheet:
        """Sheet of a size: for the screen (None), or as large as it will be on paper or on a slide.

        Text has 8 points on figures up to the width of a page, and grows with wider ones, up to 14 points.

        Args:
            size: size of the figure.

        Raises:
            InputError: another size.
        """
        if size is None:
            return cls()
        widths = {"column": 3.4, "page": 7.0}  # [inches]
        if isinstance(size, str):
            if size not in widths:
                raise InputError(f"size '{size}': expected (width, height) in inches{nearest(size, widths)}")
            return cls(widths[size], None, _PRINT)
        try:
            width, height = (float(each) for each in size)
        except (TypeError, ValueError):
            raise InputError(f"size {size!r}: expected 'column', 'page' or (width, height) in inches") from None
        least = 2.0  # [inches]
        if not (least <= width <= 100.0 and 0.0 < height <= 100.0):
            raise InputError(f"size {size!r}: expected a width from {least:g} and a height, up to 100 inches each")
        return cls(width, height, float(np.clip(_PRINT * width / widths["page"], _PRINT, _SLIDE)))

    def in_text(self, inches: float) -> float:
        """Length in sizes of the text.

        Args:
            inches: the length [inches].
        """
        return inches * 72.0 / self.font

    def grid(self, axes: int, places: int) -> Grid:
        """Grid for a number of axes.

        Args:
            axes: number of axes.
            places: number of places that they need.
        """
        screen_rows = (4, 5, 6)  # largest number of rows in figures for the screen of one, two, and more columns
        screen_widths = (8.0, 7.0)  # of a column in figures for the screen of one and of several columns [inches]
        least_panel = 28.0  # width in sizes of the text
        aspect = 1.9  # preferred width over height of a panel
        if self.width is None:
            within = (k for k, rows in enumerate(screen_rows, start=1) if places <= k * rows)
            columns = next(within, -(-places // screen_rows[-1]))
            width = columns * screen_widths[columns > 1]
        else:
            width = self.width
            columns = max(1, min(axes, int(self.in_text(width) // least_panel)))
            if self.height is not None:
                aspects = [width / k / (self.height / -(-places // k)) / aspect for k in range(1, columns + 1)]
                # On a log scale a panel twice as wide is as far from the best as one half as wide.
                columns = 1 + int(np.argmin(np.abs(np.log(aspects))))
        return Grid(-(-places // columns), columns, width, self.in_text(width / columns))

    def grid_of(self, panels: int, aspect: float | None) -> tuple[Grid, int]:
        """Grid for panels after a view of an aspect (height over width) if there is one, and the rows of the view.

        Args:
            panels: number of panels.
            aspect: height over width of the view; None without a view.
        """
        if aspect is None:
            return self.grid(max(1, panels), max(1, panels)), 0
        view_rows = 2  # largest number of rows of a view beside panels
        most = view_rows if panels else view_rows + 1
        legend = 15.0  # width of a legend beside axes, in sizes of the text
        for rows in range(1, most + 1):
            grid = self.grid(panels + 1, panels + rows)
            width = grid.place_width - LABEL_ROOM - (legend if grid.beside else 0.0)
            if aspect * width <= rows * _AXES[grid.beside]:
                break
        return grid, rows

    def heights(self, grid: Grid, above: float) -> tuple[float, float]:
        """Height of the figure [inches], and height of the axes of a row [sizes of the text].

        Args:
            grid: the grid.
            above: height of the title, and of the legends above the axes of all rows [sizes of the text].

        Raises:
            InputError: the panels do not fit.
        """
        others = above + GAP * grid.rows + TIME
        single = {True: 1.7, False: 1.3}  # height of the only row, over the height of one of several
        axes = _AXES[grid.beside] * (single[grid.beside] if grid.rows == 1 else 1.0)
        least_axes = 5.0  # height in sizes of the text
        if self.height is not None:
            axes = (self.in_text(self.height) - others) / grid.rows
            if axes < least_axes:
                least = (others + least_axes * grid.rows) * self.font / 72.0
                raise InputError(
                    f"size ({self.width:g}, {self.height:g}): its panels need a height of {np.ceil(10 * least) / 10:g} "
                    "inches; plot fewer outputs, or choose 'column' or 'page'"
                )
        return self.height or (axes * grid.rows + others) * self.font / 72.0, axes
