"""Damping of tasks that limits keep from their rates: without it, a sampled loop can oscillate between its limits.

A level minimises ``|J v - rate|^2``. If limits leave a residual rho, the gradient ``J^T rho`` turns with the
configuration q: its slope is ``N = sum_i rho_i d^2 x_i / dq^2``. The program decides the velocity at the end of a
sample, at the configuration that the velocity at the start predicts there. So in a motion n that limits leave free, one
sample of duration h multiplies a velocity by

    -h n^T N n / |J n|^2

Near a stationary point of the residual, ``|J n|`` is small. Below -1, the velocity changes its sign at every sample and
grows up to a limit. Heavy joints are slower because of their efforts; light joints reverse within a sample.

A joint that rotates about an axis with the lever ``|J_i|`` has ``|N_ii| <= |rho| |J_i|``. So the cost
``2 h |rho| |J_i| v_i^2`` bounds the factor of a joint by 1/2, at any distance of the goal. It is zero where tasks
attain their rates. Levenberg-Marquardt methods of inverse kinematics damp by the residual likewise (T. Sugihara, IEEE
Transactions on Robotics 27 (2011) 984-991).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Bool, Float

_SHARE = 2.0  # the inverse of the largest factor per sample
_ATTAINED = 1e-7  # residual, relative to the rate, that is rounding


class SampledDamping(NamedTuple):
    """Damping of all levels in one sample."""

    dt: float
    """Duration of the sample [s]."""
    motion: Float[Array, "r n"]
    """Reduced velocity at the end of the sample, per unknown of the program."""
    rest: Float[Array, " r"]
    """Value of ``motion`` times the unknowns at which the robot is at rest."""
    levers: Sequence[Float[Array, " r"]]
    """Norm of each column of the curved rows of each level on the reduced velocities, with the roots of weights."""
    curved: Sequence[Bool[Array, " k"]]
    """Masks of the rows of each level whose Jacobian depends on the configuration; a constant one has no slope N."""

    def rows(self, level: int, residual: Array, rate: Array) -> tuple[Array, Array] | None:
        """Return rows (r, n) of the damping and their desired values (r,); None if a level attains its rate.

        Args:
            level: index of the level.
            residual: residual of the level (k,) that limits cause: less the one that conflicting tasks have anyway. So
                the cost grows from zero when a limit becomes active.
            rate: its rate (k,).
        """
        residual = residual[self.curved[level]]
        size = float(np.sqrt(residual @ residual))
        if size <= _ATTAINED * (1.0 + float(np.sqrt(rate @ rate))):
            return None
        root = np.sqrt(_SHARE * self.dt * size * self.levers[level])
        return root[:, None] * self.motion, root * self.rest


def column_norms(jacobian: Float[Array, "k r"], curved: Bool[Array, " k"]) -> Float[Array, " r"]:
    """Return the norm of each column of the curved rows."""
    jacobian = jacobian[curved]
    return np.asarray(np.sqrt(np.einsum("kr,kr->r", jacobian, jacobian)))
