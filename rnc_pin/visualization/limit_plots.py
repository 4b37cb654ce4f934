"""Smallest distances and most used joint limits of a run."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rnc_pin.figures import Labels, Panel, Series, Sheet, Size, panel_figure
from rnc_pin.figures.panel import MAX_LINES
from rnc_pin.simulation import LimitReplay

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
