"""Plots of a run as files."""

from __future__ import annotations

from pathlib import Path

from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import FigureSettings, PlotSettings
from rnc_pin.figures import Labels, save
from rnc_pin.simulation import ground_paths
from rnc_pin.visualization import plot_limits, plot_top_view


def write_plot(scenario: Scenario, result: Result, path: Path) -> bool:
    """Write the plot that the file name means; False if there is nothing to draw."""
    own = {"overview": _overview, "top_view": _top_view, "limits": _limits}
    if scenario.experiment.plan is not None:
        own["plan"] = _plan
    if path.stem in own:
        return own[path.stem](scenario, result, path)
    return _plot(scenario.content.figures, result, scenario.content.plots[path.stem], path)


def _plot(figures: FigureSettings, result: Result, settings: PlotSettings, path: Path) -> bool:
    chosen = result.comparisons if settings.comparisons is None else settings.comparisons
    shown = {label: result.comparisons[label] for label in chosen if label in result.comparisons}
    size, title = settings.size or figures.size, settings.title
    run = result.trajectory
    run.plot(settings.outputs, title=title, comparisons=shown, size=size, labels=figures.labels, file=path)
    return True


def _overview(scenario: Scenario, result: Result, path: Path) -> bool:
    content = scenario.content
    result.trajectory.plot(title=content.title, labels=content.figures.labels, file=path)
    return True


def _top_view(scenario: Scenario, result: Result, path: Path) -> bool:
    if not ground_paths(result.trajectory):
        return False
    experiment, figures = scenario.experiment, scenario.content.figures
    obstacles, title = experiment.obstacles, experiment.scenario.title
    robot = experiment.reduced.robot if obstacles else None  # beside obstacles, the room that the robot needs counts
    labels = Labels(figures.labels)
    save(plot_top_view(result.trajectory, title, result.comparisons, obstacles, robot, figures.size, labels), path)
    return True


def _limits(scenario: Scenario, result: Result, path: Path) -> bool:
    if result.limits is None or not (result.limits.uses or result.limits.clearances):
        return False
    figures = scenario.content.figures
    save(plot_limits(result.limits, scenario.content.title, figures.size, Labels(figures.labels)), path)
    return True


def _plan(scenario: Scenario, result: Result, path: Path) -> bool:
    figures, plan = scenario.content.figures, scenario.experiment.plan
    assert plan is not None
    labels = {name: text for name, text in figures.labels.items() if name in plan.label_names}
    plan.plot(size=figures.size, labels=labels, file=path)
    return True
