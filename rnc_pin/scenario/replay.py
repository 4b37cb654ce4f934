"""A run that is over, read back with the robot and the model that it was of."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.scenario.builder import build_reduced
from rnc_pin.scenario.files import built_in_names, find_scenario
from rnc_pin.scenario.loading import validate
from rnc_pin.scenario.schema import Scenario
from rnc_pin.simulation import Provenance, Trajectory
from rnc_pin.visualization.recording import Recording
from rnc_pin.visualization.view import View


@dataclass(frozen=True)
class Run:
    """A run, and what it was a run of."""

    source: Path
    trajectory: Trajectory
    scenario: Scenario
    reduced: ReducedModel

    @property
    def title(self) -> str:
        """What the scenario calls itself."""
        return self.scenario.title or str(self.trajectory.info.provenance.scenario)


def load_run(source: Path) -> Run:
    """Read a folder that ``rnc-pin run`` wrote, or its ``trajectory.npz``.

    Raises:
        RncError: it is no such thing, or there is nothing to play.
    """
    trajectory = Trajectory.load(source / "trajectory.npz" if os.path.isdir(source) else source)
    origin = trajectory.info.provenance
    if origin.config is None:
        raise ConfigurationError(f"{source}: has no scenario in it, so the robot is not known")
    scenario = validate(origin.config, str(source))
    _, reduced = build_reduced(scenario, _folder(origin))
    if trajectory.q.shape[1] != reduced.robot.nq:
        raise ConfigurationError(
            f"{source}: configurations have {trajectory.q.shape[1]} entries, its robot {reduced.robot.nq}"
        )
    if len(trajectory.time) < 2:
        raise ConfigurationError(f"{source}: holds {len(trajectory.time)} samples, nothing to play")
    return Run(source, trajectory, scenario, reduced)


def _folder(origin: Provenance) -> Path:
    """What paths in a run's scenario are relative to; the run of a built-in one names no folder of any computer."""
    if origin.folder is not None:
        return Path(origin.folder)
    return find_scenario(origin.scenario).parent if origin.scenario in built_in_names() else Path()


def compared(runs: Sequence[Run]) -> dict[str, Trajectory]:
    """The runs after the first, by names that tell them apart.

    Raises:
        ConfigurationError: one is of another robot.
    """
    first = runs[0]
    for other in runs[1:]:
        if other.reduced.robot.nq != first.reduced.robot.nq or other.reduced.robot.name != first.reduced.robot.name:
            raise ConfigurationError(
                f"{other.source}: is of robot '{other.reduced.robot.name}', "
                f"{first.source} of '{first.reduced.robot.name}': one scene shows one robot"
            )
    names = [
        each.source.stem.removeprefix("trajectory_") if each.source.is_file() else each.source.name for each in runs
    ]
    shown = [name if names.count(name) == 1 else str(run.source) for name, run in zip(names, runs, strict=True)]
    return {name.replace("_", " "): run.trajectory for name, run in zip(shown[1:], runs[1:], strict=True)}


def record(runs: Sequence[Run], aside: bool = False) -> Recording:
    """The animation of a run, with others as pale robots in it or set aside."""
    run = runs[0]
    return Recording(run.reduced, run.trajectory, view_of(run.scenario), run.title, compared(runs), aside)


def view_of(scenario: Scenario) -> View:
    """How the scenario wants to be looked at."""
    return scenario.view
