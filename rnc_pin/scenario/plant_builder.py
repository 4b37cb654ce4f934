"""Builder of the plant of a scenario, with its faults."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from rnc_pin.constraints import Pfaffian
from rnc_pin.errors import ConfigurationError, RncError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.plants import ChangingPlant, ContactPlant, FaultyPlant, Plant, ReducedPlant, VelocityPlant, mujoco
from rnc_pin.robots.robot import Robot
from rnc_pin.scenario.schema import Scenario

_Change = Callable[[Robot], list[Pfaffian]]


def build_plant(scenario: Scenario, reduced: ReducedModel, q0: np.ndarray, folder: Path) -> Plant:
    """Build the plant of a scenario.

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
    in_mujoco = plant is not None and plant.type == "mujoco"
    if in_mujoco and (settings.joint_damping or settings.joint_friction or settings.substeps > 1):
        raise ConfigurationError(
            "simulation: joint_damping, joint_friction and substeps require plant 'reduced'; "
            "set the options of MuJoCo in 'plant'"
        )

    servo_time = None if plant is None else plant.settings.servo_time
    _check_servos(scenario, servo_time)
    if scenario.contacts:
        _check_contacts(scenario)
        args = scenario.constraints, scenario.actuators, scenario.mimic, scenario.forces
        system = NonholonomicSystem(reduced.robot, *args)
        limits = settings.joint_damping, settings.actuator_limits, settings.joint_friction, settings.substeps
        return ContactPlant(system, scenario.contacts, *limits)

    def plant_of(model: ReducedModel) -> Plant:
        if in_mujoco:
            assert plant is not None
            return mujoco.MuJoCoPlant(model, plant.settings, q0)
        if servo_time is not None:
            return VelocityPlant(model, servo_time, settings.substeps)
        return ReducedPlant(
            model, settings.joint_damping, settings.actuator_limits, settings.joint_friction, settings.substeps
        )

    if faults is None:
        return plant_of(reduced)
    changes: list[_Change] = []
    if faults.masses:
        changes.append(lambda robot: _perturb_masses(robot, faults.masses, scenario.seed))
    timed: list[tuple[float, _Change]] = []
    try:
        if faults.payload is not None:
            load = faults.payload
            timed.append((load.time, lambda robot: _add_payload(robot, load.frame, load.mass)))
        if faults.stuck is not None:
            stuck = faults.stuck
            timed.append((stuck.time, lambda robot: _lock_joint(robot, stuck.joint)))
        true_plant = plant_of(_true_model(scenario, folder, changes) if changes or faults.forces else reduced)
        for time, change in sorted(timed, key=lambda each: each[0]):
            changes.append(change)
            true_plant = ChangingPlant(true_plant, plant_of(_true_model(scenario, folder, changes)), time)
    except RncError as error:
        raise ConfigurationError(f"faults: {error}") from None
    return FaultyPlant(true_plant, faults.faults, reduced, settings.dt, scenario.seed)


def _check_contacts(scenario: Scenario) -> None:
    """Raise an error for settings that do not support contacts that open and close."""
    plant = scenario.plant
    if plant is not None and plant.type == "mujoco":
        raise ConfigurationError(
            "plant: 'mujoco' does not support 'contacts', because it takes the bodies on the ground from "
            "'constraints'; use 'reduced'"
        )
    if plant is not None and plant.settings.servo_time is not None:
        raise ConfigurationError("plant.servo_time: velocity servos do not support 'contacts'")
    if scenario.faults is not None:
        raise ConfigurationError("faults: do not support 'contacts'")
    assert scenario.simulation is not None
    if scenario.simulation.on_lift_off != "ignore":
        raise ConfigurationError("simulation.on_lift_off: 'contacts' lift off by themselves; remove it")


def _check_servos(scenario: Scenario, servo_time: float | None) -> None:
    """Raise an error unless controller and plant agree about inputs: forces or velocities."""
    settings = scenario.simulation
    assert settings is not None
    velocities = getattr(scenario.controller, "tracker", None) == "velocity"
    if velocities and servo_time is None:
        raise ConfigurationError("controller.tracker: 'velocity' requires velocity servos: set plant.servo_time")
    if servo_time is not None and not velocities:
        raise ConfigurationError("plant.servo_time: requires controller.tracker 'velocity'")
    unused = [name for name in ("joint_damping", "joint_friction", "actuator_limits") if getattr(settings, name)]
    if velocities and unused and scenario.plant is not None and scenario.plant.type == "reduced":
        raise ConfigurationError(f"simulation.{unused[0]}: has no effect on ideal velocity servos; remove it")
    faults = None if scenario.faults is None else scenario.faults.faults
    if velocities and faults is not None and (np.isfinite(faults.effort) or faults.dead_zone):
        raise ConfigurationError("faults: effort and dead_zone are those of forces, and the plant takes velocities")


def _true_model(scenario: Scenario, folder: Path, changes: list[_Change]) -> ReducedModel:
    """Build the true model: the system with further forces, and with changes to a separate copy of the robot."""
    robot = scenario.robot.build(folder)
    rows = [row for change in changes for row in change(robot)]
    constraints, forces = [*scenario.constraints, *rows], list(scenario.forces)
    if scenario.faults is not None:
        forces += scenario.faults.forces
    return NonholonomicSystem(robot, constraints, scenario.actuators, scenario.mimic, forces).reduce()


def _perturb_masses(robot: Robot, share: float, seed: int) -> list[Pfaffian]:
    generator = np.random.default_rng([seed, 1])
    for joint, inertia in enumerate(robot.model.inertias):
        factor = 1.0 + share * generator.uniform(-1.0, 1.0)
        robot.model.inertias[joint] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)
    return []


def _add_payload(robot: Robot, frame: str, mass: float) -> list[Pfaffian]:
    place = robot.model.frames[robot.frame_id(frame)]
    load = pin.Inertia(mass, place.placement.translation, np.zeros((3, 3)))
    robot.model.inertias[place.parentJoint] += load
    return []


def _lock_joint(robot: Robot, joint: str) -> list[Pfaffian]:
    rows = np.eye(robot.nv)[robot.velocity_indices(joint)]
    zeros = np.zeros_like(rows)
    return [Pfaffian(lambda q: rows, lambda q, v: zeros, [f"stuck({joint})"] if len(rows) == 1 else None)]
