"""Builder of the objects of a run from a scenario."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rnc_pin import plants, simulation
from rnc_pin.analysis import Grip, wheel_height_findings
from rnc_pin.applications.scenario import plan_builder
from rnc_pin.applications.scenario.controllers.base import BuiltController, reduced_velocity
from rnc_pin.applications.scenario.controllers.feedback import check_output_names
from rnc_pin.applications.scenario.controllers.tracking import VelocityTrackerSettings
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.applications.scenario.schema.world import build_obstacles
from rnc_pin.collision import check_ignored_links
from rnc_pin.control import Controller, ZeroInput, describe
from rnc_pin.errors import ConfigurationError, ConstraintError, InputError, ModelWarning, RncError
from rnc_pin.model import ConstraintKind, ForceKind, NonholonomicSystem, ReducedModel, Task
from rnc_pin.motion.whole_body import WholeBodyProgram, program_of
from rnc_pin.robots import Robot
from rnc_pin.simulation import PLOTTED_QUANTITIES, Provenance, TaskNames
from rnc_pin.verdict import Finding, FindingKind, Severity
from rnc_pin.visualization import DrawnModel

_ROUNDED = 1e-4  # largest residual of holonomic rows that counts as rounding in the file


def build_system(scenario: ScenarioFile, folder: Path) -> NonholonomicSystem:
    """Build the system of robot, constraints and actuators. Paths are relative to ``folder``.

    Args:
        scenario: a validated scenario.
        folder: base of relative paths.
    """
    return _system(scenario, scenario.robot.build(folder))


def _system(
    scenario: ScenarioFile, robot: Robot, rows: Sequence[ConstraintKind] = (), forces: Sequence[ForceKind] = ()
) -> NonholonomicSystem:
    """System of a robot as the scenario describes it, with further rows and forces."""
    constraints, forces = [*scenario.constraints, *rows], [*scenario.forces, *forces]
    return NonholonomicSystem(robot, constraints, scenario.actuators, scenario.mimic, forces)


def build_task(scenario: ScenarioFile, reduced: ReducedModel) -> Task:
    """Return the task of the scenario. By default all reducing outputs are primary.

    Args:
        scenario: a validated scenario.
        reduced: its reduced model.
    """
    names = scenario.task
    # With redundant outputs alone, a file means that none is primary.
    primary = names.primary if names.primary or names.redundant else list(reduced.reducing.names)
    return Task.of(reduced, primary, names.redundant, names.vertical)


@dataclass(frozen=True, kw_only=True)
class Experiment(plan_builder.RunContext):
    """Objects of a run."""

    controller: Controller
    plant: plants.Plant
    provenance: Provenance
    warnings: tuple[str, ...] = ()
    model_warnings: tuple[str, ...] = ()
    """Warnings about the model, which building it gave."""
    start_findings: tuple[Finding, ...] = ()
    """Findings about the model at the start, such as radii of wheels that do not fit; ``warnings`` has the doubts."""

    @property
    def drawn_model(self) -> DrawnModel:
        """Robot, model and obstacles to draw, with the contacts that open and close, whose forces a page shows."""
        return DrawnModel(self.reduced.robot, self.reduced, self.obstacles, self.scenario.contact_constraints)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings that are known before the run: those of its plan and of its start, and warnings as notes."""
        known = {str(each) for each in self.start_findings}  # warnings repeat these: once in a verdict is enough
        told = [each for each in (*self.model_warnings, *self.warnings) if each not in known]
        notes = (Finding(FindingKind.MODEL, "", None, "", None, Severity.NOTE, each) for each in told)
        return (*(() if self.plan is None else self.plan.verdict.findings), *self.start_findings, *notes)

    @property
    def program(self) -> WholeBodyProgram | None:
        """Whole-body program of the controller, if it has one."""
        return program_of(self.controller)


