"""Figure of panels over time, with one rule for its layout at any size; and paths of bodies in the plane, from above.

Paths have headings, references, the planned path and compared runs.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.ticker import NullLocator
from matplotlib.transforms import Affine2D

from rnc_pin.figures import style as st
from rnc_pin.figures.panel import GAP, LABEL_ROOM, MAX_LINES, TIME, Grid, Labels, Panel, Series, Sheet
from rnc_pin.printing import printed


class PlaneView(NamedTuple):
    """Picture that is no function of time.

    Attributes:
        draw: function that draws it into axes and returns its legend entries.
        aspect: its height over its width.
    """

    draw: Callable[[Axes], Sequence[st.LegendEntry]]
    aspect: float


# Lengths in sizes of the text:
_PAD = 0.5  # width between numbers and labels

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def panel_figure(
    panels: Sequence[Panel],
    time: np.ndarray,
    sheet: Sheet,
    *,
    title: str | None = None,
    labels: Labels | None = None,
    name: str = "",
    compared: Mapping[str, np.ndarray] | None = None,
    view: PlaneView | None = None,
) -> Figure:
    """Draw panels over time: actual solid, desired dotted, compared runs dashed.

    Args:
        panels: the panels.
        time: times (N,) of their samples [s].
        sheet: size of the figure.
        title: title above the panels.
        labels: texts that replace names.
        name: legend entry of the run if others are compared with it.
        compared: times of the samples of compared runs, by label [s].
        view: picture before the panels.

    Raises:
        InputError: the panels do not fit the height of the sheet.
    """
    texts = labels or Labels()
    grid, above = sheet.grid_of(len(panels), None if view is None else view.aspect)
    character, line_height = 0.62, 1.5  # width of a bold character and height of a line, over the size of the text
    title_lines = 3  # largest number of lines of a title
    above_axes = 0.8  # height above the first axes, for half a number
    with mpl.rc_context(st.style(sheet.font)):
        figure = st.PrintFigure((grid.width, sheet.height or 4.0))
        room = None if sheet.is_beside(grid) else sheet.in_text(grid.width / grid.columns) - LABEL_ROOM
        cells: list[_Cell] = []
        if view is not None:
            axes = figure.add_subplot()
            cells.append(_Cell(axes, 0, range(above), _legend(axes, view.draw(axes), "", room)))
        timed: list[Axes] = []
        for place, panel in enumerate(panels, start=above):
            axes = figure.add_subplot(sharex=timed[0] if timed else None)
            timed.append(axes)
            entries, note = _draw(axes, panel, time, compared or {}, texts, name)
            column, row = divmod(place, grid.rows)
            cells.append(_Cell(axes, column, range(row, row + 1), _legend(axes, entries, note, room)))
            last = row == grid.rows - 1 or panel is panels[-1]
            if last:
                axes.set_xlabel(f"{texts.text('time')} [s]")
            axes.tick_params(labelbottom=last)
        width = max(20, int(sheet.in_text(grid.width) / character))
        lines = textwrap.wrap(title or "", width, max_lines=title_lines, placeholder="...")
        if lines:
            shown = figure.suptitle("\n".join(map(st.escape, lines)), x=0.01, ha="left")
        over = [0.0] * grid.rows
        for cell in cells if room is not None else ():
            over[cell.rows[0]] = max(over[cell.rows[0]], cell.legend_size[1])
        top = above_axes + (line_height * len(lines) + _PAD if lines else 0.0)
        height, of_axes = sheet.heights(grid, sum(over) + top)
        figure.set_size_inches(grid.width, height)
        if lines:
            shown.set_y(1.0 - _PAD / sheet.in_text(height))
        for axes, panel in zip(timed, panels, strict=True):
            axes.set_ylabel(_axis_label(panel, texts, of_axes))
        tops = [top + sum(over[: row + 1]) + row * (of_axes + GAP) for row in range(grid.rows)]
        for column in range(grid.columns):
            _arrange([cell for cell in cells if cell.column == column], grid, tops, of_axes, room is None)
    return figure


@dataclass
class _Cell:
    """Axes in a column of a figure, over one or several rows. Lengths are in sizes of the figure's text."""

    axes: Axes
    column: int
    rows: range
    legend: Legend | None

    def in_text(self, pixels: float) -> float:
        """Length on the figure in sizes of its text."""
        figure = self.axes.get_figure(root=True)
        assert figure is not None
        return float(pixels / figure.dpi * 72.0 / mpl.rcParams["font.size"])

    @property
    def legend_size(self) -> tuple[float, float]:
        """Width and height of the legend as Matplotlib measures it."""
        if self.legend is None:
            return 0.0, 0.0
        extent = self.legend.get_window_extent()
        return self.in_text(extent.width), self.in_text(extent.height)

    def ticks(self) -> float:
        """Width of the numbers of the vertical axis."""
        axis = self.axes.yaxis
        axis.set_label_coords(0.0, 0.5)  # where it is placed later; Matplotlib then looks for no place
        axis.label.set_visible(False)
        extent = axis.get_tightbbox()
        axis.label.set_visible(True)
        return 0.0 if extent is None else self.in_text(self.axes.bbox.x0 - extent.x0)


