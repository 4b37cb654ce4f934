"""Plots of a run as files."""

from __future__ import annotations

from pathlib import Path

from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema.scenario import PlotSettings
from rnc_pin.visualization import ground_paths, plot_learning, plot_limits, plot_outputs, plot_run, plot_top_view, save


def write_plot(scenario: Scenario, result: Result, path: Path) -> bool:
    """Write the plot that the file name means; False if there is nothing to draw."""
    own = {"overview": _overview, "top_view": _top_view, "limits": _limits}
    if scenario.experiment.plan is not None:
        own["plan"] = _plan
    if path.stem in own:
        return own[path.stem](scenario, result, path)
    return _plot(result, scenario.content.plots[path.stem], path)


def _plot(result: Result, settings: PlotSettings, path: Path) -> bool:
    labels = result.comparisons if settings.comparisons is None else settings.comparisons
    shown = {label: result.comparisons[label] for label in labels if label in result.comparisons}
    if settings.quantity == "outputs":
        figure = plot_outputs(result.trajectory, settings.outputs, settings.title, shown)
    else:
        figure = plot_learning(result.trajectory, settings.quantity, settings.title, shown)
    save(figure, path)
    return True


def _overview(scenario: Scenario, result: Result, path: Path) -> bool:
    save(plot_run(result.trajectory, scenario.content.title), path)
    return True


def _top_view(scenario: Scenario, result: Result, path: Path) -> bool:
    if not ground_paths(result.trajectory):
        return False
    experiment = scenario.experiment
    obstacles, title = experiment.obstacles, experiment.scenario.title
    robot = experiment.reduced.robot if obstacles else None  # beside obstacles, the room that the robot needs counts
    save(plot_top_view(result.trajectory, title, result.comparisons, obstacles, robot), path)
    return True


def _limits(scenario: Scenario, result: Result, path: Path) -> bool:
    if result.limits is None or not (result.limits.uses or result.limits.clearances):
        return False
    save(plot_limits(result.limits, scenario.content.title), path)
    return True


def _plan(scenario: Scenario, result: Result, path: Path) -> bool:
    assert scenario.experiment.plan is not None
    save(scenario.experiment.plan.plot(), path)
    return True
