"""A run as an interactive page of plots that needs no network. Needs plotly, the optional extra ``interactive``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.simulation import Trajectory, tracking_errors
from rnc_pin.visualization import plot_style as ps
from rnc_pin.visualization.plots import plot_run
from rnc_pin.whole_files import written_whole

_MOST_POINTS = 2000
_DASHES = ("dash", "dashdot", "longdash", "dot", "longdashdot")


def write_plots(
    trajectory: Trajectory,
    path: str | Path,
    title: str,
    comparisons: Mapping[str, Trajectory] | None = None,
    replace: bool = True,
) -> Path:
    """Write the plots of a run, by the ending of the name: interactive for .html, else a figure.

    Args:
        trajectory: the run.
        path: ends in .png, .pdf, .svg or .html.
        title: above the plots.
        comparisons: other runs by label, dashed.
        replace: what is there by then.

    Raises:
        ConfigurationError: another ending, or plotly is not installed.
        OSError: it cannot be written.
    """
    path = Path(path)
    if path.suffix in (".png", ".pdf", ".svg"):
        return ps.save(plot_run(trajectory, title, comparisons), path, replace)
    if path.suffix != ".html":
        raise ConfigurationError(f"{path}: expected a name that ends in .png, .pdf, .svg or .html")
    figure = interactive_figure(trajectory, title, comparisons)
    with written_whole(path, replace) as partial:
        figure.write_html(partial, include_plotlyjs=True)
    return path


def interactive_figure(
    trajectory: Trajectory, title: str | None = None, comparisons: Mapping[str, Trajectory] | None = None
) -> Any:
    """A plotly figure: outputs by unit, errors, inputs, distance from singularity; zoom one and all follow.

    Raises:
        ConfigurationError: plotly is not installed.
    """
    try:
        from plotly.graph_objects import Figure
        from plotly.subplots import make_subplots
    except ImportError:
        raise ConfigurationError("plotly is not installed; pip install 'rnc_pin[interactive]'") from None
    names = ps.outputs_of(trajectory)
    units = list(dict.fromkeys(ps.series(trajectory, name)[2] for name in names))
    labels = [*(ps.quantity([unit]) for unit in units), "tracking error", "input [N, N m]", "singularity margin [-]"]
    figure: Figure = make_subplots(rows=len(labels), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, label in enumerate(labels, start=1):
        figure.update_yaxes(title_text=label, row=row, col=1)
    runs = {"": trajectory, **(comparisons or {})}
    for k, (label, run) in enumerate(runs.items()):
        dash = "solid" if not k else _DASHES[(k - 1) % len(_DASHES)]
        after = f" ({label})" if label else ""
        every = slice(None, None, max(1, len(run.time) // _MOST_POINTS))

        def add(
            row: int, column: int, name: str, values: np.ndarray, run: Trajectory = run, dash: str = dash,
            every: slice = every, after: str = after, color: str | None = None,
        ) -> None:  # fmt: skip
            shade = color or ps.shade(column)
            style = {"color": shade, "dash": dash, "width": 2 if color is None else 1.5}
            figure.add_scatter(x=run.time[every], y=values[every], name=name + after, line=style, row=row, col=1)

        for row, unit in enumerate(units, start=1):
            for column, name in enumerate(name for name in names if ps.series(trajectory, name)[2] == unit):
                actual, desired, _ = ps.series(run, name)
                add(row, column, ps.words(name), actual)
                if not k and name in run.info.goals:
                    add(row, column, f"{ps.words(name)}, desired", desired, dash="dot", color="black")
        for column, (name, error) in enumerate(tracking_errors(run).items()):
            add(len(units) + 1, column, f"error of {ps.words(name)}", np.abs(error))
        for column, (name, values) in enumerate(zip(run.info.outputs.T, run.T.T, strict=True)):
            add(len(units) + 2, column, f"input {ps.words(name)}", values)
        add(len(labels), 0, "singularity margin", run.singular_value, color="black")
    figure.update_yaxes(type="log", exponentformat="power", row=len(units) + 1, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(labels), col=1)
    figure.update_layout(title=title, template="plotly_white", height=240 * len(labels), hovermode="x unified")
    return figure
