"""Animation of a run as a page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rnc_pin.applications.scenario.drawn_run import drawn_run
from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization import Recording


def write_animation(scenario: Scenario, result: Result, path: Path) -> bool:
    """Write the page; False if the robot has nothing to draw."""
    content, visual = scenario.content, scenario.robot.visual_model
    if visual is None or not len(visual.geometryObjects):
        return False
    view = content.view
    view = replace(view, hide=[*view.hide, "compared"])  # users can switch this layer on
    drawn = drawn_run(scenario.experiment.drawn_model, content, result.trajectory)
    Recording(drawn, result.trajectory, view, content.title or scenario.name, result.comparisons).save(path)
    return True
