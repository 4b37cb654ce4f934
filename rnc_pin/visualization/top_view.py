"""Top view of a run: paths of bodies on the ground, their headings, and desired paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from rnc_pin.collision import Obstacle
from rnc_pin.printing import printed
from rnc_pin.simulation import Trajectory
from rnc_pin.visualization import plot_style as ps
from rnc_pin.visualization.panels import MAX_LINES, Others, readable_name
from rnc_pin.visualization.surroundings import outline

_MARKS = 12  # heading marks along a path: eleven equal parts, so that marks of two laps do not coincide
_TURN_LENGTH = 0.15  # distance between marks that is equivalent to a rotation of 1 rad, over the extent of the path
_SAME_PATH = 1e-3  # largest distance between two paths that count as one, over the extent
_MIN_HALF_SIZE = 0.05  # smallest half width and half height of the picture [m]
_PALE_WIDTH = 4.5  # width of the path of a compared run [points]
_BODY, _EDGE = "0.8", "0.45"  # grey of obstacles and of their outlines
_POINTER = Path([(1.2, 0.0), (-0.8, 0.62), (-0.45, 0.0), (-0.8, -0.62), (1.2, 0.0)], closed=True)


@printed(points="m", headings="rad", desired="m")
@dataclass(frozen=True)
class GroundPath:
    """Path of a point in the plane.

    Attributes:
        name: readable name of the body or frame.
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
        if self.desired is None or not np.allclose(self.desired, self.desired[-1], rtol=0.0, atol=1e-9):
            return None
        last: np.ndarray = self.desired[-1]
        return last

    def marks(self) -> np.ndarray:
        """Indices of the samples with heading marks, evenly along the path; rotation in place counts as distance."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        if self.headings is not None:
            steps = steps + _TURN_LENGTH * max(self.extent, _MIN_HALF_SIZE) * np.abs(np.diff(np.unwrap(self.headings)))
        distance = np.concatenate([[0.0], np.cumsum(steps)])
        if not distance[-1] > 0:
            return np.array([0, len(distance) - 1])
        return np.unique(np.searchsorted(distance, np.linspace(0.0, distance[-1], _MARKS)).clip(max=len(distance) - 1))


def ground_paths(run: Trajectory) -> list[GroundPath]:
    """Paths of a top view: bodies on the ground, and frames whose x and y are outputs.

    If no body is on the ground, a frame counts only if its z is not an output.
    """
    poses = [run.ground_poses[:, start : start + 3] for start in range(0, run.ground_poses.shape[1], 3)]
    bodies = [
        GroundPath(readable_name(name), pose[:, :2], pose[:, 2] if np.isfinite(pose[:, 2]).all() else None)
        for name, pose in zip(run.info.outputs.ground_poses, poses, strict=True)
    ]
    frames = _frames(run, bodies)
    scale = max([_MIN_HALF_SIZE, *(each.extent for each in (*bodies, *frames))])
    found = list(bodies)
    for frame in frames:
        # A leaning body is drawn at another point than its frame but is the same body.
        same = [
            k
            for k, body in enumerate(found)
            if body.name == frame.name or np.abs(body.points - frame.points).max() < _SAME_PATH * scale
        ]
        if not same:
            found.append(frame)
        elif found[same[0]].desired is None and frame.desired is not None:
            one = found[same[0]]  # the actual path is that of the point that has a goal
            found[same[0]] = GroundPath(one.name, frame.points, one.headings, frame.desired)
    return found[:MAX_LINES]


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle], time: np.ndarray) -> list[ps.LegendEntry]:
    """Draw the outlines of bounded obstacles: filled at the start; those that move also at the end, with paths."""
    lines = []
    for obstacle in obstacles:
        if obstacle.unbounded:
            continue
        first = outline(obstacle, float(time[0]))
        axes.fill(*first.T, color=_BODY, alpha=0.5, zorder=0)
        lines += axes.plot(*np.concatenate([first, first[:1]]).T, color=_EDGE, lw=0.9, zorder=0.5)
        if obstacle.motion is not None:
            last = outline(obstacle, float(time[-1]))
            axes.plot(*np.concatenate([last, last[:1]]).T, color=_EDGE, lw=0.9, ls=ps.DOTS, zorder=0.5)
            moments = np.linspace(time[0], time[-1], 100).tolist()
            path = np.array([obstacle.placement(t).translation[:2] for t in moments])
            axes.plot(*path.T, color=_EDGE, lw=0.9, ls=ps.DOTS, zorder=0.5)
    return [ps.LegendEntry("obstacles", lines[:1])] if lines else []


def _frames(run: Trajectory, bodies: Sequence[GroundPath]) -> list[GroundPath]:
    columns = {
        name: (kind, column)
        for kind in ("x1", "x2")
        for column, name in enumerate(run.info.outputs.of(kind).names)
        if run.info.outputs.of(kind).units[column] == "m"
        and not run.info.outputs.of(kind).is_integral(column)  # integrals along a body's own axes are no place
    }
    found = []
    for name, (kind, column) in columns.items():
        frame = name.removesuffix("_x")
        if frame == name or f"{frame}_y" not in columns or (not bodies and f"{frame}_z" in columns):
            continue
        pair = [(kind, column), columns[f"{frame}_y"]]
        points, desired = (
            np.column_stack([getattr(run, kind + ending)[:, column] for kind, column in pair])
            for ending in ("", "_desired")
        )
        has_goal = f"{frame}_x" in run.info.goals and f"{frame}_y" in run.info.goals
        found.append(GroundPath(readable_name(frame), points, None, desired if has_goal else None))
    return found


def draw_top_view(axes: Axes, run: Trajectory, others: Others) -> list[ps.LegendEntry]:
    """Draw the top view of a run. Return the legend entries."""
    paths = ground_paths(run)
    entries: list[ps.LegendEntry] = []
    plan = run.info.provenance.path
    if plan is not None and not any(path.desired is not None for path in paths):
        planned = np.array(plan.poses)[:, :2]
        entries.append(
            ps.LegendEntry("planned path", axes.plot(*planned.T, color="0.55", ls=ps.DASHES[2], lw=1.6, zorder=1))
        )
    for k, path in enumerate(paths):
        color = ps.COLORS[k]
        entries.append(ps.LegendEntry(path.name, axes.plot(*path.points.T, color=color, lw=1.8)))
        if path.headings is not None:
            _draw_headings(axes, path, color)
        else:
            axes.plot(*path.points[-1], "o", color=color, markeredgecolor="white")
        axes.plot(*path.points[0], "o", color="white", markeredgecolor=color, markersize=7, zorder=4)
    entries += _compared(axes, paths, others)
    desired = [path.desired for path in paths if path.desired is not None and path.goal is None]
    lines = [axes.plot(*points.T, color="black", ls=ps.DOTS, lw=1.3)[0] for points in desired]
    if lines:
        entries.append(ps.LegendEntry("desired", lines[:1]))
    goals = [path.goal for path in paths if path.goal is not None]
    if goals:
        entries.append(
            ps.LegendEntry("goal", axes.plot(*np.transpose(goals), "x", color="black", markersize=7, mew=1.8))
        )
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    _frame_equally(axes)
    return entries


def _compared(axes: Axes, paths: Sequence[GroundPath], others: Others) -> list[ps.LegendEntry]:
    """Draw other runs as wide pale lines below the run, so that both are visible where they coincide."""
    entries = []
    for j, (style, label) in enumerate(ps.dashes(others)):
        lines = []
        for path in ground_paths(others[label]):
            names = [each.name for each in paths]
            if path.name in names:
                color = ps.pale(ps.color_of(names.index(path.name), len(names), j))
                lines += axes.plot(
                    *path.points.T, color=color, ls=ps.scaled(style, _PALE_WIDTH), lw=_PALE_WIDTH, zorder=1.5
                )
        if lines:
            entries.append(ps.LegendEntry(label, lines))
    return entries


def _draw_headings(axes: Axes, path: GroundPath, color: str) -> None:
    assert path.headings is not None
    for sample in path.marks():
        marker = MarkerStyle(_POINTER, transform=Affine2D().rotate(float(path.headings[sample])))
        axes.plot(
            *path.points[sample], marker=marker, color=color, markersize=13, markeredgecolor="white",
            markeredgewidth=0.7, zorder=3,
        )  # fmt: skip


def _frame_equally(axes: Axes) -> None:
    """Use equal scales on both axes, and a minimum size so that a robot at rest is a dot."""
    middle = np.array([(axes.dataLim.x0 + axes.dataLim.x1) / 2, (axes.dataLim.y0 + axes.dataLim.y1) / 2])
    axes.update_datalim([middle - _MIN_HALF_SIZE, middle + _MIN_HALF_SIZE])
    axes.margins(0.08)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
