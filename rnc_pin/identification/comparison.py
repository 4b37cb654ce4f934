"""A measured log beside the open-loop path of a model: errors, slip, and the assumption that fails."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.identification.calibration import PathError, PoseProblem
from rnc_pin.identification.logs.log import Log
from rnc_pin.identification.rolling_motion import RollingMotion
from rnc_pin.identification.suspects import NO_TIMES, Suspect, pursued
from rnc_pin.identification.window_fit import rotated
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin

_WINDOWS = (1.0, 10.0, 100.0)  # durations of windows whose errors are stated [s]
_SLIP = 1.0  # duration over which slip is averaged [s]
_ROUNDING = 1e-12  # slip of rows that hold in any case [m/s]
_FAR = 6.0  # standard deviations of the slip beyond which a wheel slips
_TRACE = 0.02  # smallest slip that counts, relative to the speed of the log
_NORMAL = 1.4826  # standard deviation over the median of |x|
_MOST_KNOWN = 0.5  # share of the error by numbers above which they are the whole truth


@dataclass(frozen=True)
class Replay:
    """Measured and predicted motion at the same times.

    Example:
        >>> path = np.zeros((2, 3))
        >>> rnc.identification.Replay(np.arange(2.0), path, path + 1.0, path[:, :0], {}).error
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
        >>> rnc.compare(wrong, log, "base").suspects[0].name
        'radius of left_wheel, right_wheel'
    """

    errors: Mapping[float, PathError]
    """Error of the open-loop path by the duration of its windows [s]; infinity for the whole log."""
    slip: Mapping[str, float]
    """Root mean square slip of each row over one second, at the measured motion of the base [m/s].

    A row that a joint without measurement satisfies in any case is left out, e.g. rolling of such a wheel.
    """
    suspects: tuple[Suspect, ...]
    """Numbers that explain the error, the most suspicious first."""
    unused_rows: tuple[str, ...]
    """Rows that depend on joints which the log does not have."""
    replay: Replay = field(repr=False)
    """Measured and predicted motion."""

    @property
    def first(self) -> Suspect | None:
        """Suspect that fails first; None if the error is noise."""
        return next(iter(self.suspects), None)

    @property
    def conclusion(self) -> str:
        """Sentence about the assumption that fails first."""
        if not self.suspects:
            return "no number of the model explains the error: it is noise of the sensor"
        first, *others = self.suspects
        text = f"the {first.name} fails first: {first.explained:.0%} of the squared error of the path"
        if not others:
            return text
        return f"{text}, and {others[-1].explained:.0%} with {', '.join(each.name for each in others)}"

    def _summary(self) -> ObjectSummary:
        lines = [
            ("whole log" if np.isinf(duration) else f"windows of {duration:g} s", [Item(str(error))])
            for duration, error in self.errors.items()
        ]
        lines += [("slip", [Item(name, f"{size:.2g} m/s") for name, size in self.slip.items()])]
        lines += [
            ("suspect", [Item(f"{each.name}: {each.value:.6g} {each.unit}".strip(),
                              f"model {each.nominal:.6g}, explains {each.explained:.0%}")])
            for each in self.suspects
        ]  # fmt: skip
        lines += [("unused rows", [Item(name) for name in self.unused_rows])] if self.unused_rows else []
        return ObjectSummary(f"Comparison: {self.conclusion}", lines)


def compare(
    system: NonholonomicSystem, log: Log, sensor: str, *, heading: bool = True, speeds: bool = False
) -> Comparison:
    """Compare a log with the path that measured joints give in a model of a rolling robot.

    Numbers of the model are changed one after the other. Each time, the number is chosen that explains most of the
    remaining squared error, and all that were chosen before are fitted again with it. The order is that of evidence:
    numbers with the same effect, such as a radius and the scale of its encoder, cannot be told apart. Slip in a few
    windows is a suspect too.

    Args:
        system: the robot on a planar base, with its constraints.
        log: positions of joints and poses of the sensor.
        sensor: frame on the base whose pose is measured.
        heading: True if the sensor measures the heading.
        speeds: True to replay measured velocities of wheels instead of their positions.

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
    if speeds:
        log = _by_speeds(log, plain)
        plain = RollingMotion(system, log, (), sensor)
    problem = PoseProblem(plain, channel, heading)
    durations = [each for each in _WINDOWS if each < np.ptp(problem.times)]
    errors = {}
    for duration in (*durations, np.inf):
        chosen = problem.windows(-np.inf, np.inf, duration)
        if chosen.count:
            errors[duration] = problem.error(problem.nominal, chosen)
    if not errors:
        raise ConfigurationError(f"the log has no poses of '{sensor}' while its joints are measured")
    times, slips = _slip(plain, problem)
    sizes = {name: float(np.sqrt(np.mean(each**2))) for name, each in slips.items()}
    return Comparison(
        errors,
        {name: size for name, size in sizes.items() if not size < _ROUNDING},
        _suspects(system, log, sensor, heading),
        plain.unused,
        _replay(plain, problem, {name: (times, each) for name, each in slips.items()}),
    )


