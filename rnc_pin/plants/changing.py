"""Plant that changes during a run: it picks up a payload, or an axle locks."""

from __future__ import annotations

from typing import Any

import numpy as np

from rnc_pin.plants.plant import Plant, energy_minus_work


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
        """Restart with the first plant."""
        self._current, self._time, self._T, self._switch_energy = self._before, 0.0, None, 0.0
        self._current.reset(q, v)
        self._switch_if_due()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return configuration (nq,) and velocity (nv,)."""
        return self._current.read()

    def apply(self, T: np.ndarray) -> None:
        """Apply inputs (p,) until the next call."""
        self._T = T
        self._current.apply(T)

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s]. The switch happens at the end of the step that reaches its time."""
        self._current.advance(dt)
        self._time += dt
        self._switch_if_due()

    def __getattr__(self, name: str) -> Any:
        """Forward optional attributes to the current plant."""
        if name in ("applied", "friction_used", "wheel_names", "reduced", "external", "takes_velocities", "effort"):
            return getattr(self._current, name)
        raise AttributeError(name)

    @property
    def work(self) -> float:
        """Work done so far [J], including the switch: a payload adds energy, an impact removes some."""
        return float(self._current.work) + self._switch_energy  # type: ignore[attr-defined]

    def set_actuator_friction(self, limit: float) -> None:
        """Set the Coulomb friction of every actuator in both plants [N or N m]."""
        for plant in (self._before, self._after):
            plant.set_actuator_friction(limit)  # type: ignore[attr-defined]

    def _switch_if_due(self) -> None:
        if self._current is self._before and self._time >= self._switch_time - 1e-9:
            q, v = self._current.read()
            balance = energy_minus_work(self._current)
            self._current = self._after
            self._current.reset(q, v)
            if self._T is not None:
                self._current.apply(self._T)
            self._switch_energy += energy_minus_work(self._current) - balance
