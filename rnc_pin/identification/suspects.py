"""Numbers of a model that explain the error of its open-loop path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy import ndarray as Array

from rnc_pin.identification import unknowns
from rnc_pin.identification.calibration import PoseProblem, calibrated
from rnc_pin.identification.logs.log import Log
from rnc_pin.identification.rolling_motion import RollingMotion
from rnc_pin.identification.window_fit import Fit
from rnc_pin.model.system import NonholonomicSystem

_MOST = 4  # numbers that are changed one after the other
_WORTH = 0.1  # share of the remaining squared error that a further number has to explain
_ALL = 1e-4  # share of the squared error below which nothing is left to explain
_FIT = 10.0  # duration of the windows that show which number is wrong [s]
_PRECISION = 1e-2  # of the fits, in standard deviations
NO_TIMES = np.zeros((0, 2))
"""No interval."""

Assumption: TypeAlias = Literal["radius", "place", "encoder", "delay", "sensor", "slip"]
"""Kind of assumption of a model."""
_ASSUMPTIONS: Mapping[str, Assumption] = {
    "radius": "radius", "place": "place", "scale": "encoder", "offset": "encoder", "delay": "delay",
    "slip": "slip",
}  # fmt: skip


@dataclass(frozen=True)
class Suspect:
    """Number of the model, or slip of a row, that explains a part of an error.

    Example:
        >>> rnc.identification.Suspect("radius of left", "m", 0.1, 0.11, 0.8).assumption
        'radius'
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
    """Share of the squared error of the path that is explained by it and those before it."""

    @property
    def assumption(self) -> Assumption:
        """Assumption that fails."""
        first = self.name.split()[0]
        return _ASSUMPTIONS.get(first, "sensor")


def candidates(system: NonholonomicSystem, motion: RollingMotion) -> list[unknowns.Unknown]:
    """Numbers that may be wrong: of wheels and joints of the rows in use, of encoders, clocks and of the sensor."""
    radii = {str(getattr(each, "frame", "")): float(each.radius) for each in system.kinds if hasattr(each, "radius")}
    radii = {wheel: size for wheel, size in radii.items() if any(f"({wheel})" in row for row in motion.used)}
    alike = [[wheel for wheel in radii if radii[wheel] == size] for size in dict.fromkeys(radii.values())]
    found: list[unknowns.Unknown] = [
        unknowns.SensorPlace("x"),
        unknowns.SensorPlace("y"),
        unknowns.SensorPlace("yaw"),
        unknowns.TimeShift(),
    ]
    found += [unknowns.WheelRadius(wheels) for wheels in alike if len(wheels) > 1]
    found += [unknowns.WheelRadius(wheel) for wheel in radii]
    for joint in motion.shape_joints:
        found += [unknowns.EncoderOffset(joint), unknowns.EncoderScale(joint), unknowns.TimeShift(joint)]
    model = system.robot.model
    places = {joint: model.jointPlacements[system.robot.joint_id(joint)].translation for joint in motion.row_joints}
    for joint, place in places.items():
        found.append(unknowns.JointShift(joint, "x"))
        mirrored = [other for other, there in places.items() if np.allclose(there, place * [1, -1, 1]) and place[1] > 0]
        found += [unknowns.JointShift({joint: 0.5, other: -0.5}, "y") for other in mirrored]
    return found


class Pursuit(NamedTuple):
    """Numbers chosen one after the other, with their values in a common fit."""

    suspects: tuple[Suspect, ...]
    """The numbers; each share is of the error before the first."""
    system: NonholonomicSystem
    """The robot with these values."""
    log: Log
    """The log with these corrections."""
    before: float
    """Mean squared error of a sample before the first, in standard deviations."""
    after: float
    """Mean squared error of a sample after the last."""
    deviations: Array
    """Standard deviations of position and heading (2,) that errors are divided by [m, rad]."""


