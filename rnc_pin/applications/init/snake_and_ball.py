"""Bases that slither or roll: snakes with passive wheels, and shells moved by joints inside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from rnc_pin.applications.init.assumptions import BaseAssumptions, Entry, measured, turned
from rnc_pin.applications.init.evidence import has_word, is_revolute, joint_limits, joint_range, turning_axis
from rnc_pin.applications.init.robot_at_start import LEVEL, SAME, RobotAtStart, Shape
from rnc_pin.applications.init.wheel_detection import Wheel
from rnc_pin.applications.init.wheel_layout import TOWED, DrawnAxle
from rnc_pin.applications.init.wheeled_base import one_lateral, planar
from rnc_pin.io import Json

_BODIES = 4  # smallest number of bodies with wheels; one less if the file calls it a snake
_SNAKE = "snake.*|.*snake|serpent.*|worm|acm"
_BEND, _SHARE = 0.5, 0.8  # largest path angle from its mean [rad], and used share of joint limits
_SNAKE_DURATION, _POINTS = 12.0, 24


@dataclass(frozen=True)
class Segment:
    """Body with wheels.

    Attributes:
        chain: joints from the base to the body, the nearest to the base first.
        center: midpoint of its wheels in the world frame (3,) [m].
        axle: axle direction in the world frame (3,).
        entries: constraint entries of its wheels, with a remark on each.
        wheels: joints of its wheels.
        ground: height of the ground below its wheels [m], or None if their radius is unknown.
    """

    chain: tuple[str, ...]
    center: np.ndarray
    axle: np.ndarray
    entries: list[tuple[Entry, str]]
    wheels: tuple[str, ...]
    ground: float | None = None


def find_snake(wheels: Iterable[Wheel], axles: Iterable[DrawnAxle], at_start: RobotAtStart) -> list[Segment]:
    """Return the segments of a snake from its root on; empty if the robot is no snake.

    Args:
        wheels: wheels with joints.
        axles: axles of wheels that are only drawn.
        at_start: the robot.
    """
    segments = sorted([*_on_wheels(wheels), *_on_axles(axles, at_start)], key=lambda each: len(each.chain))
    chain = segments[-1].chain if segments else ()
    in_a_row = all(each.chain == chain[: len(each.chain)] for each in segments)
    bodies = len({each.chain for each in segments})
    enough = bodies >= (_BODIES - 1 if has_word(_SNAKE, *at_start.title) else _BODIES)
    missing = bodies < len(segments) or bodies < len(chain) + 1
    if not in_a_row or not enough or missing or segments[0].chain:
        return []
    if any(has_word(TOWED, joint) or not _has_motor(joint, at_start) for joint in chain):
        return []
    if any(at_start.drives.says(joint) for each in segments for joint in each.wheels):
        return []
    return segments if all(_crosses(one, other) for one, other in pairwise(segments)) else []


def snake_base(segments: list[Segment], at_start: RobotAtStart) -> BaseAssumptions:
    """Snake whose first body follows a serpenoid path and whose other bodies follow it; the start lies on this path."""
    result = planar(at_start, f"a snake of {len(segments)} bodies on wheels that nothing drives", [])
    for segment in segments:
        result.constraints += segment.entries
        result.passive |= set(segment.wheels)
    result.ground = segments[0].ground
    gait = _Gait.of(segments, at_start)
    result.travel = gait.wave
    speed, axis, sense = gait.speed(at_start)
    yaw = f"{at_start.frame}_yaw"
    columns: dict[str, Callable[[np.ndarray], np.ndarray]] = {speed: lambda way: sense * way, yaw: gait.heading}
    columns |= {name: partial(gait.angle, k) for k, name in enumerate(gait.joints)}
    result.pose = {name: round(float(gait.angle(k, np.zeros(1))[0]), 4) for k, name in enumerate(gait.joints)}
    result.outputs += [
        ({"frame_speed": {"frame": at_start.frame, "axis": axis}}, gait.wave),
        ({"frame_yaw": at_start.frame}, gait.bend),
    ]
    result.vertical.append({"frame_position": {"frame": at_start.frame, "axes": "xy"}})
    result.path = lambda names, time: _through([columns[each] for each in names if each in columns], gait.wave, time)
    result.duration = _SNAKE_DURATION
    result.notes.append(
        "nothing drives its wheels: it moves by bending, and cannot start straight; the joint angles follow from the "
        "path of its first body, which they push"
    )
    return result


@dataclass(frozen=True)
class _Gait:
    """Serpenoid curve, ``heading = bend sin(2 pi s / wave)`` at path length s of the first body (Hirose 1993).

    Attributes:
        joints: joints from the first body on.
        places: distance of each joint behind the wheels of the first body (k,) [m].
        signs: 1 if a joint axis points up, -1 if it points down (k,).
        along: horizontal forward direction of the first body (3,).
        spacing: distance between joints [m].
        wave: wavelength, equal to the length of the snake [m].
        bend: amplitude of the heading [rad].
    """

    joints: tuple[str, ...]
    places: np.ndarray
    signs: np.ndarray
    along: np.ndarray
    spacing: float
    wave: float
    bend: float

    @classmethod
    def of(cls, segments: list[Segment], at_start: RobotAtStart) -> _Gait:
        """Return the gait within the joint limits."""
        head, joints = segments[0], segments[-1].chain
        indices = [at_start.robot.joint_id(name) for name in joints]
        along = np.cross(head.axle, [0.0, 0.0, 1.0])
        away = np.mean([each.center for each in segments[1:]], axis=0) - head.center
        along *= -np.sign(along @ away) / np.linalg.norm(along)
        places = np.array([(head.center - at_start.data.oMi[index].translation) @ along for index in indices])
        spacing = float(np.mean(np.diff(places)))
        signs = np.array([np.sign(turning_axis(at_start.robot.model, at_start.data, index)[2]) for index in indices])
        wave = (len(joints) + 1) * spacing
        room = [_SHARE * min(high, -low) for low, high in (joint_limits(at_start.robot, name) for name in joints)]
        bend = min([_BEND, *(each / (2 * np.sin(np.pi * spacing / wave)) for each in room if each > 0)])
        return cls(joints, places, signs, along, spacing, wave, bend)

    def heading(self, s: np.ndarray) -> np.ndarray:
        """Heading of the path at path lengths s (n,) [rad]."""
        return np.asarray(self.bend * np.sin(2 * np.pi * s / self.wave))

    def angle(self, joint: int, way: np.ndarray) -> np.ndarray:
        """Angle of a joint at path lengths of the first body (n,) [rad]."""
        s, half = way - self.places[joint], self.spacing / 2
        return np.asarray(self.signs[joint] * (self.heading(s - half) - self.heading(s + half)))

    def speed(self, at_start: RobotAtStart) -> tuple[str, str, float]:
        """Return the output name of the first body's speed, its axis, and its sign: 1 along the axis, -1 against it."""
        axis = at_start.along(self.along)
        sense = float(np.sign(at_start.placement.rotation[:, "xyz".index(axis)] @ self.along))
        return f"{at_start.frame}_speed_{axis}", axis, sense


