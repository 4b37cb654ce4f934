"""Builder of the objects of a run from a scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from rnc_pin.analysis import Grip
from rnc_pin.applications.scenario.controllers import ControllerContext
from rnc_pin.applications.scenario.controllers.base import reduced_velocity
from rnc_pin.applications.scenario.controllers.feedback import check_output_names
from rnc_pin.applications.scenario.controllers.tracking import VelocityTrackerSettings
from rnc_pin.applications.scenario.controllers.whole_body import TaskGoals
from rnc_pin.applications.scenario.plan_builder import Plans, Start, plan_path, planned_path, task_references
from rnc_pin.applications.scenario.plant_builder import build_plant, start_findings, warnings_of
from rnc_pin.applications.scenario.schema import ScenarioFile, SimulationSettings
from rnc_pin.applications.scenario.schema.world import build_obstacles
from rnc_pin.collision import Obstacle, check_ignored_links
from rnc_pin.control import Controller, ZeroInput, describe
from rnc_pin.control.loop import LoopOptions
from rnc_pin.errors import ConfigurationError, ConstraintError, InputError
from rnc_pin.model import NonholonomicSystem, ReducedModel, Task
from rnc_pin.motion.optimal import MotionPlan
from rnc_pin.motion.planning import Reference
from rnc_pin.motion.whole_body import WholeBodyProgram, program_of
from rnc_pin.plants import Plant
from rnc_pin.simulation import (
    PLOTTED_QUANTITIES,
    Provenance,
    SimulationOptions,
    TaskNames,
    Trajectory,
    provenance_of,
    sample_count,
    simulate,
)
from rnc_pin.verdict import Finding, FindingKind, Severity
from rnc_pin.visualization import DrawnModel

_ROUNDED = 1e-4  # largest residual of holonomic rows that counts as rounding in the file


def build_system(scenario: ScenarioFile, folder: Path) -> NonholonomicSystem:
    """Build the system of robot, constraints and actuators. Paths are relative to ``folder``.

    Args:
        scenario: a validated scenario.
        folder: base of relative paths.
    """
    robot = scenario.robot.build(folder)
    return NonholonomicSystem(robot, scenario.constraints, scenario.actuators, scenario.mimic, scenario.forces)


def build_reduced(scenario: ScenarioFile, folder: Path) -> tuple[NonholonomicSystem, ReducedModel]:
    """Build the system and reduce it to the outputs of the scenario.

    Args:
        scenario: a validated scenario.
        folder: base of relative paths.
    """
    system = build_system(scenario, folder)
    return system, scenario.reduced(system)


def build_task(scenario: ScenarioFile, reduced: ReducedModel) -> Task:
    """Return the task of the scenario. By default all reducing outputs are primary.

    Args:
        scenario: a validated scenario.
        reduced: its reduced model.
    """
    names = scenario.task
    primary = names.primary
    if not primary and not names.redundant:
        primary = list(reduced.reducing.names)
    return Task.of(reduced, primary, names.redundant, names.vertical)


@dataclass(frozen=True)
class Experiment:
    """Objects of a run."""

    scenario: ScenarioFile
    reduced: ReducedModel
    controller: Controller
    plant: Plant
    q0: np.ndarray
    v2_0: np.ndarray
    simulation: SimulationSettings
    warnings: tuple[str, ...]
    provenance: Provenance
    obstacles: tuple[Obstacle, ...] = ()
    plan: MotionPlan | None = None
    """Optimal motion of ``planner``."""
    references: Mapping[str, Reference] = field(default_factory=dict)
    """References of the task by role: ``primary``, ``redundant``, ``vertical``."""
    goals: TaskGoals | None = None
    """Goals of whole-body tasks."""
    ends: Mapping[str, float] = field(default_factory=dict)
    """Values at which references or the plan end after the run, by output."""
    model_warnings: tuple[str, ...] = ()
    """Warnings about the model, which building it gave."""
    start_findings: tuple[Finding, ...] = ()
    """Findings about the model at the start, such as radii of wheels that do not fit; ``warnings`` has the doubts."""

    @property
    def drawn_model(self) -> DrawnModel:
        """Robot, model and obstacles to draw."""
        return DrawnModel(self.reduced.robot, self.reduced, self.obstacles)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings that are known before the run: those of its plan and of its start, and warnings as notes."""
        known = {str(each) for each in self.start_findings}
        told = [each for each in (*self.model_warnings, *self.warnings) if each not in known]
        notes = (Finding(FindingKind.MODEL, "", None, "", None, Severity.NOTE, each) for each in told)
        return (*(() if self.plan is None else self.plan.verdict.findings), *self.start_findings, *notes)

    @property
    def program(self) -> WholeBodyProgram | None:
        """Whole-body program of the controller, if it has one."""
        return program_of(self.controller)

    @property
    def loop(self) -> LoopOptions:
        """Options of the control loop that the scenario sets."""
        return {} if self.scenario.loop is None else self.scenario.loop.options

    def run(self, options: SimulationOptions) -> Trajectory:
        """Simulate the run.

        Args:
            options: options of the run, with its observer and provenance.
        """
        dt, start, v2_0 = self.simulation.dt, self.q0, self.v2_0
        duration, plant = self.simulation.seconds, self.plant
        return simulate(self.reduced, self.controller, start, duration, dt, v2_0=v2_0, plant=plant, options=options)


