"""References of a scenario: of its outputs, of frames, and of the path of a vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rnc_pin.applications.scenario.schema import ScenarioFile
from rnc_pin.array_shapes import Float
from rnc_pin.control import SlitheringReference
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.model import Coordinates, Kinematics, ReducedModel, Task
from rnc_pin.optimal import MotionPlan
from rnc_pin.planning import Hold, Reference
from rnc_pin.robots import Robot
from rnc_pin.simulation import PlannedPath


class FramePoses(NamedTuple):
    """Poses of a frame."""

    planar: Float[np.ndarray, "n 3"]
    """Position x, y [m] and heading [rad]."""
    heights: Float[np.ndarray, " n"]
    """Position z [m]."""


def frame_poses(robot: Robot, frame: str, configurations: np.ndarray) -> FramePoses:
    """Return the poses of a frame at configurations (n, nq)."""
    rotation, place = Kinematics(robot).position(configurations).placement(robot.frame_id(frame))
    heading = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return FramePoses(np.column_stack([place[:, :2], heading]), place[:, 2])


def task_starts(reduced: ReducedModel, task: Task, q0: np.ndarray) -> dict[str, np.ndarray]:
    """Values of the task's outputs at a configuration, by role: ``primary``, ``redundant``, ``vertical``."""
    x1, x2 = reduced.at(q0).outputs()
    return {"primary": x2[task.primary], "redundant": x2[task.redundant], "vertical": x1[task.vertical]}


def task_references(
    scenario: ScenarioFile, reduced: ReducedModel, task: Task, q0: np.ndarray, motion: MotionPlan | None
) -> tuple[dict[str, Reference], tuple[str, ...]]:
    """References of the task's outputs, and the names of those that the scenario or its plan gives."""
    if motion is not None and scenario.reference.path is not None:
        raise ConfigurationError("reference.path: 'planner' plans the motion; remove one of them")
    starts = task_starts(reduced, task, q0)
    references: dict[str, Reference] = {}
    given = []
    for name, start in starts.items():
        settings, outputs = getattr(scenario.reference, name), getattr(task, f"{name}_names")
        try:
            coordinates: Coordinates = getattr(task, f"{name}_coordinates")
            if settings is not None:
                references[name] = settings.from_start(start, coordinates)
            elif motion is not None and outputs and name in getattr(scenario.controller, "followed", ()):
                references[name] = motion.reference(outputs)
            else:
                references[name] = Hold(start)
                continue
            given.append(name)
        except (ConfigurationError, InputError) as error:
            raise ConfigurationError(f"reference.{name}: {error}") from None
    return references, tuple(given)


@dataclass(frozen=True)
class PathPlan:
    """Planned path of a vehicle and its references; all None without a planned path."""

    primary: Reference | None = None
    """Travelled distance and steering angle."""
    slithering: SlitheringReference | None = None
    """Reference of the trailer's heading."""
    monitored: tuple[np.ndarray, Reference] | None = None
    """Indices in x1 and reference of the x and y of the frame, for the record."""
    planned: PlannedPath | None = None
    """For plots: the frame, and the poses of the path."""


def plan_path(scenario: ScenarioFile, reduced: ReducedModel, task: Task, q0: np.ndarray) -> PathPlan:
    """Plan the path of ``reference.path``."""
    settings = scenario.reference.path
    if settings is None:
        return PathPlan()
    if scenario.reference.primary is not None or (settings.trailer and scenario.reference.vertical is not None):
        raise ConfigurationError("reference.path: replaces 'primary' and, with a trailer, 'vertical'; remove those")
    if len(task.primary) != 2 or reduced.reducing.quasi[task.primary].tolist() != [True, False]:
        raise ConfigurationError(
            "reference.path: primary outputs must be forward speed and steering angle, in this order"
        )
    speed, steering = (int(index) for index in task.primary)
    start = frame_poses(reduced.robot, settings.frame, q0[None]).planar[0]
    trailer, slithering = settings.trailer, None
    with ConfigurationError.at("reference.path"):
        path = settings.path(
            reduced,
            q0,
            start,
            settings.duration,
            speed=speed,
            steering=steering,
            forward_only=trailer is not None or bool(settings.forward_only),
        )
        if trailer is not None:
            slithering = trailer.build(reduced=reduced, task=task, tractor=settings.frame)
    poses = np.round(path.poses[:: max(1, len(path.poses) // 400)], 5).tolist()
    names = [f"{settings.frame}_{axis}" for axis in "xy"]
    monitored = None
    if all(name in reduced.vertical.names for name in names):
        monitored = (np.array([reduced.vertical.names.index(name) for name in names]), path.position)
    planned = PlannedPath(settings.frame, tuple((x, y, heading) for x, y, heading in poses))
    return PathPlan(path.reference, slithering, monitored, planned)
