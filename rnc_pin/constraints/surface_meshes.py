"""Triangles of surfaces, for drawings."""

from __future__ import annotations

import numpy as np


def grid_triangles(rows: int, columns: int) -> np.ndarray:
    """Triangles (m, 3) of a grid of vertices that is stored by rows."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return np.concatenate(
        [
            np.stack([first, first + 1, first + columns], 1),
            np.stack([first + 1, first + columns + 1, first + columns], 1),
        ]
    )
