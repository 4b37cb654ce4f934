"""Preparation of a driven run: a scenario or a bare robot gets a velocity program."""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rnc_pin.analysis import NormalForces
from rnc_pin.applications.drive.commands import LoggedCommand
from rnc_pin.applications.drive.controller import DriveController
from rnc_pin.applications.drive.controls import DriveControls, base_frame, find_controls, find_pivots
from rnc_pin.applications.init import DraftOptions, draft
from rnc_pin.applications.init.assumptions import ChosenOutputs, select_outputs
from rnc_pin.applications.scenario.builder import Experiment, build_system
from rnc_pin.applications.scenario.files import ROBOT_FILES, built_in_names, mapping_of, robot_names
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.control import ActuatorVelocityController, ComputedTorque, VelocityTracker, describe
from rnc_pin.errors import ConfigurationError, RncError, few
from rnc_pin.io import Json, load_yaml
from rnc_pin.math import unit_rows
from rnc_pin.model import NonholonomicSystem, ReducedModel
from rnc_pin.motion.whole_body.limits import CollisionAvoidance, ControlLimit
from rnc_pin.outputs import FramePosition
from rnc_pin.robots import Robot

PERIOD = 0.01
"""Sampling period of a driven run [s], if no option gives another one."""
_ACCELERATION, _SLOWEST = 4.0, 0.02  # [rad/s^2 or m/s^2]; a new goal starts without a jerk, and starts
_CONTROLLER: dict[str, Json] = {"type": "qp", "tracker": "computed_torque", "tasks": [{"damping": {}}]}
_STATES, _SPEED = 20, 0.5  # random states, and their largest reduced velocity, at which efforts are compared
_SHARE, _NEEDED = 0.8, 0.01  # of an effort limit: what accelerations may use, and what counts
_REPLACED = (
    "task", "planner", "reference", "comparisons", "sweep", "plots", "variants", "variant", "presets", "grip",
    "preflight",
)  # fmt: skip
_ALWAYS_REGULAR = ("frame_speed", "frame_yaw", "joint", "frame_angular_velocity")


@dataclass(frozen=True)
class PreparedDrive:
    """Driven run that is ready to start.

    Attributes:
        scenario: the run, as for ``rnc-pin run``.
        controls: what a user may set.
        log: commands of the run.
        controller: kinematic controller of the run.
    """

    scenario: Scenario
    controls: DriveControls
    log: list[LoggedCommand]
    controller: DriveController


def read_source(source: str, options: Mapping[str, Json], wishes: DraftOptions | None = None) -> Scenario:
    """Return a scenario, or a draft for a robot, with options.

    Args:
        source: a scenario or a robot.
        options: dotted keys and values of the scenario.
        wishes: choices for the draft of a robot.

    Raises:
        RncError: neither a scenario nor a robot, no draft of the robot runs, or choices for a scenario.
    """
    is_file = os.path.isfile(source)
    is_robot = source.lower().endswith(ROBOT_FILES) if is_file else source in robot_names()
    # Scenarios first: some have the name of their robot.
    if is_robot and source not in built_in_names():
        raw = mapping_of(load_yaml(draft(source, Path(), wishes)))
        return Scenario(Path(source).name.split(".")[0], raw, Path().resolve()).with_options(options)
    if wishes and (wishes.xacro_arguments or wishes.package_dirs):
        raise ConfigurationError(f"{source}: --arg and --package-dir are for a robot; a scenario has keys of 'robot'")
    return Scenario.read(source).with_options(options)


def prepare_drive(source: Scenario, options: Mapping[str, Json], frames: Sequence[str] = ()) -> PreparedDrive:
    """Build a driven run from a scenario.

    Args:
        source: the scenario, with its options.
        options: dotted keys and values that the user gave.
        frames: frames that can have a goal; by default those of the scenario and the ends of the robot's chains.

    Raises:
        ConfigurationError: a velocity program cannot drive the robot.
        RncError: the scenario is invalid.
    """
    name, content = source.name, source.content
    if content.contacts:
        raise ConfigurationError(f"{name}: contacts: a driven run has none that open and close; use 'constraints'")
    system = build_system(content, source.folder)
    chosen = tuple(frames) or _default_frames(content, system.robot)
    for frame in chosen:
        system.robot.frame_id(frame)
    return _driven(replace(source, raw=_driven_config(source, system, chosen, options)), chosen)


