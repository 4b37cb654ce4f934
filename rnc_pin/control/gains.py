"""Gains of the velocity tracker (10): the paper's, and gains scaled to the inertia of a region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import ConfigurationError
from rnc_pin.reduction import ReducedModel

Gain = float | np.ndarray

FASTEST = 0.2
"""Largest product of a closed-loop rate and the sampling period that the sampled tracker tolerates."""


@dataclass(frozen=True)
class VelocityGains:
    """Gains of (10); numbers, or one for each reducing output (r,).

    Attributes:
        k: feedback of the velocity error [force per velocity].
        beta: adaptation.
        sigma: leak of the adaptation [1/s].
    """

    k: Gain = 10.0
    beta: Gain = 10.0
    sigma: float = 0.1

    @classmethod
    def paper(cls) -> VelocityGains:
        """K = 10, beta = 10, sigma = 0.1: paper section 4, for every system."""
        return cls()

    @classmethod
    def scaled(
        cls,
        reduced: ReducedModel,
        configurations: np.ndarray,
        dt: float,
        bandwidth: float | None = None,
        slowest: float = 4.0,
        sigma: float = 0.1,
    ) -> VelocityGains:
        """Diagonal gains ``K = bandwidth diag(H)`` that suit the inertia over a region.

        This reads the model's inertia, once and beforehand; the controller itself never does. The closed
        velocity loop has rates ``eig(H^-1 K)``. They have to be slow for the sampling (rate times dt
        below ``FASTEST``) and fast for the outer loop (at least ``slowest``); the bandwidth is chosen in
        this window, at its upper end unless one is asked for.

        Args:
            reduced: the model.
            configurations: the region, (count, nq), e.g. along a roll-out of the reference.
            dt: sampling period [s].
            bandwidth: [rad/s]; by default the largest that the sampling allows.
            slowest: lowest closed-loop rate accepted [1/s]; about twice the outer loop's gain.
            sigma: leak of the adaptation [1/s].

        Raises:
            ConfigurationError: the window is empty, or ``bandwidth`` is outside it; says the figures.
        """
        H = reduced.inertia(np.atleast_2d(configurations))
        diagonal = np.sqrt(np.einsum("...ii->...i", H).min(axis=0) * np.einsum("...ii->...i", H).max(axis=0))
        scale = np.sqrt(diagonal)
        # eig(H^-1 D) = 1 / eig(D^-1/2 H D^-1/2)
        spread = np.linalg.eigvalsh(H / np.multiply.outer(scale, scale))
        low, high = slowest * float(spread.max()), FASTEST / dt * float(spread.min())
        if low > high:
            raise ConfigurationError(
                f"no velocity gains suit this region: closed-loop rates of at least {slowest:g}/s need a bandwidth of "
                f"{low:.3g} rad/s, sampling every {dt:g} s allows {high:.3g}; sample faster or keep clear of "
                f"configurations where the inertia is so uneven (eigenvalues {spread.min():.3g} to {spread.max():.3g})"
            )
        if bandwidth is not None and not low <= bandwidth <= high:
            raise ConfigurationError(f"bandwidth {bandwidth:g} rad/s is outside the window {low:.3g} to {high:.3g}")
        k = (high if bandwidth is None else bandwidth) * diagonal
        return cls(k=k, beta=k.copy(), sigma=sigma)
