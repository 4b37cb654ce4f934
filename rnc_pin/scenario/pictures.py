"""The plots and the animation that a run leaves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rnc_pin.scenario.output import OutputFolder
from rnc_pin.scenario.replay import view_of
from rnc_pin.scenario.run import Plan, Result
from rnc_pin.visualization.plot_style import save
from rnc_pin.visualization.plots import plot_learning, plot_outputs, plot_overview
from rnc_pin.visualization.recording import Recording


def draw(plan: Plan, result: Result, folder: OutputFolder) -> list[Path]:
    """Write the pictures of a result; none of one that has fewer than two samples."""
    trajectory, scenario = result.trajectory, plan.experiment.scenario
    if len(trajectory.time) < 2:
        return []
    written = []
    for name, settings in scenario.plots.items():
        labels = result.comparisons if settings.comparisons is None else settings.comparisons
        shown = {label: result.comparisons[label] for label in labels if label in result.comparisons}
        path = folder.file(f"{name}.png")
        if settings.quantity == "outputs":
            figure = plot_outputs(trajectory, settings.outputs, settings.title, shown)
        else:
            figure = plot_learning(trajectory, settings.quantity, settings.title, shown)
        written.append(save(figure, path))
    written.append(save(plot_overview(trajectory, scenario.title), folder.file("overview.png")))
    visual = plan.experiment.reduced.robot.visual_model
    if visual is not None and len(visual.geometryObjects):
        view = view_of(scenario)
        view = replace(view, hide=[*view.hide, "compared"])  # there for who asks
        title = scenario.title or plan.name
        recording = Recording(plan.experiment.reduced, trajectory, view, title, result.comparisons)
        written.append(recording.save(folder.file("animation.html")))
    return written
