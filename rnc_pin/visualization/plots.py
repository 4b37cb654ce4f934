"""Plots of runs that scenario files choose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.collision import Obstacle
from rnc_pin.errors import InputError
from rnc_pin.figures import Labels, Panel, PlaneView, Series, Sheet, Size, draw_paths, panel_figure
from rnc_pin.figures import style as st
from rnc_pin.figures.panel import MAX_LINES
from rnc_pin.robots.robot import Robot
from rnc_pin.simulation import LimitReplay, Trajectory, compared_paths, run_name
from rnc_pin.visualization.elements import SceneKinematics
from rnc_pin.visualization.scene_bodies import hull_from_above, outline, points_at

_ROBOT, _ROBOT_EDGE = "0.55", "0.3"  # the same of the robot


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

    # At both ends only: they set the size of the view, which moving obstacles may leave between.
    outlines = [outline(each, t) for each in obstacles if not each.unbounded for t in trajectory.time[[0, -1]].tolist()]
    if robot is not None:
        outlines += [each for q in trajectory.q[[0, -1]] for each in footprints(robot, q)]
    view = PlaneView(draw, paths.aspect(outlines))
    return panel_figure((), trajectory.time, Sheet.of(size), title=title, labels=texts, view=view)


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle], time: np.ndarray) -> list[st.LegendEntry]:
    """Draw the outlines of bounded obstacles: filled at the start; moving obstacles also at the end, with paths.

    Args:
        axes: axes to draw into.
        obstacles: the obstacles.
        time: times (N,) of the run [s].
    """
    bodies = []
    edge = "0.45"  # grey of outlines
    for obstacle in obstacles:
        if obstacle.unbounded:
            continue
        first = outline(obstacle, float(time[0]))
        bodies += axes.fill(*first.T, fc=(0.8, 0.8, 0.8, 0.5), ec=edge, lw=st.points(0.9), zorder=0.5)
        if obstacle.motion is not None:
            last = outline(obstacle, float(time[-1]))
            axes.plot(*np.concatenate([last, last[:1]]).T, color=edge, lw=st.points(0.9), ls=st.DOTS, zorder=0.5)
            moments = np.linspace(time[0], time[-1], 100).tolist()
            path = np.array([obstacle.placement(t).translation[:2] for t in moments])
            axes.plot(*path.T, color=edge, lw=st.points(0.9), ls=st.DOTS, zorder=0.5)
    return [st.LegendEntry("obstacles", bodies[:1])] if bodies else []


def footprints(robot: Robot, q: np.ndarray) -> list[np.ndarray]:
    """Outline (n, 2) [m] of every moving part from above at a configuration (nq,): the hull of its collision shapes.

    Args:
        robot: robot with a collision model.
        q: the configuration.
    """
    source = robot.collision_model
    if source is None:
        return []
    kinematics, parts = SceneKinematics(robot), dict[int, list[np.ndarray]]()
    for shape in source.geometryObjects:
        points = points_at(shape.geometry, kinematics.shape_placement(shape, q))
        # One hull for each joint: links that are fixed to each other are one part.
        parts.setdefault(int(shape.parentJoint), []).append(points)
    # Joint 0 is the world: what is fixed there does not move.
    return [hull_from_above(np.concatenate(points)) for joint, points in parts.items() if joint]


def draw_footprints(axes: Axes, robot: Robot, q: np.ndarray) -> list[st.LegendEntry]:
    """Draw the outlines at moments of a run, (N, nq), darker towards its end. Return the legend entry.

    Args:
        axes: axes to draw into.
        robot: robot with a collision model.
        q: configurations of the run.
    """
    lines = []
    moments = 5  # outlines of the robot: more would cover each other
    for k, index in enumerate(np.linspace(0, len(q) - 1, moments).round().astype(int)):
        strength = 0.25 + 0.75 * k / (moments - 1)
        for points in footprints(robot, q[index]):
            axes.fill(*points.T, color=_ROBOT, alpha=0.12 * strength, zorder=0.6, lw=0)
            edge = np.concatenate([points, points[:1]])
            lines += axes.plot(*edge.T, color=_ROBOT_EDGE, lw=st.points(0.8), alpha=strength, zorder=0.7)
    return [st.LegendEntry("robot", lines[-1:])] if lines else []


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
    # A replay without collision geometry has no distances, and a file may state no limits.
    panels = [
        *([Panel("distance", "m", _distances(replay), "nearest bodies", mark=0.0)] if replay.clearances else []),
        *([Panel("used", "% of the limit", _uses(replay), "most used limits", mark=100.0)] if replay.uses else []),
    ]  # fmt: skip
    return panel_figure(panels, replay.time, Sheet.of(size), title=title, labels=labels)


def _distances(replay: LimitReplay) -> tuple[Series, ...]:
    active_distance = 0.02  # [m]
    # A body may have several shapes: the nearest of each pair of bodies is drawn.
    columns: dict[str, list[int]] = {}
    for k, each in enumerate(replay.clearances):
        columns.setdefault(" / ".join(each.names), []).append(k)
    found = []
    for name, same in list(columns.items())[:MAX_LINES]:
        values = replay.distances[:, same].min(axis=1)
        # Beyond, distances are only lower bounds: the line is left out.
        values = np.where(values < replay.within, values, np.nan)
        found.append(Series(name, values, active=values < active_distance))
    return tuple(found)


def _uses(replay: LimitReplay) -> tuple[Series, ...]:
    active_share = 0.98  # of a joint limit
    shares = np.array([2.0 if use.kind == "position" else 1.0 for use in replay.uses])  # 0 in the middle of a range
    used = 100.0 * (1.0 + shares * replay.excesses)
    return tuple(
        Series(f"{use.kind} of {use.name}", values, active=values > 100.0 * active_share)
        for use, values in sorted(zip(replay.uses, used.T, strict=True), key=lambda each: -each[1].max())[:MAX_LINES]
    )
