"""Paths of bodies in the plane, seen from above: their headings, references, planned path and compared runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from rnc_pin.figures import style as st
from rnc_pin.figures.panel import Labels
from rnc_pin.printing import printed

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
        last: np.ndarray = self.desired[-1]
        return last

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
    _frame_equally(axes)
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


def _frame_equally(axes: Axes) -> None:
    """Use equal scales on both axes, and a minimum size so that a robot at rest is a dot."""
    middle = np.array([(axes.dataLim.x0 + axes.dataLim.x1) / 2, (axes.dataLim.y0 + axes.dataLim.y1) / 2])
    axes.update_datalim([middle - MIN_HALF_SIZE, middle + MIN_HALF_SIZE])
    axes.margins(0.08)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
