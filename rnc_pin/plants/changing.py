"""Plant that changes during a run: it picks up a payload, or an axle locks."""

from __future__ import annotations

from typing import Any

import numpy as np

from rnc_pin.plants.protocol import Machine, energy_less_work


class ChangingMachine:
    """Plant that switches from one plant to another at a given time, at the same state.

    Args:
        before, after: plants with the same configurations and actuators. Velocity that violates the constraints of
            ``after`` vanishes at the switch, as in an inelastic impact.
        time: time of the switch [s].

    Example:
        >>> robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
        >>> sliding = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh")]).reduce()
        >>> locked = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("sleigh"), rnc.NoSideSlip("sleigh", axis="x")])
        >>> plants = [rnc.simulation.ReducedPlant(each) for each in (sliding, locked.reduce())]
        >>> machine = rnc.plants.ChangingMachine(*plants, time=0.1)
        >>> machine.reset(robot.configuration(), np.array([1.0, 0.0, 0.0]))
        >>> machine.advance(0.1), machine.advance(0.1)
        (None, None)
        >>> machine.read()[0][0].round(3)  # a metre a second, for a tenth of a second
        np.float64(0.1)
    """

    def __init__(self, before: Machine, after: Machine, time: float) -> None:
        self._before, self._after, self._change = before, after, time
        self._now, self._time, self._shifted = before, 0.0, 0.0
        self._T: np.ndarray | None = None

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Restart with the first plant."""
        self._now, self._time, self._T, self._shifted = self._before, 0.0, None, 0.0
        self._now.reset(q, v)
        self._turn()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Return configuration (nq,) and velocity (nv,)."""
        return self._now.read()

    def apply(self, T: np.ndarray) -> None:
        """Apply inputs (p,) until the next call."""
        self._T = T
        self._now.apply(T)

    def advance(self, dt: float) -> None:
        """Advance the time by dt [s]. The switch happens at the end of the step that reaches its time."""
        self._now.advance(dt)
        self._time += dt
        self._turn()

    def __getattr__(self, name: str) -> Any:
        """Forward optional attributes to the current plant."""
        if name in ("applied", "friction_used", "wheel_names", "reduced", "external"):
            return getattr(self._now, name)
        raise AttributeError(name)

    @property
    def work(self) -> float:
        """Work done so far [J], including the switch: a payload adds energy, an impact removes some."""
        return float(self._now.work) + self._shifted  # type: ignore[attr-defined]

    def set_actuator_friction(self, limit: float) -> None:
        """Set the Coulomb friction of every actuator in both plants [N or N m]."""
        for machine in (self._before, self._after):
            machine.set_actuator_friction(limit)  # type: ignore[attr-defined]

    def _turn(self) -> None:
        if self._now is self._before and self._time >= self._change - 1e-9:
            q, v = self._now.read()
            balance = energy_less_work(self._now)
            self._now = self._after
            self._now.reset(q, v)
            if self._T is not None:
                self._now.apply(self._T)
            self._shifted += energy_less_work(self._now) - balance