def _by_speeds(log: Log, motion: RollingMotion) -> Log:
    """The log without positions of joints that have velocities, unless rows depend on these positions."""
    rolling = set(log.names("velocity")) - set(motion.shape_joints)
    return Log(each for each in log if not (each.quantity == "position" and each.of in rolling))


def _suspects(system: NonholonomicSystem, log: Log, sensor: str, heading: bool) -> tuple[Suspect, ...]:
    """Numbers and slip that explain the error of the path.

    Slip is not constant: it shows as windows whose slip is far from that of most windows, with the best numbers. These
    windows are left out, and the numbers are looked for again.
    """
    numbers = pursued(system, log, sensor, heading, NO_TIMES)
    share = numbers.suspects[-1].explained if numbers.suspects else 0.0
    slipped = _slipped(numbers.system, numbers.log, sensor, heading)
    if slipped is None and share < _MOST_KNOWN:
        slipped = _slipped(system, log, sensor, heading)
    if slipped is None or not numbers.before:
        return numbers.suspects
    name, speed, times = slipped
    rest = pursued(system, log, sensor, heading, times, numbers.deviations)
    explained = 1.0 - rest.before / numbers.before
    if explained <= 0:
        return numbers.suspects
    slip = Suspect(f"slip of {name}", "m/s", 0.0, speed, explained)

    if numbers.suspects and numbers.suspects[0].explained > explained:
        both = 1.0 - rest.after / numbers.before
        return (*numbers.suspects, replace(slip, explained=max(both, share)))
    # The others explain a part of what the windows without slip leave.
    left = [replace(each, explained=1.0 - (1.0 - explained) * (1.0 - each.explained)) for each in rest.suspects]
    return (slip, *left)


def _slipped(system: NonholonomicSystem, log: Log, sensor: str, heading: bool) -> tuple[str, float, np.ndarray] | None:
    """Row that slips most, its largest slip [m/s], and the intervals (K, 2) in which a row slips; None without slip."""
    motion = RollingMotion(system, log, (), sensor)
    problem = PoseProblem(motion, log.channel("pose", sensor), heading)
    times, slips = _slip(motion, problem)
    if not len(times):
        return None
    path = problem.base_poses(motion.time)
    length = np.nansum(np.hypot(*np.diff(path[:, :2], axis=0).T))
    floor = _TRACE * length / np.ptp(motion.time)
    found, worst = np.zeros(len(times), dtype=bool), ("", 0.0)
    for name, values in slips.items():
        away = np.abs(values - np.median(values))
        far = away > np.maximum(_FAR * _NORMAL * np.median(away), floor)
        found |= far
        size = float(away[far].max(initial=0.0))
        worst = max(worst, (name, size), key=lambda each: each[1])
    if not found.any() or found.mean() > 0.5:
        return None
    middle = times[found]
    return *worst, np.column_stack([middle - _SLIP, middle + _SLIP])


def _replay(motion: RollingMotion, problem: PoseProblem, slip: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Replay:
    """Both paths, the predicted one from the first pose that fits best."""
    chosen = problem.windows(-np.inf, np.inf, np.inf)
    times = problem.times[chosen.samples]
    fit = problem.fit(chosen).at(problem.nominal)
    measured = problem.base_poses(times)
    # Sensor and base are one body: the predicted sensor is that of the fit.
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
    number = np.floor((time - time[0]) / _SLIP).astype(int)
    count = np.bincount(number[whole], minlength=number[-1] + 1)
    period = float(np.median(np.diff(motion.time)))
    full = count > 0.8 * _SLIP / period
    if not full.any():
        return np.zeros(0), {}
    durations = count[full] * period
    middle = time[0] + (np.flatnonzero(full) + 0.5) * _SLIP
    return middle, {
        name: np.bincount(number[whole], column[whole], minlength=len(count))[full] / durations
        for name, column in zip(motion.used, slipped.T, strict=True)
    }
