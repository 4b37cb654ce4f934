"""``VelocityQP`` of this package: rolling is exact, because the unknowns are reduced velocities."""

from __future__ import annotations

import numpy as np

import rnc_pin as rnc
from benchmarks.ik_peers.hand_path import DAMPING, DT, GAIN, HAND, Case, Follower, Motion
from rnc_pin.control import VelocityQP, limits, tasks
from rnc_pin.model.integrators import LieRungeKutta4


def followers(given: Case) -> list[Follower]:
    """Programs with the limits of the robot's file: our gain, and that of an error that is gone after one sample."""
    return [_Program(given, GAIN), _Program(given, 1.0 / DT)]


class _Program:
    def __init__(self, given: Case, gain: float) -> None:
        self.name, self.rolling = f"rnc_pin {rnc.__version__}, gain {gain * DT:g} a sample", "reduced velocities"
        hand = tasks.OutputTask(rnc.FramePosition(HAND), given.reference, gain=gain)
        still = tasks.DampingTask(given.joints, weight=DAMPING)
        of_file = [limits.JointPositionLimit(), limits.JointVelocityLimit()]
        self._reduced, self._q = given.reduced, given.q0
        self._program = VelocityQP(given.reduced, [hand, still], of_file, dt=DT)
        self._state = self._program.initial_state(given.reduced.at(given.q0, np.zeros(given.reduced.r)).measure())
        self._integrator = LieRungeKutta4(given.robot)

    def command(self, t: float) -> None:
        self._target, self._state = self._program.step(t, rnc.Measurement(q=self._q), self._state)

    def motion(self, elapsed: float) -> Motion:
        v2, v2_dot = self._target.v2, self._target.v2_dot

        def rate(q: np.ndarray, passed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self._reduced.at(q, v2 + passed[0] * v2_dot).v, np.ones(1)

        q = self._integrator.step(rate, self._q, np.zeros(1), elapsed)[0] if elapsed else self._q
        return Motion(q, self._reduced.at(q, v2 + elapsed * v2_dot).v)

    def advance(self) -> None:
        self._q = self.motion(DT).q