def build_experiment(
    scenario: ScenarioFile, folder: Path, plans: Plans | None = None, reduced: ReducedModel | None = None
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
    if scenario.simulation is None:
        raise ConfigurationError("simulation: is missing; a run needs {duration: ..., dt: ...}")
    if scenario.controller is None and not scenario.contacts:
        raise ConfigurationError("controller: is missing; a run needs {type: ..., preset: ...}")
    simulation = scenario.simulation
    if scenario.planner is None or simulation.duration != "plan":
        try:
            sample_count(simulation.seconds, simulation.dt)
        except InputError as error:
            raise ConfigurationError(f"simulation: {error}") from None
    reduced = build_reduced(scenario, folder)[1] if reduced is None else reduced
    _check_plots(scenario, reduced)
    q0, v2_0 = start_of(scenario, reduced)

    task = build_task(scenario, reduced)
    obstacles = build_obstacles(scenario.obstacles, folder)
    check_ignored_links(obstacles, reduced.robot)
    motion = None
    if scenario.planner is not None:
        motion = (Plans() if plans is None else plans).plan(scenario, reduced, Start(q0, v2_0), obstacles)
        simulation = simulation.of_plan(motion.duration)
    for frame in scenario.view.trail:
        reduced.robot.frame_id(frame)
    at_start = start_findings(scenario, reduced, q0)
    doubted = warnings_of(at_start)
    run = partial(Experiment, scenario, reduced, q0=q0, v2_0=v2_0, simulation=simulation, obstacles=obstacles)
    if scenario.controller is None:
        without, plant = ZeroInput(reduced), build_plant(scenario, reduced, q0)
        return run(without, plant, warnings=doubted, start_findings=at_start, provenance=provenance_of(None))
    references, given = task_references(scenario, reduced, task, q0, motion)
    path = plan_path(scenario, reduced, task, q0)
    if path.primary is not None:
        references["primary"] = path.primary
    context = ControllerContext(
        reduced=reduced,
        task=task,
        **references,
        given=given,
        q0=q0,
        simulation=simulation,
        preflight=scenario.preflight,
        slithering=path.slithering,
        monitored=path.monitored,
        v2_0=v2_0,
        grip=_grip(scenario, reduced),
        obstacles=obstacles,
        plan=motion,
        outputs=scenario.listed_outputs,
    )
    built = scenario.controller.build(context)
    return run(
        built.controller,
        build_plant(scenario, reduced, q0),
        warnings=(*doubted, *built.warnings, *_unmeasured(obstacles, reduced)),
        start_findings=at_start,
        provenance=replace(
            provenance_of(built.notes),
            controller=describe(built.controller),
            task=TaskNames(tuple(task.primary_names), tuple(task.redundant_names)),
            path=path.planned if motion is None else planned_path(motion, reduced, _shown_frame(scenario, reduced)),
        ),
        plan=motion,
        references=references,
        goals=built.goals,
        ends=_later_ends(scenario, context),
    )


def start_of(scenario: ScenarioFile, reduced: ReducedModel) -> tuple[np.ndarray, np.ndarray]:
    """Initial configuration (nq,) and initial reduced velocity (r,).

    Args:
        scenario: a validated scenario.
        reduced: its reduced model.
    """
    return _initial(scenario, reduced), reduced_velocity(reduced, scenario.initial.v2, "initial.v2")


def _shown_frame(scenario: ScenarioFile, reduced: ReducedModel) -> str:
    """Frame whose planned path is drawn: the first trail, or the body of the first joint."""
    if scenario.view.trail:
        return scenario.view.trail[0]
    frames = reduced.robot.model.frames
    return next(str(each.name) for each in frames if each.parentJoint == 1 and "BODY" in str(each.type))


def _unmeasured(obstacles: Sequence[Obstacle], reduced: ReducedModel) -> tuple[str, ...]:
    """Return the warning that distances to obstacles are not known."""
    geometry = reduced.robot.collision_model if obstacles else None
    if not obstacles or (geometry is not None and len(geometry.geometryObjects)):
        return ()
    text = f"robot '{reduced.robot.name}' has no collision geometry: its distances to the obstacles are not known"
    return (text,)


def _grip(scenario: ScenarioFile, reduced: ReducedModel) -> Grip | None:
    """Return the friction limits of the wheels; None if the scenario has no ``grip``."""
    if scenario.grip is None:
        return None
    if not isinstance(scenario.controller, VelocityTrackerSettings):
        raise ConfigurationError("grip: requires a controller over a velocity tracker, such as type 'redundancy'")
    with ConfigurationError.at("grip"):
        return scenario.grip.build(reduced)


def _later_ends(scenario: ScenarioFile, context: ControllerContext) -> dict[str, float]:
    """Values at which references or the plan end after the run, by output."""
    found, duration = dict[str, float](), context.simulation.seconds
    if context.plan is not None and scenario.planner is not None and duration < context.plan.duration:
        found |= scenario.planner.goal
    for reference, outputs in context.references.values():
        if duration < reference.duration < np.inf:
            ends = reference.at(reference.duration).position.tolist()
            found |= zip(outputs, ends, strict=True)
    return found


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
    try:
        return reduced.assembled(q0, named)
    except ConstraintError as error:
        raise ConfigurationError(f"initial.q: {error}; joints named in initial.q stay: {', '.join(named)}") from None


def _check_plots(scenario: ScenarioFile, reduced: ReducedModel) -> None:
    """Raise an error if a plot names no output of the model, and no quantity."""
    valid = (*reduced.reducing.names, *reduced.vertical.names, *PLOTTED_QUANTITIES)
    for plot, settings in scenario.plots.items():
        check_output_names(f"plots.{plot}.outputs", settings.outputs, valid)
