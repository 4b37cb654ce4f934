"""Constraint rows as functions of measured joints and of unknown parameters, with exact derivatives.

An unknown place or tilt of a joint is a further joint that stands still: a prismatic joint in front of the joint's
rotation, or a revolute one behind it. So its effect on any row is ``jacobian_dot`` for a unit rate of that joint, which
each kind of row has in closed form. Rows on level ground are affine in the radius of a wheel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.rows import Rows
from rnc_pin.robots.joint_values import NamedModel
from rnc_pin.robots.robot import Robot

_NODES = 40  # of an interpolation over one angle
_MANY = 4 * _NODES  # states above which it pays
_WIDEST = 2.0 * np.pi  # range of an interpolation [rad]
_SILENT = 1e-9  # entries of a derivative below which a row does not depend on a joint
_SAMPLES = 4


class Virtual(NamedTuple):
    """Unit displacement of a joint's placement."""

    joint: str
    turns: bool
    """True for a rotation about an axis of the joint's frame, False for a shift along an axis of the carrying body."""
    axis: str


def extended_robot(robot: Robot, virtual: Sequence[Virtual]) -> Robot:
    """Robot with a further joint, named by its number, for each displacement."""
    old, new = robot.model, pin.Model()
    new.name, new.gravity = old.name, old.gravity
    at = {0: 0}
    for index in range(1, old.njoints):
        name, place = old.names[index], old.jointPlacements[index]
        parent, here = at[old.parents[index]], pin.SE3(np.eye(3), place.translation)
        for turns, kind, rotation in (
            (False, pin.JointModelPrismaticUnaligned, np.eye(3)),
            (True, pin.JointModelRevoluteUnaligned, place.rotation),
        ):
            here = here * pin.SE3(rotation, np.zeros(3))
            for number, each in enumerate(virtual):
                if each.joint == name and each.turns == turns:
                    axis = np.eye(3)["xyz".index(each.axis)]
                    parent, here = new.addJoint(parent, kind(axis), here, f"virtual {number}"), pin.SE3.Identity()
        at[index] = new.addJoint(parent, old.joints[index], here, name)
        new.appendBodyToJoint(at[index], old.inertias[index], pin.SE3.Identity())
    for frame in list(old.frames)[1:]:
        new.addFrame(pin.Frame(frame.name, at[frame.parentJoint], 0, frame.placement, frame.type), False)
    found = copy(robot)
    NamedModel.__init__(found, new)
    return found


@dataclass(eq=False)
class _Block:
    """Rows of one constraint."""

    kind: Any
    """Description that is bound again for each radius; None for rows with a constant matrix."""
    rows: Rows
    kept: list[int]
    """Rows in use."""
    shape: list[int] = field(default_factory=list)
    """Entries of v whose positions the rows depend on."""


