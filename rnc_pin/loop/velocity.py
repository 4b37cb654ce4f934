"""Velocity estimation from configurations, on the configuration manifold, with variable time steps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float


class VelocityEstimate(NamedTuple):
    """State of a velocity estimator."""

    q: Float[Array, " nq"]
    v: Float[Array, " nv"]
    """Estimated velocity."""
    other: Float[Array, " nv"]
    """Filter: output of its first stage [rad/s, m/s]. Observer: estimated acceleration [rad/s^2, m/s^2]."""


class VelocityEstimator(ABC):
    """Estimator of velocities from configurations.

    Args:
        model: Pinocchio model of the configurations.
        cutoff: cutoff frequency [rad/s].
    """

    def __init__(self, model: pin.Model, cutoff: float) -> None:
        self._model, self.cutoff = model, cutoff

    def start(self, q: Float[Array, " nq"]) -> VelocityEstimate:
        """Return the initial estimate at q: zero velocity."""
        nothing = np.zeros(self._model.nv)
        return VelocityEstimate(q, nothing, nothing)

    @abstractmethod
    def step(self, motion: VelocityEstimate, q: Float[Array, " nq"], elapsed: float) -> VelocityEstimate:
        """Return the estimate after a new measurement q.

        Args:
            motion: last estimate.
            q: measured configuration (nq,).
            elapsed: time since the last measurement [s].
        """


class FilteredVelocity(VelocityEstimator):
    """Finite differences through two first-order low-pass filters, each exact over the step. The lag is 2 / cutoff."""

    def step(self, motion: VelocityEstimate, q: np.ndarray, elapsed: float) -> VelocityEstimate:
        share = -np.expm1(-self.cutoff * elapsed)
        inner = motion.other + share * (pin.difference(self._model, motion.q, q) / elapsed - motion.other)
        return VelocityEstimate(q, motion.v + share * (inner - motion.v), inner)


class VelocityObserver(VelocityEstimator):
    """Observer of position, velocity and acceleration, without lag at constant acceleration.

    The fading-memory filter of second order (Morrison, "Introduction to Sequential Smoothing and Prediction", 1969): a
    parabola fitted to the past by least squares, with weights that decay by ``theta = exp(-cutoff dt)`` per sample.
    The observer does not use the inertia. Controllers get the measured position, not the estimated one.
    """

    def step(self, motion: VelocityEstimate, q: np.ndarray, elapsed: float) -> VelocityEstimate:
        theta = np.exp(-self.cutoff * elapsed)
        ahead = motion.v * elapsed + motion.other * (0.5 * elapsed**2)
        expected = pin.integrate(self._model, motion.q, ahead)
        miss = pin.difference(self._model, expected, q)
        v = motion.v + motion.other * elapsed + 1.5 * (1.0 - theta) ** 2 * (1.0 + theta) / elapsed * miss
        other = motion.other + (1.0 - theta) ** 3 / elapsed**2 * miss
        return VelocityEstimate(pin.integrate(self._model, expected, (1.0 - theta**3) * miss), v, other)
