"""Signed distances of pairs of shapes, with nearest points and rates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rnc_pin.array_shapes import Float, Int


@dataclass(frozen=True)
class PairDistances:
    """Distances of k pairs at one configuration and time.

    Attributes:
        pairs: indices of the pairs in ``CollisionDistances.pairs``, each once unless corners were asked for.
        distance: signed distances [m]; negative for penetration: minus the shortest translation that separates.
        point_a: nearest points of the first bodies, in the world [m].
        point_b: nearest points of the second bodies, in the world [m].
        normal: unit vectors from the first to the second body, ``point_b - point_a = distance * normal``.
        jacobian: rows of the rates: ``d_dot = jacobian @ v + drift``.
        drift: part of the rates that the prescribed motion of obstacles causes [m/s].
    """

    pairs: Int[np.ndarray, " k"]
    distance: Float[np.ndarray, " k"]
    point_a: Float[np.ndarray, "k 3"]
    point_b: Float[np.ndarray, "k 3"]
    normal: Float[np.ndarray, "k 3"]
    jacobian: Float[np.ndarray, "k nv"]
    drift: Float[np.ndarray, " k"]

    def __post_init__(self) -> None:
        for array in vars(self).values():
            array.flags.writeable = False

    def rates(self, v: np.ndarray) -> np.ndarray:
        """Rates (k,) of the distances [m/s] at a velocity v (nv,)."""
        return np.asarray(self.jacobian @ v + self.drift)
