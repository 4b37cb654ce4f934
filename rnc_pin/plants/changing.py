"""A machine that becomes another one in mid-run: a payload is taken up, an axle gets stuck."""

from __future__ import annotations

from typing import Any

import numpy as np

from rnc_pin.plants.protocol import Machine


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
        self._now, self._time = before, 0.0
        self._T: np.ndarray | None = None

    def reset(self, q: np.ndarray, v: np.ndarray) -> None:
        """Start again as the first."""
        self._now, self._time, self._T = self._before, 0.0, None
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
        if name in ("applied", "friction_used", "wheel_names"):
            return getattr(self._now, name)
        raise AttributeError(name)

    def _turn(self) -> None:
        if self._now is self._before and self._time >= self._change - 1e-9:
            q, v = self._now.read()
            self._now = self._after
            self._now.reset(q, v)
            if self._T is not None:
                self._now.apply(self._T)
