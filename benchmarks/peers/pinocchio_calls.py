"""Pinocchio's own constrained forward dynamics: one call of its library for a state.

``forwardDynamics`` takes constraint rows and their bias accelerations as known. ``constraintDynamics`` has rigid
contacts and closed loops only, so it meets systems without other rows.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from benchmarks.peers.cases import Case
from benchmarks.peers.peer import Peer, forces
from benchmarks.states import States


def peers(case: Case, states: States) -> list[Peer]:
    """The calls that can express the system."""
    found = [kkt(case, states)]
    if case.free:
        found.append(contacts(case, states))
    return found


def kkt(case: Case, states: States) -> Peer:
    """Solution of the KKT system, rows given; momenta need no rows, because nothing reacts."""
    model, data = case.model, case.model.createData()
    terms = case.reduced.terms(states.q, states.v2)
    rows = terms.A[:, : 0 if case.free else None]
    drift = (terms.A_dot[:, : rows.shape[1]] @ terms.v[..., None])[..., 0]
    each = list(zip(states.q, states.v, forces(case, states), rows, drift, strict=True))

    return _peer("Pinocchio forwardDynamics", partial(pin.forwardDynamics, model, data), each)


def contacts(case: Case, states: States) -> Peer:
    """The proximal method without contacts."""
    model, data = case.model, case.model.createData()
    each = list(zip(states.q, states.v, forces(case, states), strict=True))
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    settings = pin.ProximalSettings(1e-12, 0.0, 1)
    pin.initConstraintDynamics(model, data, models, datas)

    def forward(*state: np.ndarray) -> np.ndarray:
        return pin.constraintDynamics(model, data, *state, models, datas, settings)

    return _peer("Pinocchio constraintDynamics", forward, each)


def _peer(name: str, forward: Callable[..., np.ndarray], each: list[tuple[np.ndarray, ...]]) -> Peer:
    return Peer(name, forward, each, lambda: np.array([forward(*state).copy() for state in each]))