def _through(columns: Sequence[Callable[[np.ndarray], np.ndarray]], wave: float, duration: float) -> Mapping[str, Json]:
    """Via points of outputs while the first body moves one wavelength, from rest to rest."""
    s = np.linspace(0.0, 1.0, _POINTS + 1)[1:]
    way = wave * s**3 * (10 - 15 * s + 6 * s**2)
    values = np.round(np.column_stack([column(way) for column in columns]), 5) + 0.0
    times: list[Json] = [*np.round(duration * s, 4).tolist()]
    return {"via_points": {"times": times, "points": values.tolist()}}


def _on_wheels(wheels: Iterable[Wheel]) -> list[Segment]:
    bodies: dict[tuple[str, ...], list[Wheel]] = {}
    for wheel in wheels:
        if not wheel.carriers:
            bodies.setdefault(tuple(pivot.joint for pivot in reversed(wheel.pivots)), []).append(wheel)
    return [
        Segment(
            chain,
            np.mean([each.center for each in mates], axis=0),
            mates[0].axle,
            [(turned(each, **more), f"not driven; {measured(each)}") for each, more in one_lateral(mates)],
            tuple(each.joint for each in mates),
            min(float(each.center[2] - each.radius) for each in mates),
        )
        for chain, mates in bodies.items()
    ]


def _on_axles(axles: Iterable[DrawnAxle], at_start: RobotAtStart) -> list[Segment]:
    model, found = at_start.robot.model, []
    for each in axles:
        chain: list[str] = []
        index = each.joint
        while index > at_start.root:
            chain.insert(0, str(model.names[index]))
            index = int(model.parents[index])
        edge: dict[str, Json] = {"no_side_slip": {"frame": each.frame, "axis": each.axis}}
        ground = float(each.center[2] - each.radius)
        found.append(Segment(tuple(chain), each.center, each.axle, [(edge, "knife edge")], (), ground))
    return found


def _has_motor(joint: str, at_start: RobotAtStart) -> bool:
    upright = abs(turning_axis(at_start.robot.model, at_start.data, at_start.robot.joint_id(joint))[2]) > 0.99
    return upright and at_start.drives.drives(joint)


def _crosses(one: Segment, other: Segment) -> bool:
    """True if one body lies behind another along the rolling direction of its wheels."""
    between = other.center - one.center
    return abs(float(between @ one.axle)) < 0.3 * float(np.linalg.norm(between))


_INSIDE = 1.05  # largest distance of an inner shape from the center, in radii
_ROUND = 0.03  # largest deviation of a mesh from a sphere, in radii
_WHOLE = 0.9  # smallest extent of the mesh along each axis, as a share of its diameter
_CORNERS = 30  # smallest number of vertices of a spherical mesh
_TURNED = 3.0  # displacement of a joint without limits [rad]
_BALL_DURATION = 8.0


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
    result.duration = _BALL_DURATION
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
    reach = max(float(np.linalg.norm(each.points - center, axis=1).max()) + each.margin for each in everything)
    return reach < _INSIDE * radius


def _frame_at(center: np.ndarray, radius: float, at_start: RobotAtStart) -> str | None:
    """Name of a frame of the base with its origin at the center, the base's own frame first, or None."""
    names = [at_start.frame]
    names += [str(frame.name) for frame in at_start.robot.model.frames if frame.parentJoint == at_start.root]
    for name in names:
        away = at_start.data.oMf[at_start.robot.frame_id(name)].translation - center
        if name != "universe" and np.linalg.norm(away) < 10 * SAME * radius:
            return name
    return None
