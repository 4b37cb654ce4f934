"""Motion of a rolling base from measured joints, as a function of unknown parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rnc_pin.errors import ConfigurationError, argument, few, nearest
from rnc_pin.identification.rolled_path import Poses, RolledPath, rotated, sideways
from rnc_pin.identification.row_geometry import RowGeometry, Virtual
from rnc_pin.identification.unknowns import (
    EncoderOffset,
    EncoderScale,
    JointShift,
    JointTilt,
    SensorPlace,
    TimeShift,
    Unknown,
    WheelRadius,
)
from rnc_pin.logs.channel import Channel
from rnc_pin.logs.log import Log
from rnc_pin.model.system import NonholonomicSystem

_BREAK = 5.0  # intervals longer than so many usual ones end a window
_REGULAR = 1e-6  # smallest singular value of the unit rows of the base, relative to the largest


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


@dataclass(frozen=True)
class _Joint:
    """Measured joint of the rows."""

    name: str
    column: int
    channel: Channel


def radii_of(parameters: Sequence[UnknownNumber], p: np.ndarray) -> dict[str, float]:
    """Radius of each wheel that parameters p (P,) concern; a second parameter of a wheel adds its change."""
    radii: dict[str, float] = {}
    for value, each in zip(p, parameters, strict=True):
        for wheel in each.wheels:
            radii[wheel] = float(radii[wheel] + value - each.nominal if wheel in radii else value)
    return radii


class RollingMotion:
    """Predicted poses of a sensor on the base, from measured joints.

    Between two stamps, each joint moves at a constant rate, and the rows are those in the middle. If there are more
    rows than a motion needs, it is their least-squares solution; all rows have the same weight.

    Args:
        system: the robot on a planar base, with its constraints.
        log: positions of joints; of joints without positions, velocities.
        unknown: the unknown parameters.
        sensor: frame on the base whose pose is predicted.

    Attributes:
        parameters: the parameters, in the order of ``unknown``.
        mount: place x, y [m] and heading [rad] of the sensor on the base, in the file.
        used: names of the rows in use.
        unused: names of rows that depend on joints which the log does not have.
        time: times of the steps (N + 1,) [s].
        breaks: times in front of which a window has to end [s].

    Raises:
        ConfigurationError: a name is unknown, or the measured joints do not determine the motion of the base.
    """

    def __init__(self, system: NonholonomicSystem, log: Log, unknown: Sequence[Unknown], sensor: str) -> None:
        robot = system.robot
        model = robot.model
        if model.njoints < 2 or model.joints[1].shortname() != "JointModelPlanar":
            raise ConfigurationError(
                f"calibration needs a planar base: load robot '{robot.name}' with {argument('base', 'planar')}"
            )
        frame = model.frames[robot.frame_id(sensor)]
        if frame.parentJoint != 1:
            raise ConfigurationError(f"sensor '{sensor}' is on a body behind joint '{model.names[frame.parentJoint]}', "
                                     "expected a frame of the base")  # fmt: skip
        self.mount = np.array([*frame.placement.translation[:2], _heading_of(frame.placement.rotation)])
        self._length = max([float(np.linalg.norm(model.jointPlacements[k].translation))
                            for k in range(2, model.njoints)] or [1.0]) or 1.0  # fmt: skip
        self.parameters = [self._parameter(system, each) for each in unknown]
        names = [each.name for each in self.parameters]
        for name in names:
            if names.count(name) > 1:
                raise ConfigurationError(f"the {name} is named twice")
        virtual = list(dict.fromkeys(each for parameter in self.parameters for each in parameter.displaced))
        radii = list(dict.fromkeys(wheel for parameter in self.parameters for wheel in parameter.wheels))
        self._geometry = RowGeometry(robot, [place.block for place in system.rows.places], virtual, radii)
        self._find_joints(log)
        self._set_time()

    # ------------------------------------------------------------------ parameters

    def _parameter(self, system: NonholonomicSystem, kind: Unknown) -> UnknownNumber:
        robot, length = system.robot, self._length
        if isinstance(kind, WheelRadius):
            sizes = [getattr(each, "radius", None) for each in system.kinds
                     if getattr(each, "frame", None) in kind.frames]  # fmt: skip
            for wheel in kind.frames:
                robot.frame_id(wheel)
            radii = [size for size in sizes if size is not None]
            if not radii:
                raise ConfigurationError(f"{kind.name}: no wheel or ball rolls there")
            nominal = float(np.mean(radii))
            return UnknownNumber(kind, kind.name, "m", nominal, nominal, {}, kind.frames)
        if isinstance(kind, JointShift | JointTilt):
            turns = isinstance(kind, JointTilt)
            for joint in kind.shares:
                if robot.joint_id(joint) == 1:
                    raise ConfigurationError(f"{kind.name}: '{joint}' is the base")
            displaced = {Virtual(joint, turns, kind.axis): share for joint, share in kind.shares.items()}
            if turns:
                return UnknownNumber(kind, kind.name, "rad", 0.0, 1.0, displaced)
            axis = "xyz".index(kind.axis)
            places = {
                joint: robot.model.jointPlacements[robot.joint_id(joint)].translation[axis] for joint in kind.shares
            }
            nominal = sum(share * places[joint] for joint, share in kind.shares.items())
            nominal /= sum(share**2 for share in kind.shares.values())
            return UnknownNumber(kind, kind.name, "m", float(nominal), length, displaced)
        if isinstance(kind, SensorPlace):
            axis = ("x", "y", "yaw").index(kind.axis)
            unit, scale = ("rad", 1.0) if axis == 2 else ("m", length)
            return UnknownNumber(kind, kind.name, unit, float(self.mount[axis]), scale, {})
        if isinstance(kind, TimeShift):
            if kind.of is not None:
                robot.joint_id(kind.of)
            return UnknownNumber(kind, kind.name, "s", 0.0, 1.0, {})
        robot.single_joint(kind.joint)
        unit = robot.velocity_units[robot.velocity_indices(kind.joint).start].removesuffix("/s")
        if isinstance(kind, EncoderScale):
            return UnknownNumber(kind, kind.name, "", 1.0, 1.0, {})
        return UnknownNumber(kind, kind.name, unit, 0.0, 1.0 if unit == "rad" else length, {})

    # ------------------------------------------------------------------ joints and times

    def _find_joints(self, log: Log) -> None:
        geometry = self._geometry
        columns = {name: column for name, column in geometry.columns.items() if not name.startswith("virtual ")}
        measured = {}
        for name, column in columns.items():
            if f"position({name})" in log.channels:
                measured[column] = _Joint(name, column, log.channel("position", name))
            elif f"velocity({name})" in log.channels and column not in geometry.shape:
                measured[column] = _Joint(name, column, _summed(log.channel("velocity", name)))
        self.unused = geometry.drop([column for column in columns.values() if column not in measured])
        if not geometry.names:
            raise ConfigurationError(f"the log has no joint of the rows {few(self.unused)}")
        self.used = geometry.names
        every = range(geometry.size)
        sample, _ = geometry.evaluate(np.random.default_rng(1).uniform(-0.5, 0.5, (4, geometry.size)), {}, every)
        acting = np.abs(sample).max(axis=(0, 1)) > 1e-12
        self._joints = [each for column, each in measured.items() if acting[column] or column in geometry.shape]
        others = [column for column in columns.values() if acting[column] and column not in measured]
        self._unknown_columns = [*geometry.base, *others]
        self._columns = [*self._unknown_columns, *(each.column for each in self._joints)]
        values = np.linalg.svd(sample[:, :, self._unknown_columns], compute_uv=False)
        if sample.shape[1] < len(self._unknown_columns) or (values[:, -1] < _REGULAR * values[:, 0]).all():
            missing = [name for name, column in columns.items() if column in others]
            raise ConfigurationError(
                f"the measured joints {few([each.name for each in self._joints]) or '(none)'} do not determine the "
                f"motion of the base: expected positions of {few(missing) or 'joints with rows'} too"
            )
        for parameter in self.parameters:
            kind = parameter.kind
            name = getattr(kind, "joint", None) or (kind.of if isinstance(kind, TimeShift) else None)
            names = [each.name for each in self._joints]
            if name is not None and name not in names:
                raise ConfigurationError(
                    f"{parameter.name}: the rows use no measured joint '{name}'{nearest(name, names)}"
                )

    def _set_time(self) -> None:
        if not self._joints:
            raise ConfigurationError("the log has no joint that the rows use")
        channels = [each.channel for each in self._joints]
        finest = max(channels, key=lambda channel: len(channel.time))
        start, end = max(each.time[0] for each in channels), min(each.time[-1] for each in channels)
        inside = (finest.time >= start) & (finest.time <= end)
        time = finest.time[inside]
        whole = np.all([np.isfinite(each.at(time)).all(axis=1) for each in channels], axis=0)
        self.time = time[whole]
        if len(self.time) < 3:
            raise ConfigurationError("the joints of the log have no common time")
        self.breaks = self.time[1:][np.diff(self.time) > _BREAK * np.median(np.diff(self.time))]

    # ------------------------------------------------------------------ prediction

    def poses(self, p: np.ndarray, times: np.ndarray) -> Poses:
        """Poses of the sensor (M, 3) for parameters p (P,), from a base that starts at the origin.

        Args:
            p: parameters (P,).
            times: stamps of the sensor (M,) [s].
        """
        late = [
            k for k, each in enumerate(self.parameters) if isinstance(each.kind, TimeShift) and each.kind.of is None
        ]
        path = RolledPath(self.time, *self._steps(p))
        base = path.at(times - sum(p[k] for k in late))
        mount = self.mount.copy()
        places = [(k, ("x", "y", "yaw").index(each.kind.axis)) for k, each in enumerate(self.parameters)
                  if isinstance(each.kind, SensorPlace)]  # fmt: skip
        for k, axis in places:
            mount[axis] = p[k]
        heading = base.values[:, 2]
        arm = rotated(heading, np.broadcast_to(mount[:2], (len(times), 2)))
        values = base.values + np.column_stack([arm, np.full(len(times), mount[2])])
        slopes, rates = base.slopes.copy(), base.rates.copy()
        slopes[:, :2] += sideways(arm)[:, :, None] * base.slopes[:, None, 2]
        rates[:, :2] += sideways(arm) * base.rates[:, 2:]
        for k, axis in places:
            unit = np.eye(3)[axis]
            slopes[:, :2, k] += rotated(heading, np.broadcast_to(unit[:2], (len(times), 2)))
            slopes[:, 2, k] += unit[2]
        for k in late:
            slopes[:, :, k] -= rates
        return Poses(values, slopes, rates)

    @property
    def shape_joints(self) -> tuple[str, ...]:
        """Measured joints on whose positions the rows in use depend."""
        return tuple(each.name for each in self._joints if each.column in self._geometry.shape)

    @property
    def row_joints(self) -> tuple[str, ...]:
        """Joints that move a row in use."""
        acting = {*self._columns, *self._geometry.shape}
        return tuple(name for name, column in self._geometry.columns.items() if column in acting)

    def slip(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slip of the rows at a given motion of the base, with parameters of the file.

        Args:
            poses: poses of the base (N + 1, 3) at the times of the steps.

        Returns:
            Times (N,) in the middle of the steps [s], and slip (N, k) during each step [m]. Joints that are not
            measured move such that its square is smallest.
        """
        positions, moved, _, _ = self._measured(np.array([each.nominal for each in self.parameters]))
        A, _ = self._geometry.evaluate(positions, {}, self._columns)
        change = np.diff(poses, axis=0)
        turn = change[:, 2]
        half = rotated(-(poses[:-1, 2] + turn / 2), change[:, :2]) / np.sinc(turn / (2 * np.pi))[:, None]
        size = len(self._unknown_columns)
        slip = _product(A[:, :, :3], np.column_stack([half, turn])) + _product(A[:, :, size:], moved)
        others = A[:, :, 3:size]
        if others.shape[2]:
            inverse = np.linalg.pinv(others)
            slip = slip - _product(others, _product(inverse, np.nan_to_num(slip)))
        return (self.time[1:] + self.time[:-1]) / 2, slip

    def _steps(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Twists of the steps (N, 3) and their derivatives (N, 3, P)."""
        geometry, count = self._geometry, len(self.time) - 1
        shifts: dict[Virtual, float] = {}
        for value, parameter in zip(p, self.parameters, strict=True):
            for virtual, share in parameter.displaced.items():
                shifts[virtual] = shifts.get(virtual, 0.0) + share * (value - parameter.nominal)
        geometry.set_radii(radii_of(self.parameters, p))
        positions, moved, d_middle, d_moved = self._measured(p)
        directions: dict[Any, int] = {}  # columns, displacements and wheels
        for parameter in self.parameters:
            for each in (*parameter.displaced, *parameter.wheels):
                directions.setdefault(each, len(directions))
        for column, _ in d_middle.values():
            directions.setdefault(column, len(directions))
        A, slopes = geometry.evaluate(positions, shifts, self._columns, list(directions))
        size = len(self._unknown_columns)
        left, right = A[:, :, :size], A[:, :, size:]
        driven = _product(right, moved)
        normal = left.mT @ left
        solution = -np.linalg.solve(normal, _product(left.mT, driven)[:, :, None])[:, :, 0]
        residual = _product(left, solution) + driven
        whole = np.concatenate([solution, moved], axis=1)
        effects = []  # of each direction on the normal equations, (N, size)
        for parts in slopes:
            effect = np.zeros((count, size))
            for where, slope in parts:
                change = _product(slope, whole)
                effect += _product(left[:, where].mT, change) + _product(slope[:, :, :size].mT, residual[:, where])
            effects.append(effect)
        sides = np.zeros((count, size, len(p)))
        for k, parameter in enumerate(self.parameters):
            for each, share in (*parameter.displaced.items(), *((wheel, 1.0) for wheel in parameter.wheels)):
                sides[:, :, k] += share * effects[directions[each]]
            if k in d_moved:
                index, rate = d_moved[k]
                sides[:, :, k] += _product(left.mT, right[:, :, index] * rate[:, None])
            if k in d_middle:
                column, rate = d_middle[k]
                sides[:, :, k] += effects[directions[column]] * rate[:, None]
        return solution[:, :3], -np.linalg.solve(normal, sides)[:, :3]

    def _measured(
        self, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, dict[int, tuple[int, np.ndarray]], dict[int, tuple[int, np.ndarray]]]:
        """Positions in the middle of steps (N, n) and changes (N, joints), with derivatives by parameter.

        A derivative of a position is a column of v with numbers (N,), one of a change the number of a joint with
        numbers (N,). Joints that the rows do not depend on have none of positions, and their positions are zero.
        """
        count = len(self.time) - 1
        positions, moved = np.zeros((count, self._geometry.size)), np.zeros((count, len(self._joints)))
        d_middle: dict[int, tuple[int, np.ndarray]] = {}
        d_moved: dict[int, tuple[int, np.ndarray]] = {}
        for index, joint in enumerate(self._joints):
            own = {type(each.kind): k for k, each in enumerate(self.parameters)
                   if joint.name in (getattr(each.kind, "joint", None), getattr(each.kind, "of", None))}  # fmt: skip
            scale = p[own[EncoderScale]] if EncoderScale in own else 1.0
            offset = p[own[EncoderOffset]] if EncoderOffset in own else 0.0
            late = p[own[TimeShift]] if TimeShift in own else 0.0
            # Stamps are late: what was true at a time has a later stamp.
            raw = _held(joint.channel, self.time + late)
            middle, change = (raw[1:] + raw[:-1]) / 2, np.diff(raw)
            moved[:, index] = scale * change
            slopes: dict[type, tuple[np.ndarray, np.ndarray]] = {
                EncoderScale: (middle, change),
                EncoderOffset: (np.ones(count), np.zeros(count)),
            }
            if TimeShift in own:
                rate = scale * _slope(joint.channel, self.time + late)
                slopes[TimeShift] = (rate[1:] + rate[:-1]) / 2, np.diff(rate)
            for kind, k in own.items():
                d_moved[k] = index, slopes[kind][1]
                if joint.column in self._geometry.shape:
                    d_middle[k] = joint.column, slopes[kind][0]
            if joint.column in self._geometry.shape:
                positions[:, joint.column] = scale * middle + offset
        return positions, moved, d_middle, d_moved


def _product(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products (N, k) of matrices (N or 1, k, l) with vectors (N, l)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def _held(channel: Channel, times: np.ndarray) -> np.ndarray:
    """Values (M,) of a joint; in front of its first and behind its last sample, those."""
    return np.asarray(np.interp(times, channel.time, channel.values[:, 0]))


def _slope(channel: Channel, times: np.ndarray) -> np.ndarray:
    """Rates (M,) of a joint between its samples; zero outside."""
    rates = np.diff(channel.values[:, 0]) / np.diff(channel.time)
    inside = (times > channel.time[0]) & (times < channel.time[-1])
    k = np.clip(np.searchsorted(channel.time, times, side="right") - 1, 0, len(rates) - 1)
    return np.where(inside, rates[k], 0.0)


def _summed(channel: Channel) -> Channel:
    """Positions of a joint from its velocities, from zero."""
    v, dt = channel.values[:, 0], np.diff(channel.time)
    position = np.concatenate([[0.0], np.cumsum(dt * (v[1:] + v[:-1]) / 2)])
    return Channel("position", channel.of, channel.time, position[:, None])


def _heading_of(rotation: np.ndarray) -> float:
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))