class RowGeometry:
    """Rows ``A(theta, p) v = 0`` of a robot on level ground, over positions of its joints and parameters.

    Args:
        robot: the robot, on a planar base.
        blocks: its bound rows.
        virtual: displacements of joints that are parameters.
        radii: wheels whose radius is a parameter.

    Attributes:
        names: names of the rows in use.
        columns: name of each single joint to its column in the rows.
        base: columns of the base.

    Raises:
        ConfigurationError: rows depend on the place of the robot, move, or a wheel has no radius.
    """

    def __init__(self, robot: Robot, blocks: Sequence[Rows], virtual: Sequence[Virtual], radii: Sequence[str]) -> None:
        self._robot = extended_robot(robot, virtual)
        model = self._robot.model
        self._kinematics = Kinematics(self._robot)
        joints = list(zip(model.names, model.joints, strict=True))[1:]
        single = {name: joint for name, joint in joints if joint.nv == 1}
        self.columns = {name: joint.idx_v for name, joint in single.items()}
        self._single = {joint.idx_v: joint for joint in single.values()}
        self._virtual = {each: self.columns[f"virtual {k}"] for k, each in enumerate(virtual)}
        self.base = list(range(model.joints[1].idx_v, model.joints[1].idx_v + 3))
        self._blocks = [self._bound(robot, block) for block in blocks]
        for block in self._blocks:
            self._check(block)
        self._radii = {each: [b for b in self._blocks if getattr(b.kind, "frame", None) == each] for each in radii}
        for wheel, found in self._radii.items():
            if not found or not all(hasattr(block.kind, "radius") for block in found):
                raise ConfigurationError(f"radius of {wheel}: no wheel or ball rolls there")

    def _bound(self, robot: Robot, block: Rows) -> _Block:
        kept = [k for k in range(len(block.names)) if not (block.on_ground and block.holonomic and block.holonomic[k])]
        if block.kind is not None:
            return _Block(block.kind, block.kind.bind(self._robot), kept)
        matrix = getattr(block, "matrix", None)
        if matrix is None:
            raise ConfigurationError(f"rows {', '.join(block.names)} cannot be calibrated: they have no description")
        wide = np.zeros((len(matrix), self._robot.nv))
        for index, name in enumerate(robot.joint_names, start=1):
            joint, other = robot.model.joints[index], self._robot.model.joints[self._robot.model.getJointId(name)]
            wide[:, other.idx_v : other.idx_v + other.nv] = matrix[:, joint.idx_v : joint.idx_v + joint.nv]
        rows = copy(block)
        rows.matrix = wide  # type: ignore[attr-defined]
        return _Block(None, rows, kept)

    def _check(self, block: _Block) -> None:
        """Find the joints that a block depends on; refuse rows that depend on the place of the base."""
        if block.rows.affine or block.rows.rheonomic:
            raise ConfigurationError(f"rows {', '.join(block.rows.names)}: calibration assumes ground at rest")
        generator = np.random.default_rng(0)
        positions = generator.uniform(-0.5, 0.5, size=(_SAMPLES, self._robot.nv))
        positions[:, list(self._virtual.values())] *= 1e-2
        q = self._configurations(positions)
        for column in range(self._robot.nv):
            direction = np.eye(self._robot.nv)[column]
            slope = self._slope(block, q, direction)
            if column in self.base:
                # The base's velocity is in its own axes: on level ground, rows do not depend on its place.
                if np.abs(slope).max(initial=0.0) > _SILENT:
                    raise ConfigurationError(
                        f"rows {', '.join(block.rows.names)} depend on the place of the base: "
                        "calibration assumes rolling on level ground"
                    )
            elif np.abs(slope).max(initial=0.0) > _SILENT and column not in self._virtual.values():
                block.shape.append(column)

    def drop(self, unmeasured: Sequence[int]) -> tuple[str, ...]:
        """Leave out rows that depend on positions of unmeasured joints (columns); return their names."""
        names: list[str] = []
        for block in self._blocks:
            if set(block.shape) & set(unmeasured):
                names += [block.rows.names[row] for row in block.kept]
                block.kept = []
        return tuple(names)

    @property
    def size(self) -> int:
        """Number n of entries of v, displacements included."""
        return int(self._robot.nv)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rows in use."""
        return tuple(block.rows.names[row] for block in self._blocks for row in block.kept)

    @property
    def shape(self) -> set[int]:
        """Columns of joints whose positions the rows in use depend on."""
        return {column for block in self._blocks if block.kept for column in block.shape}

    def set_radii(self, radii: Mapping[str, float]) -> None:
        """Let wheels have other radii."""
        for wheel, radius in radii.items():
            for block in self._radii[wheel]:
                if block.kind.radius != radius:
                    block.kind = replace(block.kind, radius=radius)
                    block.rows = block.kind.bind(self._robot)

    def evaluate(
        self,
        positions: np.ndarray,
        shifts: Mapping[Virtual, float],
        columns: Sequence[int],
        directions: Sequence[int | Virtual | str] = (),
    ) -> tuple[np.ndarray, list[list[tuple[slice, np.ndarray]]]]:
        """Rows and their derivatives along joints (columns), displacements and radii (frames).

        Args:
            positions: joint positions (N, n).
            shifts: displacements of joints.
            columns: columns c to return.
            directions: directions of the derivatives.

        Returns:
            Rows (N, k, c), and for each direction the rows that change with their derivatives (N or 1, rows, c).
        """
        parts, start = [], 0
        changes: list[list[tuple[slice, np.ndarray]]] = [[] for _ in directions]
        for block in self._blocks:
            if not block.kept:
                continue
            where = slice(start, start + len(block.kept))
            start = where.stop
            spread = _Spread.over(positions[:, block.shape])
            states = np.zeros((len(spread.states), self._robot.nv))
            states[:, block.shape] = spread.states
            for virtual, value in shifts.items():
                states[:, self._virtual[virtual]] = value
            q = self._configurations(states)
            kept, chosen = np.array(block.kept)[:, None], list(columns)
            rows = block.rows.jacobian(self._kinematics.position(q))
            values = spread.to_samples(rows[:, kept, chosen])
            parts.append(np.broadcast_to(values, (len(positions), *values.shape[1:])))
            for each, found in zip(directions, changes, strict=True):
                slope = self._along(block, q, rows, each)
                if slope is not None and np.abs(slope[:, kept, chosen]).max(initial=0.0) > 0:
                    found.append((where, spread.to_samples(slope[:, kept, chosen])))
        return np.concatenate(parts, axis=1), changes

    def _along(
        self, block: _Block, q: np.ndarray, rows: np.ndarray, direction: int | Virtual | str
    ) -> np.ndarray | None:
        """Derivative (S, k, n) of a block along a direction; None if it does not depend on it."""
        if isinstance(direction, str):
            if block not in self._radii[direction]:
                return None
            larger = replace(block.kind, radius=block.kind.radius + 1.0).bind(self._robot)
            return np.asarray(larger.jacobian(self._kinematics.position(q)) - rows)
        column = self._virtual[direction] if isinstance(direction, Virtual) else direction
        if isinstance(direction, int) and column not in block.shape:
            return None
        return self._slope(block, q, np.eye(self._robot.nv)[column])

    def _slope(self, block: _Block, q: np.ndarray, direction: np.ndarray) -> np.ndarray:
        motion = self._kinematics.position(q).with_velocity(np.broadcast_to(direction, (len(q), self._robot.nv)))
        return block.rows.jacobian_dot(motion)

    def _configurations(self, positions: np.ndarray) -> np.ndarray:
        """Configurations (N, nq) of positions (N, n) of single joints, with the base at its origin."""
        model = self._robot.model
        q = np.tile(pin.neutral(model), (len(positions), 1))
        for column, joint in self._single.items():
            angle = positions[:, column]
            if joint.nq == 1:
                q[:, joint.idx_q] = angle
            else:
                q[:, joint.idx_q], q[:, joint.idx_q + 1] = np.cos(angle), np.sin(angle)
        return q


class _Spread(NamedTuple):
    """States of the joints of a block at which it is evaluated, and the way from them to all samples."""

    states: np.ndarray
    """Joint positions (S, d)."""
    basis: np.ndarray | None
    """Weights (N, S) of an interpolation; None if there is none."""
    inverse: np.ndarray | None
    """State of each sample (N,); None for one state."""

    @classmethod
    def over(cls, shape: np.ndarray) -> _Spread:
        """States for joint positions (N, d): one without joints, nodes for one angle, else each once."""
        if not shape.shape[1]:
            return cls(np.zeros((1, 0)), None, None)
        if shape.shape[1] == 1 and len(shape) > _MANY and np.ptp(shape) <= _WIDEST:
            nodes, basis = _interpolation(shape[:, 0])
            return cls(nodes[:, None], basis, None)
        states, inverse = np.unique(shape, axis=0, return_inverse=True)
        return cls(states, None, inverse.ravel())

    def to_samples(self, values: np.ndarray) -> np.ndarray:
        """Values (N, ...), or (1, ...) of one state, from those of the states (S, ...)."""
        if self.basis is not None:
            found = self.basis @ values.reshape(len(values), -1)
            return np.asarray(found.reshape(len(found), *values.shape[1:]))
        return values if self.inverse is None else values[self.inverse]


def _interpolation(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev nodes (S,) over angles (N,), and weights (N, S) of the barycentric formula.

    Rows are analytic in the angle of a joint. They have poles only where a wheel lies flat, far from real angles, so
    that the error over a turn is that of rounding.
    """
    low, high = angles.min(), angles.max()
    k = np.arange(_NODES)
    nodes = (low + high) / 2 + max(high - low, 1e-3) / 2 * np.cos(np.pi * (k + 0.5) / _NODES)
    weights = (-1.0) ** k * np.sin(np.pi * (k + 0.5) / _NODES)
    distance = angles[:, None] - nodes
    hit = distance == 0
    distance[hit] = 1.0
    basis = weights / distance
    basis[hit.any(axis=1)] = 0.0
    basis[hit] = 1.0
    return nodes, basis / basis.sum(axis=1, keepdims=True)
