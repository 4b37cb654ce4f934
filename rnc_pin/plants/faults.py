"""Faults of sensors and actuators, and plants that have them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants.plant import OF_CONTACTS, OF_INTEGRATION, Plant, continue_plant, energy_minus_work


@dataclass(frozen=True)
class Faults:
    """Faults of sensors and actuators; none by default.

    Args:
        position_noise, velocity_noise: standard deviations [rad or m, rad/s or m/s].
        position_bias, velocity_bias: constant errors of every sensor [rad or m, rad/s or m/s].
        counts: encoder counts per 2 pi rad or 2 pi m; positions are rounded to them.
        delay: measurement delay [samples].
        jitter: largest error of the sampling time, as a fraction of the sampling period.
        dropped: fraction of samples that are lost; the previous sample is repeated.
        garbage: fraction of samples that are NaN.
        effort: input limit of every actuator [N or N m]; the loop knows it.
        dead_zone: input below which an actuator has no effect [N or N m]; the loop does not know it.
        friction: Coulomb friction of every actuator, with stiction [N or N m].
        slip_time: time at which the plant starts to slip against its constraints [s].
        slip_speed: slip speed along each constraint row [m/s or rad/s].
        slip_duration: duration of the slip [s].

    Raises:
        ConfigurationError: a value is out of range.

    Example:
        >>> rnc.Faults(position_noise=1e-4, counts=4096, delay=2, effort=50.0).delay
        2
        >>> rnc.Faults(dropped=1.5)
        Traceback (most recent call last):
        ...
        rnc_pin.errors.ConfigurationError: fault dropped: expected a fraction of at most 1, found 1.5
    """

    position_noise: float = 0.0
    velocity_noise: float = 0.0
    position_bias: float = 0.0
    velocity_bias: float = 0.0
    counts: float = np.inf
    delay: int = 0
    jitter: float = 0.0
    dropped: float = 0.0
    garbage: float = 0.0
    effort: float = np.inf
    dead_zone: float = 0.0
    friction: float = 0.0
    slip_time: float = np.inf
    slip_speed: float = 0.0
    slip_duration: float = 0.05

    def __post_init__(self) -> None:
        signed = ("position_bias", "velocity_bias", "slip_speed")
        for name in (each.name for each in fields(self)):
            value = getattr(self, name)
            if np.isnan(value) or (name not in signed and value < 0):
                at_least = "" if name in signed else " of at least 0"
                raise ConfigurationError(f"fault {name}: expected a number{at_least}, found {value}")
        for name in ("dropped", "garbage", "jitter"):
            if getattr(self, name) > 1:
                raise ConfigurationError(f"fault {name}: expected a fraction of at most 1, found {getattr(self, name)}")
        if self.counts == 0:
            raise ConfigurationError("fault counts: expected a positive number, found 0")

    def slips(self, time: float) -> bool:
        """True if the plant slips from a time on [s], for a sample."""
        return self.slip_speed != 0 and self.slip_time <= time < self.slip_time + self.slip_duration


class FaultyPlant:
    """Plant with sensor and actuator faults.

    Args:
        plant: the plant without faults.
        faults: its faults.
        reduced: model that defines the configurations and actuators.
        dt: sampling period, the unit of ``jitter`` [s].
        seed: random seed of the noise; the sequence does not depend on other random numbers.

    Raises:
        ConfigurationError: friction is set, but the plant has no ``set_actuator_friction``.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> plant, faults = rnc.ReducedPlant(reduced), rnc.Faults(position_bias=0.1)
        >>> bent = rnc.plants.FaultyPlant(plant, faults, reduced, dt=0.01)
        >>> bent.reset(robot.configuration(), np.zeros(3))
        >>> (bent.read()[0] - bent.actual()[0])[:2].round(2)
        array([0.09, 0.1 ])
    """

    def __init__(self, plant: Plant, faults: Faults, reduced: ReducedModel, dt: float, seed: int = 0) -> None:
        self.plant, self.faults, self._reduced, self.dt, self._seed = plant, faults, reduced, dt, seed
        self.model = reduced.robot.model
        if faults.friction:
            if not hasattr(plant, "set_actuator_friction"):
                raise ConfigurationError(
                    f"fault friction: {type(plant).__name__} has no method 'set_actuator_friction(limit)'; "
                    "the plant has to integrate friction itself"
                )
            plant.set_actuator_friction(faults.friction)
        self._initialize()

    def _initialize(self) -> None:
        self._time, self._generator = 0.0, np.random.default_rng(self._seed)
        self._delayed: deque[tuple[np.ndarray, np.ndarray]] = deque()
        self._slip, self._slip_work = np.zeros(self.model.nv), 0.0
        self.applied = self._transmitted = np.zeros(self._reduced.p)

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart with the same noise."""
        self._initialize()
        self.plant.reset(q, v)

    def actual(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the true configuration (nq,) and velocity (nv,)."""
        q, v = self.plant.read()
        return q, v + self._slip

    def __getattr__(self, name: str) -> object:
        """Forward optional attributes to the plant."""
        if name in ("reduced", "takes_velocities", "effort", *OF_CONTACTS, *OF_INTEGRATION):
            return getattr(self.plant, name)
        raise AttributeError(name)

    @property
    def work(self) -> float:
        """Work done on the plant so far, including the work of slip against its constraints [J]."""
        done = float(self.plant.work) + self._slip_work  # type: ignore[attr-defined]
        if self._slip.any():
            q, v = self.plant.read()
            model: ReducedModel = self.plant.reduced  # type: ignore[attr-defined]
            done += float(model.at(q, v=v + self._slip).energy - model.at(q, v=v).energy)
        return done

    @property
    def external(self) -> np.ndarray | None:
        """Generalized forces (nv,) besides ``applied``: damping, friction, and the loss in the dead zone."""
        inner: np.ndarray | None = self.plant.external  # type: ignore[attr-defined]
        difference = getattr(self.plant, "applied", self._transmitted) - self.applied
        if not difference.any():
            return inner
        lost: np.ndarray = self._reduced.at(self.plant.read()[0]).B @ difference
        return lost if inner is None else inner + lost

    # ------------------------------------------------------------------ sensors

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return measured q (nq,) and v (nv,). Each call is one sample."""
        q, v = self.actual()
        faults, generator = self.faults, self._generator
        # Drawn in every sample, so that one fault does not change the noise of another.
        noise, chance = generator.normal(size=(2, self.model.nv)), generator.uniform(-1.0, 1.0, size=3)
        error = faults.position_noise * noise[0] + faults.position_bias + faults.jitter * self.dt * chance[0] * v
        v = v + faults.velocity_noise * noise[1] + faults.velocity_bias
        if error.any():
            q = pin.integrate(self.model, q, error)
        if np.isfinite(faults.counts):
            q = self._quantized(q)
        if abs(chance[2]) < faults.garbage:
            q, v = np.full(q.shape, np.nan), np.full(v.shape, np.nan)
        if abs(chance[1]) < faults.dropped and self._delayed:
            q, v = self._delayed[-1]
        self._delayed.append((q, v))
        while len(self._delayed) > faults.delay + 1:
            self._delayed.popleft()
        q, v = self._delayed[0]
        return q.copy(), v.copy()

    def _quantized(self, q: np.ndarray) -> np.ndarray:
        """Round a configuration to encoder counts from neutral."""
        step = 2.0 * np.pi / self.faults.counts
        neutral = pin.neutral(self.model)
        quantized: np.ndarray = pin.integrate(
            self.model, neutral, step * np.round(pin.difference(self.model, neutral, q) / step)
        )
        return quantized

    # ------------------------------------------------------------------ actuators

    def apply(self, T: np.ndarray) -> None:
        """Apply inputs (p,) with actuator faults; ``applied`` includes only those that the loop knows."""
        known = np.clip(T, -self.faults.effort, self.faults.effort)
        passed = np.where(np.abs(known) < self.faults.dead_zone, 0.0, known)
        self.plant.apply(passed)
        self.applied = known + (getattr(self.plant, "applied", passed) - passed)  # plant limits are known
        self._transmitted = passed

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s]; during slip the plant also moves against its constraints."""
        self.plant.advance(dt)
        begin, self._time = self._time, self._time + dt
        faults = self.faults
        if faults.slips(begin):
            q, v = self.plant.read()
            A = self._reduced.at(q).A
            self._slip = np.linalg.pinv(A) @ np.full(len(A), faults.slip_speed)
            balance = energy_minus_work(self.plant)
            continue_plant(self.plant, self.plant, pin.integrate(self.model, q, dt * self._slip), v)
            self.plant.apply(self._transmitted)
            self._slip_work += energy_minus_work(self.plant) - balance
        else:
            self._slip = np.zeros(self.model.nv)
