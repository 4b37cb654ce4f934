"""Builder of the plant of a scenario, with its faults, and findings about the model before any run."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from copy import deepcopy

import numpy as np

from rnc_pin.analysis import wheel_height_findings
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.errors import ConfigurationError, ModelWarning, RncError
from rnc_pin.model import NonholonomicSystem, ReducedModel
from rnc_pin.plants import (
    ChangingPlant,
    ContactPlant,
    FaultyPlant,
    MassErrors,
    Plant,
    ReducedPlant,
    StuckJoint,
    VelocityPlant,
    mujoco,
)
from rnc_pin.robots import Robot
from rnc_pin.verdict import Finding, Severity


def start_findings(scenario: ScenarioFile, reduced: ReducedModel, q0: np.ndarray) -> tuple[Finding, ...]:
    """Compare the radii of wheels with their heights at the initial configuration (nq,).

    The height of the ground is that of ``view.ground``, if the scenario states one; constraints may name their own.

    Args:
        scenario: a validated scenario.
        reduced: its reduced model.
        q0: the configuration.
    """
    ground = scenario.view.ground
    return wheel_height_findings(reduced, q0, None if isinstance(ground, str) else ground)


def warnings_of(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Messages of the findings that are more than a note.

    Args:
        findings: findings of a start.
    """
    return tuple(str(each) for each in findings if each.severity is not Severity.NOTE)


@contextmanager
def collected_model_warnings(show: bool) -> Iterator[list[str]]:
    """Collect the texts of ``ModelWarning``, each once. Other warnings are shown as usual.

    Args:
        show: True to show those of models afterwards too.
    """
    texts: list[str] = []
    told: list[warnings.WarningMessage] = []
    try:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always", ModelWarning)
            yield texts
            told = found
    finally:
        for each in told:
            of_model = issubclass(each.category, ModelWarning)
            if of_model and str(each.message) not in texts:
                texts.append(str(each.message))
            if show or not of_model:
                warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)


def build_plant(scenario: ScenarioFile, reduced: ReducedModel, q0: np.ndarray) -> Plant:
    """Build the plant of a scenario.

    Args:
        scenario: a validated scenario.
        reduced: model of the controller.
        q0: initial configuration, (nq,).

    Raises:
        RncError: the plant cannot be built from this robot, or a fault names an unknown frame or joint.
    """
    plant, faults, settings = scenario.plant, scenario.faults, scenario.simulation
    assert settings is not None
    in_mujoco = plant is not None and plant.type == "mujoco"
    if in_mujoco and (settings.joint_damping or settings.joint_friction or settings.substeps is not None):
        raise ConfigurationError(
            "simulation: joint_damping, joint_friction and substeps require plant 'reduced'; "
            "set the options of MuJoCo in 'plant'"
        )

    servo_time = None if plant is None else plant.servo_time
    _check_servos(scenario, servo_time)
    if scenario.contacts:
        _check_contacts(scenario)
        args = scenario.constraints, scenario.actuators, scenario.mimic, scenario.forces
        system = NonholonomicSystem(reduced.robot, *args)
        return ContactPlant(system, scenario.contacts, *settings.plant_options)

    def plant_of(model: ReducedModel) -> Plant:
        if in_mujoco:
            assert plant is not None
            return mujoco.MuJoCoPlant(model, plant.settings, q0)
        if servo_time is not None:
            return VelocityPlant(model, servo_time, settings.substeps or 1)
        return ReducedPlant(model, *settings.plant_options)

    if faults is None:
        return plant_of(reduced)
    stuck = faults.stuck
    try:
        differs = faults.masses or faults.forces
        true_plant = plant_of(_true_model(scenario, reduced.robot) if differs else reduced)
        if stuck is not None:
            locked = plant_of(_true_model(scenario, reduced.robot, stuck))
            true_plant = ChangingPlant(true_plant, locked, stuck.time)
    except RncError as error:
        raise ConfigurationError(f"faults: {error}") from None
    return FaultyPlant(true_plant, faults.faults, reduced, scenario.seed)


def _check_contacts(scenario: ScenarioFile) -> None:
    """Raise an error for settings that do not support contacts that open and close."""
    plant = scenario.plant
    if plant is not None and plant.type == "mujoco":
        why = "it takes the bodies on the ground from 'constraints'"
        raise ConfigurationError(f"plant: 'mujoco' does not support 'contacts', because {why}; use 'reduced'")
    if plant is not None and plant.servo_time is not None:
        raise ConfigurationError("plant.servo_time: velocity servos do not support 'contacts'")
    if scenario.faults is not None:
        raise ConfigurationError("faults: do not support 'contacts'")
    assert scenario.simulation is not None
    if scenario.simulation.on_lift_off != "ignore":
        raise ConfigurationError("simulation.on_lift_off: 'contacts' lift off by themselves; remove it")


def _check_servos(scenario: ScenarioFile, servo_time: float | None) -> None:
    """Raise an error unless controller and plant agree about inputs: forces or velocities."""
    settings = scenario.simulation
    assert settings is not None
    velocities = "" if scenario.controller is None else scenario.controller.velocity_command
    if velocities and servo_time is None:
        raise ConfigurationError(f"controller.{velocities} requires velocity servos: set plant.servo_time")
    if servo_time is not None and not velocities:
        raise ConfigurationError(
            "plant.servo_time: requires controller.tracker 'velocity', controller.velocities, or controller.type 'way'"
        )
    no_effect = {"joint_damping", "joint_friction", "actuator_limits"}
    unused = [name for name, value in settings if name in no_effect and value]
    if velocities and unused:
        raise ConfigurationError(f"simulation.{unused[0]}: has no effect on ideal velocity servos; remove it")
    faults = None if scenario.faults is None else scenario.faults.faults
    if velocities and faults is not None and np.isfinite(faults.effort):
        raise ConfigurationError("faults: effort is a limit of forces, and the plant takes velocities")


def _true_model(scenario: ScenarioFile, robot: Robot, stuck: StuckJoint | None = None) -> ReducedModel:
    """Build the true model: the system with other masses, further forces, and a joint that is stuck."""
    robot, faults = deepcopy(robot), scenario.faults
    assert faults is not None
    if faults.masses:
        MassErrors(faults.masses, scenario.seed).change(robot)
    constraints = [*scenario.constraints, *([] if stuck is None else [stuck.rows(robot)])]
    forces = [*scenario.forces, *faults.forces]
    return NonholonomicSystem(robot, constraints, scenario.actuators, scenario.mimic, forces).reduce()