def build_experiment(
    scenario: ScenarioFile, folder: Path, plans: plan_builder.Plans | None = None, reduced: ReducedModel | None = None
) -> Experiment:
    """Build a run from a scenario.

    Args:
        scenario: a validated scenario.
        folder: base of relative paths.
        plans, reduced: optimal motions, and the model of equal systems and outputs, of other runs, to share.

    Raises:
        RncError: a part of the scenario does not fit the robot.
    """
    if scenario.outputs is None and scenario.controller is None and scenario.simulation is None:
        raise ConfigurationError("outputs: is missing, and so are controller and simulation; a run needs the last two")
    timing = scenario.timing
    if scenario.controller is None and not scenario.contacts:
        raise ConfigurationError("controller: is missing; a run needs {type: ..., preset: ...}")
    # Before the robot is loaded, which takes longer than anything else here.
    if scenario.planner is None or timing.duration != "plan":
        with InputError.at("simulation"):
            simulation.sample_count(timing.seconds, timing.dt)
    reduced = scenario.reduced(build_system(scenario, folder)) if reduced is None else reduced
    for plot, settings in scenario.plots.items():  # a misspelt name would fail after the run
        check_output_names(f"plots.{plot}.outputs", settings.outputs, reduced, PLOTTED_QUANTITIES)
    obstacles = build_obstacles(scenario.obstacles, folder)
    check_ignored_links(obstacles, reduced.robot)
    start, task = start_of(scenario, reduced), build_task(scenario, reduced)
    context = plan_builder.RunContext(scenario, reduced, *start, task, timing, obstacles)
    context = plan_builder.with_plan(context, {} if plans is None else plans)
    for frame in scenario.view.trail:
        reduced.robot.frame_id(frame)  # raises for an unknown one, which the page would meet after the run
    at_start = start_findings(scenario, reduced, context.q0)
    # Before the controller: its roll-out may fail for the reason that these tell.
    warned = warnings_of(at_start)
    if scenario.controller is None:  # contacts fall and slide by themselves
        built, note = BuiltController(ZeroInput(reduced)), simulation.provenance_of(None)
    else:
        context = replace(plan_builder.with_references(context), grip=_grip(scenario, reduced))
        built, path = scenario.controller.build(context), context.path
        if context.plan is not None:
            trail = scenario.view.trail or reduced.robot.links_of(1)  # first the trail of the scenario, else the base
            path = plan_builder.planned_path(context.plan, reduced, trail[0])
        names = TaskNames(tuple(task.primary_names), tuple(task.redundant_names))
        said, note = describe(built.controller), simulation.provenance_of(built.notes)
        note = replace(note, controller=said, task=names, path=path)
        warned = (*warned, *built.warnings)
        if obstacles and not reduced.robot.has_collision_shapes:
            unknown = "has no collision geometry: its distances to the obstacles are not known"
            warned = (*warned, f"robot '{reduced.robot.name}' {unknown}")
    return Experiment(
        **vars(context),
        controller=built.controller,
        plant=build_plant(scenario, reduced, context.q0),
        provenance=note,
        warnings=warned,
        start_findings=at_start,
    )


def start_of(scenario: ScenarioFile, reduced: ReducedModel) -> tuple[np.ndarray, np.ndarray]:
    """Initial configuration (nq,) and initial reduced velocity (r,).

    Args:
        scenario: a validated scenario.
        reduced: its reduced model.
    """
    v2_0 = reduced_velocity(reduced, scenario.initial.v2, "initial.v2")
    return _initial(scenario, reduced), v2_0


def _grip(scenario: ScenarioFile, reduced: ReducedModel) -> Grip | None:
    """Return the friction limits of the wheels; None if the scenario has no ``grip``."""
    if scenario.grip is None:
        return None
    # Its preflight rolls a kinematic controller out, along which the forces of the wheels are known.
    if not isinstance(scenario.controller, VelocityTrackerSettings):
        raise ConfigurationError("grip: requires a controller over a velocity tracker, such as type 'redundancy'")
    with ConfigurationError.at("grip"):
        return Grip(reduced, scenario.grip.friction)


def _initial(scenario: ScenarioFile, reduced: ReducedModel) -> np.ndarray:
    """Return the initial configuration. If constraints require assembly, joints named in the file do not move."""
    q0 = reduced.robot.configuration(scenario.initial.q)
    if not reduced.assembly.size or np.abs(reduced.assembly.residual(q0)).max() < _ROUNDED:
        return q0  # the simulation corrects the rounding
    named = list(scenario.initial.q)
    following = {mimic.joint for mimic in reduced.robot.mimics} - set(named)
    if scenario.mimic and following:  # first try to move only mimic joints that the file does not name
        with suppress(ConstraintError):
            return reduced.assembled(q0, [name for name in reduced.robot.joint_names if name not in following])
    # What a file states is kept: moving it would start the run elsewhere without a word.
    try:
        return reduced.assembled(q0, named)
    except ConstraintError as error:
        raise ConfigurationError(f"initial.q: {error}; joints named in initial.q stay: {', '.join(named)}") from None


