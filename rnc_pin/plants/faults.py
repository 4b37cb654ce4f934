"""What sensors and actuators of a real machine do wrong."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ConfigurationError
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.plants.protocol import Machine, energy_less_work


@dataclass(frozen=True)
class Faults:
    """Faults of sensors and actuators; none by default.

    Args:
        position_noise, velocity_noise: standard deviations [rad or m, rad/s or m/s].
        position_bias, velocity_bias: of every sensor [the same].
        counts: steps of a position sensor in 2 pi rad, and so in 2 pi m; positions are rounded to them.
        delay: samples after which a measurement arrives.
        jitter: share of a sampling period by which a measurement is taken too early or too late at most.
        dropped: share of samples that never come: the one before is seen again.
        garbage: share of samples that are NaN.
        effort: largest input of every actuator [N or N m]; the loop knows it.
        dead_zone: input below which an actuator does nothing [N or N m]; the loop does not know it.
        friction: Coulomb friction that works against every actuator, with stiction [N or N m].
        slip_time: time at which the machine is pushed against its constraints [s].
        slip_speed: speed at which it slips then, along each constraint row [m/s or rad/s].
        slip_duration: for how long [s].

    Raises:
        ConfigurationError: a number that makes no sense.

    Example:
        >>> rnc.Faults(position_noise=1e-4, counts=4096, delay=2, effort=50.0).delay
        2
        >>> rnc.Faults(dropped=1.5)
        Traceback (most recent call last):
        ...
        rnc_pin.errors.ConfigurationError: fault dropped is a share, at most 1, found 1.5
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
                raise ConfigurationError(f"fault {name} has to be a number that is not negative, found {value}")
        for name in ("dropped", "garbage", "jitter"):
            if getattr(self, name) > 1:
                raise ConfigurationError(f"fault {name} is a share, at most 1, found {getattr(self, name)}")
        if self.counts == 0:
            raise ConfigurationError("fault counts has to be positive")


