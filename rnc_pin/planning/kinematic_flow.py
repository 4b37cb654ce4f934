"""Flow of the kinematic form ``v = R(q) u`` with constant u: exact to fourth order, and its derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float, Int
from rnc_pin.model.reduced_model import ReducedModel
from rnc_pin.planning.action_models import KinematicModel, Nodes


class Shots(NamedTuple):
    """Ends of motions from several starts, and derivatives of the tangent vectors there.

    Attributes:
        q: configurations (steps + 1, k, nq).
        by_start: derivatives (k, nv, nv) by the tangent vectors at the starts.
        by_input: derivatives (k, nv, r) by the inputs.
    """

    q: Float[Array, "n k nq"]
    by_start: Float[Array, "k nv nv"]
    by_input: Float[Array, "k nv r"]


class KinematicFlow:
    """Motions ``v = R(q) u``.

    Args:
        reduced: the model; no row prescribes a motion.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        self.reduced, self._model = reduced, KinematicModel(reduced)
        self.manifold = self._model.manifold

    def step(self, q: Float[Array, "n nq"], u: Float[Array, "n r"]) -> Float[Array, "n nq"]:
        """Configurations after displacements u, by the commutator-free method of Celledoni, Marthinsen and Owren.

        Args:
            q: configurations.
            u: reduced velocities times durations.
        """
        move = self.manifold.integrate
        first = self._v(q, u)
        middle = move(q, 0.5 * first)
        second = self._v(middle, u)
        third = self._v(move(q, 0.5 * second), u)
        fourth = self._v(move(middle, third - 0.5 * first), u)
        both = 2.0 * (second + third)
        halfway = move(q, (3.0 * first + both - fourth) / 12.0)
        return move(halfway, (-first + both + 3.0 * fourth) / 12.0)

    def along(self, q: Float[Array, "k nq"], u: Float[Array, "k r"], counts: Int[Array, " k"]) -> list[Array]:
        """Configurations (count + 1, nq) along each of k motions.

        Args:
            q: starts.
            u: displacements.
            counts: numbers of equal steps.
        """
        found, each = np.repeat(q[None], counts.max() + 1, axis=0), u / counts[:, None]
        for k in range(int(counts.max())):
            going = counts > k
            found[k + 1, going] = self.step(found[k, going], each[going])
        return [found[: count + 1, k] for k, count in enumerate(counts)]

    def shots(self, q: Float[Array, "k nq"], u: Float[Array, "k r"], steps: int) -> Shots:
        """Motions by the midpoint rule, with the exact derivatives of that rule.

        Args:
            q: starts.
            u: displacements.
            steps: number of equal steps.
        """
        each, places = u / steps, [np.array(q)]
        for _ in range(steps):
            places.append(self.coarse_step(places[-1], each))
        starts = np.concatenate(places[:-1])
        found = self._model.step_derivatives(*self._unit_steps(starts, np.tile(each, (steps, 1))))
        by_q, by_u = (part.reshape(steps, len(q), self.reduced.n, -1) for part in (found.x, found.u / steps))
        by_start, by_input = by_q[0], by_u[0]
        for k in range(1, steps):
            by_start, by_input = by_q[k] @ by_start, by_q[k] @ by_input + by_u[k]
        return Shots(np.array(places), by_start, by_input)

    def coarse_step(self, q: Float[Array, "n nq"], u: Float[Array, "n r"]) -> Float[Array, "n nq"]:
        """Configurations after displacements u, by the midpoint rule.

        Args:
            q: configurations.
            u: reduced velocities times durations.
        """
        return self._model.step(*self._unit_steps(q, u)).q

    @staticmethod
    def _unit_steps(q: Array, u: Array) -> tuple[Nodes, Array, Array]:
        """Steps of one second: the velocities are the displacements."""
        return Nodes(q, np.empty((len(q), 0))), u, np.ones(len(q))

    def _v(self, q: Array, u: Array) -> Array:
        return np.asarray(self.reduced.at(q, u).v)
