"""A measured log beside the open-loop path of a model: errors over windows, slip of rows, and suspicious numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.identification.calibration import PathError, PoseProblem
from rnc_pin.identification.rolling_motion import RollingMotion
from rnc_pin.identification.unknowns import (
    EncoderOffset,
    EncoderScale,
    JointShift,
    SensorPlace,
    TimeShift,
    Unknown,
    WheelRadius,
    unknown_of,
)
from rnc_pin.identification.window_fit import Fit
from rnc_pin.logs.log import Log
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin

_MOST = 4  # numbers that are changed one after the other
_WORTH = 0.1  # share of the remaining squared error that a further number has to explain
_FIT = 10.0  # duration of the windows that show which number is wrong [s]
_SLIP = 1.0  # duration over which slip is averaged [s]
_ROUNDING = 1e-12  # slip of rows that hold in any case [m/s]
_PRECISION = 1e-2  # of the fits, in standard deviations


@dataclass(frozen=True)
class Suspect:
    """Number of the model that explains a part of the error.

    Example:
        >>> rnc.identification.Suspect("radius of left", "m", 0.1, 0.11, 0.8).explained
        0.8
    """

    name: str
    """Name of the parameter."""
    unit: str
    """Its unit."""
    nominal: float
    """Its value in the model."""
    value: float
    """Its value in the fit with all suspects so far."""
    explained: float
    """Share of the squared error that is explained by it and those before it."""


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

    @property
    def conclusion(self) -> str:
        """Sentence about the assumption that fails first."""
        if not self.suspects:
            return "no single number of the model explains the error: it is noise of the sensor, or slip"
        first, share = self.suspects[0], self.suspects[-1].explained
        text = f"the {first.name} fails first: {first.explained:.0%} of the squared error"
        rest = f", and {share:.0%} with {', '.join(each.name for each in self.suspects[1:])}"
        return text + (rest if len(self.suspects) > 1 else "")

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
    system: NonholonomicSystem,
    log: Log,
    sensor: str,
    *,
    windows: Sequence[float] = (1.0, 10.0, 100.0),
    heading: bool = True,
) -> Comparison:
    """Compare a log with the path that measured joints give in a model of a rolling robot.

    Numbers of the model are changed one after the other. Each time, the number is chosen that explains most of the
    remaining squared error, and all that were chosen before are fitted again with it. The order is that of evidence:
    numbers with the same effect, such as a radius and the scale of its encoder, cannot be told apart.

    Args:
        system: the robot on a planar base, with its constraints.
        log: positions of joints and poses of the sensor.
        sensor: frame on the base whose pose is measured.
        windows: durations of windows with a free first pose [s].
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
    durations = [each for each in windows if each < np.ptp(problem.times)]
    errors = {}
    for duration in (*durations, np.inf):
        chosen = problem.windows(-np.inf, np.inf, duration)
        if chosen.count:
            errors[duration] = problem.error(problem.nominal, chosen)
    if not errors:
        raise ConfigurationError(f"the log has no poses of '{sensor}' while its joints are measured")
    suspects = _suspects(system, log, sensor, candidates(system, plain), heading)
    return Comparison(errors, _slip(plain, problem), suspects, plain.unused)


def candidates(system: NonholonomicSystem, motion: RollingMotion) -> list[Unknown]:
    """Numbers that may be wrong: of wheels and joints of the rows in use, of encoders, clocks and of the sensor."""
    radii = {str(getattr(each, "frame", "")): float(each.radius) for each in system.kinds if hasattr(each, "radius")}
    radii = {wheel: size for wheel, size in radii.items() if any(f"({wheel})" in row for row in motion.used)}
    alike = [[wheel for wheel in radii if radii[wheel] == size] for size in dict.fromkeys(radii.values())]
    found: list[Unknown] = [SensorPlace("x"), SensorPlace("y"), SensorPlace("yaw"), TimeShift()]
    found += [WheelRadius(wheels) for wheels in alike if len(wheels) > 1]
    found += [WheelRadius(wheel) for wheel in radii]
    for joint in motion.shape_joints:
        found += [EncoderOffset(joint), EncoderScale(joint), TimeShift(joint)]
    model = system.robot.model
    places = {joint: model.jointPlacements[system.robot.joint_id(joint)].translation for joint in motion.row_joints}
    for joint, place in places.items():
        found.append(JointShift(joint, "x"))
        mirrored = [other for other, there in places.items() if np.allclose(there, place * [1, -1, 1]) and place[1] > 0]
        found += [JointShift({joint: 0.5, other: -0.5}, "y") for other in mirrored]
    return found