def _driven(scenario: Scenario, frames: tuple[str, ...]) -> PreparedDrive:
    experiment = scenario.experiment
    _check_drivable(scenario.name, experiment)
    reduced, settings = experiment.reduced, experiment.simulation
    joints = [name for name in reduced.reducing.names if name in reduced.robot.joint_names]
    controls, log = find_controls(reduced, experiment.q0, frames, joints), list[LoggedCommand]()
    assert experiment.program is not None  # the controller of every driven scenario has one
    limits = _with_obstacles(experiment, experiment.program.limits)
    controller = DriveController(reduced, controls, log, limits, settings.dt)
    # A copy: the experiment of the scenario keeps its own program.
    tracker = copy.copy(experiment.controller)
    vars(tracker)["target"] = controller
    provenance = replace(experiment.provenance, controller=describe(tracker))
    driven = replace(experiment, controller=tracker, provenance=provenance)
    return PreparedDrive(scenario.built_with(experiment=driven), controls, log, controller)


def _with_obstacles(experiment: Experiment, limits: Sequence[ControlLimit]) -> list[ControlLimit]:
    """Return the limits of the scenario, with distances to its obstacles."""
    if not experiment.reduced.robot.has_collision_shapes:
        return list(limits)
    kept = [each for each in limits if not isinstance(each, CollisionAvoidance)]
    given = next((each for each in limits if isinstance(each, CollisionAvoidance)), None)
    # Also if the scenario asks for none: its author knew the motion, and a user goes anywhere.
    return [*kept, replace(given or CollisionAvoidance(q0=experiment.q0), obstacles=tuple(experiment.obstacles))]


# ------------------------------------------------------------------ the configuration


def _driven_config(
    source: Scenario, system: NonholonomicSystem, frames: Sequence[str], options: Mapping[str, Json]
) -> dict[str, Json]:
    """Return the scenario with outputs that are never dependent, and with a velocity program."""
    raw = source.raw
    config = {key: value for key, value in raw.items() if key not in _REPLACED}
    chosen, q0 = _chosen_outputs(source, system)
    vertical = [{"frame_position": {"frame": frame}} for frame in frames]
    config["outputs"] = {"reducing": chosen.entries, "vertical": vertical}
    given = raw.get("controller")
    program = given if isinstance(given, Mapping) and given.get("type") == "qp" else _CONTROLLER
    most = _accelerations(system.reduce(chosen.kinds), q0)
    limits = {"acceleration": {"limit": most}, **mapping_of(program.get("limits"))}
    config["controller"] = {**program, "limits": limits}
    settings = dict(mapping_of(raw.get("simulation")))
    # A file needs a duration; a driven run ends by its user.
    if settings.get("duration", "plan") == "plan":
        settings["duration"] = 10.0
    if not any(key == "simulation" or key.startswith("simulation.dt") for key in options):
        settings["dt"] = PERIOD
    # The program keeps positions within their limits: a touch of one may not end the run.
    config["simulation"] = {**settings, "position_limits": False}
    # Rates are by name of outputs, which are others now.
    config["initial"] = {key: value for key, value in mapping_of(raw.get("initial")).items() if key != "v2"}
    view, base = mapping_of(raw.get("view")), base_frame(system.robot, [])
    config["view"] = {**view, "trail": view.get("trail") or [*frames[:2], *filter(None, [base])]}
    return config


def _accelerations(reduced: ReducedModel, q0: np.ndarray) -> list[Json]:
    """Accelerations of the reduced velocities that efforts allow, at some states, and loads of wheels, at the start.

    All together they use the root of the sum of squares of what each uses alone.
    """
    generator, found, robot = np.random.default_rng(0), np.full(reduced.r, _ACCELERATION), reduced.robot
    joints = [name for name in reduced.reducing.names if name in robot.single_joint_names]
    normal, none = NormalForces(reduced), np.zeros(reduced.r)
    for k in range(_STATES):
        # A drawn state may be singular, or impossible to assemble: the others decide.
        with suppress(RncError):
            # Linkages stay on the branch on which they start.
            drawn = robot.joint_values(robot.random_configuration(generator))
            near = robot.joint_values(q0) | {name: drawn[name] for name in joints if k}
            q = reduced.assembled(robot.configuration(near), joints)
            # The first state is the start at rest, for which loads of wheels are compared.
            v2 = generator.uniform(-_SPEED, _SPEED, reduced.r) if k else none
            at = reduced.at(q, v2)
            T = at.allocate(reduced.inverse_dynamics(q, v2, none))
            each, loads = [at.allocate(column) for column in at.H.T], normal.at(at, T)
            limits = np.append(reduced.actuation.limits, np.where((loads > 0) & (k == 0), loads, np.inf))
            held = np.append(np.abs(T), 0.0 * normal.carried_by_row)
            used = np.abs([np.append(one, normal.at(at, T + one) - loads) for one in each]).T * found
            room = np.maximum(_SHARE * limits - held, _NEEDED * limits)
            scale = np.minimum(room / np.maximum(np.linalg.norm(used, axis=1), 1e-300), 1.0)
            counts = (used > _NEEDED * limits[:, None]) & ((held < _SHARE * limits)[:, None] | (k == 0))
            found *= np.where(counts, scale[:, None], 1.0).min(axis=0, initial=1.0)
    # Three digits: the numbers are written into the scenario of the record.
    return [float(f"{max(each, _SLOWEST):.3g}") for each in found]


