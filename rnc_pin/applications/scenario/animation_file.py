"""Animation of a run as a page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rnc_pin.applications.scenario.drawn_run import drawn_run
from rnc_pin.applications.scenario.execution import Plan, Result
from rnc_pin.visualization import Recording


def write_animation(plan: Plan, result: Result, path: Path) -> bool:
    """Write the page; False if the robot has nothing to draw."""
    scenario, reduced = plan.experiment.scenario, plan.experiment.reduced
    visual = reduced.robot.visual_model
    if visual is None or not len(visual.geometryObjects):
        return False
    view = scenario.view
    view = replace(view, hide=[*view.hide, "compared"])  # users can switch this layer on
    drawn = drawn_run(plan.experiment.drawn_model, scenario, result.trajectory)
    Recording(drawn, result.trajectory, view, scenario.title or plan.name, result.comparisons).save(path)
    return True
