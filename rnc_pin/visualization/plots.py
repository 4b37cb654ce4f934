"""Plots of a run over time. Every function returns a Matplotlib figure; ``plot_style.save`` writes it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rnc_pin.errors import InputError
from rnc_pin.simulation import Trajectory, tracking_errors
from rnc_pin.visualization import plot_style as ps

_LONGEST_TITLE, _TITLE_LINES = 64, 3  # letters in a line: what 6.4 inches have room for
_SMALLEST = 1e-8  # what an error axis shows


@ps.styled
def plot_outputs(
    trajectory: Trajectory,
    outputs: Sequence[str],
    title: str | None = None,
    comparisons: Mapping[str, Trajectory] | None = None,
) -> Figure:
    """Outputs over time: actual solid, desired dotted, other runs dashed.

    Args:
        trajectory: the run.
        outputs: names of reducing or vertical outputs.
        title: above the plot.
        comparisons: other runs by label.
    """
    figure = ps.PrintFigure(figsize=(6.4, ps.heightened(3.6, [*outputs, "desired", *(comparisons or {})])))
    axes = figure.subplots()
    handles = _outputs(axes, trajectory, outputs, comparisons or {})
    axes.set_xlabel("time [s]")
    ps.legend_below(axes, handles)
    _title(axes, title)
    return figure


@ps.styled
def plot_learning(
    trajectory: Trajectory,
    quantity: str,
    title: str | None = None,
    comparisons: Mapping[str, Trajectory] | None = None,
) -> Figure:
    """What a controller learnt over time, or how far its predictions were off.

    Args:
        trajectory: the run.
        quantity: "estimates" or "prediction_error".
        title: above the plot.
        comparisons: other runs by label, dashed.
    """
    figure = ps.PrintFigure(figsize=(6.4, 3.6))
    axes = figure.subplots()
    handles = _learning(axes, trajectory, quantity, comparisons or {})
    axes.set_xlabel("time [s]")
    ps.legend_below(axes, handles)
    _title(axes, title)
    return figure


@ps.styled
def plot_overview(trajectory: Trajectory, title: str | None = None) -> Figure:
    """What any run is judged by: tracking errors, actuator inputs and the distance from singularity."""
    most = max(len(trajectory.info.goals), len(trajectory.info.outputs.T))
    figure = ps.PrintFigure(figsize=(ps.widened(6.4, most), 6.4))
    panels = figure.subplots(3, 1, sharex=True)
    _errors(panels[0], trajectory, {})
    _inputs(panels[1], trajectory)
    _margin(panels[2], trajectory, {})
    panels[-1].set_xlabel("time [s]")
    _title(panels[0], title)
    return figure


@ps.styled
def plot_run(
    trajectory: Trajectory, title: str | None = None, comparisons: Mapping[str, Trajectory] | None = None
) -> Figure:
    """A run of any system: its outputs by unit, tracking errors, inputs, what it learnt, distance from singularity.

    Args:
        trajectory: the run.
        title: above the plots.
        comparisons: other runs by label, dashed.

    Raises:
        InputError: the run has fewer than two samples.
    """
    if len(trajectory.time) < 2:
        raise InputError(f"a run of {len(trajectory.time)} samples has nothing to plot")
    others = comparisons or {}
    names = ps.outputs_of(trajectory)
    units = list(dict.fromkeys(ps.series(trajectory, name)[2] for name in names))
    learnt = [each for each in ("estimates", "prediction_error") if getattr(trajectory, each).shape[1]]
    count = len(units) + 2 + len(learnt) + bool(trajectory.T.shape[1])
    most = max(len(names), len(trajectory.info.outputs.T))
    figure = ps.PrintFigure(figsize=(ps.widened(7.2, most), 2.0 * count + 0.4))
    panels = iter(figure.subplots(count, 1, sharex=True))
    first: Axes | None = None
    for unit in units:
        axes = next(panels)
        first = first or axes
        handles = _outputs(axes, trajectory, [n for n in names if ps.series(trajectory, n)[2] == unit], others)
        ps.legend_beside(axes, handles)
    axes = next(panels)
    _errors(axes, trajectory, others)
    if trajectory.T.shape[1]:
        axes = next(panels)
        _inputs(axes, trajectory)
    for each in learnt:
        axes = next(panels)
        ps.legend_beside(axes, _learning(axes, trajectory, each, others))
    axes = next(panels)
    _margin(axes, trajectory, others)
    axes.set_xlabel("time [s]")
    figure.align_ylabels()
    _title(first or axes, title)
    return figure


# ---------------------------------------------------------------------- one set of axes each


def _outputs(
    axes: Axes, trajectory: Trajectory, outputs: Sequence[str], others: Mapping[str, Trajectory]
) -> list[Line2D]:
    handles, units = [], []
    for k, name in enumerate(outputs):
        actual, desired, unit = ps.series(trajectory, name)
        units.append(unit)
        handles.append(ps.line(axes, k, len(outputs), trajectory.time, actual, ps.words(name)))
        for style, label in ps.dashes(others):
            other = others[label]
            axes.plot(other.time, ps.series(other, name)[0], color=handles[-1].get_color(), ls=style, lw=1.5)
        if name in trajectory.info.goals:
            # Above the solid line, or a dotted one that it follows closely could not be seen.
            axes.plot(trajectory.time, desired, color="black", ls=ps.DOTS, lw=1.3)
    if any(name in trajectory.info.goals for name in outputs):
        handles.append(ps.desired_entry())
    axes.set_ylabel(ps.quantity(units))
    axes.margins(x=0.01)
    return handles + ps.dashed(others, 1.5)


def _errors(axes: Axes, trajectory: Trajectory, others: Mapping[str, Trajectory]) -> None:
    errors = tracking_errors(trajectory)
    compared = {label: tracking_errors(other) for label, other in others.items()}
    handles = []
    for k, (name, error) in enumerate(errors.items()):
        label = f"{ps.words(name)} [{ps.series(trajectory, name)[2]}]"
        shown = np.abs(error) + _SMALLEST / 1e8
        handles.append(ps.line(axes, k, len(errors), trajectory.time, shown, label, lw=1.4))
        for style, other in ps.dashes(others):
            if name in compared[other]:
                shown = np.abs(compared[other][name]) + _SMALLEST / 1e8
                axes.plot(others[other].time, shown, color=handles[-1].get_color(), ls=style, lw=1.2)
    axes.set_yscale("log")
    axes.set_ylim(bottom=_SMALLEST)
    axes.set_ylabel("tracking error")
    axes.margins(x=0.01)
    ps.legend_beside(axes, handles)


def _inputs(axes: Axes, trajectory: Trajectory) -> None:
    names = trajectory.info.outputs.T
    for k, (name, column) in enumerate(zip(names, trajectory.T.T, strict=True)):
        ps.line(axes, k, len(names), trajectory.time, column, ps.words(name), lw=1.4)
    axes.set_ylabel("input [N, N m]")
    axes.margins(x=0.01)
    ps.legend_beside(axes)


def _margin(axes: Axes, trajectory: Trajectory, others: Mapping[str, Trajectory]) -> None:
    axes.plot(trajectory.time, trajectory.singular_value, color="black")
    for style, label in ps.dashes(others):
        axes.plot(others[label].time, others[label].singular_value, color="0.3", ls=style, lw=1.2)
    axes.set_ylim(0, 1.1 * float(np.nanmax(trajectory.singular_value, initial=1e-3)))
    axes.set_ylabel("singularity\nmargin [-]")
    axes.margins(x=0.01)
    ps.legend_beside(axes, ps.dashed(others, 1.2))


def _learning(axes: Axes, trajectory: Trajectory, quantity: str, others: Mapping[str, Trajectory]) -> list[Line2D]:
    values = getattr(trajectory, quantity)
    what = "estimate" if quantity == "estimates" else "measured less\npredicted rate"
    origin = trajectory.info.provenance
    known = origin.estimates if quantity == "estimates" else origin.predicted
    names = list(known) or [f"{quantity} {column}" for column in range(values.shape[1])]
    units = " / ".join(dict.fromkeys(known.values()))
    handles = []
    for column, name in enumerate(names):
        handles.append(ps.line(axes, column, len(names), trajectory.time, values[:, column], ps.words(name), lw=1.4))
        for style, label in ps.dashes(others):
            series = getattr(others[label], quantity)
            if series.shape[1] > column:
                axes.plot(others[label].time, series[:, column], color="0.3", ls=style, lw=1.2, zorder=1.5)
    axes.set_ylabel(f"{what} [{units}]" if units else what)
    axes.margins(x=0.01)
    return handles + ps.dashed(others, 1.2)


def _title(axes: Axes, title: str | None) -> None:
    if title:
        lines = textwrap.wrap(title, _LONGEST_TITLE, max_lines=_TITLE_LINES, placeholder="...")
        axes.set_title("\n".join(ps.literal(line) for line in lines), loc="left")