def _arrange(cells: Sequence[_Cell], grid: Grid, tops: Sequence[float], height: float, beside: bool) -> None:
    """Place the axes of a column, with their labels in a line. Lengths are in sizes of the text.

    Each vertical axis is measured once: Matplotlib's constrained layout measures all axes four times.

    Args:
        cells: the axes.
        grid: the grid of the figure in its final size.
        tops: distance of the axes of each row from the top of the figure.
        height: height of the axes of a row.
        beside: True if legends are beside the axes.
    """
    figure = cells[0].axes.figure
    width, whole = (cells[0].in_text(pixels) for pixels in figure.bbox.size)
    side = 1.6  # width at the right of the axes
    right = side + (max(cell.legend_size[0] for cell in cells) if beside else 0.0)

    def place(left: float) -> None:
        for cell in cells:
            end = tops[cell.rows[-1]] + height
            if cell.axes.get_xlabel() and cell is not cells[-1]:
                end -= TIME - GAP
            start = cell.column * width / grid.columns + left
            across, down = width / grid.columns - left - right, end - tops[cell.rows[0]]
            cell.axes.set_position((start / width, 1.0 - end / whole, across / width, down / whole))
            cell.axes.apply_aspect()

    # First with room for a label of usual size, to measure the numbers; then with the room that they need. With equal
    # scales, this room changes the limits and perhaps the numbers: they are measured once more.
    lines = max(1 + cell.axes.get_ylabel().count("\n") for cell in cells)
    label_line = 1.35  # width of a line of a label
    left, ticks = LABEL_ROOM, 0.0
    for _ in range(1 + any(cell.axes.get_aspect() != "auto" for cell in cells)):
        place(left)
        ticks = max(ticks, *(cell.ticks() + _PAD for cell in cells))
        left = ticks + label_line * lines + _PAD
    place(left)
    numbers_height = 1.9  # of the time
    for cell in cells:
        across, down = (cell.in_text(pixels) for pixels in cell.axes.bbox.size)
        cell.axes.yaxis.set_label_coords(-ticks / across, 0.5)
        cell.axes.xaxis.set_label_coords(0.5, -numbers_height / down)


def _axis_label(panel: Panel, texts: Labels, height: float) -> str:
    """Label of the vertical axis, in lines within a height [sizes of the text]."""
    quantity, unit = texts.text(panel.quantity), st.unit_text(panel.unit)
    if panel.quantity in texts.given:
        return f"{quantity} [{unit}]"
    lines = textwrap.wrap(f"{quantity} [{unit.replace(' ', chr(160))}]", max(14, int(height / 0.54)))
    return "\n".join(lines).replace(chr(160), " ")


