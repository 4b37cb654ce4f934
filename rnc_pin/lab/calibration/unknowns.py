"""Kinds of unknown parameters: of wheels, joints, encoders, sensors and clocks.

Constraint rows are functions of measured joints and of unknown parameters, with exact derivatives. An unknown place of
a joint is a further joint that stands still: a prismatic joint in front of the joint's rotation. So its effect on any
row is ``jacobian_dot`` for a unit rate of that joint, which each kind of row has in closed form. Rows on level ground
are affine in the radius of a wheel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.polynomial import chebyshev

from rnc_pin.constraints import RollingBall, RollingWheel
from rnc_pin.errors import ConfigurationError
from rnc_pin.lab.logs import Correction
from rnc_pin.model.kinematics import Kinematics, PositionKinematics
from rnc_pin.model.relative_rows import CouplingRow
from rnc_pin.model.rows import ConstraintKind, Rows
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.robots.joint_values import NamedModel
from rnc_pin.robots.robot import Robot

_NODES = 40  # of an interpolation over one angle
_AT_NODES = chebyshev.chebpts1(_NODES)
_TO_COEFFICIENTS = np.linalg.inv(chebyshev.chebvander(_AT_NODES, _NODES - 1))
"""Chebyshev coefficients from values at the nodes.

Rows are analytic in the angle of a joint. They have poles only where a wheel lies flat, far from real angles, so that
the error over a turn is rounding.
"""


class Virtual(NamedTuple):
    """Unit shift of a joint's placement along an axis of the carrying body."""

    joint: str
    axis: str


def extended_robot(robot: Robot, virtual: Sequence[Virtual]) -> Robot:
    """Robot with a further joint, named by its number, for each displacement.

    Args:
        robot: the robot.
        virtual: displacements of its joints.
    """
    old, new = robot.model, pin.Model()
    new.name, new.gravity = old.name, old.gravity
    at = {0: 0}
    for index in range(1, old.njoints):
        name, place = old.names[index], old.jointPlacements[index]
        # The rotation of the placement comes last: displacements are along axes of the carrying body.
        parent, here = at[old.parents[index]], pin.SE3(np.eye(3), place.translation)
        for number, each in enumerate(virtual):
            if each.joint == name:
                slide = pin.JointModelPrismaticUnaligned(np.eye(3)["xyz".index(each.axis)])
                parent, here = new.addJoint(parent, slide, here, f"virtual {number}"), pin.SE3.Identity()
        here = here * pin.SE3(place.rotation, np.zeros(3))
        at[index] = new.addJoint(parent, old.joints[index], here, name)
        new.appendBodyToJoint(at[index], old.inertias[index], pin.SE3.Identity())
    for frame in list(old.frames)[1:]:
        # Without its inertia, which came with the body of the joint.
        new.addFrame(pin.Frame(frame.name, at[frame.parentJoint], 0, frame.placement, frame.type), False)
    found = copy(robot)
    NamedModel.__init__(found, new)
    return found


@dataclass(eq=False)
class _Block:
    """Rows of one constraint."""

    kind: ConstraintKind | None
    """Description that is bound again for each radius; None for the row of a mimic joint."""
    rows: Rows
    kept: list[int]
    """Rows in use."""
    shape: list[int]
    """Entries of v whose positions the rows depend on."""
    acting: set[int]
    """Entries of v in the rows."""


