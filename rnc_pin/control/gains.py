"""Gains of the trackers (8)-(9) and (10): from the paper, from a bound on H, or scaled to H over a region.

Only ``scaled`` reads an inertia. ``normalised`` needs a bound on H from the user; ``paper`` needs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.control.protocol import Description, listed
from rnc_pin.errors import ConfigurationError, InfeasibleError
from rnc_pin.model.reduced_model import ReducedModel

Gain = float | np.ndarray

FASTEST = 0.2
"""Largest product of a closed-loop rate and the sampling period that the sampled tracker tolerates."""
LATEST = np.pi / 4
"""Largest product of a closed-loop rate and the age of the feedback signal: half of pi / 2."""


@dataclass(frozen=True)
class VelocityGains:
    """Gains of (10); each is a number, or one for each reducing output (r,).

    Attributes:
        k: feedback of the velocity error [force per velocity].
        beta: adaptation.
        sigma: leak of the adaptation [1/s].
        dead_zone: velocity error below which adaptation stops, as large as the velocity noise; zero in the paper
            (``control.dead_zone``).
    """

    k: Gain = 10.0
    beta: Gain = 10.0
    sigma: float = 0.1
    dead_zone: Gain = 0.0

    def describe(self) -> Description:
        """The numbers by name."""
        return {"k": listed(self.k), "beta": listed(self.beta), "sigma": self.sigma, **_zone(self.dead_zone)}

    @classmethod
    def paper(cls) -> VelocityGains:
        """K = 10, beta = 10, sigma = 0.1: paper section 4, for every system."""
        return cls()

    @classmethod
    def normalised(
        cls, bound: Gain, bandwidth: float = 4.0, sigma: float = 0.1, adaptation: float = 1.0
    ) -> VelocityGains:
        """Return gains ``K = bandwidth D`` from a known bound ``H <= D = diag(bound)`` only.

        With ``Hdot = V + V^T`` the error obeys ``d/dt (e^T H e / 2) = -e^T K e + e^T d``. Here d is the force that
        adaptation has not learnt yet. As ``e^T K e = bandwidth e^T D e >= bandwidth e^T H e``, the error decays at
        ``bandwidth`` or faster wherever the bound holds. Adaptation with ``beta = adaptation K`` preserves this
        (Lemma 3). The fastest rate is ``bandwidth D / H``, for the lightest motion. Consider a bandwidth of 4/s, twice
        the outer loop's, and a sampling period of 2 ms. The product of rate and period reaches ``FASTEST`` if H is 25
        times less than its bound. Adaptation makes the loop unstable if H is 125 times less.

        Args:
            bound: on the reduced inertia, ``diag(bound) - H >= 0`` [force per acceleration]; a number, or one for
                each reducing output (r,). For a diagonally dominant H, the absolute row sums are a bound.
            bandwidth: lowest rate of the closed loop [1/s].
            sigma: leak of the adaptation [1/s].
            adaptation: ``beta / k`` [1/s].

        Raises:
            ConfigurationError: the bound is not positive.
        """
        k = bandwidth * _positive(bound)
        return cls(k=k, beta=adaptation * k, sigma=sigma)

    @classmethod
    def scaled(
        cls,
        reduced: ReducedModel,
        configurations: np.ndarray,
        dt: float,
        bandwidth: float | None = None,
        slowest: float = 4.0,
        sigma: float = 0.1,
        outputs: np.ndarray | None = None,
        adaptation: float = 1.0,
        delay: float = 0.0,
    ) -> VelocityGains:
        """Return diagonal gains ``K = bandwidth diag(H)`` for the inertia over a region.

        The method reads the model's inertia once, beforehand; the controller never reads it. The closed velocity loop
        has rates ``eig(H^-1 K)``. They have to be slow for the sampling (rate times dt below ``FASTEST``) and fast for
        the outer loop (at least ``slowest``). These limits are a window for the bandwidth; the default is its upper
        end.

        A delay limits the rates too. The applied force is ``delay`` old, plus half a sample on average for the hold.
        With ``age = delay + dt / 2``, ``edot = -rate e(t - age)`` has solutions ``exp(s t)`` with
        ``s = -rate exp(-s age)``. The first solutions cross the imaginary axis at ``rate age = pi / 2``. The rates stay
        below half of that, ``LATEST = pi / 4``. The other half of the phase is for the outer loop and for adaptation,
        which takes ``atan(beta / k / rate)``.

        Args:
            reduced: the model.
            configurations: the region, (count, nq), e.g. along a roll-out of the reference.
            dt: sampling period [s].
            bandwidth: [rad/s]; by default the largest that the sampling allows.
            slowest: lowest accepted closed-loop rate [1/s]; about twice the outer loop's gain.
            sigma: leak of the adaptation [1/s].
            outputs: indices of the reducing outputs of these gains; all by default.
            adaptation: ``beta / k`` [1/s]. Use 30 if gravity is large for the inertia that it acts on, as at a light
                wrist: adaptation must then be as fast as the gravity force changes.
            delay: time from a measurement to the force that answers it, without sampling [s].

        Raises:
            InfeasibleError: the window is empty; the message gives its limits.
            ConfigurationError: ``bandwidth`` is outside the window, or the delay is negative.
        """
        _check_delay(delay)
        H = reduced.inertia(np.atleast_2d(configurations))
        diagonal, spread = _scaled(H if outputs is None else H[:, outputs][:, :, outputs])
        fastest = min(FASTEST / dt, LATEST / (delay + dt / 2))
        low, high = slowest * float(spread.max()), fastest * float(spread.min())
        if low > high:
            raise InfeasibleError(
                f"no velocity gains suit this region: closed-loop rates of at least {slowest:g}/s need a bandwidth of "
                f"{low:.3g} rad/s, sampling every {dt:g} s{_late(delay)} allows {high:.3g}; sample faster or keep "
                "clear of configurations where the inertia is so uneven "
                f"(eigenvalues {spread.min():.3g} to {spread.max():.3g})"
            )
        if bandwidth is not None and not low <= bandwidth <= high:
            raise ConfigurationError(f"bandwidth {bandwidth:g} rad/s is outside the window {low:.3g} to {high:.3g}")
        k = (high if bandwidth is None else bandwidth) * diagonal
        return cls(k=k, beta=adaptation * k, sigma=sigma)


@dataclass(frozen=True)
class PositionGains:
    """Gains of (8)-(9); each is a number, or one for each output (k,).

    Attributes:
        k1: gain of the filtered error w, which replaces the rate.
        k2: gain of the error.
        gamma: rate of the filter [1/s], one number.
        beta: adaptation gain.
        sigma: leak of the adaptation [1/s].
        dead_zone: error below which adaptation stops, as large as the output noise; zero in the paper.
    """

    k1: Gain = 10.0
    k2: Gain = 10.0
    gamma: float = 2.0
    beta: Gain = 10.0
    sigma: float = 0.1
    dead_zone: Gain = 0.0

    def describe(self) -> Description:
        """The numbers by name."""
        return {
            "k1": listed(self.k1),
            "k2": listed(self.k2),
            "gamma": self.gamma,
            "beta": listed(self.beta),
            "sigma": self.sigma,
            **_zone(self.dead_zone),
        }

    @classmethod
    def paper(cls) -> PositionGains:
        """k1 = k2 = 10, gamma = 2, beta = 10, sigma = 0.1: paper section 4, for every system."""
        return cls()

    @classmethod
    def normalised(cls, bound: Gain, gamma: float = 8.0, rate: float = 3.0, sigma: float = 0.1) -> PositionGains:
        """Return gains from a known bound ``H <= D = diag(bound)`` only.

        With ``k1 = kappa1 D, k2 = kappa2 D`` every motion of ``H = D / rho``, rho at least 1, has the polynomial
        ``s^3 + 2 gamma s^2 + rho (omega^2 s + 2 kappa2 gamma^3)`` with ``omega^2 = kappa1 gamma^4 + kappa2 gamma^2``.
        It is stable at every rho for ``kappa1 > 0``. Its slow root tends to ``-rate = -2 kappa2 gamma^3 / omega^2`` as
        H gets lighter. With ``omega = 4 rate`` that root is beyond ``-rate`` at the bound itself. Sampling every dt
        matters once ``rho omega^2 > gamma / dt``: at 2 ms H may be 27 times less than its bound.

        Args:
            bound: on the inertia of the outputs, ``diag(bound) - H >= 0``; a number, or one for each output (k,).
            gamma: rate of the filter [1/s].
            rate: decay rate of the error [1/s]; below ``gamma / 2``.
            sigma: leak of the adaptation [1/s].

        Raises:
            ConfigurationError: the bound is not positive, or the filter is too slow for the rate.
        """
        if not 0 < 2.0 * rate < gamma:
            raise ConfigurationError(f"gamma has to be above twice the rate {rate:g}/s, found {gamma:g}/s")
        diagonal, square = _positive(bound), (4.0 * rate) ** 2
        kappa2 = rate * square / (2.0 * gamma**3)
        kappa1 = (square - kappa2 * gamma**2) / gamma**4
        return cls(k1=kappa1 * diagonal, k2=kappa2 * diagonal, gamma=gamma, beta=1.0 * diagonal, sigma=sigma)

    @classmethod
    def scaled(
        cls,
        inertia: np.ndarray,
        dt: float,
        gamma: float = 8.0,
        rate: float = 3.0,
        sigma: float = 0.1,
        delay: float = 0.0,
    ) -> PositionGains:
        """Return diagonal gains for the inertia over a region.

        With ``k = kappa diag(H)`` the closed loop oscillates at ``omega^2 = kappa1 gamma^4 + kappa2 gamma^2``. The
        filter damps this oscillation at about ``gamma``. The zero-order hold excites it at ``omega^2 dt / 4``: half of
        omega^2 times the average age of inputs, half a sample. So omega^2 may be gamma / dt, or with a delay
        ``gamma / (dt + 2 delay)``. The error then decays at ``rate = 2 kappa2 gamma^3 / omega^2``.

        Args:
            inertia: of the outputs over the region, (count, k, k).
            dt: sampling period [s].
            gamma: rate of the filter [1/s].
            rate: decay rate of the error [1/s].
            sigma: leak of the adaptation [1/s].
            delay: time from a measurement to the force that answers it, without sampling [s].

        Raises:
            InfeasibleError: sampling is too slow for these rates; the message gives the limits.
            ConfigurationError: the delay is negative.
        """
        _check_delay(delay)
        diagonal, spread = _scaled(inertia)
        square = gamma / (dt + 2.0 * delay) * float(spread.min())
        kappa2 = rate * square / (2.0 * gamma**3)
        kappa1 = (square - kappa2 * gamma**2) / gamma**4
        if kappa1 <= 0 or square < (4.0 * rate) ** 2 * float(spread.max()):
            raise InfeasibleError(
                f"no position gains suit this region: sampling every {dt:g} s{_late(delay)} allows oscillations of "
                f"{np.sqrt(square):.3g} rad/s, a decay rate of {rate:g}/s with gamma {gamma:g} needs "
                "more; sample faster or choose a smaller rate"
            )
        return cls(k1=kappa1 * diagonal, k2=kappa2 * diagonal, gamma=gamma, beta=diagonal.copy(), sigma=sigma)


def _positive(bound: Gain) -> np.ndarray:
    """Return a bound on the inertia as an array; raise an error if it is not positive."""
    values = np.asarray(bound, dtype=float)
    if not (np.isfinite(values).all() and (values > 0).all()):
        raise ConfigurationError(f"a bound on the inertia has to be positive, found {values.tolist()}")
    return values


def _zone(dead_zone: Gain) -> Description:
    """Description of a dead zone, if there is one."""
    return {"dead_zone": listed(dead_zone)} if np.any(dead_zone) else {}


def _check_delay(delay: float) -> None:
    if not 0 <= delay < np.inf:
        raise ConfigurationError(f"delay of a loop has to be a time [s], not negative, found {delay}")


def _late(delay: float) -> str:
    return f" with a delay of {delay:g} s" if delay else ""


def _scaled(H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Typical diagonal D (k,) of inertia matrices H (count, k, k), and the eigenvalues of D^-1/2 H D^-1/2."""
    H = 0.5 * (H + H.mT)  # an effective inertia need not be symmetric
    entries = np.einsum("...ii->...i", H).reshape(-1, H.shape[-1])
    diagonal = np.sqrt(entries.min(axis=0) * entries.max(axis=0))
    scale = np.sqrt(diagonal)
    return diagonal, np.linalg.eigvalsh(H / np.multiply.outer(scale, scale))
