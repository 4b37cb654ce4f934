"""Chained form of the fire truck, paper (22), with its coordinate and input maps.

Proved symbolically (wheel bases L1, L2): with ``v1 = u cos theta1``,

    z0 = x     x2 = y     x1 = tan theta1     x0 = tan phi1 / (L1 cos^3 theta1)
    y1 = theta2           y0 = -sin(theta2 - theta1 + phi2) / (L2 cos phi2 cos theta1)

and ``z0dot = v1, x0dot = v2, x1dot = x0 v1, x2dot = x1 v1, y0dot = v3, y1dot = y0 v1``. Valid while headings,
steering angles and the hitch angle stay within 90 degrees. Without the trailer's y1 and y0 it is the form of a car.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.errors import InputError

_LIMIT = np.pi / 2


@dataclass(frozen=True)
class FireTruckChart:
    """Maps between (x, y, theta1, phi1, theta2, phi2), inputs (u, phi1_dot, phi2_dot), and the chained form.

    Args:
        L1: tractor's wheel base [m].
        L2: kingpin to the trailer's axle [m].

    Example:
        >>> chart = rnc.planning.FireTruckChart(L1=2.0, L2=1.0)
        >>> state = np.array([1.0, 2.0, 0.0, np.arctan(0.5), 0.0, 0.0])
        >>> chart.to_chain(state) + 0.0  # x0 = tan(phi1) / L1 = 0.25
        array([1.  , 0.25, 0.  , 2.  , 0.  , 0.  ])
        >>> bool(np.allclose(chart.from_chain(chart.to_chain(state)), state))
        True
    """

    L1: float = 1.0
    L2: float = 1.0

    def to_chain(self, state: np.ndarray) -> np.ndarray:
        """Return (z0, x0, x1, x2, y0, y1) for (x, y, theta1, phi1, theta2, phi2).

        Raises:
            InputError: an angle is outside the chart.
        """
        x, y, theta1, phi1, theta2, phi2 = state
        if max(abs(theta1), abs(phi1), abs(phi2), abs(theta2 - theta1)) >= _LIMIT:
            raise InputError("a heading, steering or hitch angle is not within 90 degrees: outside the chained form")
        c = np.cos(theta1)
        y0 = -np.sin(theta2 - theta1 + phi2) / (self.L2 * np.cos(phi2) * c)
        return np.array([x, np.tan(phi1) / (self.L1 * c**3), np.tan(theta1), y, y0, theta2])

    def from_chain(self, chain: np.ndarray) -> np.ndarray:
        """Return (x, y, theta1, phi1, theta2, phi2) for (z0, x0, x1, x2, y0, y1)."""
        z0, x0, x1, x2, y0, y1 = chain
        theta1 = np.arctan(x1)
        c, hitch = np.cos(theta1), y1 - theta1
        # sin(hitch + phi2) / cos phi2 = sin hitch + cos hitch tan phi2
        phi2 = np.arctan((-y0 * self.L2 * c - np.sin(hitch)) / np.cos(hitch))
        return np.array([z0, x2, theta1, np.arctan(x0 * self.L1 * c**3), y1, phi2])

    def to_inputs(self, state: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return (u, phi1_dot, phi2_dot) for the inputs (v1, v2, v3) of the chained form."""
        _, _, theta1, phi1, theta2, phi2 = state
        u = v[0] / np.cos(theta1)
        theta1_dot = u * np.tan(phi1) / self.L1
        theta2_dot = -u * np.sin(theta2 - theta1 + phi2) / (self.L2 * np.cos(phi2))
        c, s = np.cos(theta1), np.sin(theta1)
        x0_theta1 = 3 * np.tan(phi1) * s / (self.L1 * c**4)
        phi1_dot = (v[1] - x0_theta1 * theta1_dot) * self.L1 * c**3 * np.cos(phi1) ** 2
        hitch, hitch_dot = theta2 - theta1, theta2_dot - theta1_dot
        # y0 = -(sin hitch + cos hitch tan phi2) / (L2 cos theta1)
        numerator = np.sin(hitch) + np.cos(hitch) * np.tan(phi2)
        by_hitch = (np.cos(hitch) - np.sin(hitch) * np.tan(phi2)) * hitch_dot
        rest = -v[2] * self.L2 * c - by_hitch - numerator * s / c * theta1_dot
        return np.array([u, phi1_dot, rest / np.cos(hitch) * np.cos(phi2) ** 2])