class FaultyMachine:
    """A machine seen through bad sensors and driven through bad actuators.

    Args:
        machine: the machine.
        faults: what is wrong with it.
        reduced: the model whose configurations and actuators they are.
        dt: sampling period, of which ``jitter`` is a share [s].
        seed: of the noise: the same numbers in the same order, whatever runs beside it.

    Raises:
        ConfigurationError: friction is asked for, and the machine has no ``set_actuator_friction``.

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> plant, faults = rnc.simulation.ReducedPlant(reduced), rnc.Faults(position_bias=0.1)
        >>> bent = rnc.plants.FaultyMachine(plant, faults, reduced, dt=0.01)
        >>> bent.reset(robot.configuration(), np.zeros(3))
        >>> (bent.read()[0] - bent.actual()[0])[:2].round(2)
        array([0.09, 0.1 ])
    """

    def __init__(self, machine: Machine, faults: Faults, reduced: ReducedModel, dt: float, seed: int = 0) -> None:
        self.machine, self.faults, self._reduced, self._dt, self._seed = machine, faults, reduced, dt, seed
        self._model = reduced.robot.model
        if faults.friction:
            if not hasattr(machine, "set_actuator_friction"):
                raise ConfigurationError(
                    f"fault friction: {type(machine).__name__} has no method 'set_actuator_friction(limit)'; "
                    "friction is part of the motion, so the plant has to integrate it"
                )
            machine.set_actuator_friction(faults.friction)
        self._forget()

    def _forget(self) -> None:
        self._time, self._generator = 0.0, np.random.default_rng(self._seed)
        self._under_way: deque[tuple[np.ndarray, np.ndarray]] = deque()
        self._slip, self._pushed = np.zeros(self._model.nv), 0.0
        self.applied = self._given = np.zeros(self._reduced.p)

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Start again, with the same noise."""
        self._forget()
        self.machine.reset(q, v)

    def actual(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,) as they are."""
        q, v = self.machine.read()
        return q, v + self._slip

    def __getattr__(self, name: str) -> Any:
        """What else the machine has to tell."""
        if name in ("friction_used", "wheel_names", "reduced"):
            return getattr(self.machine, name)
        raise AttributeError(name)

    @property
    def work(self) -> float:
        """Work done on the machine so far, by what pushes it against its constraints as well [J]."""
        done = float(self.machine.work) + self._pushed  # type: ignore[attr-defined]
        if self._slip.any():
            q, v = self.machine.read()
            moving: ReducedModel = self.machine.reduced  # type: ignore[attr-defined]
            done += float(moving.at(q, v=v + self._slip).energy - moving.at(q, v=v).energy)
        return done

    @property
    def external(self) -> np.ndarray | None:
        """Generalized forces (nv,) beside ``applied``: damping, friction, and what the actuators do not pass on."""
        inner: np.ndarray | None = self.machine.external  # type: ignore[attr-defined]
        passed = getattr(self.machine, "applied", self._given) - self.applied
        if not passed.any():
            return inner
        lost: np.ndarray = self._reduced.at(self.machine.read()[0]).B @ passed
        return lost if inner is None else inner + lost

    # ------------------------------------------------------------------ sensors

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """What sensors say; each call is one sample of theirs."""
        faults, draw = self.faults, self._generator
        q, v = self.actual()
        # Drawn whether needed or not, so that one fault's noise does not depend on the others.
        noise, chance = draw.normal(size=(2, self._model.nv)), draw.uniform(-1.0, 1.0, size=3)
        error = faults.position_noise * noise[0] + faults.position_bias + faults.jitter * self._dt * chance[0] * v
        if error.any():
            q = pin.integrate(self._model, q, error)
        if np.isfinite(faults.counts):
            q = self._counted(q)
        v = v + faults.velocity_noise * noise[1] + faults.velocity_bias
        if abs(chance[2]) < faults.garbage:
            q, v = np.full(q.shape, np.nan), np.full(v.shape, np.nan)
        if abs(chance[1]) < faults.dropped and self._under_way:
            q, v = self._under_way[-1]
        self._under_way.append((q, v))
        while len(self._under_way) > faults.delay + 1:
            self._under_way.popleft()
        q, v = self._under_way[0]
        return q.copy(), v.copy()

    def _counted(self, q: np.ndarray) -> np.ndarray:
        """A configuration on the grid of the encoders, counted from neutral."""
        step = 2.0 * np.pi / self.faults.counts
        neutral = pin.neutral(self._model)
        counted: np.ndarray = pin.integrate(
            self._model, neutral, step * np.round(pin.difference(self._model, neutral, q) / step)
        )
        return counted

    # ------------------------------------------------------------------ actuators

    def apply(self, T: np.ndarray) -> None:
        """Hold what the actuators make of these inputs; ``applied`` is as far as a loop knows."""
        faults = self.faults
        self.applied = np.clip(T, -faults.effort, faults.effort)
        given = np.where(np.abs(self.applied) < faults.dead_zone, 0.0, self.applied)
        self.machine.apply(given)
        self.applied = self.applied + (getattr(self.machine, "applied", given) - given)  # its own limits are known too
        self._given = given

    def advance(self, dt: float) -> None:
        """Let time pass [s]; where it slips, it is moved against its constraints meanwhile."""
        self.machine.advance(dt)
        begin, self._time = self._time, self._time + dt
        faults = self.faults
        slips = faults.slip_time <= begin < faults.slip_time + faults.slip_duration
        if slips and faults.slip_speed:
            q, v = self.machine.read()
            A = self._reduced.at(q).A
            self._slip = np.linalg.pinv(A) @ np.full(len(A), faults.slip_speed)
            balance = energy_less_work(self.machine)
            self.machine.reset(pin.integrate(self._model, q, dt * self._slip), v)
            self.machine.apply(self._given)
            self._pushed += energy_less_work(self.machine) - balance
        else:
            self._slip = np.zeros(self._model.nv)