class RowGeometry:
    """Rows ``A(theta, p) v = 0`` of a robot on level ground, over positions of its joints and parameters.

    Args:
        robot: the robot, on a planar base.
        blocks: its bound rows.
        virtual: displacements of joints that are parameters.

    Attributes:
        names: names of the rows in use.
        columns: name of each single joint to its column in the rows.
        base: columns of the base.

    Raises:
        ConfigurationError: rows depend on the place of the robot, or move.
    """

    def __init__(self, robot: Robot, blocks: Sequence[Rows], virtual: Sequence[Virtual]) -> None:
        self._robot = extended_robot(robot, virtual)
        model = self._robot.model
        self._kinematics = Kinematics(self._robot)
        self._single = {name: self._robot.single_joint(name) for name in self._robot.single_joint_names}
        self.columns = {name: joint.idx_v for name, joint in self._single.items()}
        self._virtual = {each: self.columns[f"virtual {k}"] for k, each in enumerate(virtual)}
        self.base = list(range(model.joints[1].idx_v, model.joints[1].idx_v + 3))
        self._blocks = [self._bound(block) for block in blocks]

    def _bound(self, block: Rows) -> _Block:
        """Rows of the extended robot; refuse those that depend on the place of the base."""
        if block.affine or block.rheonomic:
            raise ConfigurationError(f"rows {', '.join(block.names)}: calibration assumes ground at rest")
        if block.kind is not None:
            rows = block.kind.bind(self._robot)
        else:
            assert isinstance(block, CouplingRow)  # a system itself adds those of mimic joints only
            rows = CouplingRow(self._robot, block.joint, block.driver, block.ratio, block.offset, block.names[0])
        generator = np.random.default_rng(0)
        samples = 4  # random shapes: an entry that depends on a joint does so at almost all
        positions = generator.uniform(-0.5, 0.5, size=(samples, self._robot.nv))
        # Displacements are lengths: as large as angles, they would take wheels far from their places.
        positions[:, list(self._virtual.values())] *= 1e-2
        place = self._kinematics.position(self._configurations(positions))
        silent = 1e-9  # entries of a derivative below which a row does not depend on a joint
        sizes = [np.abs(self._slope(rows, place, column)).max(initial=0.0) for column in range(self._robot.nv)]
        depending = [column for column, size in enumerate(sizes) if size > silent]
        # The base's velocity is in its own axes: on level ground, rows do not depend on its place.
        if set(depending) & set(self.base):
            raise ConfigurationError(
                f"rows {', '.join(rows.names)} depend on the place of the base: calibration assumes rolling on level "
                "ground"
            )
        # Rows of heights hold in any case: the base is planar.
        kept = [k for k in range(len(rows.names)) if not (rows.on_ground and rows.holonomic and rows.holonomic[k])]
        shape = [column for column in depending if column not in self._virtual.values()]
        acting = set(np.abs(rows.jacobian(place)).max(axis=(0, 1)).nonzero()[0].tolist())
        return _Block(block.kind, rows, kept, shape, acting)

    def drop(self, unmeasured: Sequence[int]) -> tuple[str, ...]:
        """Leave out rows that depend on positions of unmeasured joints, or act on nothing else; return their names.

        Args:
            unmeasured: columns of joints that the log does not have.
        """
        names: list[str] = []
        for block in self._blocks:
            if set(block.shape) & set(unmeasured) or block.acting <= set(unmeasured):
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
        """Let wheels have other radii.

        Args:
            radii: radius of each wheel [m], by frame.
        """
        for block in self._blocks:
            if block.kind is not None and (kind := with_radius(block.kind, radii)) is not block.kind:
                block.kind, block.rows = kind, kind.bind(self._robot)

    def evaluate(
        self, positions: Mapping[int, np.ndarray], shifts: Mapping[Virtual, float], columns: Sequence[int]
    ) -> EvaluatedRows:
        """Rows at positions (N,) of the joints that they depend on, by column, and at displacements of joints.

        Args:
            positions: the positions.
            shifts: the displacements.
            columns: columns of the rows to return.
        """
        parts = []
        for block in self._blocks:
            if not block.kept:
                continue
            samples = _Samples.over([positions[column] for column in block.shape])
            states = np.zeros((len(samples.states), self._robot.nv))
            # Other joints stay at zero: the block does not depend on them.
            states[:, block.shape] = samples.states
            for virtual, value in shifts.items():
                states[:, self._virtual[virtual]] = value
            parts.append((block, samples, self._kinematics.position(self._configurations(states))))
        return EvaluatedRows(self, parts, list(columns))

    def along(self, block: _Block, place: PositionKinematics, direction: int | Virtual | str) -> np.ndarray:
        """Derivative (S, k, n) of a block along a direction; (1, k, n) zeros if it does not depend on it.

        Args:
            block: rows of one constraint.
            place: kinematics at S states.
            direction: column of a joint, displacement of a joint, or frame of a wheel, for its radius.
        """
        if isinstance(direction, Virtual):
            return self._slope(block.rows, place, self._virtual[direction])
        if isinstance(direction, int) and direction in block.shape:
            return self._slope(block.rows, place, direction)
        if isinstance(block.kind, RollingWheel | RollingBall) and block.kind.frame == direction:
            # Rows are affine in the radius: the difference for one metre is the derivative, exactly.
            larger = replace(block.kind, radius=block.kind.radius + 1.0).bind(self._robot)
            return np.asarray(larger.jacobian(place) - block.rows.jacobian(place))
        return np.zeros((1, len(block.rows.names), self._robot.nv))

    def _slope(self, rows: Rows, place: PositionKinematics, column: int) -> np.ndarray:
        """Derivative (S, k, n) of rows along an entry of v."""
        return rows.jacobian_dot(place.with_velocity(np.tile(np.eye(self._robot.nv)[column], (len(place.q), 1))))

    def _configurations(self, positions: np.ndarray) -> np.ndarray:
        """Configurations (N, nq) of positions (N, n) of single joints, with the base at its origin."""
        q = np.tile(pin.neutral(self._robot.model), (len(positions), 1))
        for joint in self._single.values():
            joint.put(q, positions[:, joint.idx_v])
        return q


