"""Measured motion and rows of an inertial identification, and rows of random motions: what could be measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConfigurationError, ConstraintError, few, nearest
from rnc_pin.identification.inertial_fit import InertialFit, MeasuredRow, dynamic_parameters
from rnc_pin.identification.logs.channel import Channel
from rnc_pin.identification.logs.log import Log
from rnc_pin.identification.reduced_regressor import ReducedRegressor, WindowAverages
from rnc_pin.identification.unknowns import (
    BodyInertia,
    CoulombFriction,
    DynamicUnknown,
    EffortOffset,
    EffortScale,
    MotorInertia,
    ViscousFriction,
)
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.system import NonholonomicSystem

_SMOOTHED = 9  # samples of the parabola whose slope is a rate
_GUESSES = 20  # first guesses of passive joints
_SHOWN = 1e-6  # smallest relative singular value of the measured velocities


class MeasuredMotion:
    """Samples of a log at the times of one of its channels, without those at which a measurement is missing.

    The base is where a measured frame of it is, or at the origin. Positions that the log lacks follow from holonomic
    rows, and velocities from all rows: of the base of a robot on wheels, and of the passive joints of a loop.

    Args:
        regressor: the dynamics.
        log: positions of joints; velocities, or slopes of the positions; efforts.

    Attributes:
        time: times (N,) [s].
        q: configurations (N, nq).
        v: velocities (N, nv), which satisfy the rows.
        efforts: measured efforts (N, p'), in the order of ``actuators``.
        actuators: names of actuators whose efforts are in the log.
        period: usual interval of the samples [s].

    Raises:
        ConfigurationError: the log does not show the position or the velocity of a joint or the base.
    """

    def __init__(self, regressor: ReducedRegressor, log: Log) -> None:
        system = regressor.system
        robot = system.robot
        self._log, self._robot, self._regressor = log, robot, regressor
        self.actuators = [name for name in system.actuation.names if name in log.names("effort")]
        measured = [name for name in regressor.joints if name in log.names("position")]
        if not measured:
            raise ConfigurationError("identification needs positions of joints, the log has none")
        time = log.channel("position", measured[0]).time
        positions = np.column_stack([log.channel("position", name).at(time)[:, 0] for name in measured])
        base, twist = self._base(time)
        velocities = [self._rate("velocity", name, time) for name in measured]
        columns = [robot.velocity_indices(name).start for name in measured]
        if twist is not None:
            velocities += list(twist.T)
            columns += range(*robot.velocity_indices("root_joint").indices(robot.nv))
        known = np.column_stack(velocities)
        efforts = [log.channel("effort", name).at(time)[:, 0] for name in self.actuators]
        self.efforts = np.column_stack(efforts) if efforts else np.zeros((len(time), 0))
        parts = [positions, known, self.efforts, *([] if base is None else [base])]
        whole = np.isfinite(np.hstack(parts)).all(axis=1)
        if whole.sum() < 2:
            raise ConfigurationError("the log has no two times at which all its channels are measured")
        self.time, self.efforts = time[whole], self.efforts[whole]
        self.period = float(np.median(np.diff(self.time)))
        self.q = self._configurations(measured, positions[whole], None if base is None else base[whole])
        self.v = self._velocities(columns, known[whole])

    def _rate(self, quantity: str, name: str, time: np.ndarray) -> np.ndarray:
        """Measured velocity (N,) of a joint, or the slope of its positions."""
        if name in self._log.names("velocity"):
            return self._log.channel("velocity", name).at(time)[:, 0]
        return _slopes(self._log.channel("position", name))(time)[:, 0]

    def _base(self, time: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Configuration (N, nq of the base) and twist in its own axes (N, nv of the base), if they are measured."""
        model = self._robot.model
        if model.njoints < 2 or model.names[1] != "root_joint":
            return None, None
        poses = [name for name in self._log.names("pose") if self._carries(name)]
        twists = [name for name in self._log.names("twist") if self._carries(name)]
        planar = model.joints[1].shortname() == "JointModelPlanar"
        base = twist = None
        if poses:
            place = model.frames[self._robot.frame_id(poses[0])].placement.inverse()
            channel = self._log.channel("pose", poses[0])
            base = np.full((len(time), model.joints[1].nq), np.nan)
            for k, pose in enumerate(channel.at(time)):
                if np.isfinite(pose).all():
                    base[k] = _of_base(pin.XYZQUATToSE3(pose) * place, planar)
        if twists:
            place = model.frames[self._robot.frame_id(twists[0])].placement
            twist = self._log.channel("twist", twists[0]).at(time) @ place.toActionMatrix().T
            twist = twist[:, [0, 1, 5]] if planar else twist
        return base, twist

    def _carries(self, frame: str) -> bool:
        model = self._robot.model
        return model.existFrame(frame) and model.frames[model.getFrameId(frame)].parentJoint == 1

    def _configurations(self, measured: list[str], positions: np.ndarray, base: np.ndarray | None) -> np.ndarray:
        """Configurations (N, nq); joints that are not measured follow from holonomic rows."""
        robot, model = self._robot, self._robot.model
        q = np.tile(robot.configuration(), (len(positions), 1))
        for name, values in zip(measured, positions.T, strict=True):
            robot.single_joint(name).put(q, values)
        if base is not None:
            q[:, : base.shape[1]] = base
        elif "root_joint" in model.names and np.abs(model.gravity.linear[:2]).max() > 0:
            raise ConfigurationError("gravity is not vertical: identification needs poses of a frame of the base")
        missing = [name for name in robot.joint_names if name not in measured and name != "root_joint"]
        if missing:
            entries = [self._places(name) for name in missing]
            q[0] = self._closed(q[0], measured)
            for k in range(1, len(q)):
                for where in entries:
                    q[k, where] = q[k - 1, where]
                q[k] = self._regressor.system.assembly.project(q[k], measured)
        return q

    def _places(self, name: str) -> slice:
        """Entries of q of a joint."""
        joint = self._robot.model.joints[self._robot.joint_id(name)]
        return slice(joint.idx_q, joint.idx_q + joint.nq)

    def _closed(self, q: np.ndarray, measured: list[str]) -> np.ndarray:
        """Configuration with the measured positions: the nearest one that closes loops, from several first guesses."""
        assembly, generator = self._regressor.system.assembly, np.random.default_rng(0)
        entries = [self._places(name) for name in measured]
        guess, failure = q, None
        for _ in range(_GUESSES):
            try:
                return assembly.project(guess, measured)
            except ConstraintError as error:
                failure = failure or error
            guess = assembly.random_configuration(generator)
            for where in entries:
                guess[where] = q[where]
        raise ConfigurationError(
            f"the measured positions at {self.time[0]:.3g} s do not fit the constraints: {failure}"
        )

    def _velocities(self, columns: list[int], known: np.ndarray) -> np.ndarray:
        """Velocities (N, nv) on the rows that are nearest to the measured entries (N, k)."""
        R = self._regressor.basis(self.q).R
        shown = R[:, columns]
        values = np.linalg.svd(shown, compute_uv=False)
        rank = R.shape[2]
        weakest = values[:, rank - 1] / values[:, 0] if shown.shape[1] >= rank else np.zeros(len(R))
        if np.median(weakest) < _SHOWN:
            directions = np.linalg.svd(np.median(shown, axis=0))[2][min(len(columns), rank - 1) :]
            hidden = np.abs(np.median(R, axis=0) @ directions.T).max(axis=1)
            names = [name for name, size in zip(self._robot.velocity_names, hidden, strict=True) if size > 0.1]
            raise ConfigurationError(
                f"the log does not show the velocity of {few(names)}: expected its position or velocity, or lock it"
            )
        return (R @ np.linalg.pinv(shown) @ known[..., None])[..., 0]


def _of_base(place: pin.SE3, planar: bool) -> np.ndarray:
    """Configuration of a planar or free base at a place."""
    if not planar:
        return np.asarray(pin.SE3ToXYZQUAT(place))
    return np.array([*place.translation[:2], place.rotation[0, 0], place.rotation[1, 0]])


def _slopes(channel: Channel) -> Callable[[np.ndarray], np.ndarray]:
    """Slopes of a channel at other times: of parabolas through neighbouring samples, without delay."""
    uniform = np.linspace(channel.time[0], channel.time[-1], len(channel.time))
    count = min(_SMOOTHED, len(uniform) - 1 + len(uniform) % 2)
    step = uniform[1] - uniform[0]
    values = np.nan_to_num(channel.at(uniform))
    slopes = scipy.signal.savgol_filter(values, count, min(2, count - 1), deriv=1, delta=step, axis=0)
    return Channel("velocity", channel.of, uniform, slopes).at


_LINEAR = (CoulombFriction, ViscousFriction, MotorInertia)
_WINDOW = 32  # intervals of a window by default
_GAP = 1.5  # duration of a window with a gap, relative to a usual one
_STATES = 12  # random states for each column
_POSTURES, _MOVES = 8, 6
_STILL = 1e-3  # velocity of a joint at rest, relative to the fastest


class InertialProblem:
    """Rows of the reduced dynamics and of the momentum.

    Args:
        system: the robot with its constraints and actuators.
        log: what was measured.
        window: duration over which efforts are averaged [s]; None for 32 samples.

    Attributes:
        regressor: columns of the dynamics.
        motion: the measured motion.
        efforts: measured efforts, each of which is a row of its own.
        effort_size: root mean square of the measured efforts.
        assumed: words of the quantity that has its value of the file, because no row shows the scale of all masses.

    Raises:
        ConfigurationError: the log has neither efforts nor a conserved momentum, or is shorter than a window.
    """

    def __init__(self, system: NonholonomicSystem, log: Log, window: float | None = None) -> None:
        self.system = system
        measured = [name for name in system.actuation.names if name in log.names("effort")]
        self.regressor = ReducedRegressor(system, measured)
        self.motion = MeasuredMotion(self.regressor, log)
        self._with_forces = bool(measured and self.regressor.rows)
        if not self._with_forces and not self.regressor.conserved:
            raise ConfigurationError(
                "the log has no effort of the actuators, and no momentum is conserved: no row shows an inertia"
            )
        self.efforts = tuple(self.motion.actuators) if self._with_forces and self.regressor.plain else ()
        self.effort_size = float(np.sqrt(np.mean(self.motion.efforts**2))) if self.motion.efforts.any() else 1.0
        self._length = _WINDOW if window is None else round(window / self.motion.period)
        if self._length < 4:
            raise ConfigurationError(
                f"window: expected at least 4 samples of {self.motion.period:.3g} s, found {window}"
            )
        values = [rows.rate(Kinematics(system.robot).position(self.motion.q[:1])) for rows in self.regressor.momentum]
        self.homogeneous = not self._with_forces and not any(np.any(each) for each in values)
        self.assumed = self._inertia_of_base()[0] if self.homogeneous else ""

    # ------------------------------------------------------------------ measured rows

    def blocks(self, start: float, end: float) -> list[MeasuredRow]:
        """Measured rows between two times."""
        inside = np.flatnonzero((self.motion.time >= start) & (self.motion.time <= end))
        time, q, v = self.motion.time[inside], self.motion.q[inside], self.motion.v[inside]
        found: list[MeasuredRow] = []
        if self._with_forces:
            found += self._effort_blocks(time, q, v, self.motion.efforts[inside])
        if self.regressor.conserved and len(time):
            columns, values = self.regressor.momenta(q, v)
            names = [name for rows in self.regressor.momentum for name in rows.names]
            found += [MeasuredRow(name, columns[:, k], values[:, k]) for k, name in enumerate(names)]
        if self.homogeneous and found:
            name, row = self._inertia_of_base()
            value = row @ self.regressor.nominal()
            found.append(MeasuredRow(name, row[None], np.array([value]), deviation=1e-6 * abs(value), fixed=True))
        return found

    def _effort_blocks(self, time: np.ndarray, q: np.ndarray, v: np.ndarray, efforts: np.ndarray) -> list[MeasuredRow]:
        regressor, length = self.regressor, self._length
        starts = np.arange(0, len(time) - length, max(length // 2, 1))
        starts = starts[time[starts + length] - time[starts] < _GAP * length * self.motion.period]
        if not len(starts):
            return []
        windows = WindowAverages(time, starts, length)
        columns = regressor.weak(q, v, windows)
        at = Kinematics(self.system.robot).position(q)
        R = regressor.basis(q).R[..., regressor.rows]
        own = [self.system.actuation.names.index(name) for name in self.motion.actuators]
        if regressor.plain:
            names, order = regressor.outputs, self.motion.actuators
            inputs = np.zeros((len(time), len(names)))
            for k, name in enumerate(names):
                if name:
                    inputs[:, k] = efforts[:, order.index(name)]
        else:
            names = [f"force along {self.system.robot.velocity_names[regressor.entries[k]]}" for k in regressor.rows]
            inputs = (R.mT @ (self.system.actuation.matrix(at)[..., own] @ efforts[..., None]))[..., 0]
        if self.system.forces:
            passive = self.system.forces.sums(at.with_velocity(v)).total
            inputs = inputs + (R.mT @ passive[..., None])[..., 0]
        values = windows.mean(inputs)
        names = [
            name or f"force along {self.system.robot.velocity_names[regressor.entries[k]]}"
            for name, k in zip(names, regressor.rows, strict=True)
        ]
        return [MeasuredRow(name, columns[:, k], values[:, k]) for k, name in enumerate(names)]

    def _inertia_of_base(self) -> tuple[str, np.ndarray]:
        """Words and columns (width,) of the first inertia that the conserved momentum contains."""
        first = self.regressor.conserved[0]
        v = np.eye(self.system.n)[first]
        q = self.system.robot.configuration()
        unit = self.system.robot.velocity_units[first]
        joint = self.regressor.momentum[0].names[0]
        words = "mass of the robot" if unit == "m/s" else "inertia of the robot in its zero position"
        return f"{words} of {joint}", self.regressor.momenta(q[None], v[None])[0][0, 0]

    # ------------------------------------------------------------------ rows of random motions

    def structure(self, generator: np.random.Generator) -> np.ndarray:
        """Columns (N, width) of the same rows at random motions."""
        count = 1 + _STATES * self.regressor.width // max(len(self.regressor.rows) + len(self.regressor.conserved), 1)
        q = self.regressor.random_configurations(count, generator)
        r = len(self.regressor.entries)
        rows = self._rows(q, generator.normal(size=(count, r)), generator.normal(size=(count, r)))
        return np.vstack([*rows, *([self._inertia_of_base()[1][None]] if self.homogeneous else [])])

    def movers(self, combination: np.ndarray, generator: np.random.Generator) -> list[tuple[str, float]]:
        """Entries of v with the change of rows that their motion shows for a combination (width,), largest first.

        Other joints start from positions of the log, and move if they move in it.
        """
        robot, found = self.system.robot, []
        rates_of_log = np.abs(self.motion.v[:, self.regressor.entries]).max(axis=0)
        moving = rates_of_log > _STILL * rates_of_log.max()
        postures = self.motion.q[:: max(len(self.motion.q) // _POSTURES, 1)]
        for k, entry in enumerate(self.regressor.entries):
            if entry in self.regressor.conserved:
                continue
            along = np.eye(len(self.regressor.entries))[k]
            total = 0.0
            for q in postures:
                moved = []
                for step in generator.uniform(-0.7, 0.7, _MOVES):
                    moved.append(pin.integrate(robot.model, q, self.regressor.basis(q[None]).R[0] @ along * step))
                rates = generator.normal(size=(2, _MOVES, len(along))) * (moving | (along > 0))
                for rows in self._rows(np.array(moved), *rates):
                    seen = (rows @ combination).reshape(_MOVES, -1)
                    total += float(np.sum((seen - seen.mean(axis=0)) ** 2))
            found.append((robot.velocity_names[entry], np.sqrt(total)))
        return sorted(found, key=lambda each: -each[1])

    def _rows(self, q: np.ndarray, rates: np.ndarray, accelerations: np.ndarray) -> list[np.ndarray]:
        """Columns of the rows at configurations, reduced velocities and accelerations (N, r)."""
        v = (self.regressor.basis(q).R @ rates[..., None])[..., 0]
        R, R_dot = self.regressor.basis(q, v)
        found = []
        if self._with_forces:
            v_dot = (R @ accelerations[..., None] + R_dot @ rates[..., None])[..., 0]
            found.append(self.regressor.forces(q, v, v_dot))
        if self.regressor.conserved:
            found.append(self.regressor.momenta(q, v)[0])
        return [each.reshape(-1, self.regressor.width) for each in found]


def column_names(regressor: ReducedRegressor, inertial: Sequence[str]) -> list[str]:
    """Names of the columns of a regressor.

    Args:
        regressor: the regressor.
        inertial: names of the ten parameters of a body.
    """
    bodies = [f"{each} of {name}" for name in regressor.bodies for each in inertial]
    kinds = ("Coulomb friction", "viscous friction", "motor inertia")
    return [*bodies, *(f"{kind} of {name}" for kind in kinds for name in regressor.joints)]


class AskedParameters:
    """Unknowns of an identification, and where they stand.

    Attributes:
        bodies: joints of the unknown inertias.
        friction: joints whose friction or motor inertia is unknown.
        columns: columns of the regressor that belong to unknowns.
        names: names of the scales and offsets.
        begin: index of the first of them among the unknowns.
    """

    def __init__(self, problem: InertialProblem, unknown: Sequence[DynamicUnknown] | None) -> None:
        self._problem, regressor = problem, problem.regressor
        model = problem.system.robot.model
        if unknown is None:
            massive = [name for name in regressor.bodies if model.inertias[model.getJointId(name)].mass > 0]
            driven = [name for name in problem.efforts if name in regressor.joints]
            unknown = [BodyInertia(name) for name in massive]
            unknown += [kind(name) for name in driven for kind in (CoulombFriction, ViscousFriction)]
        if not unknown:
            raise ConfigurationError("name at least one unknown parameter")
        if len({each.name for each in unknown}) < len(unknown):
            raise ConfigurationError("an unknown parameter is named twice")
        self.bodies = [each.joint for each in unknown if isinstance(each, BodyInertia)]
        _check(self.bodies, regressor.bodies, "body behind joint")
        for name in self.bodies:
            if not model.inertias[model.getJointId(name)].mass > 0:
                raise ConfigurationError(f"the body behind joint '{name}' has no mass in the file to start from")
        linear = [each for each in unknown if isinstance(each, _LINEAR)]
        _check([each.joint for each in linear], regressor.joints, "joint")
        first, size = 10 * len(regressor.bodies), len(regressor.joints)
        self._first = [10 * regressor.bodies.index(name) for name in self.bodies]
        self._linear = [
            first + size * _LINEAR.index(type(each)) + regressor.joints.index(each.joint) for each in linear
        ]
        self.friction = list(dict.fromkeys(each.joint for each in linear))
        self.columns = [k for start in self._first for k in range(start, start + 10)] + self._linear
        of_effort = [each for each in unknown if isinstance(each, EffortScale | EffortOffset)]
        _check([each.joint for each in of_effort], problem.efforts, "measured effort of joint")
        self._of_effort = sorted(of_effort, key=lambda each: isinstance(each, EffortOffset))
        self.names = tuple(each.name for each in self._of_effort)
        self.begin = len(self.columns)
        self._is_scale = np.array([isinstance(each, EffortScale) for each in self._of_effort], dtype=float)
        self.first_values = self._is_scale

    def bind(self, blocks: Sequence[MeasuredRow]) -> None:
        """Tell rows which scale and offset is theirs."""
        for index, each in enumerate(self._of_effort):
            for block in blocks:
                if block.name == each.joint:
                    setattr(block, "scale" if isinstance(each, EffortScale) else "offset", self.begin + index)

    def fit(self, blocks: list[MeasuredRow], prior: float | None) -> InertialFit:
        """Least squares from the values of the file; scales begin with their values for the file's inertias."""
        self.bind(blocks)
        model, known = self._problem.system.robot.model, self._problem.regressor.nominal()
        for name, first in zip(self.bodies, self._first, strict=True):
            known[first : first + 10] = dynamic_parameters(model.inertias[model.getJointId(name)])
        scales = self._first_scales(blocks, known)
        rest = np.concatenate([self._first_linear(blocks, known), scales])
        signs = np.concatenate([np.ones(len(self._linear)), np.sign(scales) * self._is_scale])
        return InertialFit(blocks, known, self.columns, len(self.bodies), rest, signs, prior)

    def _first_linear(self, blocks: Sequence[MeasuredRow], known: np.ndarray) -> np.ndarray:
        """Friction and motor inertia of the file; where it has none, values that act a tenth as much as the bodies."""
        bodies = slice(0, 10 * len(self._problem.regressor.bodies))
        values = known[self._linear]
        for k, column in enumerate(self._linear):
            acts = [(np.std(block.D[:, bodies] @ known[bodies]), np.std(block.D[:, column])) for block in blocks]
            if values[k] <= 0:
                values[k] = max((0.1 * body / own for body, own in acts if own > 0 and body > 0), default=1.0)
        return values

    def _first_scales(self, blocks: Sequence[MeasuredRow], known: np.ndarray) -> np.ndarray:
        """Scales and offsets that explain the efforts by the file's inertias and by friction, which has a sign."""
        values, size = self.first_values.copy(), 10 * len(self._problem.regressor.bodies)
        for block in blocks:
            if block.scale is None:
                continue
            model = block.D[:, :size] @ known[:size]
            dissipation = [k for k in self._linear if k < size + 2 * len(self._problem.regressor.joints)]
            rest = block.D[:, [k for k in dissipation if block.D[:, k].any()]]
            found = np.linalg.lstsq(np.column_stack([model, rest, np.ones(len(model))]), block.y, rcond=None)[0]
            power = float(np.sum(np.std(rest, axis=0) * found[1 : 1 + rest.shape[1]])) or found[0]
            least = 1e-3 * np.std(block.y) / max(np.std(model), 1e-300)
            values[block.scale - self.begin] = np.sign(power) * max(found[0] * np.sign(power), least)
        return values


def _check(given: Sequence[str], valid: Sequence[str], what: str) -> None:
    for name in given:
        if name not in valid:
            raise ConfigurationError(f"unknown {what} '{name}'{nearest(name, valid)}")
