"""From a scenario to objects that run."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import pinocchio as pin

from rnc_pin.analysis import Grip
from rnc_pin.control import Controller, SlitheringReference, describe
from rnc_pin.errors import ConfigurationError, ConstraintError, InfeasibleError, InputError, nearest
from rnc_pin.loop import LoopOptions
from rnc_pin.math.coordinates import Coordinates
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.model.task import Task
from rnc_pin.plain import Json
from rnc_pin.planning import CarPath, Hold, Reference, Slowed
from rnc_pin.planning.driven_path import continued_back, distances
from rnc_pin.planning.steering_geometry import SteeringGeometry
from rnc_pin.plants import Machine
from rnc_pin.robots.robot import Robot
from rnc_pin.scenario.machines import build_machine
from rnc_pin.scenario.schema import Scenario, SimulationSettings
from rnc_pin.scenario.schema.controllers import Context
from rnc_pin.scenario.schema.controllers.base import Built, reduced_velocity
from rnc_pin.scenario.schema.controllers.velocity import VelocitySettings
from rnc_pin.simulation import PlannedPath, Provenance, TaskNames, sample_count
from rnc_pin.simulation.info_json import provenance_of, provenance_to_plain

_SLOWED_TIMES = 6  # what an initial error asks for does not slow down, so that a factor may not be enough
_ROUNDED = 1e-4  # residual of holonomic rows that a file's few digits leave


def build_system(scenario: Scenario, folder: Path) -> NonholonomicSystem:
    """Robot, constraints and actuators; paths are relative to ``folder``."""
    robot = scenario.robot.build(folder)
    return NonholonomicSystem(robot, scenario.constraints, scenario.actuators, scenario.mimic)


def build_reduced(scenario: Scenario, folder: Path) -> tuple[NonholonomicSystem, ReducedModel]:
    """The system and its reduction to the scenario's outputs."""
    system = build_system(scenario, folder)
    return system, system.reduce(scenario.outputs.reducing, scenario.outputs.vertical)


def build_task(scenario: Scenario, reduced: ReducedModel) -> Task:
    """How the scenario divides the outputs; without a word of it all reducing outputs are primary."""
    names = scenario.task
    primary = names.primary
    if not primary and not names.redundant:
        primary = list(reduced.reducing.names)
    return Task.of(reduced, primary, names.redundant, names.vertical)


@dataclass(frozen=True)
class Experiment:
    """Everything a run needs; without a machine the reduced model itself moves."""

    scenario: Scenario
    reduced: ReducedModel
    controller: Controller
    q0: np.ndarray
    v2_0: np.ndarray
    simulation: SimulationSettings
    warnings: tuple[str, ...]
    provenance: Provenance
    machine: Machine | None = None

    @property
    def loop(self) -> LoopOptions:
        """Options of the loop around the controller, as far as the scenario has a word for them."""
        said = self.scenario.loop
        options = {} if said is None else {key: getattr(said, key) for key in type(said).model_fields}
        return cast(LoopOptions, {key: value for key, value in options.items() if value is not None})

    @property
    def notes(self) -> dict[str, Json]:
        """What the record of a run will say of it, as its file does."""
        return provenance_to_plain(self.provenance)


