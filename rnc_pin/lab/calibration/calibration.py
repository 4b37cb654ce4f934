"""Kinematic calibration of a rolling robot from a log: batch least squares of its open-loop path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, InfeasibleError
from rnc_pin.lab.calibration.rolling_motion import RollingMotion
from rnc_pin.lab.calibration.unknowns import SensorPlace, Unknown, UnknownNumber, corrections_of, radii_of, with_radius
from rnc_pin.lab.calibration.window_fit import Fit, WindowFit, Windows, correlation_of, joined, plane
from rnc_pin.lab.logs import Channel, Correction, Log
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.printing import Item, Line, ObjectSummary, SummaryMixin, items

_FEWEST = 4  # samples of a window


@dataclass(frozen=True)
class PathError:
    """Distance of an open-loop path from the measured one, after the best first pose.

    Example:
        >>> rnc.calibration.PathError(mean=0.1, rms=0.12, largest=0.3, heading=0.02, samples=100).mean
        0.1
    """

    mean: float
    """Mean distance [m]."""
    rms: float
    """Root mean square distance [m]."""
    largest: float
    """Largest distance [m]."""
    heading: float
    """Root mean square error of the heading [rad]; zero if it is not measured."""
    samples: int
    """Number of measured poses."""

    def __str__(self) -> str:
        return f"mean {self.mean:.3g} m, largest {self.largest:.3g} m, heading {self.heading:.3g} rad"


@dataclass(frozen=True, repr=False)
class Calibration(SummaryMixin):
    """Estimated parameters of a robot, with their covariance, and what the log says about them.

    Example:
        >>> robot, pair = rnc.Robot.from_urdf("differential_drive.urdf", base="planar"), ["left_wheel", "right_wheel"]
        >>> true = rnc.NonholonomicSystem(robot, [rnc.RollingWheel(wheel, 0.1) for wheel in pair])
        >>> reduced = true.reduce([rnc.JointPosition(f"{wheel}_joint") for wheel in pair])
        >>> turns = rnc.planning.MinimumJerk([0.0, 0.0], [40.0, 60.0], duration=10.0)
        >>> target = rnc.control.ReducingOutputController(reduced, turns)
        >>> time, q = rnc.kinematic_rollout(reduced, target, robot.configuration(), duration=10.0)
        >>> log = rnc.Log.of_motion(robot, time, q, frames=["base"])
        >>> file = rnc.NonholonomicSystem(robot, [rnc.RollingWheel(wheel, 0.12) for wheel in pair])
        >>> found = rnc.calibrate(file, log, [rnc.calibration.WheelRadius(pair)], "base")
        >>> found.values.round(4)
        array([0.1])
    """

    names: tuple[str, ...]
    """Names of the parameters, (P,)."""
    nominal: np.ndarray
    """Their values in the robot's file, (P,)."""
    values: np.ndarray
    """Estimates (P,)."""
    covariance: np.ndarray
    """Covariance of the estimates (P, P), for errors as long correlated as the residuals are."""
    units: tuple[str, ...]
    """Units of the parameters, (P,)."""
    combinations: tuple[tuple[str, float], ...]
    """Combinations of scaled parameters, the worst known first, with their standard deviations."""
    errors: Mapping[str, PathError]
    """Errors of the whole open-loop path by name: "nominal", "fit", and of the part that was held out."""
    outliers: np.ndarray
    """Times in seconds of measured poses that are more than five standard deviations away."""
    deviations: np.ndarray
    """Standard deviations of the measured position [m] and heading [rad]."""
    correlation: float
    """Number of samples over which residuals are correlated; 1 for white noise."""
    sensor: str
    """Frame whose pose was measured."""
    unused_rows: tuple[str, ...]
    """Rows that depend on joints which the log does not have."""
    system: NonholonomicSystem
    """The robot and its constraints with the estimates."""
    corrections: Mapping[str, Correction]
    """Corrections of encoders and clocks by joint or frame, for ``Log.corrected`` and mapping files."""

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the estimates (P,)."""
        return np.sqrt(np.diag(self.covariance))

    def _summary(self) -> ObjectSummary:
        every = zip(self.names, self.units, self.values, self.std, self.nominal, strict=True)
        lines: list[Line] = [
            (name, [Item(f"{value:.6g} {unit}".strip(), f"std {std:.2g}, file {nominal:.6g}")])
            for name, unit, value, std, nominal in every
        ]
        lines += [(f"path, {name}", [Item(str(error))]) for name, error in self.errors.items()]
        words, deviation = self.combinations[0]
        lines += [("worst known", [Item(words, f"std {deviation:.2g}")])]
        lines += [("outliers", [Item(f"{len(self.outliers)} poses")] if len(self.outliers) else [])]
        lines += [("unused rows", items(self.unused_rows))]
        return ObjectSummary("Calibration", [line for line in lines if line[1]])


def calibrate(
    system: NonholonomicSystem,
    log: Log,
    unknown: Sequence[Unknown],
    sensor: str,
    *,
    held_out: float = 0.0,
    heading: bool = True,
    resolution: float = 0.1,
) -> Calibration:
    """Estimate kinematic parameters from measured joints and measured poses of a frame on the base.

    The rows of the system turn measured joints into the path of the base. The sum of squared distances from the
    measured poses is minimized by Gauss-Newton steps with exact derivatives. It is taken over windows of time, each
    with a free first pose, so the fixed frame of the poses does not matter. Short windows come first, since their
    paths depend on parameters almost linearly; the last window is the whole log. Poses far away count less (Huber).

    Assumptions: the ground is level, wheels do not slip, and all rows count alike where there are more than necessary.

    Args:
        system: the robot on a planar base, with its constraints.
        log: positions of joints and poses of the sensor.
        unknown: the parameters.
        sensor: frame on the base whose pose is measured.
        held_out: share of the log at its end that is not used, but whose error is stated.
        heading: True if the sensor measures the heading.
        resolution: largest accepted standard deviation of a combination of parameters, relative to their sizes.

    Raises:
        ConfigurationError: a name is unknown, or an option is out of range.
        InfeasibleError: the log does not determine a combination of parameters, which the message names.

    Returns:
        Estimates with their covariance, and the robot that has them.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> wheels = [rnc.RollingWheel("left_wheel", 0.2), rnc.RollingWheel("right_wheel", 0.2)]
        >>> system = rnc.NonholonomicSystem(robot, wheels)
        >>> still = rnc.Log.of_motion(robot, np.arange(9.0), np.tile(robot.configuration(), (9, 1)), frames=["base"])
        >>> try:
        ...     rnc.calibrate(system, still, [rnc.calibration.WheelRadius("left_wheel")], "base")
        ... except rnc.InfeasibleError as error:
        ...     print(error)
        the log does not determine the radius of left_wheel
    """
    if not unknown:
        raise ConfigurationError("name at least one unknown parameter")
    if not 0 <= held_out <= 0.9:
        raise ConfigurationError(f"held_out: expected a share of 0 to 0.9, found {held_out}")
    motion = RollingMotion(system, log, unknown, sensor)
    problem = PoseProblem(motion, log.channel("pose", sensor), heading)
    end = problem.times[0] + (1 - held_out) * np.ptp(problem.times)
    shares = np.array([0.01, 0.1])  # of the log's duration: windows that are fitted before the whole log
    durations = [*(np.ptp(problem.times) * shares), np.inf]
    p = problem.nominal
    first, last = 1.0, 0.03  # precision of the first windows and of the last ones, in standard deviations
    loose = 0.1  # standard deviation of the parameters of the file in short windows, relative to their sizes
    for duration in durations:
        chosen = problem.windows(problem.times[0], end, duration)
        if chosen.count:
            # Short windows hardly show some combinations: the first parameters count there, not in the last windows.
            precision, prior = (last, np.inf) if np.isinf(duration) else (first, loose)
            p, fit, converged = problem.fit(chosen).minimized(p, problem.scales, problem.is_valid, precision, prior)
    if not chosen.count:
        raise ConfigurationError(f"the log has fewer than {_FEWEST} poses of '{sensor}' while its joints are measured")
    if not converged:
        raise InfeasibleError("the calibration did not converge: give fewer parameters")
    # Errors of a path are correlated: as white noise, they would count more poses than are independent.
    correlation = correlation_of(fit)
    # An estimate that is larger than its typical size is known relative to itself.
    scales = np.maximum(problem.scales, np.abs(p))
    covariance, combinations = _precision(fit, motion.parameters, scales, correlation, resolution)
    errors = {
        "nominal": problem.error(problem.nominal, problem.windows(problem.times[0], np.inf, np.inf)),
        "fit": problem.error(p, chosen),
    }
    if held_out:
        # From the next sample on: no pose is in both parts.
        rest = problem.windows(np.nextafter(end, np.inf), np.inf, np.inf)
        errors |= {"held out": problem.error(p, rest), "held out, nominal": problem.error(problem.nominal, rest)}
    outlying = 5.0  # standard deviations of an outlier
    far = (np.stack(fit.sizes, axis=1) > outlying * fit.deviations).any(axis=1)
    return Calibration(
        tuple(each.name for each in motion.parameters),
        problem.nominal,
        p,
        covariance,
        tuple(each.unit for each in motion.parameters),
        combinations,
        errors,
        problem.times[chosen.samples[far]],
        fit.deviations,
        correlation,
        sensor,
        motion.unused,
        calibrated(system, motion.parameters, p, sensor),
        corrections_of(motion.parameters, p, sensor),
    )


class PoseProblem:
    """Measured poses beside the poses of a rolling motion."""

    def __init__(self, motion: RollingMotion, channel: Channel, heading: bool) -> None:
        """Keep the poses that were measured while the joints were.

        Args:
            motion: motion of the base.
            channel: poses of the sensor.
            heading: True if the sensor measures the heading.
        """
        self.motion, self._heading = motion, heading
        # Outside the joints' log there is no prediction.
        inside = (channel.time >= motion.time[0]) & (channel.time <= motion.time[-1])
        self.times, poses = channel.time[inside], channel.values[inside]
        x, y, z, w = poses[:, 3:].T
        # Without jumps of 2 pi, so that headings are compared as numbers and are linear between samples.
        yaw = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2)))
        self.measured = np.column_stack([poses[:, :2], yaw])
        self.nominal = motion.nominal
        self.scales = np.array([each.scale for each in motion.parameters])

    def is_valid(self, p: np.ndarray) -> bool:
        """True if radii are positive, and all numbers are finite.

        Args:
            p: parameters (P,).
        """
        radii = [value for value, each in zip(p, self.motion.parameters, strict=True) if each.wheels]
        return bool(np.isfinite(p).all() and all(radius > 0 for radius in radii))

    def windows(self, start: float, end: float, duration: float) -> Windows:
        """Windows of a duration between two times; none contains a break of the joints' log.

        Args:
            start, end: times [s].
            duration: duration of each window [s]; infinity for one window from break to break.
        """
        chosen = np.flatnonzero((self.times >= start) & (self.times <= end))
        times = self.times[chosen]
        piece = np.searchsorted(self.motion.breaks, times, side="right")
        if np.isfinite(duration):
            # It grows with time: no two windows share a number.
            piece = piece * (len(times) + 1) + np.floor((times - times[:1]) / duration).astype(int)
        _, number, counts = np.unique(piece, return_inverse=True, return_counts=True)
        large = counts[number] >= _FEWEST
        return Windows(chosen[large], np.unique(number[large], return_inverse=True)[1])

    def fit(self, windows: Windows) -> WindowFit:
        """Least squares over windows.

        Args:
            windows: windows, each with a free first pose.
        """
        predict = partial(self.motion.poses, times=self.times[windows.samples])
        return WindowFit(predict, self.measured[windows.samples], windows, self._heading)

    def base_poses(self, times: np.ndarray) -> np.ndarray:
        """Measured poses (M, 3) of the base at times within the sensor's; NaN at others.

        They are linear between the samples of the sensor, which stands at its place in the file.

        Args:
            times: times (M,) [s].
        """
        inside = (times >= self.times[0]) & (times <= self.times[-1])
        at = np.stack([np.interp(times, self.times, column) for column in self.measured.T], axis=1)
        mount = self.motion.mount
        heading = at[:, 2] - mount[2]
        found = joined(plane(at) - np.exp(1j * heading) * complex(*mount[:2]), heading)
        found[~inside] = np.nan
        return found

    def error(self, p: np.ndarray, windows: Windows) -> PathError:
        """Error of the open-loop path.

        Args:
            p: parameters (P,).
            windows: windows, each with its best first pose.
        """
        # With the best first pose of each window: where the path begins is no error of the robot.
        distance, angle = self.fit(windows).at(p).sizes
        rms, turned = (float(np.sqrt(np.mean(each**2))) for each in (distance, angle))
        return PathError(float(distance.mean()), rms, float(distance.max()), turned, len(distance))


def _precision(
    fit: Fit, parameters: Sequence[UnknownNumber], scales: np.ndarray, correlation: float, resolution: float
) -> tuple[np.ndarray, tuple[tuple[str, float], ...]]:
    """Covariance (P, P), and combinations with their standard deviations; refuse one that the log does not show."""
    scaled = fit.scaled()[1] * scales
    _, values, vectors = np.linalg.svd(scaled, full_matrices=False)
    # As in numpy.linalg.matrix_rank: a singular value below is zero up to rounding.
    rounding = len(scaled) * np.finfo(float).eps * max(values.max(initial=0.0), 1.0)
    deviations = np.sqrt(correlation) / np.maximum(values, 1e-300)
    names = [each.name for each in parameters]
    words = [_combination_name(vector, names) for vector in vectors]
    found = sorted(zip(words, deviations.tolist(), strict=True), key=lambda each: -each[1])
    unseen = (deviations > resolution) | (values <= rounding)
    lost = [word for word, each in zip(words, unseen, strict=True) if each]
    if lost:
        raise InfeasibleError(f"the log does not determine the {'; or the '.join(lost)}")
    spread = (vectors.T / values) * scales[:, None]
    return correlation * spread @ spread.T, tuple(found)


def calibrated(
    system: NonholonomicSystem, parameters: Sequence[UnknownNumber], p: np.ndarray, sensor: str
) -> NonholonomicSystem:
    """The system with estimated radii, places of joints, and place of the sensor.

    Args:
        system: the robot with the parameters of its file.
        parameters: the unknown numbers.
        p: their estimates (P,).
        sensor: frame on the base whose pose was measured.
    """
    # The system of the caller keeps its numbers: placements are changed in a copy of the model.
    robot = copy(system.robot)
    model = robot.model = system.robot.model.copy()
    radii = radii_of(parameters, p)
    for value, each in zip(p, parameters, strict=True):
        by = float(value - each.nominal)
        for virtual, share in each.displaced.items():
            joint = robot.joint_id(virtual.joint)
            model.jointPlacements[joint] = _moved(model.jointPlacements[joint], virtual.axis, share * by)
        if isinstance(each.kind, SensorPlace):
            frame = model.frames[robot.frame_id(sensor)]
            frame.placement = _moved(frame.placement, each.kind.axis, by)
    return system.with_robot(robot, [with_radius(kind, radii) for kind in system.kinds])


def _moved(place: pin.SE3, axis: str, by: float) -> pin.SE3:
    """Placement that is moved along x, y or z [m], or turned about z ("yaw") [rad]."""
    if axis == "yaw":
        return pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, by) @ place.rotation, place.translation)
    return pin.SE3(place.rotation, place.translation + by * np.eye(3)["xyz".index(axis)])


def _combination_name(vector: np.ndarray, names: Sequence[str]) -> str:
    """Words of a combination of scaled parameters (P,), the largest first and positive."""
    # A singular vector and its opposite are the same combination: one sign, so that words agree.
    vector = vector / vector[np.argmax(np.abs(vector))]
    named, most = 0.1, 6  # smallest share of a parameter in the name of a combination, and their largest number
    large = [k for k in np.argsort(-np.abs(vector)).tolist() if abs(vector[k]) > named][:most]
    if len(large) == 1:
        return names[large[0]]
    words = " ".join(f"{'-' if vector[k] < 0 else '+'} {abs(vector[k]):.2f} {names[k]}" for k in large)
    return f"combination {words.removeprefix('+ ')}"


# ---------------------------------------------------------------------- comparison


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
        lines: list[Line] = [
            ("whole log" if np.isinf(duration) else f"windows of {duration:g} s", [Item(str(error))])
            for duration, error in self.errors.items()
        ]
        lines += [("slip", [Item(name, f"{size:.2g} m/s") for name, size in self.slip.items()])]
        lines += [("unused rows", items(self.unused_rows))]
        return ObjectSummary("Comparison", [line for line in lines if line[1]])


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
    poses = log.channel("pose", sensor)  # its error before those of the joints
    problem = PoseProblem(RollingMotion(system, log, (), sensor), poses, heading)
    errors = {}
    stated = (1.0, 10.0, 100.0)  # durations of windows whose errors are stated [s]
    for duration in (*(each for each in stated if each < np.ptp(problem.times)), np.inf):
        chosen = problem.windows(-np.inf, np.inf, duration)
        if chosen.count:
            errors[duration] = problem.error(problem.nominal, chosen)
    if not errors:
        raise ConfigurationError(f"the log has no poses of '{sensor}' while its joints are measured")
    slip = _slip(problem)
    sizes = {name: float(np.sqrt(np.mean(each**2))) for name, (_, each) in slip.items()}
    rounding = 1e-12  # slip of rows that hold in any case [m/s]
    large = {name: size for name, size in sizes.items() if not size < rounding}
    return Comparison(errors, large, problem.motion.unused, _replay(problem, slip))


def _replay(problem: PoseProblem, slip: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Replay:
    """Both paths, the predicted one from the first pose that fits best."""
    motion = problem.motion
    chosen = problem.windows(-np.inf, np.inf, np.inf)
    times = problem.times[chosen.samples]
    fit = problem.fit(chosen).at(problem.nominal)
    measured = problem.base_poses(times)
    # Sensor and base are one body: the fit predicts the sensor.
    heading = measured[:, 2] + fit.residuals[:, 2]
    sensor = plane(problem.measured[chosen.samples]) + plane(fit.residuals)
    predicted = joined(sensor - np.exp(1j * heading) * complex(*motion.mount[:2]), heading)
    return Replay(times, measured, predicted, motion.configurations(times, predicted), slip)


def _slip(problem: PoseProblem) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times (W,) and mean slip (W,) of each row over windows of a second [m/s]."""
    motion = problem.motion
    time, slipped = motion.slip(problem.base_poses(motion.time))
    whole = np.isfinite(slipped).all(axis=1)
    window = 1.0  # duration over which slip is averaged [s]
    number = np.floor((time - time[0]) / window).astype(int)
    count = np.bincount(number[whole], minlength=number[-1] + 1)
    period = float(np.median(np.diff(motion.time)))
    # Windows with gaps of the log say little: a fifth of the samples may be missing.
    full = count > 0.8 * window / period
    middle = time[0] + (np.flatnonzero(full) + 0.5) * window
    sums = [np.bincount(number[whole], column[whole], minlength=len(count))[full] for column in slipped.T]
    means = [(middle, each / (count[full] * period)) for each in sums]
    return dict(zip(motion.used, means, strict=True)) if full.any() else {}
