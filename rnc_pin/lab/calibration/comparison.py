"""A measured log beside the open-loop path of a model: errors and slip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.lab.calibration.calibration import PathError, PoseProblem
from rnc_pin.lab.calibration.rolling_motion import RollingMotion
from rnc_pin.lab.calibration.window_fit import rotated
from rnc_pin.lab.logs.log import Log
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin


@dataclass(frozen=True)
class Replay:
    """Measured and predicted motion at the same times.

    Example:
        >>> path = np.zeros((2, 3))
        >>> rnc.calibration.Replay(np.arange(2.0), path, path + 1.0, path[:, :0], {}).error
        array([1.41421356, 1.41421356])
    """

    time: np.ndarray
    """Times (M,) of the measured poses [s]."""
    measured: np.ndarray
    """Measured poses (M, 3) of the base: x, y [m] and heading [rad]."""
    predicted: np.ndarray
    """Poses (M, 3) that the measured joints give, from the best first pose."""
    q: np.ndarray
    """Predicted configurations (M, nq), whose base moves as ``predicted``."""
    slip: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """Times (W,) [s] and mean slip (W,) [m/s] of each row over windows of one second."""

    @property
    def error(self) -> np.ndarray:
        """Distance of both positions (M,) [m]."""
        return np.asarray(np.hypot(*(self.measured - self.predicted)[:, :2].T))


@dataclass(frozen=True, repr=False)
class Comparison(SummaryMixin):
    """Measured log beside a model.

    Example:
        >>> robot, pair = rnc.Robot.from_urdf("differential_drive.urdf", base="planar"), ["left_wheel", "right_wheel"]
        >>> true = rnc.NonholonomicSystem(robot, [rnc.RollingWheel(wheel, 0.1) for wheel in pair])
        >>> reduced = true.reduce([rnc.JointPosition(f"{wheel}_joint") for wheel in pair])
        >>> turns = rnc.planning.Harmonic([0.0, 0.0], amplitude=[20.0, 25.0], frequency=[0.05, 0.08])
        >>> target = rnc.control.ReducingOutputController(reduced, turns)
        >>> time, q = rnc.kinematic_rollout(reduced, target, robot.configuration(), duration=20.0)
        >>> log = rnc.Log.of_motion(robot, time, q, frames=["base"])
        >>> wrong = rnc.NonholonomicSystem(robot, [rnc.RollingWheel(wheel, 0.12) for wheel in pair])
        >>> list(rnc.compare(wrong, log, "base").slip)
        ['rolling(left_wheel)', 'rolling(right_wheel)']
    """

    errors: Mapping[float, PathError]
    """Error of the open-loop path by the duration of its windows [s]; infinity for the whole log."""
    slip: Mapping[str, float]
    """Root mean square slip of each row over one second, at the measured motion of the base [m/s].

    A row that a joint without measurement satisfies in any case is left out, e.g. rolling of such a wheel.
    """
    unused_rows: tuple[str, ...]
    """Rows that depend on joints which the log does not have."""
    replay: Replay = field(repr=False)
    """Measured and predicted motion."""

    def _summary(self) -> ObjectSummary:
        lines = [
            ("whole log" if np.isinf(duration) else f"windows of {duration:g} s", [Item(str(error))])
            for duration, error in self.errors.items()
        ]
        lines += [("slip", [Item(name, f"{size:.2g} m/s") for name, size in self.slip.items()])]
        lines += [("unused rows", [Item(name) for name in self.unused_rows])] if self.unused_rows else []
        return ObjectSummary("Comparison", lines)


def compare(system: NonholonomicSystem, log: Log, sensor: str, *, heading: bool = True) -> Comparison:
    """Compare a log with the path that measured joints give in a model of a rolling robot.

    Args:
        system: the robot on a planar base, with its constraints.
        log: positions of joints and poses of the sensor.
        sensor: frame on the base whose pose is measured.
        heading: True if the sensor measures the heading.

    Raises:
        ConfigurationError: a name is unknown, or the log does not determine the motion of the base.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("left_wheel", 0.1), rnc.NoSideSlip("base")])
        >>> still = rnc.Log.of_motion(robot, np.arange(9.0), np.tile(robot.configuration(), (9, 1)), frames=["base"])
        >>> try:
        ...     rnc.compare(system, still, "bas")
        ... except rnc.ConfigurationError as error:
        ...     print(error)
        the log has no pose(bas); did you mean 'pose(base)'?
    """
    channel = log.channel("pose", sensor)
    plain = RollingMotion(system, log, (), sensor)
    problem = PoseProblem(plain, channel, heading)
    stated = (1.0, 10.0, 100.0)  # durations of windows whose errors are stated [s]
    durations = [each for each in stated if each < np.ptp(problem.times)]
    errors = {}
    for duration in (*durations, np.inf):
        chosen = problem.windows(-np.inf, np.inf, duration)
        if chosen.count:
            errors[duration] = problem.error(problem.nominal, chosen)
    if not errors:
        raise ConfigurationError(f"the log has no poses of '{sensor}' while its joints are measured")
    times, slips = _slip(plain, problem)
    sizes = {name: float(np.sqrt(np.mean(each**2))) for name, each in slips.items()}
    rounding = 1e-12  # slip of rows that hold in any case [m/s]
    return Comparison(
        errors,
        {name: size for name, size in sizes.items() if not size < rounding},
        plain.unused,
        _replay(plain, problem, {name: (times, each) for name, each in slips.items()}),
    )


def _replay(motion: RollingMotion, problem: PoseProblem, slip: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Replay:
    """Both paths, the predicted one from the first pose that fits best."""
    chosen = problem.windows(-np.inf, np.inf, np.inf)
    times = problem.times[chosen.samples]
    fit = problem.fit(chosen).at(problem.nominal)
    measured = problem.base_poses(times)
    # Sensor and base are one body: the fit predicts the sensor.
    heading = measured[:, 2] + fit.residuals[:, 2]
    sensor = problem.measured[chosen.samples, :2] + fit.residuals[:, :2]
    arm = rotated(heading, np.broadcast_to(motion.mount[:2], (len(times), 2)))
    predicted = np.column_stack([sensor - arm, heading])
    q = motion.with_base(motion.configurations(times), predicted)
    return Replay(times, measured, predicted, q, slip)


def _slip(motion: RollingMotion, problem: PoseProblem) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (W,) and mean slip (W,) of the rows over windows of a second [m/s]."""
    time, slipped = motion.slip(problem.base_poses(motion.time))
    whole = np.isfinite(slipped).all(axis=1)
    window = 1.0  # duration over which slip is averaged [s]
    number = np.floor((time - time[0]) / window).astype(int)
    count = np.bincount(number[whole], minlength=number[-1] + 1)
    period = float(np.median(np.diff(motion.time)))
    # Windows with gaps of the log say little: a fifth of the samples may be missing.
    full = count > 0.8 * window / period
    if not full.any():
        return np.zeros(0), {}
    durations = count[full] * period
    middle = time[0] + (np.flatnonzero(full) + 0.5) * window
    return middle, {
        name: np.bincount(number[whole], column[whole], minlength=len(count))[full] / durations
        for name, column in zip(motion.used, slipped.T, strict=True)
    }