class EvaluatedRows:
    """Rows of a robot at samples, and their derivatives.

    Args:
        geometry: the rows.
        parts: each block in use with its samples and the kinematics at their states.
        columns: columns of the matrices.
    """

    def __init__(
        self, geometry: RowGeometry, parts: Sequence[tuple[_Block, _Samples, PositionKinematics]], columns: list[int]
    ) -> None:
        self._geometry, self._parts, self._columns = geometry, parts, columns

    @property
    def matrix(self) -> np.ndarray:
        """Rows (N, k, c); (1, k, c) if they are constant."""
        return self._joined([block.rows.jacobian(place) for block, _, place in self._parts])

    def along(self, direction: int | Virtual | str) -> np.ndarray:
        """Derivatives (N or 1, k, c) along a joint (column), a displacement or the radius of a wheel (frame).

        Args:
            direction: column of a joint [rad or m], displacement [m], or frame of a wheel, for its radius [m].
        """
        return self._joined([self._geometry.along(block, place, direction) for block, _, place in self._parts])

    def _joined(self, tables: Sequence[np.ndarray]) -> np.ndarray:
        found = []
        for (block, samples, _), table in zip(self._parts, tables, strict=True):
            whole = np.broadcast_to(table, (len(samples.states), *table.shape[-2:]))
            found.append(samples.values(whole[:, np.array(block.kept)[:, None], self._columns]))
        size = max(map(len, found))
        return np.concatenate([np.broadcast_to(each, (size, *each.shape[1:])) for each in found], axis=1)


class _Samples(NamedTuple):
    """States of the joints of a block at which it is evaluated, and the way from them to all samples."""

    states: np.ndarray
    """Joint positions (S, d)."""
    angle: np.ndarray | None
    """Angles (N,) relative to the range of the nodes, from -1 to 1; None without an interpolation."""

    @classmethod
    def over(cls, shape: Sequence[np.ndarray]) -> _Samples:
        """States for positions (N,) of joints: one without joints, nodes for one angle, else all."""
        if not shape:
            return cls(np.zeros((1, 0)), None)
        many = 4 * _NODES  # states above which an interpolation pays
        widest = 2.0 * np.pi  # range of an interpolation [rad]; the coefficients that a turn needs fit into the nodes
        if len(shape) == 1 and len(shape[0]) > many and np.ptp(shape[0]) <= widest:
            low, high = shape[0].min(), shape[0].max()
            middle, half = (low + high) / 2, max(high - low, 1e-3) / 2
            return cls((middle + half * _AT_NODES)[:, None], (shape[0] - middle) / half)
        return cls(np.stack(shape, axis=1), None)

    def values(self, at_states: np.ndarray) -> np.ndarray:
        """Values (N or 1, ...) at the samples from those at the states (S, ...).

        Args:
            at_states: values at the states (S, ...).
        """
        if self.angle is None:
            return at_states
        coefficients = _TO_COEFFICIENTS @ at_states.reshape(_NODES, -1)
        rounding = 1e-15  # coefficients that are left out
        large = np.abs(coefficients) > rounding * max(np.abs(at_states).max(), 1.0)
        # Rows in sine and cosine need few coefficients: the rest is rounding, and costs time at each sample.
        degree = int(np.flatnonzero(large.any(axis=1)).max(initial=0))
        found = chebyshev.chebvander(self.angle, degree) @ coefficients[: degree + 1]
        return found.reshape(-1, *at_states.shape[1:])


