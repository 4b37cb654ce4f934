"""Figures of a run. Every function returns a Matplotlib figure; ``plot_style.save`` writes it to a file.

``panels`` defines the panels over time. ``top_view`` draws the view from above.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.collision import Obstacle
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import LimitReplay, Trajectory
from rnc_pin.visualization import panels as p
from rnc_pin.visualization import plot_style as ps
from rnc_pin.visualization.panels import MAX_LINES, readable_name
from rnc_pin.visualization.surroundings import hull_from_above, outline, surface_points
from rnc_pin.visualization.top_view import draw_obstacles, draw_top_view, ground_paths

_WIDTH, _NARROW = 8.0, 7.0  # width of a panel and its legend in figures of one and of several columns [inches]
_MAX_TITLE, _TITLE_LINES = 64, 3  # characters per line that fit a figure of one column; largest number of lines
_HEIGHT = 2.1  # height of a panel [inches]
_ROWS = (4, 5, 6)  # largest number of rows in figures of one, two, and more columns
_VIEW_HEIGHTS = 3.2, 6.0  # smallest and largest height of a top view without panels [inches]
_VIEW = 2  # height of a top view beside panels, in panels


@ps.styled
def plot_outputs(
    trajectory: Trajectory,
    outputs: Sequence[str],
    title: str | None = None,
    comparisons: Mapping[str, Trajectory] | None = None,
) -> Figure:
    """Plot outputs over time, grouped by quantity: actual solid, desired dotted, other runs dashed.

    Args:
        trajectory: run to plot.
        outputs: names of reducing or vertical outputs.
        title: title above the plot.
        comparisons: other runs by label.
    """
    return _stacked(trajectory, p.outputs(trajectory, comparisons or {}, outputs), title, comparisons or {})


@ps.styled
def plot_learning(
    trajectory: Trajectory,
    quantity: str,
    title: str | None = None,
    comparisons: Mapping[str, Trajectory] | None = None,
) -> Figure:
    """Plot the parameter estimates or the prediction error of a controller over time.

    Args:
        trajectory: run to plot.
        quantity: "estimates" or "prediction_error".
        title: title above the plot.
        comparisons: other runs by label, dashed.
    """
    return _stacked(trajectory, p.learning_panels(trajectory, comparisons or {}, quantity), title, comparisons or {})


@ps.styled
def plot_top_view(
    trajectory: Trajectory,
    title: str | None = None,
    comparisons: Mapping[str, Trajectory] | None = None,
    obstacles: Sequence[Obstacle] = (),
    robot: Robot | None = None,
) -> Figure:
    """Plot the top view of a run: actual paths with heading marks, and desired paths.

    Args:
        trajectory: run to plot.
        title: title above the plot.
        comparisons: other runs by label, dashed.
        obstacles: bodies in the world, with their outlines.
        robot: robot whose outlines are drawn at some moments; none by default.

    Raises:
        InputError: the run has no path in the plane.
    """
    paths = ground_paths(trajectory)
    if not paths:
        raise InputError("the run has no path for a top view: no body on the ground, no planar frame with x and y")
    bounded = [each for each in obstacles if not each.unbounded]
    outlines = [outline(each, t) for each in bounded for t in trajectory.time[[0, -1]].tolist()]
    if robot is not None:
        outlines += [each for q in trajectory.q[[0, -1]] for each in footprints(robot, q)]
    across, up = np.ptp(np.concatenate([*(path.points for path in paths), *outlines]), axis=0)
    height = np.clip(0.7 * _WIDTH * up / max(across, 1e-9) + 1.2, *_VIEW_HEIGHTS)
    figure = ps.PrintFigure(figsize=(_WIDTH, float(height)))
    axes = figure.subplots()
    entries = draw_obstacles(axes, obstacles, trajectory.time)
    if robot is not None:
        entries = [*draw_footprints(axes, robot, trajectory.q), *entries]
    ps.legend_beside(axes, [*draw_top_view(axes, trajectory, comparisons or {}), *entries])
    _title(axes, title)
    _layout_once(figure)
    return figure


@ps.styled
def plot_run(
    trajectory: Trajectory, title: str | None = None, comparisons: Mapping[str, Trajectory] | None = None
) -> Figure:
    """Plot a run of any system: top view, and outputs, errors, inputs, estimates and singularity margin over time.

    Args:
        trajectory: run to plot.
        title: title above the plots.
        comparisons: other runs by label, dashed.

    Raises:
        InputError: the run has fewer than two samples.
    """
    if len(trajectory.time) < 2:
        raise InputError(f"the run has too few samples to plot: {len(trajectory.time)}, expected at least 2")
    others = comparisons or {}
    shown = p.panels(trajectory, others)
    above = _VIEW if ground_paths(trajectory) else 0
    rows, columns = _layout(above + len(shown))
    figure = ps.PrintFigure(figsize=(_WIDTH if columns == 1 else _NARROW * columns, _HEIGHT * rows + 0.4))
    grid = figure.add_gridspec(rows, columns)
    first: Axes | None = None
    if above:
        first = figure.add_subplot(grid[:above, 0])
        ps.legend_beside(first, draw_top_view(first, trajectory, others))
        _layout_once(figure)
    timed: list[Axes] = []
    for place, panel in enumerate(shown, start=above):
        axes = figure.add_subplot(grid[place % rows, place // rows], sharex=timed[0] if timed else None)
        timed.append(axes)
        _draw(axes, panel, trajectory, others)
        _label_time(axes, last=place % rows == rows - 1 or panel is shown[-1])
    figure.align_labels_of(timed)
    _title(first or timed[0], title)
    return figure


def write_plots(
    trajectory: Trajectory,
    path: str | Path,
    title: str,
    comparisons: Mapping[str, Trajectory] | None = None,
    replace: bool = True,
) -> Path:
    """Write the figure of ``plot_run``.

    Args:
        trajectory: run to plot.
        path: file name that ends in .png, .pdf or .svg.
        title: title above the plots.
        comparisons: other runs by label, dashed.
        replace: True replaces an existing file.

    Raises:
        ConfigurationError: the file name has another suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in (".png", ".pdf", ".svg"):
        raise ConfigurationError(f"{path}: expected a name that ends in .png, .pdf or .svg")
    return ps.save(plot_run(trajectory, title, comparisons), path, replace)


