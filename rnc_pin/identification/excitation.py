"""Motions that make the parameters of an identification visible, within the limits of the robot's file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError, InfeasibleError, SingularityError
from rnc_pin.identification.inertial_problem import column_names
from rnc_pin.identification.reduced_regressor import BaseParameters, ReducedRegressor
from rnc_pin.identification.unknowns import INERTIAL
from rnc_pin.model.input_validation import ArrayInput, vector
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.system import NonholonomicSystem
from rnc_pin.printing import Item, ObjectSummary, SummaryMixin

_STEPS = 200  # samples of a motion while it is chosen
_HARMONICS = 4
_LEAST = 0.01  # smallest share of the rates that a motion may have
_SHRINK, _GROW, _AGREE = 0.85, 1.5, 0.2  # step sizes of the search after a failure and a success; share of successes
_NONE = 1e6  # limits from which on there is none
_SPREAD = 1.0  # weight of the condition number beside the smallest singular value
_RANDOM = 20  # random motions beside which the result is stated


@dataclass(frozen=True, repr=False)
class Excitation(SummaryMixin):
    """Motion for an identification: a Fourier series of the reduced velocities, which begins and ends at rest.

    Example:
        >>> robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
        >>> joints = ["left_wheel_joint", "right_wheel_joint"]
        >>> wheels = [rnc.RollingWheel(f"{side}_wheel", 0.1) for side in ("left", "right")]
        >>> system = rnc.NonholonomicSystem(robot, wheels, joints)
        >>> reduced = system.reduce([rnc.JointPosition(name) for name in joints])
        >>> motion = rnc.excite(reduced, 5.0, robot.configuration(), rates=6.0, tries=20)
        >>> motion.v2(0.0), bool(motion.condition <= motion.random_condition)
        (array([0., 0.]), True)
    """

    duration: float
    """Duration [s]."""
    cosines: np.ndarray
    """Coefficients (harmonics, r) of the reduced velocities."""
    sines: np.ndarray
    """Coefficients (harmonics, r)."""
    condition: float
    """Condition number of the columns of the base parameters, of unit length for random motions."""
    random_condition: float
    """Median of the condition numbers of random motions within the same limits."""
    parameters: tuple[str, ...]
    """Names of the first parameters of the combinations that the motion shows."""

    def v2(self, t: float | np.ndarray) -> np.ndarray:
        """Return the reduced velocities (..., r) at times.

        Args:
            t: times (...) since the start [s].
        """
        turn = np.multiply.outer(t, self._rates)
        return np.cos(turn) @ self.cosines + np.sin(turn) @ self.sines

    def v2_dot(self, t: float | np.ndarray) -> np.ndarray:
        """Return the reduced accelerations (..., r) at times.

        Args:
            t: times (...) since the start [s].
        """
        turn = np.multiply.outer(t, self._rates)
        return (self._rates * np.cos(turn)) @ self.sines - (self._rates * np.sin(turn)) @ self.cosines

    @property
    def _rates(self) -> np.ndarray:
        return 2 * np.pi / self.duration * np.arange(1, len(self.cosines) + 1)

    def _summary(self) -> ObjectSummary:
        lines = [
            ("condition number", [Item(f"{self.condition:.4g}"), Item(f"random motions {self.random_condition:.4g}")]),
            ("combinations", [Item(str(len(self.parameters)))]),
        ]
        return ObjectSummary(f"Excitation: {self.duration:g} s", lines)


class _Motion(NamedTuple):
    """Samples of a motion."""

    columns: np.ndarray
    """Columns (rows, width) of the regressor."""
    excess: float
    """Largest position, velocity or effort beyond its limit, relative to the limit; at most zero within them."""
    limit: str
    """Name of that limit."""


def excite(
    reduced: ReducedModel,
    duration: float,
    q0: ArrayInput,
    rates: float | ArrayInput,
    *,
    share: float = 0.9,
    tries: int = 150,
    seed: int = 0,
) -> Excitation:
    """Choose a motion that shows the inertial parameters well, within the limits of the robot's file.

    The reduced velocities are Fourier series with zero mean. A random search maximizes the smallest singular value of
    the columns of the base parameters and lowers their condition number (E-optimality). Each motion is made smaller
    until it is within all limits of positions, velocities and efforts that the file states, for its inertias.

    Args:
        reduced: the robot; its reducing outputs move.
        duration: duration [s].
        q0: first configuration (nq,).
        rates: largest reduced velocity, a number or (r,) [rad/s or m/s].
        share: share of the file's limits that may be used.
        tries: number of motions that are tried.
        seed: seed of the search.

    Raises:
        ConfigurationError: a number is out of range.
        InfeasibleError: no motion is within the limits; the message names the first of them.

    Returns:
        The motion, with its condition number beside that of random motions.

    Example:
        >>> robot = rnc.Robot.from_urdf("space_robot.urdf")
        >>> joints = [f"joint_{k}" for k in (1, 2, 3)]
        >>> system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], joints)
        >>> reduced = system.reduce([rnc.JointPosition(name) for name in joints])
        >>> motion = rnc.excite(reduced, 6.0, robot.configuration({"joint_2": 1.0}), rates=1.0, tries=10)
        >>> len(motion.parameters)
        8
    """
    if not duration > 0 or not 0 < share <= 1 or tries < 1:
        raise ConfigurationError("excitation: expected a positive duration, a share between 0 and 1, and tries")
    size = np.broadcast_to(np.asarray(rates, dtype=float), (reduced.r,))
    if not (np.isfinite(size).all() and (size > 0).all()):
        raise ConfigurationError(f"rates: expected positive numbers, found {rates}")
    search = _Search(reduced, duration, vector(q0, reduced.robot.nq, "q0"), size, share)
    return search.best(tries, np.random.default_rng(seed))


class _Search:
    """Random search over coefficients (2 harmonics, r)."""

    def __init__(self, reduced: ReducedModel, duration: float, q0: np.ndarray, rates: np.ndarray, share: float) -> None:
        given = reduced.reduction_data.given
        system = NonholonomicSystem(reduced.robot, given.constraints, given.actuators, given.mimic, given.forces)
        self._regressor = ReducedRegressor(system, system.actuation.names)
        self._reduced, self._duration, self._q0, self._rates, self._share = reduced, duration, q0, rates, share
        self._bounds = _bounds(reduced)

    def best(self, tries: int, generator: np.random.Generator) -> Excitation:
        """The best motion of a (1+1) evolution strategy that starts from the best of some random motions."""
        draws = [self._within(self._drawn(generator)) for _ in range(_RANDOM)]
        pool = np.vstack([found.columns for _, found in draws])
        base = BaseParameters.of(pool, [str(k) for k in range(pool.shape[1])])
        sizes = np.linalg.norm(pool[:, base.independent], axis=0) / np.sqrt(len(draws))

        def spectrum(found: _Motion) -> np.ndarray:
            return np.linalg.svd(found.columns[:, base.independent] / sizes, compute_uv=False)

        def merit(found: _Motion) -> float:
            values = np.log(np.maximum(spectrum(found), 1e-300))
            return float(values[-1] - _SPREAD * (values[0] - values[-1]))

        x, found = max(draws, key=lambda each: merit(each[1]))
        value, step = merit(found), 0.3
        for _ in range(tries):
            other, moved = self._within(x + step * self._rates * self._drawn(generator, 1.0))
            now = merit(moved)
            better = now > value
            step = float(np.clip(step * (_GROW if better else _SHRINK**_AGREE), 1e-3, 1.0))
            if better:
                x, found, value = other, moved, now
        conditions = [float(each[0] / max(each[-1], 1e-300)) for each in (spectrum(one) for _, one in draws)]
        own = spectrum(found)
        names = column_names(self._regressor, INERTIAL)
        cosines, sines = np.split(self._at_rest(x), 2)
        return Excitation(
            self._duration,
            cosines,
            sines,
            float(own[0] / own[-1]),
            float(np.median(conditions)),
            tuple(names[k] for k in base.independent),
        )

    def _drawn(self, generator: np.random.Generator, size: np.ndarray | float | None = None) -> np.ndarray:
        drawn = generator.normal(size=(2 * _HARMONICS, self._reduced.r)) / np.sqrt(2 * _HARMONICS)
        return drawn * (self._rates if size is None else size)

    def _at_rest(self, x: np.ndarray) -> np.ndarray:
        """Coefficients whose motion begins and ends without velocity and acceleration."""
        cosines, sines = np.split(x.copy(), 2)
        k = np.arange(1, _HARMONICS + 1)
        cosines -= cosines.mean(axis=0)
        sines -= np.outer(k, k @ sines) / (k @ k)
        return np.concatenate([cosines, sines])

    def _within(self, x: np.ndarray) -> tuple[np.ndarray, _Motion]:
        """Coefficients made smaller until their motion is within the limits, and the motion."""
        x, factor = self._at_rest(x), 1.0
        turn = 2 * np.pi * np.outer(np.linspace(0, 1, 8 * _STEPS), np.arange(1, _HARMONICS + 1))
        cosines, sines = np.split(x, 2)
        largest = np.abs(np.cos(turn) @ cosines + np.sin(turn) @ sines).max(axis=0)
        x = x * np.minimum(1.0, self._rates / np.maximum(largest, 1e-300))
        name = "the basis of the motions"
        while factor > _LEAST:
            try:
                found = self._moved(factor * x)
                if found.excess <= 0:
                    return factor * x, found
                name = found.limit
            except SingularityError:
                name = "the basis of the motions"
            factor *= _SHRINK
        raise InfeasibleError(f"no motion from this configuration is within the limits: {name}")

    def _moved(self, x: np.ndarray) -> _Motion:
        reduced, model = self._reduced, self._reduced.robot.model
        cosines, sines = np.split(x, 2)
        series = Excitation(self._duration, cosines, sines, 1.0, 1.0, ())
        dt, q, path = self._duration / _STEPS, self._q0, []
        times = dt * np.arange(_STEPS)
        v2, v2_dot = series.v2(times), series.v2_dot(times)
        for start, halfway in zip(v2, series.v2(times + dt / 2), strict=True):
            path.append(q)
            middle = pin.integrate(model, q, dt / 2 * reduced.at(q, start).v)
            q = pin.integrate(model, q, dt * reduced.at(middle, halfway).v)
        positions = np.array(path)
        states = reduced.at(positions, v2)
        velocities, accelerations = states.v, states.v_dot(v2_dot)
        efforts = states.allocate(reduced.inverse_dynamics(positions, v2, v2_dot))
        columns = [self._regressor.forces(positions, velocities, accelerations)]
        if self._regressor.conserved:
            columns.append(self._regressor.momenta(positions, velocities)[0])
        columns = [each.reshape(-1, self._regressor.width)[:, : 10 * len(self._regressor.bodies)] for each in columns]
        excess, limit = -np.inf, ""
        measured = {"position": positions, "velocity": velocities, "effort": efforts}
        for name, kind, index, low, high in self._bounds:
            values = measured[kind][:, index]
            half, middle = self._share * (high - low) / 2, (high + low) / 2
            beyond = float(np.max(np.abs(values - middle)) / half - 1)
            if beyond > excess:
                excess, limit = beyond, f"the {kind} of {name}"
        return _Motion(np.vstack(columns), excess, limit)


def _bounds(reduced: ReducedModel) -> list[tuple[str, str, int, float, float]]:
    """Limits of the file: name, kind, entry of q, v or T, lowest and highest value."""
    robot, model, found = reduced.robot, reduced.robot.model, []
    for name in robot.joint_names:
        joint = model.joints[robot.joint_id(name)]
        if joint.nv != 1:
            continue
        speed = float(model.upperVelocityLimit[joint.idx_v])
        if 0 < speed < _NONE:
            found.append((name, "velocity", joint.idx_v, -speed, speed))
        low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
        if joint.nq == 1 and 0 < high - low < _NONE:
            found.append((name, "position", joint.idx_q, low, high))
    for column, (name, effort) in enumerate(zip(reduced.actuation.names, reduced.actuation.limits, strict=True)):
        if np.isfinite(effort):
            found.append((name, "effort", column, -float(effort), float(effort)))
    return found