# ---------------------------------------------------------------------- unknowns


Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class JointNumber:
    """Unknown number of one joint; a subclass has the words before the joint in its name.

    Args:
        joint: the joint.
    """

    joint: str
    words: ClassVar[str]

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"{self.words} of {self.joint}"


@dataclass(frozen=True)
class WheelRadius:
    """Radius of a wheel or a ball, or the common radius of several [m].

    Args:
        wheels: frames of ``RollingWheel`` or ``RollingBall`` constraints.

    Example:
        >>> rnc.calibration.WheelRadius("left_wheel").name
        'radius of left_wheel'
    """

    wheels: str | Sequence[str]

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"radius of {', '.join(self.frames)}"

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames of the wheels."""
        return (self.wheels,) if isinstance(self.wheels, str) else tuple(self.wheels)


@dataclass(frozen=True)
class JointShift:
    """Place of a joint along an axis of the body that carries it [m]: a wheelbase, or the distance of a wheel.

    Several joints shift together by their shares. ``{"left": 0.5, "right": -0.5}`` along y is the track of two wheels:
    it grows by a metre if each wheel moves half a metre outwards.

    Args:
        joints: a joint, or joints with their shares.
        axis: axis of the body that carries the joints.

    Example:
        >>> rnc.calibration.JointShift({"left": 0.5, "right": -0.5}, "y").name
        'place of left, right along y'
    """

    joints: str | Mapping[str, float]
    axis: Axis

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"place of {', '.join(self.shares)} along {self.axis}"

    @property
    def shares(self) -> Mapping[str, float]:
        """Shift of each joint for a unit of the parameter.

        Raises:
            ConfigurationError: no joint, or a share that is zero or not finite.
        """
        shares = {self.joints: 1.0} if isinstance(self.joints, str) else self.joints
        valid = isinstance(shares, Mapping) and shares and all(np.isfinite(each) and each for each in shares.values())
        if not valid:
            raise ConfigurationError(f"place of joints: expected a joint, or joints with shares, found {shares!r}")
        return shares


class EncoderScale(JointNumber):
    """Factor of the measured position of a joint, e.g. of a gear.

    Args:
        joint: the joint.

    Example:
        >>> rnc.calibration.EncoderScale("steering").name
        'scale of steering'
    """

    words: ClassVar[str] = "scale"


class EncoderOffset(JointNumber):
    """Value added to the measured and scaled position of a joint [rad or m].

    Args:
        joint: the joint.

    Example:
        >>> rnc.calibration.EncoderOffset("steering").name
        'offset of steering'
    """

    words: ClassVar[str] = "offset"


@dataclass(frozen=True)
class SensorPlace:
    """Place of the frame whose pose is measured, on its body: along x or y [m], or the angle about z [rad].

    Args:
        axis: "x", "y" or "yaw".

    Example:
        >>> rnc.calibration.SensorPlace("yaw").name
        'yaw of the sensor'
    """

    axis: Literal["x", "y", "yaw"]

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"{self.axis} of the sensor"


@dataclass(frozen=True)
class TimeShift:
    """Time by which the stamps of a joint or of the sensor are later than the measurement [s].

    Args:
        of: a joint, or None for the sensor of the pose.

    Example:
        >>> rnc.calibration.TimeShift("steering").name
        'delay of steering'
    """

    of: str | None = None

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return f"delay of {self.of or 'the sensor'}"


Unknown: TypeAlias = WheelRadius | JointShift | EncoderScale | EncoderOffset | SensorPlace | TimeShift


class UnknownNumber(NamedTuple):
    """Unknown number with its value in the robot's file."""

    kind: Unknown
    name: str
    unit: str
    nominal: float
    scale: float
    """Typical size: a radius, a length of the robot, one radian, one."""
    displaced: Mapping[Virtual, float]
    """Displacements of joints for a unit of the parameter."""
    wheels: tuple[str, ...] = ()
    """Wheels of a radius."""

    @property
    def joint(self) -> str | None:
        """Joint whose measurement it corrects; None for other parameters."""
        return getattr(self.kind, "joint", getattr(self.kind, "of", None))


