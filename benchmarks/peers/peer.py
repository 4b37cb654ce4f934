"""A peer: another way to compute the accelerations of a system at given states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.peers.cases import Case
from benchmarks.states import States


@dataclass(frozen=True)
class Peer:
    """Accelerations of a system at some states, computed by others.

    Attributes:
        name: short name.
        forward: one call for a state, whose time counts.
        states: its arguments at each state.
        v_dot: full accelerations (count, entries) at the states in the conventions of Pinocchio.
        first: first entry of v that ``v_dot`` has.
    """

    name: str
    forward: Callable[..., object]
    states: Sequence[tuple[Any, ...]]
    v_dot: Callable[[], np.ndarray]
    first: int = 0

    def run(self) -> None:
        """One pass through all states."""
        for state in self.states:
            self.forward(*state)

    def difference(self, case: Case, states: States) -> float:
        """Largest difference of an acceleration from ours, relative to the largest acceleration."""
        ours = full_accelerations(case, states)[:, self.first :]
        return float(np.abs(self.v_dot() - ours).max() / np.abs(ours).max())


def full_accelerations(case: Case, states: States) -> np.ndarray:
    """Our accelerations (count, nv)."""
    at = case.reduced.at(states.q, states.v2)
    return at.v_dot(at.v2_dot(states.T))


def forces(case: Case, states: States) -> np.ndarray:
    """Generalized forces (count, nv) of the inputs."""
    return np.asarray((case.reduced.at(states.q).B @ states.T[..., None])[..., 0])