def _draw(
    axes: Axes, panel: Panel, time: np.ndarray, compared: Mapping[str, np.ndarray], texts: Labels, name: str
) -> tuple[list[st.LegendEntry], str]:
    """Draw a panel. Return the entries and the title of its legend: lines by name, then runs."""
    count, note = len(panel.series), st.escape(panel.note)
    own = [_draw_series(axes, series, k, count, time) for k, series in enumerate(panel.series)]
    entries = [
        st.LegendEntry(texts.of(series) + (" (active)" if _is_active(series) else ""), [line])
        for series, line in zip(panel.series, own, strict=True)
    ]
    runs = []
    for number, (dashes, label) in enumerate(st.dashes(compared)):
        lines = []
        for k, series in enumerate(panel.series):
            if label in series.compared:
                color = st.color_of(k, count, number)
                lines += axes.plot(compared[label], series.compared[label], color=color, ls=dashes, lw=st.points(1.4))
        if lines:
            runs.append(st.LegendEntry(texts.text(label), lines))
    if runs:
        if count == 1:
            note, entries = ", ".join(filter(None, (texts.of(panel.series[0]), note))), []
        entries += [st.LegendEntry(texts.text(name), own), *runs]
    # Desired lines are drawn last: a solid line that follows them closely would hide them.
    desired = [
        axes.plot(time, series.desired, color="black", ls=st.DOTS, lw=st.points(1.3))[0]
        for series in panel.series
        if series.desired is not None
    ]
    if desired:
        entries.append(st.LegendEntry(texts.text("desired"), desired[:1]))
    if panel.mark is not None:
        axes.axhline(panel.mark, color="black", lw=st.points(0.8))
    axes.margins(x=0.01)
    _limit_axis(axes, panel)
    return entries, note


def _draw_series(axes: Axes, series: Series, k: int, count: int, time: np.ndarray) -> Line2D:
    """Draw the k-th line of a panel with its active samples."""
    line = st.line(axes, k, MAX_LINES if series.active is not None else count, time, series.values)
    active_width = 5.0  # of the pale line at active samples [points]
    if series.active is not None and _is_active(series):
        marked = np.where(series.active, series.values, np.nan)
        axes.plot(time, marked, color=line.get_color(), lw=st.points(active_width), alpha=0.4, solid_capstyle="round")
    return line


def _is_active(series: Series) -> bool:
    return series.active is not None and bool(series.active.any())


def _limit_axis(axes: Axes, panel: Panel) -> None:
    """Set the range of the vertical axis where the values alone give none that can be read."""
    if panel.log:
        axes.set_yscale("log")
        # Matplotlib's own labels are formulas, which take a third of the time of a figure. Powers of ten are enough.
        axes.yaxis.set_major_formatter(lambda value, _: f"10{str(round(np.log10(value))).translate(_RAISED)}")
        axes.yaxis.set_minor_locator(NullLocator())
    if panel.bottom is not None:
        drawn = [values for each in panel.series for values in (each.values, *each.compared.values())]
        top = max((float(np.nanmax(values, initial=0.0)) for values in drawn), default=0.0)
        axes.set_ylim(panel.bottom, max(2 * top, 100 * panel.bottom) if panel.log else max(1.1 * top, 1e-3))
    elif not panel.log:
        low, high = axes.get_ylim()
        least = 1e-6 * max(1.0, abs(low), abs(high))  # a smaller range would show only rounding errors
        if high - low < least:
            axes.set_ylim((low + high - least) / 2, (low + high + least) / 2)


def _legend(axes: Axes, entries: Sequence[st.LegendEntry], note: str, room: float | None) -> Legend | None:
    """Add a legend, in which lines of one entry are side by side.

    Args:
        axes: the axes.
        entries: entries.
        note: title of the legend, with escaped characters.
        room: width of a legend above the axes [sizes of the text]; None for one beside them.

    Returns:
        The legend; None without entries.
    """
    if not entries:
        return None
    beside = room is None
    line_limit = 30  # characters: longer lines beside the axes would leave them too little room
    narrow = 0.5  # width of a character of a legend, over the size of the figure's text
    handle = 6  # characters that the line of an entry and the gap between columns need
    widest = line_limit if room is None else int(room / narrow) - handle
    texts = [_broken(entry.text, widest) for entry in entries]
    longest = handle + max(len(line) for text in texts for line in text.split("\n"))
    handles = [entry.lines[0] if len(entry.lines) == 1 else tuple(entry.lines) for entry in entries]
    return axes.legend(
        handles, texts, title=_broken(note, widest) or None,
        ncols=1 if room is None else min(len(texts), max(1, int(room / narrow / longest))),
        loc="center left" if beside else "lower left", bbox_to_anchor=(1.01, 0.5) if beside else (0.0, 1.0),
        borderaxespad=0.5 if beside else 0.0, borderpad=0.4, alignment="left", columnspacing=1.2, labelspacing=0.35,
        handlelength=2.4, handletextpad=0.6, handler_map={tuple: HandlerTuple(ndivide=None, pad=0.4)},
    )  # fmt: skip