def radii_of(parameters: Sequence[UnknownNumber], p: np.ndarray) -> dict[str, float]:
    """Radius of each wheel that parameters p (P,) concern; a second parameter of a wheel adds its change.

    Args:
        parameters: the unknown numbers.
        p: their values (P,).
    """
    radii: dict[str, float] = {}
    for value, each in zip(p, parameters, strict=True):
        for wheel in each.wheels:
            radii[wheel] = float(radii[wheel] + value - each.nominal if wheel in radii else value)
    return radii


def with_radius(kind: ConstraintKind, radii: Mapping[str, float]) -> ConstraintKind:
    """The constraint of a wheel or ball with another radius; other constraints as they are.

    Args:
        kind: the constraint.
        radii: new radii by frame [m].
    """
    if isinstance(kind, RollingWheel | RollingBall) and kind.frame in radii:
        return replace(kind, radius=radii[kind.frame])
    return kind


def number_of(kind: Unknown, system: NonholonomicSystem, mount: np.ndarray) -> UnknownNumber:
    """Unknown number of a system, whose sensor has a place (3,) on the base: x, y [m] and heading [rad].

    Args:
        kind: the unknown.
        system: the robot and its constraints, with the value of the file.
        mount: place of the sensor on the base: x, y [m] and heading [rad].

    Raises:
        ConfigurationError: a frame or joint is not there, or has no such number.
    """
    robot, model = system.robot, system.robot.model
    distances = [float(np.linalg.norm(model.jointPlacements[k].translation)) for k in range(2, model.njoints)]
    # Size of the robot; a metre for one whose joints all sit at their bodies.
    length = max(distances or [1.0]) or 1.0
    if isinstance(kind, WheelRadius):
        radii = {each.frame: each.radius for each in system.kinds if isinstance(each, RollingWheel | RollingBall)}
        for wheel in kind.frames:
            robot.frame_id(wheel)
            if wheel not in radii:
                raise ConfigurationError(f"radius of {wheel}: no wheel or ball rolls there")
        # The file may state another radius for each wheel of a common one.
        nominal = float(np.mean([radii[wheel] for wheel in kind.frames]))
        return UnknownNumber(kind, kind.name, "m", nominal, nominal, {}, kind.frames)
    if isinstance(kind, JointShift):
        for joint in kind.shares:
            if robot.joint_id(joint) == 1:
                raise ConfigurationError(f"{kind.name}: '{joint}' is the base")
        displaced = {Virtual(joint, kind.axis): share for joint, share in kind.shares.items()}
        axis = "xyz".index(kind.axis)
        places = {joint: model.jointPlacements[robot.joint_id(joint)].translation[axis] for joint in kind.shares}
        # The least-squares solution of place = share * nominal: exact where the joints are symmetric.
        nominal = sum(share * places[joint] for joint, share in kind.shares.items())
        nominal /= sum(share**2 for share in kind.shares.values())
        return UnknownNumber(kind, kind.name, "m", float(nominal), length, displaced)
    if isinstance(kind, SensorPlace):
        axis = ("x", "y", "yaw").index(kind.axis)
        unit, scale = ("rad", 1.0) if axis == 2 else ("m", length)
        return UnknownNumber(kind, kind.name, unit, float(mount[axis]), scale, {})
    if isinstance(kind, TimeShift):
        if kind.of is not None:
            robot.joint_id(kind.of)
        return UnknownNumber(kind, kind.name, "s", 0.0, 1.0, {})
    robot.single_joint(kind.joint)
    unit = robot.velocity_units[robot.velocity_indices(kind.joint).start].removesuffix("/s")
    if isinstance(kind, EncoderScale):
        return UnknownNumber(kind, kind.name, "", 1.0, 1.0, {})
    return UnknownNumber(kind, kind.name, unit, 0.0, 1.0 if unit == "rad" else length, {})


def corrections_of(parameters: Sequence[UnknownNumber], p: np.ndarray, sensor: str) -> dict[str, Correction]:
    """Corrections of joints and clocks that parameters p (P,) say, by joint or frame.

    Args:
        parameters: the unknown numbers.
        p: their estimates (P,).
        sensor: frame whose pose was measured; its clock is corrected under this name.
    """
    found: dict[str, Correction] = {}
    for value, each in zip(p.tolist(), parameters, strict=True):
        key = {EncoderScale: "scale", EncoderOffset: "offset", TimeShift: "delay"}.get(type(each.kind))
        if key is not None:
            name = each.joint or sensor
            found[name] = found.get(name, Correction()).model_copy(update={key: value})
    return found
