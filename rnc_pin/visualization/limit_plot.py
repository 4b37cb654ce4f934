"""Figure of the distances and of the joint limits of a run over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rnc_pin.simulation import LimitReplay
from rnc_pin.visualization import plot_style as ps
from rnc_pin.visualization.panels import MOST, readable_name

_WIDTH, _HEIGHT = 8.0, 2.6  # of a panel [inches]
_NEAR = 0.02  # distance below which a pair counts as active [m]
_USED = 0.98  # share of a joint limit above which it counts as active
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
    figure = ps.PrintFigure(figsize=(_WIDTH, _HEIGHT * max(count, 1) + 0.5))
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
        if len(names) == MOST:
            break
        names.append(name)
        same = [j for j, other in enumerate(replay.clearances) if other.names == each.names and j >= k]
        values = replay.distances[:, same].min(axis=1)
        values = np.where(values < replay.within, values, np.nan)
        entries.append(_line(axes, len(names) - 1, name, replay.time, values, values < _NEAR))
    axes.axhline(0.0, color="black", lw=0.8)
    axes.set_ylabel("distance [m]")
    ps.legend_beside(axes, entries, "nearest bodies")


def _uses(axes: Axes, replay: LimitReplay) -> None:
    most = sorted(range(len(replay.uses)), key=lambda k: -replay.uses[k].excess)[:MOST]
    entries = []
    for place, k in enumerate(most):
        use = replay.uses[k]
        values = 100.0 * replay.excesses[:, k]
        name = f"{use.kind} of {readable_name(use.name)}"
        entries.append(_line(axes, place, name, replay.time, values, values > 100.0 * (_USED - 1.0)))
    axes.axhline(0.0, color="black", lw=0.8)
    axes.set_ylabel("beyond limit\n[% of its range]")
    ps.legend_beside(axes, entries, "most used joint limits")


def _line(
    axes: Axes, place: int, name: str, time: np.ndarray, values: np.ndarray, active: np.ndarray
) -> ps.LegendEntry:
    drawn = ps.line(axes, place, MOST, time, values)
    if active.any():
        marked = np.where(active, values, np.nan)
        axes.plot(time, marked, color=drawn.get_color(), lw=_ACTIVE_WIDTH, alpha=0.4, solid_capstyle="round")
        name = f"{name} (active)"
    return ps.LegendEntry(name, [drawn])