def pursued(
    system: NonholonomicSystem, log: Log, sensor: str, heading: bool, skip: Array, deviations: Array | None = None
) -> Pursuit:
    """Change numbers one after the other: orthogonal matching pursuit with fits in between.

    Args:
        system: the robot.
        log: the log.
        sensor: frame whose pose is measured.
        heading: True if headings are measured.
        skip: intervals (K, 2) that do not count [s].
        deviations: standard deviations of position and heading (2,) that errors are divided by; those of the first fit
            by default.
    """
    channel = log.channel("pose", sensor)
    numbers = candidates(system, RollingMotion(system, log, (), sensor))
    motion = RollingMotion(system, log, numbers, sensor)
    problem = PoseProblem(motion, channel, heading, skip)
    windows = problem.windows(-np.inf, np.inf, min(_FIT, float(np.ptp(problem.times))) + 1e-9)
    if not windows.count:
        return Pursuit((), system, log, 0.0, 0.0, np.ones(2))
    whole = problem.fit(windows)
    wheels = [set(each.wheels) for each in motion.parameters]
    banned: set[int] = set()
    start = whole.at(problem.nominal)
    sizes = start.deviations if deviations is None else deviations
    first = _squares(start, sizes)

    def fitted(chosen: Sequence[int], guess: Array) -> tuple[Array, Fit, float]:
        """Parameters, fit and mean squared error with some numbers."""
        part = RollingMotion(system, log, [numbers[k] for k in chosen], sensor)
        smaller = PoseProblem(part, channel, heading, skip)
        index = list(chosen)
        values, _, _ = smaller.fit(windows).minimized(
            guess[index], smaller.scales, smaller.is_valid, _PRECISION, np.inf
        )
        p = problem.nominal.copy()
        p[index] = values
        fit = whole.at(p)
        return p, fit, _squares(fit, sizes)

    p, fit, remaining = problem.nominal, start, first
    chosen: list[int] = []
    shares: list[float] = []
    while len(chosen) < _MOST and remaining > _ALL * first:
        best = _most_telling(fit, problem.scales, chosen, banned)
        if best is None:
            break
        common = {k for k in chosen if wheels[k] & wheels[best]}
        if common and not all(wheels[k] > wheels[best] for k in common):
            banned.add(best)
            continue
        if not common:
            p, fit, left = fitted([*chosen, best], p)
            if left > (1 - _WORTH) * remaining:
                p, fit, _ = fitted(chosen, p) if chosen else (problem.nominal, start, first)
                break
            chosen, remaining = [*chosen, best], left
            shares.append(1.0 - remaining / first)
        # A common radius is no candidate besides a finer one, and no number that the later ones replace.
        replaced = common or {
            k for k in chosen[:-1] if fitted([each for each in chosen if each != k], p)[2] < remaining / (1 - _WORTH)
        }
        if replaced:
            banned |= replaced
            p, fit, remaining, chosen, shares = problem.nominal, start, first, [], []
    parameters = [motion.parameters[k] for k in chosen]
    suspects = tuple(
        Suspect(each.name, each.unit, each.nominal, float(value), explained)
        for each, value, explained in zip(parameters, p[chosen], shares, strict=True)
    )
    return Pursuit(
        suspects,
        calibrated(system, parameters, p[chosen], sensor) if chosen else system,
        log.corrected(unknowns.corrections_of(parameters, p[chosen], sensor)) if chosen else log,
        first,
        remaining,
        sizes,
    )


def _most_telling(fit: Fit, scales: Array, chosen: Sequence[int], banned: set[int]) -> int | None:
    """Number that explains most of the residuals besides those that were chosen or banned; None if none does."""
    r, J = fit.scaled()
    rest = _unexplained(J * scales, chosen)
    gains = _gains(rest, r, np.sum(rest**2, axis=0).max(initial=0))
    gains[[*chosen, *banned]] = 0.0
    best = int(np.argmax(gains))
    return best if gains[best] > _WORTH * (r @ r) else None


def _unexplained(columns: Array, chosen: Sequence[int]) -> Array:
    """Parts of columns that the chosen ones among them do not explain as well."""
    if not chosen:
        return columns
    basis, _ = np.linalg.qr(columns[:, list(chosen)])
    return np.asarray(columns - basis @ (basis.T @ columns))


def _gains(columns: Array, residual: Array, whole: Array | float) -> Array:
    """Squares of a residual that each column alone explains; zero for one whose square is small beside ``whole``."""
    sizes = np.sum(columns**2, axis=0)
    return np.divide((columns.T @ residual) ** 2, sizes, out=np.zeros_like(sizes), where=sizes > 1e-9 * whole)


def _squares(fit: Fit, deviations: Array) -> float:
    """Mean of the squared residuals of a sample, in standard deviations."""
    return float(np.mean(np.sum((fit.residuals / deviations[[0, 0, 1]]) ** 2, axis=1)))
