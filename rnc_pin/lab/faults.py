"""Plants with faulty sensors and actuators, and plants of another robot than the model."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.input_validation import NotNegative
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.model.rows import ConstantRows, ConstraintKind, Rows
from rnc_pin.plants.plant import Plant, PlantReport, report_of, takes_velocities
from rnc_pin.plants.reduced_plant import ReducedPlant
from rnc_pin.robots.robot import Robot


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
        self._applied: np.ndarray | None = None

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart with the same noise.

        Args:
            q: true configuration (nq,).
            v: true velocity (nv,).
        """
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
        """Return the report of the plant, with the true state and the inputs within the limit of the actuators."""
        found = report_of(self.plant)
        return found._replace(actual=self.actual(), applied=self._applied if found.applied is None else found.applied)

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
        # The first sample cannot be lost: there is none to repeat.
        if chance < faults.dropped and self._delayed:
            q, v = self._delayed[-1]
        self._delayed.append((q, v))
        while len(self._delayed) > faults.delay + 1:
            self._delayed.popleft()
        # Until the delay has passed, the first sample stands for those before it.
        q, v = self._delayed[0]
        return q.copy(), v.copy()

    def _quantized(self, q: np.ndarray) -> np.ndarray:
        """Round a configuration to encoder counts from neutral."""
        step = 2.0 * np.pi / self.faults.counts
        neutral = pin.neutral(self.model)
        # From neutral and in the tangent space, so that quaternions keep unit length.
        steps = np.round(pin.difference(self.model, neutral, q) / step)
        return np.asarray(pin.integrate(self.model, neutral, step * steps))

    # ------------------------------------------------------------------ actuators

    def apply(self, T: np.ndarray) -> None:
        """Apply inputs (p,) within the limit of the actuators.

        Args:
            T: inputs (p,) [N or N m].
        """
        self._applied = np.clip(T, -self.faults.effort, self.faults.effort)
        self.plant.apply(self._applied)

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s].

        Args:
            dt: the time [s].
        """
        self.plant.advance(dt)


@dataclass(frozen=True)
class MassErrors:
    """Relative errors of the inertias of all bodies.

    Attributes:
        largest: largest relative error, as a fraction.
        seed: seed of the errors.
    """

    largest: float
    seed: int

    def change(self, robot: Robot) -> None:
        """Multiply the inertias of a robot, which has no other users.

        Args:
            robot: the robot, which is changed in place.
        """
        # A stream of its own: noise with the same seed is independent of these errors.
        generator = np.random.default_rng([self.seed, 1])
        for joint, inertia in enumerate(robot.model.inertias):
            factor = 1.0 + self.largest * generator.uniform(-1.0, 1.0)
            robot.model.inertias[joint] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)


@dataclass(frozen=True)
class StuckJoint:
    """Joint that locks during the run."""

    joint: str
    """Name of the joint."""
    time: NotNegative = 0.0
    """Time at which the joint locks [s]."""

    def rows(self, robot: Robot) -> ConstraintKind:
        """Rows that hold the joint where it is.

        Args:
            robot: the robot.

        Raises:
            ModelError: the joint is unknown.
        """
        return _LockedRows(robot, self.joint)


class _LockedRows(ConstantRows):
    """Rows that hold a joint where it is."""

    def __init__(self, robot: Robot, joint: str) -> None:
        entries = robot.velocity_indices(joint)
        self.matrix = np.eye(robot.nv)[entries]
        self.names = tuple(f"stuck({robot.velocity_names[entry]})" for entry in np.arange(robot.nv)[entries])
        self.units = tuple(robot.velocity_units[entry] for entry in np.arange(robot.nv)[entries])

    def bind(self, robot: Robot) -> Rows:
        return self


class ChangingPlant:
    """Plant that switches from one plant to another at a given time, at the same state.

    Args:
        before, after: plants with the same configurations and actuators. Velocity that violates the constraints of
            ``after`` vanishes at the switch, as in an inelastic impact.
        time: time of the switch [s].

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> sliding = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> locked = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh"), rnc.NoSideSlip("sleigh", axis="x")])
        >>> plants = [rnc.ReducedPlant(each) for each in (sliding, locked.reduce())]
        >>> plant = rnc.plants.ChangingPlant(*plants, time=0.1)
        >>> plant.reset(robot.configuration(), np.array([1.0, 0.0, 0.0]))
        >>> plant.advance(0.1), plant.advance(0.1)
        (None, None)
        >>> plant.read()[0][0].round(3)  # a metre a second, for a tenth of a second
        np.float64(0.1)
    """

    def __init__(self, before: Plant, after: Plant, time: float) -> None:
        self._before, self._after, self._switch_time = before, after, time
        self._current, self._time, self._switch_energy = before, 0.0, 0.0
        self._T: np.ndarray | None = None

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart with the first plant.

        Args:
            q: configuration (nq,).
            v: velocity (nv,).
        """
        self._current, self._time, self._T, self._switch_energy = self._before, 0.0, None, 0.0
        self._current.reset(q, v)
        self._switch_if_due()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return configuration (nq,) and velocity (nv,)."""
        return self._current.read()

    def apply(self, T: np.ndarray) -> None:
        """Apply inputs (p,) until the next call.

        Args:
            T: inputs (p,) [N or N m].
        """
        self._T = T
        self._current.apply(T)

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s]. The switch happens at the end of the step that reaches its time.

        Args:
            dt: the time [s].
        """
        self._current.advance(dt)
        self._time += dt
        self._switch_if_due()

    @property
    def takes_velocities(self) -> bool:
        """True if the inputs are velocities."""
        return takes_velocities(self._current)

    def report(self) -> PlantReport:
        """Return the report of the current plant; its work includes the switch, since an impact removes energy."""
        found = report_of(self._current)
        return found._replace(work=found.work + self._switch_energy)

    def _switch_if_due(self) -> None:
        # Sums of dt round: a switch at the time of a sample happens there, and not one sample later.
        if self._current is self._before and self._time >= self._switch_time - 1e-9:
            q, v = self._current.read()
            balance = _energy_minus_work(self._current)
            self._current = self._after
            self._after.reset(q, v)
            if isinstance(self._before, ReducedPlant) and isinstance(self._after, ReducedPlant):
                # One run has one estimate: the second plant goes on with the errors of the first.
                self._after.keep_errors(self._before.errors)
            if self._T is not None:
                self._current.apply(self._T)
            self._switch_energy += _energy_minus_work(self._current) - balance


def _energy_minus_work(plant: Plant) -> float:
    """Energy of a plant minus the work done on it [J]; NaN if it is unknown."""
    report = report_of(plant)
    q, v = plant.read()
    return np.nan if report.reduced is None else float(report.reduced.at(q, v=v).energy) - report.work
