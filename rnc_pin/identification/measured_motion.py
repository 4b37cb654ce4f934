"""Motion of a whole robot from a log: configurations, velocities and efforts at common times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import scipy

from rnc_pin.errors import ConfigurationError, ConstraintError, few
from rnc_pin.identification.logs.channel import Channel
from rnc_pin.identification.logs.log import Log
from rnc_pin.identification.reduced_regressor import ReducedRegressor

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