def _layout_once(figure: Figure) -> None:
    """Run the layout once before drawing: equal scales change the ticks. The next layout makes room for the labels."""
    layout = figure.get_layout_engine()
    assert layout is not None
    layout.execute(figure)


def _layout(places: int) -> tuple[int, int]:
    """Rows and columns for a number of panels."""
    columns = next((k for k, rows in enumerate(_ROWS, start=1) if places <= k * rows), -(-places // _ROWS[-1]))
    return -(-places // columns), columns


def _stacked(run: Trajectory, shown: Sequence[p.Panel], title: str | None, others: p.Others) -> Figure:
    """Figure with one column of panels."""
    height = 3.6 if len(shown) == 1 else _HEIGHT * len(shown) + 0.5
    figure = ps.PrintFigure(figsize=(_WIDTH, height))
    stack = figure.subplots(max(1, len(shown)), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(stack, shown, strict=False):
        _draw(axes, panel, run, others)
    _label_time(stack[-1], last=True)
    figure.align_labels_of(stack)
    _title(stack[0], title)
    return figure


def _draw(axes: Axes, panel: p.Panel, run: Trajectory, others: p.Others) -> None:
    """Draw a panel: actual solid, desired dotted, other runs dashed, in the colours of the legend."""
    count = len(panel.series)
    entries = [
        ps.LegendEntry(series.name, [ps.line(axes, k, count, run.time, series.values)])
        for k, series in enumerate(panel.series)
    ]
    for run_index, (style, label) in enumerate(ps.dashes(others)):
        lines = []
        for k, series in enumerate(panel.series):
            if label in series.compared:
                color = ps.color_of(k, count, run_index)
                lines += axes.plot(others[label].time, series.compared[label], color=color, ls=style, lw=1.4)
        if lines:
            entries.append(ps.LegendEntry(label, lines))
    # Desired lines are drawn last: a solid line that follows them closely would hide them.
    desired = [
        axes.plot(run.time, series.desired, color="black", ls=ps.DOTS, lw=1.3)[0]
        for series in panel.series
        if series.desired is not None
    ]
    if desired:
        entries.append(ps.LegendEntry("desired", desired[:1]))
    axes.set_ylabel(panel.label)
    axes.margins(x=0.01)
    if panel.log:
        axes.set_yscale("log")
    if panel.bottom is not None:
        drawn = [values for each in panel.series for values in (each.values, *each.compared.values())]
        top = max((float(np.nanmax(values, initial=0.0)) for values in drawn), default=0.0)
        axes.set_ylim(panel.bottom, max(2 * top, 100 * panel.bottom) if panel.log else max(1.1 * top, 1e-3))
    if not (panel.log or panel.bottom is not None):
        _limit_zoom(axes)
    ps.legend_beside(axes, entries, panel.note)


def _limit_zoom(axes: Axes) -> None:
    """Enlarge the range of an axis that would show only rounding errors."""
    low, high = axes.get_ylim()
    least = 1e-6 * max(1.0, abs(low), abs(high))
    if high - low < least:
        axes.set_ylim((low + high - least) / 2, (low + high + least) / 2)


def _label_time(axes: Axes, last: bool) -> None:
    if last:
        axes.set_xlabel("time [s]")
    axes.tick_params(labelbottom=last)


def _title(axes: Axes, title: str | None) -> None:
    if title:
        lines = textwrap.wrap(title, _MAX_TITLE, max_lines=_TITLE_LINES, placeholder="...")
        axes.set_title("\n".join(ps.escape_dollars(line) for line in lines), loc="left")


# ------------------------------------------------------------------ footprints

_MOMENTS = 5
_FACE, _EDGE = "0.55", "0.3"


def footprints(robot: Robot, q: np.ndarray) -> list[np.ndarray]:
    """Outline (n, 2) [m] of every moving part from above at a configuration (nq,): the hull of its collision shapes."""
    source = robot.collision_model
    if source is None:
        return []
    data, placed = robot.model.createData(), source.createData()
    pin.updateGeometryPlacements(robot.model, data, source, placed, q)
    parts: dict[int, list[np.ndarray]] = {}
    for shape, pose in zip(source.geometryObjects, placed.oMg, strict=True):
        points = surface_points(shape.geometry) @ pose.rotation.T + pose.translation
        parts.setdefault(int(shape.parentJoint), []).append(points)
    return [hull_from_above(np.concatenate(points)) for joint, points in parts.items() if joint]


def draw_footprints(axes: Axes, robot: Robot, q: np.ndarray) -> list[ps.LegendEntry]:
    """Draw the outlines at moments of a run, (N, nq), darker towards its end. Return the legend entry."""
    lines = []
    for k, index in enumerate(np.linspace(0, len(q) - 1, _MOMENTS).round().astype(int)):
        strength = 0.25 + 0.75 * k / (_MOMENTS - 1)
        for points in footprints(robot, q[index]):
            axes.fill(*points.T, color=_FACE, alpha=0.12 * strength, zorder=0.6, lw=0)
            lines += axes.plot(*np.concatenate([points, points[:1]]).T, color=_EDGE, lw=0.8, alpha=strength, zorder=0.7)
    return [ps.LegendEntry("robot", lines[-1:])] if lines else []


# ------------------------------------------------------------------ distances and joint limits

_LIMITS_HEIGHT = 2.6  # height of a panel [inches]
_ACTIVE_DISTANCE = 0.02  # distance below which a pair counts as active [m]
_ACTIVE_SHARE = 0.98  # share of a joint limit above which it counts as active
_ACTIVE_WIDTH = 5.0


@ps.styled
def plot_limits(replay: LimitReplay, title: str | None = None) -> Figure:
    """Plot the smallest distances and the most used joint limits over time; wide pale lines mark the active ones.

    A pair is active below 20 mm, and a joint limit above 98 % of it. Distances beyond ``replay.within`` are not drawn.

    Args:
        replay: result of ``replay_limits``.
        title: title above the plots.
    """
    count = bool(replay.clearances) + bool(replay.uses)
    figure = ps.PrintFigure(figsize=(_WIDTH, _LIMITS_HEIGHT * max(count, 1) + 0.5))
    panels = list(figure.subplots(max(count, 1), 1, sharex=True, squeeze=False)[:, 0])
    for axes, draw in zip(panels, [_distances] * bool(replay.clearances) + [_uses] * bool(replay.uses), strict=False):
        draw(axes, replay)
        axes.margins(x=0.01)
    panels[-1].set_xlabel("time [s]")
    figure.align_labels_of(panels)
    if title:
        panels[0].set_title(ps.escape_dollars(title), loc="left", wrap=True)
    return figure


def _distances(axes: Axes, replay: LimitReplay) -> None:
    names: list[str] = []
    entries = []
    for k, each in enumerate(replay.clearances):
        name = " / ".join(map(readable_name, each.names))
        if name in names:
            continue  # another shape of the same two bodies, which is farther
        if len(names) == MAX_LINES:
            break
        names.append(name)
        same = [j for j, other in enumerate(replay.clearances) if other.names == each.names and j >= k]
        values = replay.distances[:, same].min(axis=1)
        values = np.where(values < replay.within, values, np.nan)
        entries.append(_line(axes, len(names) - 1, name, replay.time, values, values < _ACTIVE_DISTANCE))
    axes.axhline(0.0, color="black", lw=0.8)
    axes.set_ylabel("distance [m]")
    ps.legend_beside(axes, entries, "nearest bodies")


def _uses(axes: Axes, replay: LimitReplay) -> None:
    most = sorted(range(len(replay.uses)), key=lambda k: -replay.uses[k].excess)[:MAX_LINES]
    entries = []
    for place, k in enumerate(most):
        use = replay.uses[k]
        values = 100.0 * replay.excesses[:, k]
        name = f"{use.kind} of {readable_name(use.name)}"
        entries.append(_line(axes, place, name, replay.time, values, values > 100.0 * (_ACTIVE_SHARE - 1.0)))
    axes.axhline(0.0, color="black", lw=0.8)
    axes.set_ylabel("beyond limit\n[% of its range]")
    ps.legend_beside(axes, entries, "most used joint limits")


def _line(
    axes: Axes, place: int, name: str, time: np.ndarray, values: np.ndarray, active: np.ndarray
) -> ps.LegendEntry:
    drawn = ps.line(axes, place, MAX_LINES, time, values)
    if active.any():
        marked = np.where(active, values, np.nan)
        axes.plot(time, marked, color=drawn.get_color(), lw=_ACTIVE_WIDTH, alpha=0.4, solid_capstyle="round")
        name = f"{name} (active)"
    return ps.LegendEntry(name, [drawn])
