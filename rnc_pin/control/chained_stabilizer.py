"""Point stabilisation of chained systems.

A. Astolfi, "Discontinuous control of nonholonomic systems", Systems & Control Letters 27 (1996) 37-45:
for ``x1dot = u1, x2dot = u2, x3dot = x2 u1, ..., xndot = x(n-1) u1`` the coordinates ``z_i = x_i / x1^(i-2)``
are linear under ``u1 = -k x1``. So a linear law places their poles, and the state converges exponentially from every
initial state with nonzero x1.
"""

from __future__ import annotations

import numpy as np
import scipy

from rnc_pin.control.controller import Description
from rnc_pin.errors import ConfigurationError, InputError
from rnc_pin.printing import ReprMixin


class ChainedStabilizer(ReprMixin):
    """``u1 = -k x1``, ``u2 = -P z`` with poles of z placed at -rate, -1.1 rate, -1.2 rate, ...

    A common factor on both inputs keeps them below ``max_input`` and does not change the path. If x1 is zero and
    another state is not, z does not exist, and the law raises an error.

    Args:
        n: length of the chain, at least 3.
        k: decay rate of x1 [1/s].
        rate: decay rate of z [1/s]; above k, so that z decays before x1.
        max_input: largest norm of the inputs.

    Example:
        >>> stabilizer = rnc.control.ChainedStabilizer(n=3, k=0.5)
        >>> stabilizer.command(np.array([2.0, 0.0, 0.0])) + 0.0  # u1 = -k x1
        array([-1.,  0.])
        >>> u1, u2 = stabilizer.command(np.array([2.0, 0.0, 1.0]))
        >>> float(u1), bool(u2 != 0.0)
        (-1.0, True)
    """

    def __init__(self, n: int, k: float = 0.5, rate: float = 1.5, max_input: float = 1e3) -> None:
        if not max_input > 0:
            raise ConfigurationError(f"a chained stabiliser needs a positive largest input, found {max_input:g}")
        if n < 3 or not 0 < k < rate:
            raise ConfigurationError(f"a chained stabiliser needs n >= 3 and 0 < k < rate, found {n}, {k:g}, {rate:g}")
        self.n, self.k, self.rate, self.max_input = n, k, rate, max_input
        size = n - 1
        A = np.diag(k * np.arange(size, dtype=float)) - np.diag(np.full(size - 1, k), -1)
        poles = -rate * (1.0 + 0.1 * np.arange(size))
        self.P = scipy.signal.place_poles(A, np.eye(size)[:, :1], poles).gain_matrix[0]

    def describe(self) -> Description:
        """Return the rates."""
        return {
            "type": type(self).__name__,
            "n": self.n,
            "k": self.k,
            "rate": self.rate,
            "max_input": self.max_input,
        }

    def command(self, x: np.ndarray) -> np.ndarray:
        """Return (u1, u2) at a chained state x (n,).

        Raises:
            InputError: x1 is zero, or so small beside the others that z overflows.
        """
        u = self._law(x)
        return u / self._scale(u)

    def coordinates(self, x: np.ndarray) -> np.ndarray:
        """Return ``z_i = x_i / x1^(i-2)`` for i = 2..n, (n - 1,).

        Raises:
            InputError: as in ``command``.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            z = x[1:] / x[0] ** np.arange(self.n - 1)
        if not np.isfinite(z).all():
            raise InputError(f"a chained state with x1 = {x[0]:g} is outside the domain of its stabiliser: x1 = 0")
        return z

    def command_rate(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the rate of the command while the chain moves under u."""
        z = self.coordinates(x)
        powers = x[0] ** np.arange(self.n - 1)
        x_dot = np.concatenate([[u[1]], x[1:-1] * u[0]])  # of x2, x3, ..., xn
        z_dot = x_dot / powers - np.arange(self.n - 1) * z * (u[0] / x[0])
        law, rate = self._law(x), np.array([-self.k * u[0], -self.P @ z_dot])
        scale = self._scale(law)
        along = (
            law * (law @ rate) / (law @ law) if scale > 1.0 else 0.0
        )  # at the limit only the direction of a command changes
        return (rate - along) / scale

    def _law(self, x: np.ndarray) -> np.ndarray:
        """Command without its limit."""
        return np.array([-self.k * x[0], -self.P @ self.coordinates(x)])

    def _scale(self, u: np.ndarray) -> float:
        """Divisor that keeps the norm of a command within the limit, at least 1."""
        return max(1.0, float(np.linalg.norm(u)) / self.max_input)
