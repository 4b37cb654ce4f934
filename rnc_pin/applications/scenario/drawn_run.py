"""Page of a run, with the constraints that appear and vanish in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.phase_builder import captured_closures
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.kinds import with_ground
from rnc_pin.constraints import GroundPlane
from rnc_pin.model import ConstraintKind
from rnc_pin.robots import Robot
from rnc_pin.simulation import Trajectory
from rnc_pin.visualization import DrawnModel, Recording


def drawn_run(drawn: DrawnModel, scenario: ScenarioFile, trajectory: Trajectory) -> DrawnModel:
    """Add the constraints of phases and contacts to the subject of a page, so that it shows their forces.

    Args:
        drawn: robot, model and obstacles of the scenario.
        scenario: the scenario of the run.
        trajectory: the run.
    """
    kinds = [each.constraint for each in scenario.contacts]
    if scenario.phases:
        kinds = _of_phases(scenario, drawn.robot, trajectory)
    return replace(drawn, switching=tuple(kinds)) if kinds else drawn


def _of_phases(scenario: ScenarioFile, robot: Robot, trajectory: Trajectory) -> list[ConstraintKind]:
    """Constraints of the phases that the run has reached, with loops closed as they were in the run."""
    found: list[ConstraintKind] = []
    for settings, phase in zip(scenario.phases, trajectory.info.phases, strict=False):
        kinds = scenario.constraints if settings.constraints is None else settings.constraints
        if scenario.ground is not None and any(hasattr(each, "ground") for each in kinds):
            kinds = with_ground(kinds, cast(GroundPlane, scenario.ground))
        if settings.capture_distance is not None and phase.first_sample < len(trajectory.q):
            kinds = captured_closures(kinds, robot, trajectory.q[phase.first_sample], settings.capture_distance)
        found += kinds
    return found


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
