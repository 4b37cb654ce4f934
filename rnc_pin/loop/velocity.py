"""Velocities of a machine that tells positions only; on the configuration manifold, with time steps of any length."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from numpy import ndarray as Array


class VelocityEstimate(NamedTuple):
    """What an estimate remembers."""

    q: Float[Array, " nq"]
    v: Float[Array, " nv"]
    """The estimate."""
    other: Float[Array, " nv"]
    """Of a filter its inner stage [rad/s, m/s], of an observer the acceleration [rad/s^2, m/s^2]."""


class VelocityEstimator(ABC):
    """Makes velocities of configurations.

    Args:
        model: whose configurations they are.
        cutoff: [rad/s]
    """

    def __init__(self, model: pin.Model, cutoff: float) -> None:
        self._model, self.cutoff = model, cutoff

    def start(self, q: Float[Array, " nq"]) -> VelocityEstimate:
        """At rest."""
        nothing = np.zeros(self._model.nv)
        return VelocityEstimate(q, nothing, nothing)

    @abstractmethod
    def step(self, motion: VelocityEstimate, q: Float[Array, " nq"], elapsed: float) -> VelocityEstimate:
        """After another measurement, a time [s] later."""


class FilteredVelocity(VelocityEstimator):
    """Differences through two first-order filters of one cutoff, each exact over the step. They lag by 2 / cutoff."""

    def step(self, motion: VelocityEstimate, q: np.ndarray, elapsed: float) -> VelocityEstimate:
        share = -np.expm1(-self.cutoff * elapsed)
        inner = motion.other + share * (pin.difference(self._model, motion.q, q) / elapsed - motion.other)
        return VelocityEstimate(q, motion.v + share * (inner - motion.v), inner)


class VelocityObserver(VelocityEstimator):
    """A position, velocity and acceleration that follow what is measured: no lag while accelerations are steady.

    The fading-memory filter of second order (Morrison, "Introduction to Sequential Smoothing and Prediction", 1969):
    the parabola that fits the past best when its weight fades by ``theta = exp(-cutoff dt)`` a sample. No inertia is
    read. The estimated position stays inside; controllers see the measured one.
    """

    def step(self, motion: VelocityEstimate, q: np.ndarray, elapsed: float) -> VelocityEstimate:
        theta = np.exp(-self.cutoff * elapsed)
        ahead = motion.v * elapsed + motion.other * (0.5 * elapsed**2)
        expected = pin.integrate(self._model, motion.q, ahead)
        miss = pin.difference(self._model, expected, q)
        v = motion.v + motion.other * elapsed + 1.5 * (1.0 - theta) ** 2 * (1.0 + theta) / elapsed * miss
        other = motion.other + (1.0 - theta) ** 3 / elapsed**2 * miss
        return VelocityEstimate(pin.integrate(self._model, expected, (1.0 - theta**3) * miss), v, other)
