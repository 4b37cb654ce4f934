"""Seeded random states of a system, all of them regular."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

import rnc_pin as rnc

_SPREAD = 0.05  # how far configurations are from the initial one, along the tangent space [m or rad]
_TRIES = 100


class States(NamedTuple):
    """States of a system under inputs, one a row."""

    q: np.ndarray
    """Configurations (count, nq) that satisfy the holonomic rows."""
    v2: np.ndarray
    """Reduced velocities (count, r)."""
    T: np.ndarray
    """Actuator inputs (count, p)."""
    v: np.ndarray
    """Full velocities (count, nv)."""


def regular_states(reduced: rnc.ReducedModel, q0: np.ndarray, count: int, seed: int = 0) -> States:
    """Configurations near q0 (nq,), with normally distributed velocities and inputs."""
    generator = np.random.default_rng(seed)
    v2 = generator.normal(size=(count, reduced.r))
    T = generator.normal(size=(count, reduced.p))
    q = np.array([_regular_configuration(reduced, q0, generator) for _ in range(count)])
    return States(q, v2, T, reduced.terms(q, v2).v)


def _regular_configuration(reduced: rnc.ReducedModel, q0: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Drawn again where it cannot be assembled or is singular."""
    for _ in range(_TRIES):
        step = _SPREAD * generator.normal(size=reduced.robot.nv)
        try:
            q = reduced.assembled(pin.integrate(reduced.robot.model, q0, step))
            reduced.terms(q, np.zeros(reduced.r))
            return q
        except (rnc.ConstraintError, rnc.SingularityError):
            continue
    raise rnc.ConstraintError(f"none of {_TRIES} configurations near the initial one is regular")
