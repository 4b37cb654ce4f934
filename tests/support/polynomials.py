"""Polynomials of time and planar axes."""

import numpy as np


def powers(s, order):
    """Rows of a quintic's value, slope, ... at s (n,) by its coefficients: (n, 6)."""
    exponents = np.arange(6)
    factors = np.prod([exponents - k for k in range(order)], axis=0)  # zero where the power is lower than the order
    return factors * np.asarray(s)[:, None] ** np.maximum(exponents - order, 0)


def in_axes(start, goal, chart):
    """Extent along the axes' x, and the quintic y(x) (6,) between the poses, straight at both ends."""
    c, n = np.cos(chart), np.sin(chart)
    dx, dy = np.array([[c, n], [-n, c]]) @ (goal - start)[:2]
    ends = np.array([0.0, dx])
    rows = np.concatenate([powers(ends / dx, order) / dx**order for order in range(3)])
    return dx, np.linalg.solve(rows, [0.0, dy, *np.tan([start[2] - chart, goal[2] - chart]), 0.0, 0.0])
