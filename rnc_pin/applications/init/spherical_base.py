"""Spherical robots: a shell that rolls on the ground, moved by joints inside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.applications.init.base_assumptions import BaseAssumptions
from rnc_pin.applications.init.joint_properties import is_revolute, joint_range, turning_axis
from rnc_pin.applications.init.robot_at_start import RobotAtStart
from rnc_pin.applications.init.shapes import LEVEL, Shape
from rnc_pin.applications.init.tolerances import SAME
from rnc_pin.io import Json

_INSIDE = 1.05  # largest distance of an inner shape from the center, in radii
_ROUND = 0.03  # largest deviation of a mesh from a sphere, in radii
_WHOLE = 0.9  # smallest extent of the mesh along each axis, as a share of its diameter
_CORNERS = 30  # smallest number of vertices of a spherical mesh
_TURNED = 3.0  # displacement of a joint without limits [rad]
_DURATION = 8.0


@dataclass(frozen=True)
class Shell:
    """Sphere around the whole robot.

    Attributes:
        frame: frame fixed to the shell, with its origin at the center.
        radius: radius [m].
        measured: geometry that gives the radius, "collision" or "visual".
        height: height of the base's origin above the ground [m].
    """

    frame: str
    radius: float
    measured: str
    height: float


def find_shell(at_start: RobotAtStart) -> Shell | None:
    """Return the shell of a spherical robot, or None.

    Args:
        at_start: the robot.
    """
    if not _drives(at_start):
        return None
    for kind, shapes in at_start.shapes.items():
        for shape in shapes:
            sphere = _sphere(shape) if shape.joint == at_start.root else None
            if sphere is None or not _encloses(sphere, at_start):
                continue
            center, radius = sphere
            frame = _frame_at(center, radius, at_start)
            if frame is not None:
                origin = float(at_start.data.oMi[at_start.root].translation[2])
                return Shell(frame, radius, kind, origin - center[2] + radius)
    return None


def spherical_base(shell: Shell, at_start: RobotAtStart) -> BaseAssumptions:
    """Ball that rolls on the ground while the inner joints follow their references."""
    own = bool(at_start.root) and not at_start.is_rigid
    result = BaseAssumptions(None if own else "free", "a ball that joints inside it roll", at_start.frame)
    joint = at_start.robot.joint_names[at_start.root - 1] if own else "root_joint"
    result.initial[joint] = [0.0, 0.0, round(shell.height, 6), 0.0, 0.0, 0.0, 1.0]
    result.ground = 0.0
    entry: dict[str, Json] = {"rolling_ball": {"frame": shell.frame, "radius": round(shell.radius, 6)}}
    result.constraints.append((entry, f"radius from the {shell.measured} geometry"))
    drives = _drives(at_start)
    result.passive |= set(at_start.start) - set(drives)
    result.outputs += [({"joint": name}, _step(name, at_start)) for name in drives]
    result.outputs.append(({"frame_orientation": shell.frame}, 0.0))
    result.untracked |= {f"{shell.frame}_orientation_{axis}" for axis in "xyz"} | result.passive
    result.vertical.append({"frame_position": {"frame": shell.frame, "axes": "xy"}})
    result.feedback = {"type": "jacobian_transpose", "active": [*drives], "preset": "scaled"}
    result.feedback_remark = "moves the inner joints by their own actuators; the shell rolls as the constraints require"
    result.duration = _DURATION
    result.notes.append("only the inner joints drive the shell: its position is not controlled")
    return result


def _drives(at_start: RobotAtStart) -> list[str]:
    """Driven inner joints."""
    return [name for name in at_start.start if at_start.drives.drives(name)]


def _step(name: str, at_start: RobotAtStart) -> float:
    """Displacement of a joint's reference [rad or m]; largest for a continuous joint with a horizontal axis."""
    low, high = joint_range(at_start.robot, name)
    level = abs(turning_axis(at_start.robot.model, at_start.data, at_start.robot.joint_id(name))[2]) < LEVEL
    length = (_TURNED if level else 0.4) if is_revolute(at_start.robot, name) else 0.05
    room = 0.3 * max(high - at_start.start[name], at_start.start[name] - low)
    return round(max(float(min(length, room)), 0.0), 4)


def _sphere(shape: Shape) -> tuple[np.ndarray, float] | None:
    """Center (3,) and radius of a spherical shape, or None."""
    if len(shape.points) == 1:
        return shape.points[0], shape.margin
    if len(shape.points) < _CORNERS or shape.margin:
        return None
    # Least-squares sphere through all vertices: |p|^2 = 2 c . p + (r^2 - |c|^2).
    unknowns = np.column_stack([2 * shape.points, np.ones(len(shape.points))])
    center = np.linalg.lstsq(unknowns, (shape.points**2).sum(axis=1), rcond=None)[0][:3]
    distances = np.linalg.norm(shape.points - center, axis=1)
    radius = float(distances.max())
    whole = (np.ptp(shape.points, axis=0) > _WHOLE * 2 * radius).all()
    return (center, radius) if whole and distances.min() > (1 - _ROUND) * radius else None


def _encloses(sphere: tuple[np.ndarray, float], at_start: RobotAtStart) -> bool:
    center, radius = sphere
    everything = [each for kind in at_start.shapes.values() for each in kind]
    return all(
        float(np.linalg.norm(each.points - center, axis=1).max()) + each.margin < _INSIDE * radius
        for each in everything
    )


def _frame_at(center: np.ndarray, radius: float, at_start: RobotAtStart) -> str | None:
    """Name of a frame of the base with its origin at the center, the base's own frame first, or None."""
    names = [at_start.frame]
    names += [str(frame.name) for frame in at_start.robot.model.frames if frame.parentJoint == at_start.root]
    for name in names:
        away = at_start.data.oMf[at_start.robot.frame_id(name)].translation - center
        if name != "universe" and np.linalg.norm(away) < 10 * SAME * radius:
            return name
    return None
