"""Plant of a scenario, where it differs from the reduced model of the controller."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import Pfaffian
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants import ChangingMachine, FaultyMachine, Machine, mujoco
from rnc_pin.robots.robot import Robot
from rnc_pin.scenario.schema import Scenario
from rnc_pin.simulation import ReducedPlant

_Change = Callable[[Robot], list[Pfaffian]]


def build_machine(scenario: Scenario, reduced: ReducedModel, q0: np.ndarray, folder: Path) -> Machine | None:
    """Build the plant of a scenario; None if the plant is the reduced model of the controller.

    Args:
        scenario: a validated scenario.
        reduced: model of the controller.
        q0: initial configuration, (nq,).
        folder: base of relative paths.

    Raises:
        RncError: the plant cannot be built from this robot, or a fault names an unknown frame or joint.
    """
    plant, faults, settings = scenario.plant, scenario.faults, scenario.simulation
    assert settings is not None
    simulated = plant is not None and plant.type == "mujoco"
    if faults is None and not simulated:
        return None
    if simulated and (settings.joint_damping or settings.joint_friction or settings.substeps > 1):
        raise ConfigurationError(
            "simulation: joint_damping, joint_friction and substeps require plant 'reduced'; "
            "set the options of MuJoCo in 'plant'"
        )

    def made(true: ReducedModel) -> Machine:
        if simulated:
            assert plant is not None
            return mujoco.MuJoCoPlant(true, plant.settings, q0)
        return ReducedPlant(true, settings.plant, settings.substeps)

    if faults is None:
        return made(reduced)
    changes: list[_Change] = []
    if faults.masses:
        changes.append(lambda robot: _other_masses(robot, faults.masses, scenario.seed))
    later: list[tuple[float, _Change]] = []
    try:
        if faults.payload is not None:
            load = faults.payload
            later.append((load.time, lambda robot: _loaded(robot, load.frame, load.mass)))
        if faults.stuck is not None:
            stuck = faults.stuck
            later.append((stuck.time, lambda robot: _stuck(robot, stuck.joint)))
        machine = made(_truth(scenario, folder, changes) if changes else reduced)
        for time, change in sorted(later, key=lambda each: each[0]):
            changes.append(change)
            machine = ChangingMachine(machine, made(_truth(scenario, folder, changes)), time)
    except RncError as error:
        raise ConfigurationError(f"faults: {error}") from None
    return FaultyMachine(machine, faults.faults, reduced, settings.dt, scenario.seed)


def _truth(scenario: Scenario, folder: Path, changes: list[_Change]) -> ReducedModel:
    """Build the true model: the system with changes to a separate copy of the robot."""
    robot = scenario.robot.build(folder)
    rows = [row for change in changes for row in change(robot)]
    return NonholonomicSystem(robot, [*scenario.constraints, *rows], scenario.actuators, scenario.mimic).reduce()


def _other_masses(robot: Robot, share: float, seed: int) -> list[Pfaffian]:
    generator = np.random.default_rng([seed, 1])
    for joint, inertia in enumerate(robot.model.inertias):
        factor = 1.0 + share * generator.uniform(-1.0, 1.0)
        robot.model.inertias[joint] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)
    return []


def _loaded(robot: Robot, frame: str, mass: float) -> list[Pfaffian]:
    place = robot.model.frames[robot.frame_id(frame)]
    load = pin.Inertia(mass, place.placement.translation, np.zeros((3, 3)))
    robot.model.inertias[place.parentJoint] += load
    return []


def _stuck(robot: Robot, joint: str) -> list[Pfaffian]:
    rows = np.eye(robot.nv)[robot.velocity_indices(joint)]
    nothing = np.zeros_like(rows)
    return [Pfaffian(lambda q: rows, lambda q, v: nothing, [f"stuck({joint})"] if len(rows) == 1 else None)]
