"""Controls of a driven run: the frames, joints, base, obstacles and gains that a user may set, and their ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.applications.drive.base import DrivenBase, find_base
from rnc_pin.collision import Obstacle
from rnc_pin.errors import InputError
from rnc_pin.model import ReducedModel
from rnc_pin.robots import NO_LIMIT

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
            raise InputError(
                f"{name}: expected {self.lower:g} to {self.upper:g} {self.unit}".rstrip() + f", found {value:g}"
            )


GAINS: dict[str, Range] = {
    "frame gain": Range(0.1, 10.0, 2.0, "1/s"),
    "frame speed": Range(0.02, 2.0, 0.4, "m/s"),
    "posture gain": Range(0.0, 5.0, 1.0, "1/s"),
    "joint speed": Range(0.05, 3.0, 0.8, "rad/s"),
    "base speed": Range(0.02, 2.0, 0.5, "m/s"),
    "turn rate": Range(0.05, 3.0, 0.8, "rad/s"),
    "obstacle speed": Range(0.05, 2.0, 0.5, "m/s"),
}
"""Gains and speeds of every driven run."""


@dataclass(frozen=True)
class DriveControls:
    """Frames, joints, base, obstacles and gains that a user may set.

    Attributes:
        frames: frames that can have a goal, with the axes (x, y, z) along which each can move.
        joints: joints of the posture, with their ranges [rad or m].
        base: the base; None if the robot cannot drive.
        obstacles: obstacles that can move, with their positions at the start [m].
        gains: gains and speeds.
    """

    frames: Mapping[str, tuple[bool, bool, bool]]
    joints: Mapping[str, Range]
    base: DrivenBase | None = None
    obstacles: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    gains: Mapping[str, Range] = field(default_factory=lambda: dict(GAINS))


def find_controls(
    reduced: ReducedModel, q0: np.ndarray, frames: Sequence[str], joints: Sequence[str], obstacles: Sequence[Obstacle]
) -> DriveControls:
    """Return the controls of a robot.

    Args:
        reduced: the model.
        q0: initial configuration (nq,).
        frames: frames that can have a goal.
        joints: independent joints of one degree of freedom.
        obstacles: bodies in the world.
    """
    base = find_base(reduced, q0, joints)
    driven = () if base is None else base.wheels
    places = {each.name: tuple(float(x) for x in each.placement(0.0).translation) for each in obstacles}
    return DriveControls(
        {frame: _movable_axes(reduced, q0, frame) for frame in frames},
        {name: _range_of(reduced, q0, name) for name in joints if name not in driven},
        base,
        {name: (x, y, z) for name, (x, y, z) in places.items()},
    )


def _movable_axes(reduced: ReducedModel, q0: np.ndarray, frame: str) -> tuple[bool, bool, bool]:
    """World axes along which a frame can move at all, constraints aside."""
    generator = np.random.default_rng(0)
    found = np.zeros(3, dtype=bool)
    for q in (q0, *(reduced.robot.random_configuration(generator, 0.5) for _ in range(2))):
        jacobian = reduced.at(q).position.jacobian(reduced.robot.frame_id(frame))[:3]
        found |= np.abs(jacobian).max(axis=1) > 1e-9
    x, y, z = found.tolist()
    return x, y, z


def _range_of(reduced: ReducedModel, q0: np.ndarray, name: str) -> Range:
    model = reduced.robot.model
    joint = model.joints[reduced.robot.joint_id(name)]
    value = reduced.robot.joint_values(q0)[name]
    start = float(value if isinstance(value, float) else np.ravel(value)[0])
    unit = reduced.robot.velocity_units[joint.idx_v].removesuffix("/s")
    low, high = -NO_LIMIT, NO_LIMIT
    if joint.nq == 1:
        low, high = (float(each[joint.idx_q]) for each in (model.lowerPositionLimit, model.upperPositionLimit))
    if not -NO_LIMIT < low < high < NO_LIMIT or high - low > 4 * _TURN:
        low, high = start - _TURN, start + _TURN
    return Range(min(low, start), max(high, start), start, unit)