def numbers_of(names: Sequence[str], system: NonholonomicSystem, log: Log, sensor: str) -> list[Unknown]:
    """Return the unknown numbers with the names that a comparison prints, or that ``unknown_of`` knows.

    Args:
        names: the names.
        system: the robot.
        log: the log that was compared.
        sensor: frame on the base whose pose is measured.

    Raises:
        ConfigurationError: no kind of number has such a name.
    """
    known = {each.name: each for each in candidates(system, RollingMotion(system, log, (), sensor))}
    return [known[name] if name in known else unknown_of(name) for name in names]


def _suspects(
    system: NonholonomicSystem, log: Log, sensor: str, numbers: Sequence[Unknown], heading: bool
) -> tuple[Suspect, ...]:
    """Numbers chosen one after the other: orthogonal matching pursuit with fits in between."""
    motion = RollingMotion(system, log, numbers, sensor)
    problem = PoseProblem(motion, log.channel("pose", sensor), heading)
    windows = problem.windows(-np.inf, np.inf, min(_FIT, float(np.ptp(problem.times))) + 1e-9)
    if not windows.count:
        return ()
    whole = problem.fit(windows)
    p, found = problem.nominal.copy(), []
    chosen: list[int] = []
    fit = whole.at(p)
    deviations = fit.deviations
    first = remaining = _squares(fit, deviations)
    while len(chosen) < _MOST:
        r, J = fit.scaled()
        rest = J * problem.scales
        if chosen:  # parts that the chosen numbers explain as well
            basis, _ = np.linalg.qr(rest[:, chosen])
            rest = rest - basis @ (basis.T @ rest)
        sizes = np.sum(rest**2, axis=0)
        gains = np.divide((rest.T @ r) ** 2, sizes, out=np.zeros_like(sizes), where=sizes > 1e-9 * sizes.max(initial=0))
        gains[chosen] = 0.0
        best = int(np.argmax(gains))
        if gains[best] <= _WORTH * (r @ r):
            break
        chosen.append(best)
        part = RollingMotion(system, log, [numbers[k] for k in chosen], sensor)
        smaller = PoseProblem(part, log.channel("pose", sensor), heading)
        values, _, _ = smaller.fit(windows).minimized(p[chosen], smaller.scales, smaller.is_valid, _PRECISION, np.inf)
        p[chosen] = values
        fit = whole.at(p)
        left = _squares(fit, deviations)
        if left > (1 - _WORTH) * remaining:
            break
        remaining = left
        number = motion.parameters[best]
        found.append((number, 1.0 - remaining / first))
    values_of = {id(motion.parameters[k]): float(p[k]) for k in chosen}
    return tuple(
        Suspect(each.name, each.unit, each.nominal, values_of[id(each)], explained) for each, explained in found
    )


def _squares(fit: Fit, deviations: np.ndarray) -> float:
    """Sum of squared residuals, in standard deviations of the first fit."""
    return float(np.sum((fit.residuals / deviations[[0, 0, 1]]) ** 2))


def _slip(motion: RollingMotion, problem: PoseProblem) -> dict[str, float]:
    """Root mean square slip of the rows, averaged over a second each."""
    time, slipped = motion.slip(problem.base_poses(motion.time))
    whole = np.isfinite(slipped).all(axis=1)
    if not whole.any():
        return {}
    number = np.floor((time[whole] - time[0]) / _SLIP).astype(int)
    count = np.bincount(number)
    period = float(np.median(np.diff(time)))
    full = count > 0.8 * _SLIP / period
    sums = np.stack([np.bincount(number, column)[full] for column in slipped[whole].T], axis=1)
    sizes = np.sqrt(np.mean((sums / (count[full, None] * period)) ** 2, axis=0)) if full.any() else np.full(
        slipped.shape[1], np.nan
    )  # fmt: skip
    return {name: size for name, size in zip(motion.used, sizes.tolist(), strict=True) if not size < _ROUNDING}
