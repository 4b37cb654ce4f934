"""Motion of a rolling base from measured joints, as a function of unknown parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConfigurationError, InfeasibleError, argument, few, place_of
from rnc_pin.lab.calibration import unknowns
from rnc_pin.lab.calibration.unknowns import RowGeometry, Virtual
from rnc_pin.lab.calibration.window_fit import Poses, RolledPath, joined, plane
from rnc_pin.lab.logs import Channel, Log
from rnc_pin.model.coordinates import heading_of
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.robots.joint_values import SingleJoint

_Slopes = dict[int, tuple[int, np.ndarray]]
"""Derivatives by parameter: the number of a column or joint, with numbers."""


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
        nominal: their values in the file (P,).
        mount: place x, y [m] and heading [rad] of the sensor on the base, in the file.
        used: names of the rows in use.
        unused: names of rows that depend on joints which the log does not have.
        time: times of the steps (N + 1,) [s].
        breaks: times in front of which a window has to end [s].

    Raises:
        ConfigurationError: a name is unknown, or the measured joints do not determine the motion of the base.
    """

    def __init__(self, system: NonholonomicSystem, log: Log, unknown: Sequence[unknowns.Unknown], sensor: str) -> None:
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
        self.mount = np.array([*frame.placement.translation[:2], heading_of(frame.placement.rotation)])
        self.parameters = [unknowns.number_of(each, system, self.mount) for each in unknown]
        self.nominal = np.array([each.nominal for each in self.parameters])
        names = [each.name for each in self.parameters]
        for name in names:
            if names.count(name) > 1:
                raise ConfigurationError(f"the {name} is named twice")
        virtual = list(dict.fromkeys(each for parameter in self.parameters for each in parameter.displaced))
        self._model = model
        self._geometry = RowGeometry(robot, [place.block for place in system.rows.places], virtual)
        self._find_joints(log)
        self._set_time()

    # ------------------------------------------------------------------ joints and times

    def _find_joints(self, log: Log) -> None:
        geometry = self._geometry
        columns = {name: column for name, column in geometry.columns.items() if not name.startswith("virtual ")}
        measured: dict[int, Channel] = {}
        for name, column in columns.items():
            if f"position({name})" in log.channels:
                measured[column] = log.channel("position", name)
            elif f"velocity({name})" in log.channels and column not in geometry.shape:
                speed = log.channel("velocity", name)
                position = scipy.integrate.cumulative_trapezoid(speed.values, speed.time, axis=0, initial=0.0)
                measured[column] = Channel("position", name, speed.time, position)
        self.unused = geometry.drop([column for column in columns.values() if column not in measured])
        if not geometry.names:
            raise ConfigurationError(f"the log has no joint of the rows {few(self.unused)}")
        self.used = geometry.names
        every = range(geometry.size)
        # At four random shapes: a column that acts on a row does so at almost all shapes.
        drawn = np.random.default_rng(1).uniform(-0.5, 0.5, (geometry.size, 4))
        sample = geometry.evaluate(dict(enumerate(drawn)), {}, every).matrix
        acting = np.abs(sample).max(axis=(0, 1)) > 1e-12
        self._joints = {k: each for k, each in measured.items() if acting[k] or k in geometry.shape}
        """Measured joints of the rows by column."""
        others = [column for column in columns.values() if acting[column] and column not in measured]
        self._unknown_columns = [*geometry.base, *others]
        self._columns = [*self._unknown_columns, *self._joints]
        # The worst of the drawn shapes may be singular by chance: one regular shape is enough.
        values = np.linalg.svd(sample[:, :, self._unknown_columns], compute_uv=False)
        regular = 1e-6  # smallest singular value of the unit rows of the base, relative to the largest
        names = [each.of for each in self._joints.values()]
        if sample.shape[1] < len(self._unknown_columns) or (values[:, -1] < regular * values[:, 0]).all():
            missing = [name for name, column in columns.items() if column in others]
            raise ConfigurationError(
                f"the measured joints {few(names) or '(none)'} do not determine the "
                f"motion of the base: expected positions of {few(missing) or 'joints with rows'} too"
            )
        for parameter in self.parameters:
            if parameter.joint is not None:
                place_of(parameter.joint, names, f"{parameter.name}: the rows use no measured joint")

    def _set_time(self) -> None:
        if not self._joints:
            raise ConfigurationError("the log has no joint that the rows use")
        channels = list(self._joints.values())
        # The joint with most samples gives the steps: others are interpolated, so no sample of it is lost.
        finest = max(channels, key=lambda channel: len(channel.time))
        start, end = max(each.time[0] for each in channels), min(each.time[-1] for each in channels)
        time = finest.time[(finest.time >= start) & (finest.time <= end)]
        self.time = time[np.all([np.isfinite(each.at(time)).all(axis=1) for each in channels], axis=0)]
        if len(self.time) < 3:
            raise ConfigurationError("the joints of the log have no common time")
        longest = 5.0  # intervals longer than so many usual ones end a window
        self.breaks = self.time[1:][np.diff(self.time) > longest * np.median(np.diff(self.time))]

    # ------------------------------------------------------------------ prediction

    def poses(self, p: np.ndarray, times: np.ndarray) -> Poses:
        """Poses of the sensor (M, 3) for parameters p (P,), from a base that starts at the origin.

        Args:
            p: parameters (P,).
            times: stamps of the sensor (M,) [s].
        """
        late = [k for k, one in enumerate(self.parameters) if one.kind == unknowns.TimeShift()]
        base = RolledPath(self.time, *self._steps(p), len(p)).at(times - sum(p[k] for k in late))
        # Places that are no parameters stay as in the file.
        mount = self.mount.copy()
        places = [(k, ("x", "y", "yaw").index(each.kind.axis)) for k, each in enumerate(self.parameters)
                  if isinstance(each.kind, unknowns.SensorPlace)]  # fmt: skip
        for k, axis in places:
            mount[axis] = p[k]
        turned, size = np.exp(1j * base.values[:, 2]), len(times)
        arm = turned * complex(*mount[:2])
        slopes, rates, away = base.slopes, base.rates, np.stack([-arm.imag, arm.real], axis=1)
        # The sensor is away from the base: a turn of the base moves it sideways.
        slopes[:, :2] += away[:, :, None] * slopes[:, 2:]
        rates[:, :2] += away * rates[:, 2:]
        for k, axis in places:
            slopes[:, :, k] += joined(turned * (1.0, 1j, 0.0)[axis], np.full(size, float(axis == 2)))
        for k in late:
            slopes[:, :, k] -= rates
        return Poses(base.values + joined(arm, np.full(size, mount[2])), slopes, rates)

    def configurations(self, times: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Configurations (T, nq) of the robot at times (T,) [s], with parameters of the file.

        Unmeasured joints of rows start at zero, other joints stand still there.

        Args:
            times: times (T,) [s].
            poses: poses (T, 3) of the base: x, y [m] and heading [rad].
        """
        positions, changes, _, _ = self._measured(self.nominal)
        whole = _Solution(self._geometry.evaluate(positions, {}, self._columns).matrix, changes).whole
        q, first = np.tile(pin.neutral(self._model), (len(times), 1)), self._model.joints[1].idx_q
        q[:, first : first + 4] = np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        starts = {column: _held(each, self.time[:1]) for column, each in self._joints.items()}
        joints = {joint.idx_v: SingleJoint.of(joint) for joint in self._model.joints if joint.nv == 1}
        for column, change in zip(self._columns[3:], whole[:, 3:].T, strict=True):
            position = np.concatenate([[0.0], np.cumsum(change)]) + starts.get(column, 0.0)
            joints[column].put(q, np.interp(times, self.time, position))
        return q

    def slip(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slip of the rows at a given motion of the base, with parameters of the file.

        Args:
            poses: poses of the base (N + 1, 3) at the times of the steps.

        Returns:
            Times (N,) in the middle of the steps [s], and slip (N, k) during each step [m]. Joints that are not
            measured move such that its square is smallest.
        """
        positions, moved, _, _ = self._measured(self.nominal)
        A = self._geometry.evaluate(positions, {}, self._columns).matrix
        change = np.diff(poses, axis=0)
        turn = change[:, 2]
        # The twist that leads from one pose to the next: chords of arcs are shorter than their lengths, by sinc.
        half = np.exp(-1j * (poses[:-1, 2] + turn / 2)) * plane(change) / np.sinc(turn / (2 * np.pi))
        size = len(self._unknown_columns)
        slip = np.matvec(A[:, :, :3], joined(half, turn)) + np.matvec(A[:, :, size:], moved)
        others = A[:, :, 3:size]
        slip = slip - np.matvec(others, np.matvec(np.linalg.pinv(others), np.nan_to_num(slip)))
        return (self.time[1:] + self.time[:-1]) / 2, slip

    def _steps(self, p: np.ndarray) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """Twists of the steps (3, N), and their derivatives (3, N) by the parameters that change them."""
        geometry = self._geometry
        shifts: dict[Virtual, float] = {}
        for value, parameter in zip(p, self.parameters, strict=True):
            for virtual, share in parameter.displaced.items():
                shifts[virtual] = shifts.get(virtual, 0.0) + share * (value - parameter.nominal)
        geometry.set_radii(unknowns.radii_of(self.parameters, p))
        positions, changes, d_middle, d_changes = self._measured(p)
        rows = geometry.evaluate(positions, shifts, self._columns)
        solution = _Solution(rows.matrix, changes)

        @cache  # parameters share directions, such as the radius of a wheel with two joints
        def effect(direction: int | Virtual | str) -> np.ndarray:
            return solution.effect_of_rows(rows.along(direction))

        found = {}
        for k, parameter in enumerate(self.parameters):
            parts = [share * effect(virtual) for virtual, share in parameter.displaced.items()]
            parts += [effect(wheel) for wheel in parameter.wheels]
            if k in d_middle:
                column, by = d_middle[k]
                parts.append(by[:, None] * effect(column))
            if k in d_changes:
                parts.append(solution.effect_of_change(*d_changes[k]))
            if parts:
                found[k] = sum(parts, np.zeros(1))[:, :3].T
        return solution.whole[:, :3].T, found

    def _measured(self, p: np.ndarray) -> tuple[dict[int, np.ndarray], np.ndarray, _Slopes, _Slopes]:
        """Positions in the middle of steps by column, and changes (N, j) of joints, with derivatives by parameter.

        A derivative of a position is a column of v with numbers, one of a change the number of a joint with numbers.
        Only joints that the rows depend on have positions.
        """
        positions: dict[int, np.ndarray] = {}
        moved: list[np.ndarray] = []
        d_middle: _Slopes = {}
        d_moved: _Slopes = {}
        usual = {unknowns.EncoderScale: 1.0, unknowns.EncoderOffset: 0.0, unknowns.TimeShift: 0.0}
        for index, (column, channel) in enumerate(self._joints.items()):
            own = {type(each.kind): k for k, each in enumerate(self.parameters) if each.joint == channel.of}
            scale, offset, late = (p[own[kind]] if kind in own else value for kind, value in usual.items())
            # Stamps are late: what was true at a time has a later stamp.
            raw = _held(channel, self.time + late)
            middle, change = (raw[1:] + raw[:-1]) / 2, np.diff(raw)
            moved.append(scale * change)
            in_shape = column in self._geometry.shape
            if in_shape:
                positions[column] = scale * middle + offset
            rate = scale * _slope(channel, self.time + late) if unknowns.TimeShift in own else raw
            slopes = {
                unknowns.EncoderScale: (middle, change),
                unknowns.EncoderOffset: (np.ones_like(middle), np.zeros_like(change)),
                unknowns.TimeShift: ((rate[1:] + rate[:-1]) / 2, np.diff(rate)),
            }
            for kind, k in own.items():
                of_middle, of_change = slopes[kind]
                d_moved[k] = index, of_change
                if in_shape:
                    d_middle[k] = column, of_middle
        return positions, np.stack(moved, axis=1), d_middle, d_moved


class _Solution:
    """Motion (N, c) of all columns of rows (N or 1, k, c) that fits measured changes (N, j) of the last ones best.

    Raises:
        InfeasibleError: the other columns are dependent at a sample.
    """

    def __init__(self, A: np.ndarray, changes: np.ndarray) -> None:
        """Solve the rows in the least-squares sense.

        Args:
            A: rows (N or 1, k, c), the measured joints last.
            changes: measured changes (N, j) of these joints.
        """
        size = A.shape[2] - changes.shape[1]
        self._left, self._driven = A[:, :, :size], A[:, :, size:]
        # The pivots of Cholesky's method show dependent columns, at all samples in one call.
        normal = self._left.mT @ self._left
        try:
            pivots = np.linalg.cholesky(normal).diagonal(axis1=1, axis2=2) ** 2
        except np.linalg.LinAlgError:
            pivots = np.zeros(1)
        singular = 1e-14  # pivot of the normal equations relative to their diagonal
        if (pivots <= singular * normal.diagonal(axis1=1, axis2=2)).any():
            raise InfeasibleError("the rows do not determine the motion of the base at each measured position")
        self._inverse = np.linalg.inv(normal)
        self.whole = np.concatenate([self._solved(np.matvec(self._driven, changes)), changes], axis=1)
        self._residual = np.matvec(A, self.whole)

    def _solved(self, driven: np.ndarray) -> np.ndarray:
        """Motion (N, s) of the first columns that cancels rows (N, k) best."""
        return -np.matvec(self._inverse, np.matvec(self._left.mT, driven))

    def effect_of_rows(self, slope: np.ndarray) -> np.ndarray:
        """Derivative (N, s) of the motion for a derivative (N or 1, k, c) of the rows."""
        # Derivative of the normal equations: rows that contradict each other leave a residual, which turns with them.
        by_residual = np.matvec(self._inverse, np.matvec(slope[:, :, : self._left.shape[2]].mT, self._residual))
        return self._solved(np.matvec(slope, self.whole)) - by_residual

    def effect_of_change(self, joint: int, rate: np.ndarray) -> np.ndarray:
        """Derivative (N, s) of the motion for a derivative (N,) of the changes of one measured joint."""
        return self._solved(self._driven[:, :, joint] * rate[:, None])


def _held(channel: Channel, times: np.ndarray) -> np.ndarray:
    """Values (M,) of a joint; in front of its first and behind its last sample, those."""
    return np.asarray(np.interp(times, channel.time, channel.values[:, 0]))


def _slope(channel: Channel, times: np.ndarray) -> np.ndarray:
    """Rates (M,) of a joint between its samples; zero outside."""
    rates = np.diff(channel.values[:, 0]) / np.diff(channel.time)
    inside = (times > channel.time[0]) & (times < channel.time[-1])
    k = np.clip(np.searchsorted(channel.time, times, side="right") - 1, 0, len(rates) - 1)
    return np.where(inside, rates[k], 0.0)