def _chosen_outputs(source: Scenario, system: NonholonomicSystem) -> tuple[ChosenOutputs, np.ndarray]:
    """Independent outputs, and the start. Joints come first if pivots are aimed: speeds of the base may vanish."""
    robot, given = system.robot, source.content.initial.q
    q0 = robot.configuration(given)
    if system.assembly.size:
        q0 = system.assembled(q0, list(given))
    base = base_frame(robot, [])
    aimed = base is not None and bool(find_pivots(system.reduce(), q0, base)[0])
    return select_outputs(_output_candidates(source, robot, aimed), system, q0), q0


def _output_candidates(source: Scenario, robot: Robot, joints_first: bool) -> list[tuple[Mapping[str, Json], float]]:
    """Yield output entries by preference: speeds and joints of the scenario, the base, joints, then all others."""
    given = mapping_of(source.raw.get("outputs")).get("reducing")
    entries = [each for each in given if isinstance(each, Mapping)] if isinstance(given, list) else []
    # First what is independent everywhere: a drive ends where its outputs become dependent.
    told = [entry for entry in entries if next(iter(entry)) in _ALWAYS_REGULAR]
    base = base_frame(robot, [])
    if base is not None:
        told += [{"frame_speed": {"frame": base}}, {"frame_yaw": base}, {"frame_speed": {"frame": base, "axis": "y"}}]
    actuated = [each for each in source.content.actuators if isinstance(each, str) and each in robot.joint_names]
    told += [{"joint": name} for name in dict.fromkeys((*actuated, *robot.joint_names)) if name != "root_joint"]
    if joints_first:
        told.sort(key=lambda each: "joint" not in each)
    # An entry that comes twice depends on itself: it is chosen once.
    return [(entry, 0.0) for entry in (*told, *entries)]


def _default_frames(scenario: ScenarioFile, robot: Robot) -> tuple[str, ...]:
    """Frames of the scenario's position outputs and trails, then the ends of chains; none that a base carries."""
    named = [each.frame for each in scenario.listed_outputs if isinstance(each, FramePosition)]
    parents = {int(parent) for parent in robot.model.parents[1:]}
    bodies = {int(each.parentJoint): str(each.name) for each in robot.model.frames if each.type.name == "BODY"}
    ends = [bodies[joint] for joint in sorted(bodies) if joint and joint not in parents]
    root = robot.joint_id("root_joint") if "root_joint" in robot.joint_names else 0
    known = filter(robot.model.existFrame, dict.fromkeys((*named, *scenario.view.trail, *([] if named else ends))))
    most_frames = 4
    moving = [name for name in known if robot.model.frames[robot.frame_id(name)].parentJoint not in (0, root)]
    return tuple(moving[:most_frames])


def _check_drivable(name: str, experiment: Experiment) -> None:
    """Refuse a robot whose motions the actuators cannot produce, or whose tracker learns a model.

    Raises:
        ConfigurationError: with the reason.
    """
    reduced = experiment.reduced
    matrix = reduced.at(experiment.q0).input_matrix
    moved = 1e-6  # smallest singular value of R^T B, in rows of unit length, at which actuators move everything
    rank = int(np.linalg.matrix_rank(unit_rows(matrix), moved)) if matrix.size else 0
    if rank < reduced.r:
        idle = [reduced.reducing.names[k] for k in np.flatnonzero(~matrix.any(axis=1))]
        which = f" (none moves {few(idle)})" if idle else ""
        raise ConfigurationError(
            f"{name}: cannot be driven by velocities: {reduced.r} independent velocities, but its actuators move only "
            f"{rank} of them{which}; 'rnc-pin run' takes a controller for such a robot"
        )
    if not isinstance(experiment.controller, ComputedTorque | VelocityTracker | ActuatorVelocityController):
        raise ConfigurationError(f"{name}: controller.unknown is not available in a driven run; remove it")
