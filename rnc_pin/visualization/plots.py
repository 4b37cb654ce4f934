"""Plots of runs that scenario files choose, and of the distributions of a sweep."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from rnc_pin.collision import Obstacle
from rnc_pin.errors import InputError
from rnc_pin.figures import Labels, Panel, PlaneView, Series, Sheet, Size, draw_paths, panel_figure
from rnc_pin.figures import style as st
from rnc_pin.figures.panel import MAX_LINES
from rnc_pin.figures.style import COLORS, PrintFigure, escape, style
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import LimitReplay, Trajectory, compared_paths, run_name
from rnc_pin.visualization.scene_bodies import hull_from_above, outline, surface_points

_BODY, _EDGE = "0.8", "0.45"  # grey of obstacles and of their outlines
_ROBOT, _ROBOT_EDGE = "0.55", "0.3"  # the same of the robot
_MOMENTS = 5  # number of outlines of the robot


def plot_top_view(
    trajectory: Trajectory,
    title: str | None = None,
    comparisons: Mapping[str, Trajectory] | None = None,
    obstacles: Sequence[Obstacle] = (),
    robot: Robot | None = None,
    size: Size | None = None,
    labels: Labels | None = None,
) -> Figure:
    """Plot the top view of a run: actual paths with heading marks, and desired paths.

    Args:
        trajectory: run to plot.
        title: title above the plot.
        comparisons: other runs by label, dashed.
        obstacles: bodies in the world, with their outlines.
        robot: robot whose outlines are drawn at some moments; none by default.
        size: size of the figure, as for ``Trajectory.plot``.
        labels: texts of names.

    Raises:
        InputError: the run has no path in the plane.
    """
    others, texts = comparisons or {}, labels or Labels()
    paths = compared_paths(trajectory, others)
    if not paths.own:
        raise InputError("the run has no path for a top view: no body on the ground, no planar frame with x and y")

    def draw(axes: Axes) -> list[st.LegendEntry]:
        entries = draw_obstacles(axes, obstacles, trajectory.time)
        if robot is not None:
            entries = [*draw_footprints(axes, robot, trajectory.q), *entries]
        return [*draw_paths(axes, paths, texts, run_name(trajectory, others)), *entries]

    outlines = [outline(each, t) for each in obstacles if not each.unbounded for t in trajectory.time[[0, -1]].tolist()]
    if robot is not None:
        outlines += [each for q in trajectory.q[[0, -1]] for each in footprints(robot, q)]
    view = PlaneView(draw, paths.aspect(outlines))
    return panel_figure((), trajectory.time, Sheet.of(size), title=title, labels=texts, view=view)


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle], time: np.ndarray) -> list[st.LegendEntry]:
    """Draw the outlines of bounded obstacles: filled at the start; those that move also at the end, with paths."""
    lines = []
    for obstacle in obstacles:
        if obstacle.unbounded:
            continue
        first = outline(obstacle, float(time[0]))
        axes.fill(*first.T, color=_BODY, alpha=0.5, zorder=0)
        lines += axes.plot(*np.concatenate([first, first[:1]]).T, color=_EDGE, lw=st.points(0.9), zorder=0.5)
        if obstacle.motion is not None:
            last = outline(obstacle, float(time[-1]))
            axes.plot(*np.concatenate([last, last[:1]]).T, color=_EDGE, lw=st.points(0.9), ls=st.DOTS, zorder=0.5)
            moments = np.linspace(time[0], time[-1], 100).tolist()
            path = np.array([obstacle.placement(t).translation[:2] for t in moments])
            axes.plot(*path.T, color=_EDGE, lw=st.points(0.9), ls=st.DOTS, zorder=0.5)
    return [st.LegendEntry("obstacles", lines[:1])] if lines else []


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


def draw_footprints(axes: Axes, robot: Robot, q: np.ndarray) -> list[st.LegendEntry]:
    """Draw the outlines at moments of a run, (N, nq), darker towards its end. Return the legend entry."""
    lines = []
    for k, index in enumerate(np.linspace(0, len(q) - 1, _MOMENTS).round().astype(int)):
        strength = 0.25 + 0.75 * k / (_MOMENTS - 1)
        for points in footprints(robot, q[index]):
            axes.fill(*points.T, color=_ROBOT, alpha=0.12 * strength, zorder=0.6, lw=0)
            edge = np.concatenate([points, points[:1]])
            lines += axes.plot(*edge.T, color=_ROBOT_EDGE, lw=st.points(0.8), alpha=strength, zorder=0.7)
    return [st.LegendEntry("robot", lines[-1:])] if lines else []


_ACTIVE_DISTANCE = 0.02  # distance below which a pair counts as active [m]
_ACTIVE_SHARE = 0.98  # share of a joint limit above which it counts as active


def plot_limits(
    replay: LimitReplay, title: str | None = None, size: Size | None = None, labels: Labels | None = None
) -> Figure:
    """Plot the smallest distances and the most used joint limits over time; wide pale lines mark the active ones.

    A pair is active below 20 mm, and a joint limit above 98 % of it. Distances beyond ``replay.within`` are not drawn.

    Args:
        replay: result of ``replay_limits``.
        title: title above the plots.
        size: size of the figure, as for ``Trajectory.plot``.
        labels: texts of names.
    """
    panels = [
        *([Panel("distance", "m", _distances(replay), "nearest bodies", zero=True)] if replay.clearances else []),
        *([Panel("beyond limit", "% of its range", _uses(replay), "most used joint limits", zero=True)]
          if replay.uses else []),
    ]  # fmt: skip
    return panel_figure(panels, replay.time, Sheet.of(size), title=title, labels=labels)


def _distances(replay: LimitReplay) -> tuple[Series, ...]:
    found: dict[str, Series] = {}
    for k, each in enumerate(replay.clearances):
        name = " / ".join(each.names)
        if name in found:
            continue  # another shape of the same two bodies, which is farther
        if len(found) == MAX_LINES:
            break
        same = [j for j, other in enumerate(replay.clearances) if other.names == each.names and j >= k]
        values = replay.distances[:, same].min(axis=1)
        values = np.where(values < replay.within, values, np.nan)
        found[name] = Series(name, values, active=values < _ACTIVE_DISTANCE)
    return tuple(found.values())


def _uses(replay: LimitReplay) -> tuple[Series, ...]:
    most = sorted(range(len(replay.uses)), key=lambda k: -replay.uses[k].excess)[:MAX_LINES]
    found = []
    for k in most:
        use, values = replay.uses[k], 100.0 * replay.excesses[:, k]
        found.append(Series(f"{use.kind} of {use.name}", values, active=values > 100.0 * (_ACTIVE_SHARE - 1.0)))
    return tuple(found)


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
    figure.set_layout_engine("constrained")
    if title:
        figure.suptitle(escape(title))
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
        axes.set_xlabel("\n".join(textwrap.wrap(escape(panel.name), _MAX_LABEL)))
        if panel.shares:
            axes.set_ylabel("share of runs [%]")
        else:
            axes.set_ylabel("runs" if number % columns == 0 else "")
            axes.locator_params(axis="y", integer=True)
    if several:
        handles = [Patch(color=colors[label], label=label) for label in labels]
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(labels), beside))
    return figure