def _broken(text: str, widest: int) -> str:
    """Break a long text into several lines; a text with a formula is kept whole."""
    if "$" in text.replace("\\$", ""):
        return text
    return "\n".join(textwrap.wrap(text, max(8, widest))) or text


# ------------------------------------------------------------------ paths from above

MIN_HALF_SIZE = 0.05  # smallest half width and half height of the picture [m]
_POINTER = Path([(1.2, 0.0), (-0.8, 0.62), (-0.45, 0.0), (-0.8, -0.62), (1.2, 0.0)], closed=True)


@printed(points="m", headings="rad", desired="m")
@dataclass(frozen=True)
class GroundPath:
    """Path of a point in the plane.

    Attributes:
        name: name of the body or frame.
        points: positions (N, 2) [m].
        headings: headings (N,) [rad]; None if the point has no heading.
        desired: desired positions (N, 2) [m]; None if there is no goal.
    """

    name: str
    points: np.ndarray
    headings: np.ndarray | None = None
    desired: np.ndarray | None = None

    @property
    def extent(self) -> float:
        """Longer side of the bounding box [m]."""
        return float(np.ptp(self.points, axis=0).max(initial=0.0))

    @property
    def goal(self) -> np.ndarray | None:
        """Constant desired position (2,) [m]; None without a goal, or if the desired position varies."""
        # A goal that moves by rounding only is drawn as a cross, not as a path of no length.
        if self.desired is None or not np.allclose(self.desired, self.desired[-1], rtol=0.0, atol=1e-9):
            return None
        return np.asarray(self.desired[-1])

    def marks(self) -> np.ndarray:
        """Indices of the samples with heading marks, evenly along the path; rotation in place counts as distance."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        turn_length = 0.15  # distance that counts as a turn of 1 rad, over the extent of the path
        if self.headings is not None:
            steps = steps + turn_length * max(self.extent, MIN_HALF_SIZE) * np.abs(np.diff(np.unwrap(self.headings)))
        distance = np.concatenate([[0.0], np.cumsum(steps)])
        if not distance[-1] > 0:
            return np.array([0, len(distance) - 1])
        count = 12  # eleven equal parts, so that marks of two laps do not coincide
        return np.unique(np.searchsorted(distance, np.linspace(0.0, distance[-1], count)).clip(max=len(distance) - 1))


@printed(planned="m")
@dataclass(frozen=True)
class GroundPaths:
    """Paths of a run, the planned path, and the paths of compared runs.

    Attributes:
        own: paths of the run.
        planned: points (K, 2) [m] of the planned path, if any.
        compared: paths of the compared runs by label.
    """

    own: Sequence[GroundPath]
    planned: np.ndarray | None = None
    compared: Mapping[str, Sequence[GroundPath]] = field(default_factory=dict)

    def aspect(self, further: Sequence[np.ndarray] = ()) -> float:
        """Height over width of the paths and of further points (n, 2).

        Args:
            further: points that the picture has to show too [m].
        """
        every = [path.points for paths in (self.own, *self.compared.values()) for path in paths]
        planned = [] if self.planned is None else [self.planned]
        across, up = np.maximum(np.ptp(np.concatenate([*every, *planned, *further]), axis=0), 2 * MIN_HALF_SIZE)
        return float(up / across)


def draw_paths(axes: Axes, paths: GroundPaths, texts: Labels, name: str = "") -> list[st.LegendEntry]:
    """Draw paths from above: actual solid, desired dotted, planned in long dashes, compared runs wide and pale.

    Args:
        axes: axes to draw into.
        paths: the paths.
        texts: texts of the legend and of the axes.
        name: legend entry of the run if others are compared with it.

    Returns:
        Legend entries.
    """
    entries: list[st.LegendEntry] = []
    plan_color = "#8a8a8a"  # grey, beside the colours of the bodies
    if paths.planned is not None:
        planned = axes.plot(*paths.planned.T, color=plan_color, ls=(0, (4, 2)), lw=st.points(2.4), zorder=1)
        entries.append(st.LegendEntry(texts.text("planned path"), planned))
    own = []
    for k, path in enumerate(paths.own):
        color = st.COLORS[k]
        own += axes.plot(*path.points.T, color=color, lw=st.points(1.8))
        if path.headings is not None:
            _draw_headings(axes, path, color)
        else:
            axes.plot(*path.points[-1], "o", color=color, markeredgecolor="white")
        axes.plot(*path.points[0], "o", color="white", markeredgecolor=color, markersize=st.points(7.0), zorder=4)
    compared = _compared(axes, paths, texts)
    if compared and len(own) == 1:
        entries.append(st.LegendEntry(f"{texts.text(name)} ({texts.text(paths.own[0].name)})", own))
    else:
        entries += [st.LegendEntry(texts.text(path.name), [line]) for path, line in zip(paths.own, own, strict=True)]
        entries += [st.LegendEntry(texts.text(name), own)] if compared else []
    entries += compared
    desired = [path.desired for path in paths.own if path.desired is not None and path.goal is None]
    lines = [axes.plot(*points.T, color="black", ls=st.DOTS, lw=st.points(1.3))[0] for points in desired]
    if lines:
        entries.append(st.LegendEntry(texts.text("desired"), lines[:1]))
    goals = [path.goal for path in paths.own if path.goal is not None]
    if goals:
        x, y = np.transpose(goals)
        crosses = axes.plot(x, y, "x", color="black", markersize=st.points(7.0), mew=st.points(1.8))
        entries.append(st.LegendEntry(texts.text("goal"), crosses))
    axes.set_xlabel(f"{texts.text('x')} [m]")
    axes.set_ylabel(f"{texts.text('y')} [m]")
    # Equal scales on both axes, and a minimum size so that a robot at rest is a dot.
    middle = np.array([(axes.dataLim.x0 + axes.dataLim.x1) / 2, (axes.dataLim.y0 + axes.dataLim.y1) / 2])
    axes.update_datalim([middle - MIN_HALF_SIZE, middle + MIN_HALF_SIZE])
    axes.margins(0.08)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    return entries


def _compared(axes: Axes, paths: GroundPaths, texts: Labels) -> list[st.LegendEntry]:
    """Draw other runs as wide pale lines below the run, so that both are visible where they coincide."""
    entries = []
    pale_width = 4.5  # [points]: wide enough to be seen on both sides of the own path
    names, width = [each.name for each in paths.own], st.points(pale_width)
    for j, (style, label) in enumerate(st.dashes(paths.compared)):
        lines = []
        for path in paths.compared[label]:
            if path.name in names:
                color = st.pale(st.color_of(names.index(path.name), len(names), j))
                lines += axes.plot(*path.points.T, color=color, ls=st.scaled(style, width), lw=width, zorder=1.5)
        if lines:
            entries.append(st.LegendEntry(texts.text(label), lines))
    return entries


def _draw_headings(axes: Axes, path: GroundPath, color: str) -> None:
    assert path.headings is not None
    for sample in path.marks():
        marker = MarkerStyle(_POINTER, transform=Affine2D().rotate(float(path.headings[sample])))
        axes.plot(
            *path.points[sample], marker=marker, color=color, markersize=st.points(13.0), markeredgecolor="white",
            markeredgewidth=st.points(0.7), zorder=3,
        )  # fmt: skip