# ---------------------------------------------------------------------- plants


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
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", ModelWarning)
        yield texts
    for each in found:  # after the block that records them: inside it, they would be recorded again
        of_model = issubclass(each.category, ModelWarning)
        if of_model and str(each.message) not in texts:
            texts.append(str(each.message))
        if show or not of_model:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)


def build_plant(scenario: ScenarioFile, reduced: ReducedModel, q0: np.ndarray) -> plants.Plant:
    """Build the plant of a scenario.

    Args:
        scenario: a validated scenario.
        reduced: model of the controller.
        q0: initial configuration, (nq,).

    Raises:
        RncError: the plant cannot be built from this robot, or a fault names an unknown frame or joint.
    """
    plant, faults, settings = scenario.plant, scenario.faults, scenario.timing
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
        # The system without contacts: the plant adds their rows while they are closed.
        return plants.ContactPlant(_system(scenario, reduced.robot), scenario.contacts, *settings.plant_options)

    def plant_of(model: ReducedModel) -> plants.Plant:
        if in_mujoco:
            assert plant is not None
            return plants.mujoco.MuJoCoPlant(model, plant.settings, q0)
        if servo_time is not None:
            return plants.VelocityPlant(model, servo_time, settings.substeps or 1)
        return plants.ReducedPlant(model, *settings.plant_options)

    if faults is None:
        return plant_of(reduced)
    stuck = faults.stuck
    with RncError.at("faults"):
        differs = faults.masses or faults.forces  # noise and delays need no second model
        true_plant = plant_of(_true_model(scenario, reduced.robot) if differs else reduced)
        if stuck is not None:
            locked = plant_of(_true_model(scenario, reduced.robot, stuck))
            true_plant = plants.ChangingPlant(true_plant, locked, stuck.time)
    return plants.FaultyPlant(true_plant, faults.faults, reduced, scenario.seed)


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
    if scenario.timing.on_lift_off != "ignore":
        raise ConfigurationError("simulation.on_lift_off: 'contacts' lift off by themselves; remove it")


def _check_servos(scenario: ScenarioFile, servo_time: float | None) -> None:
    """Raise an error unless controller and plant agree about inputs: forces or velocities."""
    velocities = "" if scenario.controller is None else scenario.controller.velocity_command
    if velocities and servo_time is None:
        raise ConfigurationError(f"controller.{velocities} requires velocity servos: set plant.servo_time")
    if servo_time is not None and not velocities:
        raise ConfigurationError(
            "plant.servo_time: requires controller.tracker 'velocity', controller.velocities, or controller.type 'way'"
        )
    no_effect = {"joint_damping", "joint_friction", "actuator_limits"}
    # Ideal servos impose velocities, so that forces of a joint change nothing: better refused than ignored.
    unused = [name for name, value in scenario.timing if name in no_effect and value]
    if velocities and unused:
        raise ConfigurationError(f"simulation.{unused[0]}: has no effect on ideal velocity servos; remove it")
    faults = None if scenario.faults is None else scenario.faults.faults
    if velocities and faults is not None and np.isfinite(faults.effort):
        raise ConfigurationError("faults: effort is a limit of forces, and the plant takes velocities")


def _true_model(scenario: ScenarioFile, robot: Robot, stuck: plants.StuckJoint | None = None) -> ReducedModel:
    """Build the true model: the system with other masses, further forces, and a joint that is stuck."""
    # The controller keeps the nominal masses: only the plant's own robot is changed.
    robot, faults = deepcopy(robot), scenario.faults
    assert faults is not None
    if faults.masses:
        plants.MassErrors(faults.masses, scenario.seed).change(robot)
    # No outputs: a stuck joint may be one of them, and the plant needs none.
    return _system(scenario, robot, [] if stuck is None else [stuck.rows(robot)], faults.forces).reduce()
