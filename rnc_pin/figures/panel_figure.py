"""Figure of panels over time, with one rule for its layout at any size; and paths of bodies in the plane, from above.

Paths have headings, references, the planned path and compared runs.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend import Legend
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.ticker import NullLocator
from matplotlib.transforms import Affine2D

from rnc_pin.figures import style as st
from rnc_pin.figures.panel import LABEL_ROOM, MAX_LINES, Labels, Panel, Sheet
from rnc_pin.printing import printed


class PlaneView(NamedTuple):
    """Picture that is no function of time.

    Attributes:
        draw: function that draws it into axes and returns its legend entries.
        aspect: its height over its width.
    """

    draw: Callable[[Axes], Sequence[st.LegendEntry]]
    aspect: float


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
    texts, timed = labels or Labels(), list[Axes]()
    grid, view_rows = sheet.grid_of(len(panels), None if view is None else view.aspect)
    character, line_height = 0.62, 1.5  # width of a bold character and height of a line, over the size of the text
    title_lines = 3  # largest number of lines of a title
    above_axes = 0.8  # height above the first axes, for half a number
    with mpl.rc_context(st.style(sheet.font)):
        figure = st.PrintFigure((grid.width, sheet.height or 4.0))
        cells, over = figure.add_gridspec(grid.rows, grid.columns), [0.0] * grid.rows
        room = None if grid.beside else grid.place_width - LABEL_ROOM

        def add_legend(axes: Axes, row: int, entries: Sequence[st.LegendEntry], note: str) -> None:
            if entries:
                extent = _legend(axes, entries, note, room).get_window_extent()
                over[row] = max(over[row], 0.0 if room is None else sheet.in_text(extent.height / figure.dpi))

        if view is not None:
            axes = figure.add_subplot(cells[:view_rows, 0])
            add_legend(axes, 0, view.draw(axes), "")
        for place, panel in enumerate(panels, start=view_rows):
            column, row = divmod(place, grid.rows)
            axes = figure.add_subplot(cells[row, column], sharex=timed[0] if timed else None)
            timed.append(axes)
            add_legend(axes, row, *_draw(axes, panel, time, compared or {}, texts, name))
            last = row == grid.rows - 1 or panel is panels[-1]
            if last:
                axes.set_xlabel(f"{texts.text('time')} [s]")
            axes.tick_params(labelbottom=last)
        width = max(20, int(sheet.in_text(grid.width) / character))
        lines = textwrap.wrap(title or "", width, max_lines=title_lines, placeholder="...")
        if lines:
            figure.suptitle("\n".join(map(st.escape, lines)), x=0.01, ha="left")
        height, of_axes = sheet.heights(grid, sum(over) + above_axes + line_height * len(lines))
        figure.set_size_inches(grid.width, height)
        for axes, panel in zip(timed, panels, strict=True):
            axes.set_ylabel(_axis_label(panel, texts, of_axes))
        figure.align_ylabels()
        # Once, and here: each ``savefig`` would measure all texts again.
        ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.08).execute(figure)
    return figure


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
    own, entries, runs = list[Line2D](), list[st.LegendEntry](), list[st.LegendEntry]()
    active_width = 5.0  # of the pale line at active samples [points]
    for k, series in enumerate(panel.series):
        line = st.line(axes, k, count if series.active is None else MAX_LINES, time, series.values)
        text = texts.of(series)
        if series.active is not None and series.active.any():
            marked, width = np.where(series.active, series.values, np.nan), st.points(active_width)
            axes.plot(time, marked, color=line.get_color(), lw=width, alpha=0.4, solid_capstyle="round")
            text += " (active)"
        own.append(line)
        entries.append(st.LegendEntry(text, [line]))
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
    entries += _draw_desired(axes, [(time, each.desired) for each in panel.series if each.desired is not None], texts)
    if panel.mark is not None:
        axes.axhline(panel.mark, color="black", lw=st.points(0.8))
    axes.margins(x=0.01)
    _limit_axis(axes, panel)
    return entries, note


def _draw_desired(
    axes: Axes, lines: Iterable[np.ndarray | tuple[np.ndarray, np.ndarray]], texts: Labels
) -> list[st.LegendEntry]:
    """Draw desired lines (x, y), and return their legend entry."""
    drawn = [axes.plot(x, y, color="black", ls=st.DOTS, lw=st.points(1.3))[0] for x, y in lines]
    return [st.LegendEntry(texts.text("desired"), drawn[:1])] if drawn else []


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


def _legend(axes: Axes, entries: Sequence[st.LegendEntry], note: str, room: float | None) -> Legend:
    """Add a legend, in which lines of one entry are side by side.

    Args:
        axes: the axes.
        entries: entries.
        note: title of the legend, with escaped characters.
        room: width of a legend above the axes [sizes of the text]; None for one beside them.
    """
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
        if path.headings is None:
            axes.plot(*path.points[-1], "o", color=color, markeredgecolor="white")
        else:
            for sample in path.marks():
                marker = MarkerStyle(_POINTER, transform=Affine2D().rotate(float(path.headings[sample])))
                axes.plot(
                    *path.points[sample], marker=marker, color=color, markersize=st.points(13.0),
                    markeredgecolor="white", markeredgewidth=st.points(0.7), zorder=3,
                )  # fmt: skip
        axes.plot(*path.points[0], "o", color="white", markeredgecolor=color, markersize=st.points(7.0), zorder=4)
    compared = _compared(axes, paths, texts)
    if compared and len(own) == 1:
        entries.append(st.LegendEntry(f"{texts.text(name)} ({texts.text(paths.own[0].name)})", own))
    else:
        entries += [st.LegendEntry(texts.text(path.name), [line]) for path, line in zip(paths.own, own, strict=True)]
        entries += [st.LegendEntry(texts.text(name), own)] if compared else []
    entries += compared
    desired = [path.desired.T for path in paths.own if path.desired is not None and path.goal is None]
    entries += _draw_desired(axes, desired, texts)
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
