"""Interactive page of plots that works offline. It needs plotly (optional extra ``interactive``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.io.atomic_write import atomic_file
from rnc_pin.simulation import Trajectory
from rnc_pin.visualization import plot_style as ps
from rnc_pin.visualization.panels import Others, Panel, panels
from rnc_pin.visualization.plots import plot_run
from rnc_pin.visualization.top_view import GroundPath, ground_paths

_MOST_POINTS = 2000
_DASHES = ("dash", "dashdot", "longdash", "longdashdot")
_PANEL, _VIEW, _GAP = 240, 480, 24  # heights [pixels]


def write_plots(
    trajectory: Trajectory,
    path: str | Path,
    title: str,
    comparisons: Mapping[str, Trajectory] | None = None,
    replace: bool = True,
) -> Path:
    """Write the plots of a run: an interactive page for .html, otherwise a figure.

    Args:
        trajectory: run to plot.
        path: file name that ends in .png, .pdf, .svg or .html.
        title: title above the plots.
        comparisons: other runs by label, dashed.
        replace: True replaces an existing file.

    Raises:
        ConfigurationError: the file name has another suffix, or plotly is not installed.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix in (".png", ".pdf", ".svg"):
        return ps.save(plot_run(trajectory, title, comparisons), path, replace)
    if path.suffix != ".html":
        raise ConfigurationError(f"{path}: expected a name that ends in .png, .pdf, .svg or .html")
    figure = interactive_figure(trajectory, title, comparisons)
    with atomic_file(path, replace) as partial:
        figure.write_html(partial, include_plotlyjs=True)
    return path


def interactive_figure(
    trajectory: Trajectory, title: str | None = None, comparisons: Mapping[str, Trajectory] | None = None
) -> Any:
    """Plotly figure with the panels of ``plot_run``, which share one time axis.

    Raises:
        ConfigurationError: plotly is not installed.
    """
    try:
        from plotly.graph_objects import Figure
        from plotly.subplots import make_subplots
    except ImportError:
        raise ConfigurationError("plotly is not installed; pip install 'rnc_pin[interactive]'") from None
    others = comparisons or {}
    shown, paths = panels(trajectory, others), ground_paths(trajectory)
    above = [_VIEW] if paths else []
    heights = [*above, *(_PANEL for _ in shown)]
    figure: Figure = make_subplots(rows=len(heights), cols=1, row_heights=heights, vertical_spacing=_GAP / sum(heights))
    if paths:
        _add_top_view(figure, paths, others)
    for row, panel in enumerate(shown, start=1 + len(above)):
        _add_panel(figure, row, panel, trajectory, others)
        figure.update_xaxes(matches=f"x{len(heights)}", showticklabels=row == len(heights), row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(heights), col=1)
    for row in range(1, len(heights) + 1):
        top = figure.layout[_axis(row)].domain[1]
        figure.update_layout({_legend(row): {"x": 1.01, "xanchor": "left", "y": top, "yanchor": "top"}})
    figure.update_layout(title=title, template="plotly_white", height=sum(heights), hovermode="x unified")
    return figure


def _axis(row: int) -> str:
    return "yaxis" if row == 1 else f"yaxis{row}"


def _legend(row: int) -> str:
    """Layout key of the legend of a panel."""
    return "legend" if row == 1 else f"legend{row}"


def _add_panel(figure: Any, row: int, panel: Panel, run: Trajectory, others: Others) -> None:
    """Add a panel: actual solid, desired dotted, other runs dashed, as in ``plot_run``."""
    count = len(panel.series)

    def shown(values: np.ndarray) -> np.ndarray:
        return np.maximum(values, panel.bottom or 0.0) if panel.log else values

    for k, series in enumerate(panel.series):
        name = f"{panel.what} {series.name}".strip()
        _add_line(figure, row, run.time, shown(series.values), name, ps.COLORS[k])
        for index, (dash, label) in enumerate(zip(cycle(_DASHES), others, strict=False)):
            if label in series.compared:
                color = ps.color_of(k, count, index)
                time, values = others[label].time, shown(series.compared[label])
                _add_line(figure, row, time, values, f"{name} ({label})", color, dash)
        if series.desired is not None:
            _add_line(figure, row, run.time, series.desired, f"{name}, desired", "black", "dot")
    scale = {"type": "log", "exponentformat": "power"} if panel.log else {}
    if panel.bottom == 0.0:
        scale = {"rangemode": "tozero"}
    figure.update_yaxes(title_text=panel.label.replace("\n", "<br>"), **scale, row=row, col=1)


def _add_top_view(figure: Any, paths: Sequence[GroundPath], others: Others) -> None:
    names = [path.name for path in paths]
    for k, path in enumerate(paths):
        _add_path(figure, path.points, f"{path.name} from above", ps.COLORS[k])
        if path.headings is not None:
            marks = path.marks()
            angles = 90.0 - np.rad2deg(path.headings[marks])  # plotly measures clockwise from the vertical axis
            figure.add_scatter(
                x=path.points[marks, 0], y=path.points[marks, 1], mode="markers", showlegend=False, row=1, col=1,
                name=f"heading of {path.name}",
                marker={"symbol": "arrow", "size": 12, "angle": angles, "color": ps.COLORS[k]},
            )  # fmt: skip
        if path.goal is not None:
            figure.add_scatter(
                x=path.goal[:1], y=path.goal[1:], mode="markers", name=f"goal of {path.name}", row=1, col=1,
                marker={"symbol": "x", "size": 10, "color": "black"},
            )  # fmt: skip
        elif path.desired is not None:
            _add_path(figure, path.desired, f"{path.name} from above, desired", "black", "dot")
    for index, (dash, label) in enumerate(zip(cycle(_DASHES), others, strict=False)):
        for path in ground_paths(others[label]):
            if path.name in names:
                color = ps.color_of(names.index(path.name), len(names), index)
                _add_path(figure, path.points, f"{path.name} from above ({label})", color, dash)
    figure.update_xaxes(title_text="x [m]", title_standoff=2, row=1, col=1)
    figure.update_yaxes(title_text="y [m]", scaleanchor="x", row=1, col=1)


def _add_path(figure: Any, points: np.ndarray, name: str, color: str, dash: str = "solid") -> None:
    """Add a path (N, 2) to the top view."""
    _add_line(figure, 1, points[:, 0], points[:, 1], name, color, dash)


def _add_line(
    figure: Any, row: int, along: np.ndarray, values: np.ndarray, name: str, color: str, dash: str = "solid"
) -> None:
    every = slice(None, None, max(1, len(values) // _MOST_POINTS))
    style = {"color": color, "dash": dash, "width": 2 if dash == "solid" else 1.5}
    figure.add_scatter(
        x=along[every], y=values[every], name=name, mode="lines", line=style, legend=_legend(row), row=row, col=1
    )
