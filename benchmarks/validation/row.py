"""One comparison."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

DATA = Path(__file__).parents[2] / "tests" / "data"

# Tolerances, relative to the published quantity unless a row says otherwise.
MATRIX = 1e-9
EIGENVALUE = 1e-8
MOTION = 1e-8
INVARIANT = 1e-9


@dataclass(frozen=True)
class Row:
    """A quantity, as published or in closed form, and as computed here.

    Attributes:
        source: who published it, or which formula it is.
        quantity: what is compared.
        published: number or array.
        ours: the same, from a live run.
        tolerance: largest difference, relative to the largest entry of ``published``.
        scale: what to measure the difference by where ``published`` is zero.
    """

    source: str
    quantity: str
    published: ArrayLike
    ours: ArrayLike
    tolerance: float
    scale: float | None = None

    @property
    def difference(self) -> float:
        """Largest difference of an entry, relative."""
        published, ours = np.asarray(self.published), np.asarray(self.ours)
        assert published.shape == ours.shape, f"{self.quantity}: {published.shape} against {ours.shape}"
        return float(np.abs(ours - published).max() / (self.scale or np.abs(published).max()))

    @property
    def holds(self) -> bool:
        """True if the difference is within the tolerance."""
        return self.difference <= self.tolerance


def conserved(quantity: str, drift: float) -> Row:
    """Row of a quantity that a motion keeps, such as its energy: the change, relative to the quantity itself."""
    return Row("conservation", f"{quantity}, relative", 0.0, drift, INVARIANT, 1.0)
