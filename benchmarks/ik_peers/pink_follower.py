"""pink: its ``RollingTask`` of both wheels as equality constraints, or as costs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pink
import pinocchio as pin
from pink.tasks import DampingTask, FrameTask, RollingTask

from benchmarks.ik_peers.hand_path import DAMPING, DT, GAIN, HAND, RADIUS, ROLLING, WHEELS, Case, Follower, Motion


def followers(given: Case) -> list[Follower]:
    """Equalities with our gain and with its default gain of one a sample, and costs."""
    return [
        _Pink(given, GAIN * DT, equalities=True),
        _Pink(given, 1.0, equalities=True),
        _Pink(given, 1.0, equalities=False),
    ]


class _Pink:
    def __init__(self, given: Case, gain: float, equalities: bool) -> None:
        self.name = f"pink {pink.__version__}, gain {gain:g} a sample"
        self.rolling = "equalities" if equalities else "costs"
        self._reference = given.reference
        self._at = pink.Configuration(given.robot.model, given.robot.model.createData(), given.q0)
        self._hand = FrameTask(HAND, position_cost=1.0, orientation_cost=0.0, gain=gain)
        rolling = [RollingTask(f"{wheel}_link", "universe", RADIUS, cost=np.sqrt(ROLLING)) for wheel in WHEELS]
        self._tasks: Sequence[pink.Task] = [self._hand, DampingTask(cost=np.sqrt(DAMPING))]
        self._constraints: Sequence[pink.Task] = rolling
        if not equalities:
            self._tasks, self._constraints = [*self._tasks, *rolling], []

    def command(self, t: float) -> None:
        self._at.update(self._at.q)
        self._hand.set_target(pin.SE3(np.eye(3), self._reference.at(t + DT).position))
        self._v = pink.solve_ik(self._at, self._tasks, DT, solver="daqp", constraints=self._constraints)

    def motion(self, elapsed: float) -> Motion:
        return Motion(pin.integrate(self._at.model, self._at.q, elapsed * self._v), self._v)

    def advance(self) -> None:
        self._at.q = pin.integrate(self._at.model, self._at.q, DT * self._v)
