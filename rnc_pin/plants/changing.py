"""A machine that becomes another one in mid-run: a payload is taken up, an axle gets stuck."""

from __future__ import annotations

from typing import Any

import numpy as np

from rnc_pin.plants.protocol import Machine, energy_less_work


class ChangingMachine:
    """One machine up to some time, and another from there on, at the same state.

    Args:
        before, after: the machines, with the same configurations and actuators. What motion the second cannot have is
            gone at once, as in an impact.
        time: when [s].

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
        """Start again as the first."""
        self._now, self._time, self._T, self._shifted = self._before, 0.0, None, 0.0
        self._now.reset(q, v)
        self._turn()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Configuration (nq,) and velocity (nv,)."""
        return self._now.read()

    def apply(self, T: np.ndarray) -> None:
        """Hold these inputs (p,)."""
        self._T = T
        self._now.apply(T)

    def advance(self, dt: float) -> None:
        """Let time pass [s]; the change is at the end of the step that reaches its time."""
        self._now.advance(dt)
        self._time += dt
        self._turn()

    def __getattr__(self, name: str) -> Any:
        """What else the machine has to tell."""
        if name in ("applied", "friction_used", "wheel_names", "reduced", "external"):
            return getattr(self._now, name)
        raise AttributeError(name)

    @property
    def work(self) -> float:
        """Done so far, the change itself included: a load brings the energy that it has, an impact takes some [J]."""
        return float(self._now.work) + self._shifted  # type: ignore[attr-defined]

    def set_actuator_friction(self, limit: float) -> None:
        """Let dry friction of this size work against every actuator of both [N or N m]."""
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
