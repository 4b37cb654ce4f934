"""From a scenario to objects that run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rnc_pin.control import (
    Controller,
    KinematicController,
    ReducingOutputController,
    RedundancyController,
    VelocityGains,
    VelocityTracker,
)
from rnc_pin.errors import ConfigurationError, InputError, SingularityError, nearest
from rnc_pin.planning import Hold, Joined, Reference, ReferencePoint
from rnc_pin.reduction import ReducedModel
from rnc_pin.scenario.schema import ControllerSettings, Scenario, SimulationSettings
from rnc_pin.simulation import kinematic_rollout
from rnc_pin.system import NonholonomicSystem
from rnc_pin.task import Task

_ROLLOUT_STEP = 0.05  # [s]; the region that gains are scaled to is smooth
_OUTER_GAIN = 2.0  # the paper's k3 [1/s]


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
    _check_gain_lengths(scenario.controller, task)
    kinematic = _kinematic(scenario.controller, reduced, task, references)
    warnings: list[str] = []
    gains = _gains(scenario.controller, scenario.simulation, reduced, kinematic, references, q0, warnings)
    _check_plots(scenario, reduced)
    for frame in scenario.view.trail:
        reduced.robot.frame_id(frame)
    return Experiment(
        scenario=scenario,
        reduced=reduced,
        controller=VelocityTracker(kinematic, gains),
        q0=q0,
        simulation=scenario.simulation,
        warnings=tuple(warnings),
        notes={"gains": {name: np.asarray(getattr(gains, name)).tolist() for name in ("k", "beta", "sigma")}},
    )


def _kinematic(
    settings: ControllerSettings, reduced: ReducedModel, task: Task, references: dict[str, Reference]
) -> KinematicController:
    k21 = settings.k21
    if settings.type == "redundancy":
        default = 0.0 if settings.preset == "paper" else _OUTER_GAIN  # the paper feeds x21d_dot open loop
        return RedundancyController(
            task,
            references["primary"],
            references["vertical"],
            k3=_gain(settings.k3, _OUTER_GAIN),
            k21=_gain(k21, default),
        )
    ordered = Joined([references["primary"], references["redundant"]])
    order = np.argsort(np.concatenate([task.primary, task.redundant]))
    return ReducingOutputController(reduced, _Reordered(ordered, order), k2=_gain(k21, _OUTER_GAIN))


class _Reordered:
    """A reference with its outputs in another order."""

    def __init__(self, reference: Reference, order: np.ndarray) -> None:
        self._reference, self._order = reference, order
        self.size, self.duration = reference.size, reference.duration

    def at(self, t: float) -> ReferencePoint:
        point = self._reference.at(t)
        return ReferencePoint(*(each[self._order] for each in point))


def _gains(
    settings: ControllerSettings,
    simulation: SimulationSettings,
    reduced: ReducedModel,
    kinematic: KinematicController,
    references: dict[str, Reference],
    q0: np.ndarray,
    warnings: list[str],
) -> VelocityGains:
    gains = VelocityGains.paper()
    if settings.preset == "scaled":
        horizon = min(simulation.duration, max(reference.duration for reference in references.values()) + 1.0)
        try:
            _, region = kinematic_rollout(reduced, kinematic, q0, horizon, _ROLLOUT_STEP)
        except SingularityError as error:
            # The run will end there too, and its results are wanted: gains of the start will do until then.
            warnings.append(f"the reference leads into a singular configuration: {error}")
            region = q0[None]
        try:
            gains = VelocityGains.scaled(reduced, region, simulation.dt, settings.bandwidth)
        except ConfigurationError as error:
            raise ConfigurationError(f"controller: {error}") from None
    elif settings.bandwidth is not None:
        raise ConfigurationError("controller.bandwidth: belongs to the preset 'scaled'")
    return VelocityGains(
        k=_gain(settings.k, gains.k),
        beta=_gain(settings.beta, gains.beta),
        sigma=gains.sigma if settings.sigma is None else settings.sigma,
    )


def _gain(value: float | list[float] | None, default: float | np.ndarray) -> float | np.ndarray:
    if value is None:
        return default
    return np.array(value) if isinstance(value, list) else value


def _check_gain_lengths(settings: ControllerSettings, task: Task) -> None:
    primary = len(task.primary) if settings.type == "redundancy" else task.r
    sizes = {"k": task.r, "beta": task.r, "k3": len(task.vertical), "k21": primary}
    for name, size in sizes.items():
        value = getattr(settings, name)
        if isinstance(value, list) and len(value) != size:
            raise ConfigurationError(f"controller.{name}: {len(value)} values for {size} outputs")


def _check_plots(scenario: Scenario, reduced: ReducedModel) -> None:
    valid = (*reduced.reducing.names, *reduced.vertical.names)
    for plot, settings in scenario.plots.items():
        for name in settings.outputs:
            if name not in valid:
                raise ConfigurationError(f"plots.{plot}.outputs: no output '{name}'{nearest(name, valid)}")
