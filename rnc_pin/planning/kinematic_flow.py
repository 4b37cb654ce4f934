"""Flow of the kinematic form ``v = R(q) u`` with constant u: exact to fourth order, and its derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.analysis.derivatives import StateDerivatives, state_derivatives
from rnc_pin.array_shapes import Float
from rnc_pin.model.configuration_manifold import ConfigurationManifold
from rnc_pin.model.reduced_model import ReducedModel


class FlowSensitivity(NamedTuple):
    """Configurations (k + 1, nq) along inputs, and derivatives (nv, k, r) of the tangent vector at the end by them."""

    q: Float[Array, "n nq"]
    end: Float[Array, "nv k r"]


class KinematicFlow:
    """Motions ``v = R(q) u``.

    Args:
        reduced: the model; no row prescribes a motion.
    """

    def __init__(self, reduced: ReducedModel) -> None:
        self.reduced, self.manifold = reduced, ConfigurationManifold(reduced.robot.model)

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

    def along(self, q: Float[Array, " nq"], u: Float[Array, "k r"]) -> Float[Array, "n nq"]:
        """Configurations (k + 1, nq) along displacements."""
        found = [np.array(q)[None]]
        for each in u:
            found.append(self.step(found[-1], each[None]))
        return np.concatenate(found)

    def sensitivity(self, q: Float[Array, " nq"], u: Float[Array, "k r"]) -> FlowSensitivity:
        """Configurations along displacements by the midpoint rule, with the exact derivatives of that rule."""
        model, nv = self.reduced.robot.model, self.reduced.n
        places, middles, moved = [np.array(q)[None]], [], []
        for each in u:
            start, half, v = self._midpoint(places[-1], each[None])
            moved.append((0.5 * start[0], v[0]))
            middles.append(half)
            places.append(self.manifold.integrate(places[-1], v))
        q_all = np.concatenate(places)
        first, second = self._derivatives(q_all[:-1], u), self._derivatives(np.concatenate(middles), u)
        end, after = np.zeros((nv, len(u), self.reduced.r)), np.eye(nv)
        for k in reversed(range(len(u))):
            turned, pushed = pin.dIntegrate(model, q_all[k], moved[k][0])
            v_q = second.v_q[k] @ (turned + 0.5 * pushed @ first.v_q[k])
            v_u = second.v_v2[k] + 0.5 * second.v_q[k] @ pushed @ first.v_v2[k]
            turned, pushed = pin.dIntegrate(model, q_all[k], moved[k][1])
            end[:, k] = after @ pushed @ v_u
            after = after @ (turned + pushed @ v_q)
        return FlowSensitivity(q_all, end)

    def coarse_step(self, q: Float[Array, "n nq"], u: Float[Array, "n r"]) -> Float[Array, "n nq"]:
        """Configurations after displacements u, by the midpoint rule.

        Args:
            q: configurations.
            u: reduced velocities times durations.
        """
        return self.manifold.integrate(q, self._midpoint(q, u)[2])

    def _midpoint(self, q: Array, u: Array) -> tuple[Array, Array, Array]:
        """Displacements at the start, configurations halfway, and displacements there."""
        start = self._v(q, u)
        half = self.manifold.integrate(q, 0.5 * start)
        return start, half, self._v(half, u)

    def _v(self, q: Array, u: Array) -> Array:
        return np.asarray(self.reduced.at(q, u).v)

    def _derivatives(self, q: Array, u: Array) -> StateDerivatives:
        return state_derivatives(self.reduced, q, u, np.zeros((len(q), self.reduced.p)))
