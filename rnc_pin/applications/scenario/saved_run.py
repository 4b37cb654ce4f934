"""Finished runs, loaded from files with their robot and model, and their pages."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rnc_pin.applications.scenario.builder import build_reduced
from rnc_pin.applications.scenario.execution import Result
from rnc_pin.applications.scenario.files import built_in_names, find_scenario
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.applications.scenario.schema.world import build_obstacles
from rnc_pin.collision import Obstacle
from rnc_pin.errors import ConfigurationError
from rnc_pin.model import ReducedModel
from rnc_pin.simulation import Provenance, Trajectory
from rnc_pin.visualization import DrawnModel, Recording


def drawn_run(drawn: DrawnModel, scenario: ScenarioFile) -> DrawnModel:
    """Add the contacts that open and close to the subject of a page, so that it shows their forces.

    Args:
        drawn: robot, model and obstacles of the scenario.
        scenario: the scenario of the run.
    """
    return replace(drawn, switching=tuple(each.constraint for each in scenario.contacts))


def write_animation(scenario: Scenario, result: Result, path: Path) -> bool:
    """Write the page.

    Raises:
        ModelError: the robot has no geometry.
    """
    content = scenario.content
    view = replace(content.view, hide=[*content.view.hide, "compared"])  # users can switch this layer on
    drawn = drawn_run(scenario.experiment.drawn_model, content)
    Recording(drawn, result.trajectory, view, content.title or scenario.name, result.comparisons).save(path)
    return True


@dataclass(frozen=True)
class Run:
    """Finished run with its scenario and model."""

    source: Path
    trajectory: Trajectory
    scenario: ScenarioFile
    reduced: ReducedModel
    obstacles: tuple[Obstacle, ...] = ()

    @property
    def drawn_model(self) -> DrawnModel:
        """Robot with its model and the obstacles, to draw."""
        return drawn_run(DrawnModel(self.reduced.robot, self.reduced, self.obstacles), self.scenario)

    @property
    def title(self) -> str:
        """Title of the scenario, or its name."""
        return self.scenario.title or str(self.trajectory.info.provenance.scenario)


def load_run(source: Path) -> Run:
    """Load a folder of ``rnc-pin run``, or its ``trajectory.npz``.

    Raises:
        RncError: the source is not a run, or has fewer than two samples.
    """
    trajectory = Trajectory.load(source / "trajectory.npz" if os.path.isdir(source) else source)
    origin = trajectory.info.provenance
    if origin.config is None:
        raise ConfigurationError(f"{source}: contains no scenario, so the robot is unknown")
    scenario = validate(origin.config, str(source))
    folder = _folder(origin)
    _, reduced = build_reduced(scenario, folder)
    if trajectory.q.shape[1] != reduced.robot.nq:
        raise ConfigurationError(
            f"{source}: configurations have {trajectory.q.shape[1]} entries, but its robot has nq = {reduced.robot.nq}"
        )
    if len(trajectory.time) < 2:
        raise ConfigurationError(f"{source}: contains {len(trajectory.time)} samples, at least 2 are required")
    return Run(source, trajectory, scenario, reduced, build_obstacles(scenario.obstacles, folder))


def _folder(origin: Provenance) -> Path:
    """Base folder of relative paths in a run's scenario. Runs of built-in scenarios do not record a folder."""
    if origin.folder is not None:
        return Path(origin.folder)
    return find_scenario(origin.scenario).parent if origin.scenario in built_in_names() else Path()


def _compared(runs: Sequence[Run]) -> dict[str, Trajectory]:
    """Return the runs after the first, by unique names from those of their files.

    Raises:
        ConfigurationError: the runs have different robots.
    """
    first, paths = runs[0], [each.source for each in runs]
    names = [each.stem.removeprefix("trajectory_") if each.is_file() else each.name for each in paths]
    found: dict[str, Trajectory] = {}
    for name, other in zip(names[1:], runs[1:], strict=True):
        if other.reduced.robot.nq != first.reduced.robot.nq or other.reduced.robot.name != first.reduced.robot.name:
            raise ConfigurationError(
                f"{other.source}: is of robot '{other.reduced.robot.name}', "
                f"{first.source} of '{first.reduced.robot.name}': one scene shows one robot"
            )
        shown = name if names.count(name) == 1 else str(other.source)
        found[shown.replace("_", " ")] = other.trajectory
    return found


def animation_of(runs: Sequence[Run]) -> Recording:
    """Return the animation of a run, with other runs as pale robots in it."""
    run = runs[0]
    return Recording(run.drawn_model, run.trajectory, run.scenario.view, run.title, _compared(runs))