def build_experiment(scenario: Scenario, folder: Path) -> Experiment:
    """A run from a scenario.

    Raises:
        RncError: anything in it does not fit the robot.
    """
    if scenario.simulation is None:
        raise ConfigurationError("simulation: is missing; a run needs {duration: ..., dt: ...}")
    if scenario.controller is None:
        raise ConfigurationError("controller: is missing; a run needs {type: ..., preset: ...}")
    try:  # before anything is written
        sample_count(scenario.simulation.duration, scenario.simulation.dt, scenario.simulation.substeps)
    except InputError as error:
        raise ConfigurationError(f"simulation: {error}") from None
    _, reduced = build_reduced(scenario, folder)
    task = build_task(scenario, reduced)
    q0 = _initial(scenario, reduced)
    v2_0 = reduced_velocity(reduced, scenario.initial.v2, "initial.v2")
    x1, x2 = reduced.outputs(q0)
    starts = {"primary": x2[task.primary], "redundant": x2[task.redundant], "vertical": x1[task.vertical]}
    references: dict[str, Reference] = {}
    given = tuple(name for name in starts if getattr(scenario.reference, name) is not None)
    for name, start in starts.items():
        settings = getattr(scenario.reference, name)
        try:
            coordinates: Coordinates = getattr(task, f"{name}_coordinates")
            references[name] = Hold(start) if settings is None else settings.build(start, coordinates)
        except (ConfigurationError, InputError) as error:
            raise ConfigurationError(f"reference.{name}: {error}") from None
    path = _plan_path(scenario, reduced, task, q0)
    built = _built(
        scenario,
        Context(
            reduced=reduced,
            task=task,
            primary=references["primary"] if path.primary is None else path.primary,
            redundant=references["redundant"],
            vertical=references["vertical"],
            given=given,
            q0=q0,
            simulation=scenario.simulation,
            preflight=scenario.preflight,
            slithering=path.slithering,
            watched=path.watched,
            v2_0=v2_0,
            grip=_grip(scenario, reduced),
        ),
    )
    _check_plots(scenario, reduced)
    for frame in scenario.view.trail:
        reduced.robot.frame_id(frame)
    return Experiment(
        scenario=scenario,
        reduced=reduced,
        controller=built.controller,
        q0=q0,
        v2_0=v2_0,
        simulation=scenario.simulation,
        warnings=built.warnings,
        provenance=replace(
            provenance_of(built.notes),
            controller=describe(built.controller),
            task=TaskNames(tuple(task.primary_names), tuple(task.redundant_names)),
            path=path.planned,
        ),
        machine=build_machine(scenario, reduced, q0, folder),
    )


def _grip(scenario: Scenario, reduced: ReducedModel) -> Grip | None:
    """Of the wheels on the ground; None where the scenario does not speak of it."""
    if scenario.grip is None:
        return None
    if not isinstance(scenario.controller, VelocitySettings):
        raise ConfigurationError("grip: is only known beforehand of controllers whose references are rolled out")
    try:
        return Grip(reduced, scenario.grip.friction, scenario.grip.loads)
    except ConfigurationError as error:
        raise ConfigurationError(f"grip: {error}") from None


def _built(scenario: Scenario, context: Context) -> Built:
    """The controller, its references slowed until wheels hold on where the scenario asks for that."""
    assert scenario.controller is not None
    if scenario.grip is None or not scenario.grip.slow:
        return scenario.controller.build(context)
    slower, slowed = 1.0, replace(context, preflight="warn")
    for _ in range(_SLOWED_TIMES):
        built = scenario.controller.build(slowed)
        if built.slower == 1.0 or not np.isfinite(built.slower):
            break
        slower *= built.slower
        slowed = replace(
            slowed,
            primary=Slowed(context.primary, slower),
            redundant=Slowed(context.redundant, slower),
            vertical=Slowed(context.vertical, slower),
            watched=context.watched and (context.watched[0], Slowed(context.watched[1], slower)),
        )
    if built.warnings and scenario.preflight == "refuse":
        raise InfeasibleError("; ".join(built.warnings))
    if slower > 1.0:
        said = f"references take {slower:.4g} times as long, so that wheels hold on to the ground"
        built = replace(built, warnings=(said, *built.warnings))
    return built


def _initial(scenario: Scenario, reduced: ReducedModel) -> np.ndarray:
    """The initial configuration; where it has to be assembled, joints that the file names stay where it says."""
    q0 = reduced.robot.configuration(scenario.initial.q)
    if not reduced.assembly.size or np.abs(reduced.position_residual(q0)).max() < _ROUNDED:
        return q0  # a simulation takes the rounding away
    named = list(scenario.initial.q)
    following = {mimic.joint for mimic in reduced.robot.mimics} - set(named)
    if scenario.mimic and following:  # where it is enough that these follow, nothing else gives way
        with suppress(ConstraintError):
            return reduced.assembled(q0, [name for name in reduced.robot.joint_names if name not in following])
    try:
        return reduced.assembled(q0, named)
    except ConstraintError as error:
        raise ConfigurationError(f"initial.q: {error}") from None


