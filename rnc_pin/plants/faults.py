"""Faults of sensors and actuators, and plants that have them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants.plant import Plant, PlantReport, report_of, takes_velocities


@dataclass(frozen=True)
class Faults:
    """Faults of sensors and actuators; none by default.

    Args:
        position_noise, velocity_noise: standard deviations [rad or m, rad/s or m/s].
        counts: encoder counts per 2 pi rad or 2 pi m; positions are rounded to them.
        delay: measurement delay [samples].
        dropped: fraction of samples that are lost; the previous sample is repeated.
        effort: input limit of every actuator [N or N m]; the loop knows it.

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
    counts: float = np.inf
    delay: int = 0
    dropped: float = 0.0
    effort: float = np.inf

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= 0:
                raise ConfigurationError(f"fault {name}: expected a number of at least 0, found {value}")
        if self.dropped > 1:
            raise ConfigurationError(f"fault dropped: expected a fraction of at most 1, found {self.dropped}")
        if self.counts == 0:
            raise ConfigurationError("fault counts: expected a positive number, found 0")


class FaultyPlant:
    """Plant with sensor and actuator faults.

    Args:
        plant: the plant without faults.
        faults: its faults.
        reduced: model that defines the configurations.
        seed: random seed of the noise; the sequence does not depend on other random numbers.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> counted = rnc.plants.FaultyPlant(rnc.ReducedPlant(reduced), rnc.Faults(counts=8), reduced)
        >>> counted.reset(robot.configuration({"root_joint": [1.0, 0.0, 0.0]}), np.zeros(3))
        >>> counted.read()[0][0].round(3)  # an eighth of 2 pi m
        np.float64(0.785)
    """

    def __init__(self, plant: Plant, faults: Faults, reduced: ReducedModel, seed: int = 0) -> None:
        self.plant, self.faults, self._seed = plant, faults, seed
        self.model = reduced.robot.model
        self._initialize()

    def _initialize(self) -> None:
        self._generator = np.random.default_rng(self._seed)
        self._delayed: deque[tuple[np.ndarray, np.ndarray]] = deque()

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart with the same noise."""
        self._initialize()
        self.plant.reset(q, v)

    @property
    def takes_velocities(self) -> bool:
        """True if the inputs are velocities."""
        return takes_velocities(self.plant)

    def actual(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the true configuration (nq,) and velocity (nv,)."""
        return self.plant.read()

    def report(self) -> PlantReport:
        """Return the report of the plant, with the true state."""
        return report_of(self.plant)._replace(actual=self.actual())

    # ------------------------------------------------------------------ sensors

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return measured q (nq,) and v (nv,). Each call is one sample."""
        q, v = self.actual()
        faults, generator = self.faults, self._generator
        # Drawn in every sample, so that one fault does not change the noise of another.
        noise, chance = generator.normal(size=(2, self.model.nv)), abs(generator.uniform(-1.0, 1.0, size=3)[1])
        v = v + faults.velocity_noise * noise[1]
        if faults.position_noise:
            q = pin.integrate(self.model, q, faults.position_noise * noise[0])
        if np.isfinite(faults.counts):
            q = self._quantized(q)
        if chance < faults.dropped and self._delayed:
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
        """Apply inputs (p,) within the limit of the actuators."""
        self.plant.apply(np.clip(T, -self.faults.effort, self.faults.effort))

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s]."""
        self.plant.advance(dt)
