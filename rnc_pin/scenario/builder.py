"""From a scenario to objects that run."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rnc_pin.control import Controller
from rnc_pin.errors import ConfigurationError, InputError, nearest
from rnc_pin.planning import Hold, Reference
from rnc_pin.reduction import ReducedModel
from rnc_pin.scenario.controllers import Setting, build_controller
from rnc_pin.scenario.schema import Scenario, SimulationSettings
from rnc_pin.system import NonholonomicSystem
from rnc_pin.task import Task


def build_system(scenario: Scenario, folder: Path) -> NonholonomicSystem:
    """Robot, constraints and actuators; paths are relative to ``folder``."""
    robot = scenario.robot.build(folder)
    actuators = [each if isinstance(each, str) else each.build() for each in scenario.actuators]
    return NonholonomicSystem(robot, [each.build() for each in scenario.constraints], actuators)


def build_reduced(scenario: Scenario, folder: Path) -> tuple[NonholonomicSystem, ReducedModel]:
    """The system and its reduction to the scenario's outputs."""
    system = build_system(scenario, folder)
    outputs = scenario.outputs
    reduced = system.reduce([each.build() for each in outputs.reducing], [each.build() for each in outputs.vertical])
    return system, reduced


def build_task(scenario: Scenario, reduced: ReducedModel) -> Task:
    """How the scenario divides the outputs; without a word of it all reducing outputs are primary."""
    names = scenario.task
    primary = names.primary
    if not primary and not names.redundant:
        primary = list(reduced.reducing.names)
    return Task.of(reduced, primary, names.redundant, names.vertical)


@dataclass(frozen=True)
class Experiment:
    """Everything a run needs."""

    scenario: Scenario
    reduced: ReducedModel
    controller: Controller
    q0: np.ndarray
    simulation: SimulationSettings
    warnings: tuple[str, ...]
    notes: dict[str, Any]


def build_experiment(scenario: Scenario, folder: Path) -> Experiment:
    """A run from a scenario.

    Raises:
        RncError: anything in it does not fit the robot.
    """
    if scenario.simulation is None:
        raise ConfigurationError("simulation: is missing; a run needs {duration: ..., dt: ...}")
    if scenario.controller is None:
        raise ConfigurationError("controller: is missing; a run needs {type: ..., preset: ...}")
    _, reduced = build_reduced(scenario, folder)
    task = build_task(scenario, reduced)
    q0 = reduced.robot.configuration(scenario.initial.q)
    x1, x2 = reduced.outputs(q0)
    starts = {"primary": x2[task.primary], "redundant": x2[task.redundant], "vertical": x1[task.vertical]}
    references: dict[str, Reference] = {}
    for name, start in starts.items():
        settings = getattr(scenario.reference, name)
        try:
            references[name] = Hold(start) if settings is None else settings.build(start)
        except (ConfigurationError, InputError) as error:
            raise ConfigurationError(f"reference.{name}: {error}") from None
    setting = Setting(scenario.controller, scenario.simulation, reduced, task, references, q0)
    controller = build_controller(setting)
    _check_plots(scenario, reduced)
    for frame in scenario.view.trail:
        reduced.robot.frame_id(frame)
    return Experiment(
        scenario=scenario,
        reduced=reduced,
        controller=controller,
        q0=q0,
        simulation=scenario.simulation,
        warnings=tuple(setting.warnings),
        notes={"controller": _described(controller), **_estimated(setting)},
    )


def _estimated(setting: Setting) -> dict[str, Any]:
    masses = setting.settings.unknown
    return {} if masses is None else {"estimates": [f"mass of {joint}" for joint in masses.initial]}


def _described(controller: object) -> dict[str, Any]:
    """Gains of a controller and of those under it, for the record."""
    content: dict[str, Any] = {"type": type(controller).__name__}
    for name in ("gains", "k", "k3", "k21", "k2"):
        value = getattr(controller, name, None)
        if is_dataclass(value):
            value = {each.name: np.asarray(getattr(value, each.name)).tolist() for each in fields(value)}
        if value is not None:
            content[name] = value if isinstance(value, dict) else np.asarray(value).tolist()
    for name in ("target", "tracker"):
        if hasattr(controller, name):
            content[name] = _described(getattr(controller, name))
    return content


def _check_plots(scenario: Scenario, reduced: ReducedModel) -> None:
    valid = (*reduced.reducing.names, *reduced.vertical.names)
    for plot, settings in scenario.plots.items():
        for name in settings.outputs:
            if name not in valid:
                raise ConfigurationError(f"plots.{plot}.outputs: no output '{name}'{nearest(name, valid)}")