@dataclass(frozen=True)
class _Way:
    """What a path that is driven gives; nothing where the scenario plans none."""

    primary: Reference | None = None
    """Distance driven and steering angle."""
    slithering: SlitheringReference | None = None
    """Of the trailer's heading."""
    watched: tuple[np.ndarray, Reference] | None = None
    """Positions in x1 and reference of the frame's x and y."""
    planned: PlannedPath | None = None
    """For the pictures: the poses, whose they are, and which trailer should follow."""


def _plan_path(scenario: Scenario, reduced: ReducedModel, task: Task, q0: np.ndarray) -> _Way:
    """Plan the path that the scenario asks for."""
    settings = scenario.reference.path
    if settings is None:
        return _Way()
    if scenario.reference.primary is not None or (settings.trailer and scenario.reference.vertical is not None):
        raise ConfigurationError("reference.path: takes the place of 'primary' and, with a trailer, of 'vertical'")
    if len(task.primary) != 2 or reduced.reducing.quasi[task.primary].tolist() != [True, False]:
        raise ConfigurationError("reference.path: the primary outputs have to be forward speed and steering angle")
    speed, steering = (int(index) for index in task.primary)
    start = frame_poses(reduced.robot, settings.frame, q0[None])[0]
    trailer, slithering = settings.trailer, None
    try:
        path = CarPath(
            start,
            settings.to,
            settings.duration,
            settings.wheelbase,
            via=settings.via,
            max_steering=settings.max_steering,
            forward_only=trailer is not None or bool(settings.forward_only),
            geometry=SteeringGeometry(
                reduced,
                q0,
                settings.frame,
                speed=speed,
                steering=steering,
                largest=np.tan(settings.max_steering) / settings.wheelbase,
            ),
        )
        if trailer is not None:
            slithering = SlitheringReference(reduced, task, settings.frame, trailer.frame, trailer.kingpin)
    except ConfigurationError as error:
        raise type(error)(f"reference.path: {error}") from None
    poses = np.round(path.poses[:: max(1, len(path.poses) // 400)], 5).tolist()
    trailing = None if trailer is None else trailer.frame
    names = [f"{settings.frame}_{axis}" for axis in "xy"]
    watched = None
    if all(name in reduced.vertical.names for name in names):
        watched = (np.array([reduced.vertical.names.index(name) for name in names]), path.position)
    planned = PlannedPath(settings.frame, trailing, tuple((x, y, heading) for x, y, heading in poses))
    return _Way(path.reference, slithering, watched, planned)


def frame_poses(robot: Robot, frame: str, configurations: np.ndarray) -> np.ndarray:
    """x, y and heading of a frame, (N, 3), along configurations (N, nq)."""
    data, index = robot.model.createData(), robot.frame_id(frame)
    poses = np.empty((len(configurations), 3))
    for pose, q in zip(poses, configurations, strict=True):
        pin.framesForwardKinematics(robot.model, data, q)
        placement = data.oMf[index]
        pose[:2] = placement.translation[:2]
        pose[2] = np.arctan2(placement.rotation[1, 0], placement.rotation[0, 0])
    return poses


def off_tracking(experiment: Experiment, configurations: np.ndarray) -> float | None:
    """Largest distance [m] of a trailer's axle from the path that was driven, or None where there is no trailer.

    The path is that of the frame that the scenario plans for, with a straight stretch before the start.
    """
    settings = experiment.scenario.reference.path
    if settings is None or settings.trailer is None or not len(configurations):
        return None
    robot = experiment.reduced.robot
    some = configurations[::10]  # a vehicle moves little in between
    driven, axle = (frame_poses(robot, frame, some) for frame in (settings.frame, settings.trailer.frame))
    behind = 2.0 * float(np.linalg.norm(driven[0, :2] - axle[0, :2]))
    return float(distances(axle[:, :2], continued_back(driven, behind)).max())


def _check_plots(scenario: Scenario, reduced: ReducedModel) -> None:
    valid = (*reduced.reducing.names, *reduced.vertical.names)
    for plot, settings in scenario.plots.items():
        for name in settings.outputs:
            if name not in valid:
                raise ConfigurationError(f"plots.{plot}.outputs: no output '{name}'{nearest(name, valid)}")
