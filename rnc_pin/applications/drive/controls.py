"""Controls of a driven run: frames, joints and gains that a user may set, with ranges; and the base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.evidence import joint_limits
from rnc_pin.control import TwistController
from rnc_pin.errors import InputError, RncError
from rnc_pin.math import unit_rows
from rnc_pin.model import ConfigurationEvaluation, ReducedModel
from rnc_pin.outputs import FrameSpeed, FrameYaw
from rnc_pin.robots import NO_LIMIT, Robot

_RANK = 1e-6  # smallest singular value, of rows of unit length, at which motions are independent
_STEERED = 0.1  # [rad] by which a joint turns in the test of whether it steers
ARRIVED = 0.02
"""Distance at which the base has reached its goal [m]."""


@dataclass(frozen=True)
class DrivenBase:
    """Base of a robot.

    Attributes:
        frame: frame of the base, with x forward.
        turns: True if it can turn on the spot.
        slides: True if it can move sideways.
        steering: joint that steers a base that cannot turn on the spot; None without one.
        steering_sign: sign of the curvature's change with that joint.
        wheels: joints that move with the base, such as wheels; an articulation or a raked fork can rest meanwhile.
        ahead: distance of the frame ahead of the axle that cannot move sideways [m]; zero without such an axle.
        folding: yaw over change of curvature, while the steering joint turns and the base does not drive [m].
        pivots: joints that are aimed at the twist of the base, such as those of steered drives.
    """

    frame: str
    turns: bool
    slides: bool
    steering: str | None = None
    steering_sign: float = 1.0
    wheels: tuple[str, ...] = ()
    ahead: float = 0.0
    folding: float = 0.0
    pivots: tuple[str, ...] = ()

    def rates(self, rows: np.ndarray, robot: Robot) -> np.ndarray:
        """Return the rows (3, nv) of the rates that a user sets: zero for motions that the base does not have.

        Args:
            rows: rows of ``base_rows``.
            robot: the robot.
        """
        found = rows.copy()
        if not self.slides:
            found[1] = 0.0
        if not self.turns:
            found[2] = 0.0
            if self.steering is not None:
                found[2, robot.velocity_indices(self.steering)] = 1.0
        return found


def base_frame(robot: Robot, preferred: Sequence[str]) -> str | None:
    """Return the frame of the base: the first preferred frame on the root joint, or the root link; None without one."""
    if "root_joint" not in robot.joint_names:
        return None
    root, frames = robot.joint_id("root_joint"), robot.model.frames
    own = [name for name in preferred if frames[robot.frame_id(name)].parentJoint == root]
    return next(iter([*own, *robot.links_of(root)]), None)


def find_base(reduced: ReducedModel, q0: np.ndarray, joints: Sequence[str]) -> DrivenBase | None:
    """Return the base of a robot; None if it cannot drive while its joints rest.

    Args:
        reduced: the model.
        q0: initial configuration (nq,).
        joints: independent joints.
    """
    robot = reduced.robot
    # A frame whose speed the scenario reduces is what its author drives.
    preferred = [name.removesuffix("_speed_x") for name in reduced.reducing.names if name.endswith("_speed_x")]
    frame = base_frame(robot, [name for name in preferred if robot.model.existFrame(name)])
    if frame is None or any(name.startswith("momentum(") for name in reduced.constraints.names):
        return None  # a base that floats moves by the reaction to its joints only
    pivots, slides = find_pivots(reduced, q0, frame)
    if pivots:
        return DrivenBase(frame, turns=True, slides=slides, wheels=pivots, pivots=pivots)
    here = reduced.at(q0)
    rows = base_rows(robot, frame, here)
    wheels = _wheels(here, rows, robot, joints)
    rest = [robot.velocity_indices(name).start for name in joints if name not in wheels]
    resting = here.R[rest]
    # A motion that depends on the rates of joints needs them: the base does not have it while they rest.
    forward, left, turn = rows @ here.R
    if not _independent(resting, forward):
        return None
    turns = _independent(resting, forward, turn)
    slides = _independent(resting, forward, left)
    found = None if turns else _steering(reduced, q0, frame, [j for j in joints if j not in wheels])
    if found is None:
        return DrivenBase(frame, turns, slides, wheels=wheels)
    steering, bending = found
    moved = 1 + rest.index(robot.velocity_indices(steering).start)
    ahead, folding = _ahead(reduced, q0, frame, steering), curvature(here, rows, rest, moved) / bending
    return DrivenBase(frame, turns, slides, steering, float(np.sign(bending)), wheels, ahead, folding)


def find_pivots(reduced: ReducedModel, q0: np.ndarray, frame: str) -> tuple[tuple[str, ...], bool]:
    """Return the joints that are aimed at the twist of a base, and whether they let it move to any side; none for most.

    The single pivot of a car is steered by hand, unless it turns by half a turn: then the base turns on the spot.

    Args:
        reduced: the model.
        q0: a configuration (nq,).
        frame: frame of the base.
    """
    try:
        controller = TwistController(reduced, frame)
    except RncError:  # such as a base that a force drives
        return (), False
    base = controller.base
    # In the plane, a twist has three directions.
    slides, ranges = bool(base.slides) and base.at(q0).free.shape[1] == 3, (base.upper - base.lower)[base.pivots]
    by_hand = not slides and len(ranges) < 2 and ranges.min(initial=np.inf) < np.pi
    return ((), False) if by_hand else (controller.steering, slides)


def base_rows(robot: Robot, frame: str, at: ConfigurationEvaluation) -> np.ndarray:
    """Rows (3, nv) of the twist of a frame: the forward speed, the speed to the left and the yaw rate."""
    kinds = FrameSpeed(frame, "x"), FrameSpeed(frame, "y"), FrameYaw(frame)
    return np.vstack([kind.bind(robot).jacobian(at.position) for kind in kinds])


def _wheels(here: ConfigurationEvaluation, rows: np.ndarray, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
    """Joints that move with the base; an articulation or a raked fork is none of them, because it bends the path.

    A base with three independent rates needs no joint to bend its path. One that cannot drive while they rest has none.
    """
    moving, R = rows @ here.R, here.R
    # These cannot move while the base rests: the constraints couple them to it.
    coupled = tuple(j for j in joints if not _independent(moving, R[robot.velocity_indices(j).start], full=False))
    if _independent(R[:0], *moving):
        return coupled
    found = tuple(name for name in coupled if not _bends(here, robot, name))
    rest = [robot.velocity_indices(name).start for name in joints if name not in found]
    return found if _independent(R[rest], moving[0]) else coupled


def _bends(here: ConfigurationEvaluation, robot: Robot, joint: str) -> bool:
    """True if actuators hold a joint at rest, and it is no wheel: those turn about axes nearer to the ground."""
    place = robot.velocity_indices(joint).start
    own = np.flatnonzero(np.count_nonzero(here.B, axis=0) == 1)
    actuated = np.flatnonzero(np.any(here.B[:, own] != 0, axis=1))
    axis = here.position.joint_jacobian(robot.joint_id(joint))[3:, place]
    upright = abs(axis[2]) >= np.hypot(axis[0], axis[1])
    return bool(upright) and any(not _independent(here.R[[k]], here.R[place], full=False) for k in actuated)


def _independent(given: np.ndarray, *rows: np.ndarray, full: bool = True) -> bool:
    """True if rows are independent of given rows and of each other; ``full`` is False if the given ones may depend."""
    # Of unit length: the rank depends neither on units nor on the size of the robot.
    units = unit_rows(np.array([*given, *rows]))
    if any(np.linalg.norm(row) < _RANK for row in rows):
        return False
    before = np.linalg.matrix_rank(units[: len(given)], _RANK) if len(given) else 0
    after = np.linalg.matrix_rank(units, _RANK)
    return bool(after == before + len(rows) and (not full or before == len(given)))


def _ahead(reduced: ReducedModel, q0: np.ndarray, frame: str, steering: str) -> float:
    """Distance of the frame ahead of the axle that cannot move sideways [m]; zero without such an axle."""
    # Away from straight: there the base does not turn, so that every distance would fit.
    change = _STEERED * np.eye(reduced.robot.nv)[reduced.robot.velocity_indices(steering).start]
    there = reduced.at(pin.integrate(reduced.robot.model, q0, change))
    _, left, turn = base_rows(reduced.robot, frame, there) @ there.R
    distance = float(turn @ left) / max(float(turn @ turn), 1e-300)
    return distance if np.abs(left - distance * turn).max() < _RANK * max(1.0, abs(distance)) else 0.0


def curvature(at: ConfigurationEvaluation, rows: np.ndarray, resting: Sequence[int], moved: int = 0) -> float:
    """Curvature of the base's path [rad/m] while joints rest: yaw rate over forward speed.

    Args:
        at: the model at a configuration.
        rows: rows of ``base_rows``.
        resting: entries of v that are zero.
        moved: which rate the yaw rate is divided by, while the others are zero; 0 is the forward speed, k the k-th
            entry of ``resting``.
    """
    stack = np.vstack([rows[0] @ at.R, at.R[list(resting)]])
    # Least squares: joints that the constraints move with the base cannot all rest.
    v2 = np.linalg.lstsq(stack, np.eye(len(stack))[moved], rcond=None)[0]
    return float(rows[2] @ at.R @ v2)


def _steering(reduced: ReducedModel, q0: np.ndarray, frame: str, joints: Sequence[str]) -> tuple[str, float] | None:
    """Joint that changes the curvature most, and the change over its own [1/m]; None without one."""
    robot = reduced.robot
    resting = [robot.velocity_indices(name).start for name in joints]

    def at(q: np.ndarray) -> float:
        here = reduced.at(q)
        return curvature(here, base_rows(robot, frame, here), resting)

    effects = dict[str, float]()
    for name, place in zip(joints, resting, strict=True):
        change = _STEERED * np.eye(robot.nv)[place]
        with suppress(RncError):  # a singular configuration of the outputs
            # To both sides: the present bend of the path drops out.
            effects[name] = at(pin.integrate(robot.model, q0, change)) - at(pin.integrate(robot.model, q0, -change))
    best = max(effects, key=lambda name: abs(effects[name]), default=None)
    if best is None or abs(effects[best]) <= 1e-6:
        return None
    return best, effects[best] / (2.0 * _STEERED)


FAR = 100.0
"""Largest coordinate of a goal [m]."""
_TURN = np.pi  # [rad]; range of a joint without limits, to both sides


@dataclass(frozen=True)
class Range:
    """Range of a number, its value at the start, and its unit."""

    lower: float
    upper: float
    start: float
    unit: str = ""

    def check(self, name: str, value: float) -> None:
        """Raise InputError if a value is out of range."""
        if not self.lower <= value <= self.upper:
            span = f"{self.lower:g} to {self.upper:g} {self.unit}".rstrip()
            raise InputError(f"{name}: expected {span}, found {value:g}")


GAINS: dict[str, Range] = {
    "frame gain": Range(0.1, 10.0, 2.0, "1/s"),
    "frame speed": Range(0.02, 2.0, 0.4, "m/s"),
    "posture gain": Range(0.0, 5.0, 1.0, "1/s"),
    "joint speed": Range(0.05, 3.0, 0.8, "rad/s"),
    "base speed": Range(0.02, 2.0, 0.5, "m/s"),
    "turn rate": Range(0.05, 3.0, 0.8, "rad/s"),
}
"""Gains and speeds of every driven run."""


@dataclass(frozen=True)
class DriveControls:
    """Frames, joints and base that a user may move; ``GAINS`` has the gains and speeds.

    Attributes:
        frames: frames that can have a goal, with the axes (x, y, z) along which each can move.
        joints: joints of the posture, with their ranges [rad or m].
        base: the base; None if the robot cannot drive.
    """

    frames: Mapping[str, tuple[bool, bool, bool]]
    joints: Mapping[str, Range]
    base: DrivenBase | None = None


def find_controls(reduced: ReducedModel, q0: np.ndarray, frames: Sequence[str], joints: Sequence[str]) -> DriveControls:
    """Return the controls of a robot.

    Args:
        reduced: the model.
        q0: initial configuration (nq,).
        frames: frames that can have a goal.
        joints: independent joints of one degree of freedom.
    """
    base = find_base(reduced, q0, joints)
    driven = () if base is None else base.wheels
    ranges = {name: _range_of(reduced, q0, name) for name in joints if name not in driven}
    return DriveControls({frame: _movable_axes(reduced, q0, frame) for frame in frames}, ranges, base)


def _movable_axes(reduced: ReducedModel, q0: np.ndarray, frame: str) -> tuple[bool, bool, bool]:
    """World axes along which a frame can move at all, constraints aside."""
    generator = np.random.default_rng(0)
    found = np.zeros(3, dtype=bool)
    # Not at the start alone, where a row may be zero by chance.
    for q in (q0, *(reduced.robot.random_configuration(generator, 0.5) for _ in range(2))):
        jacobian = reduced.at(q).position.jacobian(reduced.robot.frame_id(frame))[:3]
        found |= np.abs(jacobian).max(axis=1) > 1e-9
    x, y, z = found.tolist()
    return x, y, z


def _range_of(reduced: ReducedModel, q0: np.ndarray, name: str) -> Range:
    joint = reduced.robot.single_joint(name)
    start, (low, high) = float(joint.position(q0)), joint_limits(reduced.robot, name)
    # A slider over many turns could not be set with care.
    if not -NO_LIMIT < low < high < NO_LIMIT or high - low > 4 * _TURN:
        low, high = start - _TURN, start + _TURN
    # A start beyond its limits is a place of the slider too.
    return Range(min(low, start), max(high, start), start, joint.unit.removesuffix("/s"))
