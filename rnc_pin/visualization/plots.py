"""Plots in one print-ready style: readable in grey, and by people who see colours differently."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rnc_pin.simulation import Trajectory, tracking_errors

# Okabe and Ito, in an order in which neighbours differ in lightness too.
COLORS = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9"]
STYLE: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.grid": True,
    "grid.color": "0.88",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.axisbelow": True,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
    "savefig.dpi": 200,
    "figure.constrained_layout.use": True,
}


def plot_outputs(
    trajectory: Trajectory,
    outputs: Sequence[str],
    path: str | Path,
    title: str | None = None,
    comparisons: Mapping[str, Trajectory] | None = None,
) -> Path:
    """Outputs over time: actual solid, desired dotted, other runs dashed.

    Args:
        trajectory: the run.
        outputs: names of reducing or vertical outputs.
        path: of the PNG.
        title: above the plot.
        comparisons: other runs by label.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.6))
        axes = figure.subplots()
        units: list[str] = []
        others = comparisons or {}
        handles = []
        for color, name in zip(_cycle(outputs), outputs, strict=True):
            actual, desired, unit = _series(trajectory, name)
            units.append(unit)
            handles += axes.plot(trajectory.time, actual, color=color, label=_words(name))
            for style, other in zip(cycle(_DASHES), others.values(), strict=False):
                axes.plot(other.time, _series(other, name)[0], color=color, ls=style, lw=1.5)
            if name in trajectory.meta["goals"]:
                # Above the solid line, or a dotted one that it follows closely could not be seen.
                axes.plot(trajectory.time, desired, color="black", ls=_DOTS, lw=1.3)
        if any(name in trajectory.meta["goals"] for name in outputs):
            handles.append(Line2D([], [], color="black", ls=_DOTS, lw=1.3, label="desired"))
        handles += _dashed(others, 1.5)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(" / ".join(dict.fromkeys(f"{_quantity(unit)} [{unit}]" if unit else "value" for unit in units)))
        axes.margins(x=0.01)
        _finish(figure, axes, handles, title, path)
    return Path(path)


def plot_learning(
    trajectory: Trajectory,
    quantity: str,
    path: str | Path,
    title: str | None = None,
    comparisons: Mapping[str, Trajectory] | None = None,
) -> Path:
    """What a controller learnt over time, or how far its predictions were off.

    Args:
        trajectory: the run.
        quantity: "estimates" or "prediction_error".
        path: of the PNG.
        title: above the plot.
        comparisons: other runs by label, dashed.
    """
    values = getattr(trajectory, quantity)
    what = "estimate" if quantity == "estimates" else "measured less predicted rate"
    known = trajectory.meta.get("estimates" if quantity == "estimates" else "predicted") or {}
    names = list(known) or [f"{quantity} {column}" for column in range(values.shape[1])]
    units = " / ".join(dict.fromkeys(known.values()))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.6))
        axes = figure.subplots()
        handles = []
        for column, (color, name) in enumerate(zip(_cycle(names), names, strict=True)):
            handles += axes.plot(trajectory.time, values[:, column], color=color, label=_words(name), lw=1.4)
            for style, other in zip(cycle(_DASHES), (comparisons or {}).values(), strict=False):
                series = getattr(other, quantity)
                if series.shape[1] > column:
                    axes.plot(other.time, series[:, column], color="0.3", ls=style, lw=1.2, zorder=1.5)
        handles += _dashed(comparisons or {}, 1.2)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"{what} [{units}]" if units else what)
        axes.margins(x=0.01)
        _finish(figure, axes, handles, title, path)
    return Path(path)


def plot_overview(trajectory: Trajectory, path: str | Path, title: str | None = None) -> Path:
    """What any run is judged by: tracking errors, actuator inputs and the distance from singularity."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 6.4))
        errors_axes, inputs_axes, margin_axes = figure.subplots(3, 1, sharex=True)
        errors = tracking_errors(trajectory)
        for color, (name, error) in zip(_cycle(list(errors)), errors.items(), strict=True):
            unit = _series(trajectory, name)[2]
            errors_axes.plot(trajectory.time, np.abs(error) + 1e-16, color=color, label=f"{_words(name)} [{unit}]")
        errors_axes.set_yscale("log")
        errors_axes.set_ylim(bottom=1e-8)
        errors_axes.set_ylabel("tracking error")
        names = trajectory.meta["names"]["T"]
        for color, name, column in zip(_cycle(names), names, trajectory.T.T, strict=True):
            inputs_axes.plot(trajectory.time, column, color=color, label=_words(name))
        inputs_axes.set_ylabel("actuator input [N, N m]")
        margin_axes.plot(trajectory.time, trajectory.singular_value, color="black")
        margin_axes.set_ylim(bottom=0)
        margin_axes.set_ylabel("smallest singular value")
        margin_axes.set_xlabel("time [s]")
        for axes in (errors_axes, inputs_axes):
            _legend(axes)
        if title:
            errors_axes.set_title(title, loc="left")
        figure.savefig(path)
    return Path(path)


def _legend(axes: Axes) -> None:
    """A legend beside the axes; of many lines the largest are named, or it would leave the axes no room."""
    lines = axes.get_lines()
    if len(lines) > _NAMED:
        lines = sorted(lines, key=lambda line: -float(np.max(np.abs(line.get_ydata()), initial=0.0)))[:_NAMED]
    if lines:
        title = f"largest of {len(axes.get_lines())}" if len(axes.get_lines()) > _NAMED else None
        axes.legend(handles=lines, loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=9, title=title)


_NAMED = 9
_DOTS = (0, (1, 2))
_DASHES = [(0, (6, 3)), (0, (6, 2, 1, 2)), (0, (3, 2)), (0, (8, 2, 1, 2, 1, 2)), (0, (1, 4)), (0, (10, 4))]


def _series(trajectory: Trajectory, name: str) -> tuple[np.ndarray, np.ndarray, str]:
    for kind in ("x2", "x1"):
        names = trajectory.meta["names"][kind]
        if name in names:
            column = names.index(name)
            unit = trajectory.meta["units"][kind][column]
            return getattr(trajectory, kind)[:, column], getattr(trajectory, f"{kind}_desired")[:, column], unit
    raise KeyError(name)


def _cycle(items: Sequence[str]) -> list[str]:
    return [COLORS[i % len(COLORS)] for i in range(len(items))]


def _words(name: str) -> str:
    return name.replace("_", " ")


def _quantity(unit: str) -> str:
    return {"m": "position", "rad": "angle"}.get(unit, "value")


def _dashed(labels: Iterable[str], width: float) -> list[Line2D]:
    """Entries of a legend for the runs that are compared."""
    styles = zip(cycle(_DASHES), labels, strict=False)
    return [Line2D([], [], color="0.3", ls=style, lw=width, label=label) for style, label in styles]


def _finish(figure: Figure, axes: Axes, handles: list[Line2D], title: str | None, path: str | Path) -> None:
    below = (0.5, -0.16)
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=below, ncols=min(4, len(handles)), fontsize=9)
    if title:
        axes.set_title(title, loc="left")
    figure.savefig(path)
