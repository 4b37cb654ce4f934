"""Operations on the configuration manifold for stacks of configurations, with their derivatives."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float


class StateManifold:
    """Exponential map, its inverse and their derivatives, for stacks of configurations.

    Derivatives are along tangent vectors at each configuration, as Pinocchio defines them. A robot whose joints are all
    real numbers needs no loop.

    Args:
        model: Pinocchio's model.
    """

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self._flat = model.nq == model.nv
        self.nv = model.nv

    def integrate(self, q: Float[Array, "n nq"], step: Float[Array, "n nv"]) -> Float[Array, "n nq"]:
        """Configurations displaced by tangent vectors."""
        if self._flat:
            return q + step
        return np.array([pin.integrate(self._model, a, b) for a, b in zip(q, step, strict=True)]).reshape(q.shape)

    def integrate_derivatives(
        self, q: Float[Array, "n nq"], step: Float[Array, "n nv"]
    ) -> tuple[Float[Array, "n nv nv"], Float[Array, "n nv nv"]]:
        """Derivatives of ``integrate`` by the configuration and by the tangent vector."""
        if self._flat:
            eye = np.broadcast_to(np.eye(self.nv), (len(q), self.nv, self.nv))
            return eye, eye
        both = [pin.dIntegrate(self._model, a, b) for a, b in zip(q, step, strict=True)]
        return np.array([each[0] for each in both]), np.array([each[1] for each in both])

    def difference(self, start: Float[Array, "n nq"], end: Float[Array, "n nq"]) -> Float[Array, "n nv"]:
        """Tangent vectors at ``start`` that lead to ``end``."""
        if self._flat:
            return end - start
        found = [pin.difference(self._model, a, b) for a, b in zip(start, end, strict=True)]
        return np.array(found).reshape(len(start), self.nv)

    def difference_derivative(self, start: Float[Array, "n nq"], end: Float[Array, "n nq"]) -> Float[Array, "n nv nv"]:
        """Derivatives of ``difference`` by ``end``."""
        if self._flat:
            return np.broadcast_to(np.eye(self.nv), (len(start), self.nv, self.nv))
        return np.array([pin.dDifference(self._model, a, b)[1] for a, b in zip(start, end, strict=True)])

    def interpolate(self, start: Float[Array, " nq"], end: Float[Array, " nq"], parts: Array) -> Float[Array, "n nq"]:
        """Configurations on the geodesic between two configurations, at fractions (n,) of it."""
        return np.array([pin.interpolate(self._model, start, end, float(part)) for part in parts])
