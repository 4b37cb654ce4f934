"""Feedback gains along a motion from the Riccati recursion."""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from rnc_pin.array_shapes import Float
from rnc_pin.optimal.linear_quadratic import LinearQuadratic, RiccatiFactors
from rnc_pin.optimal.transcription import Iterate, Transcription

_GOAL, _BOUND = 1e2, 1e6
"""Weights of the goal and of active bounds of inputs, relative to the cost of typical inputs."""
_ACTIVE = 1e-3  # distance from a limit that counts as active, in typical sizes


def feedback_gains(problem: Transcription, at: Iterate) -> Float[Array, "K nu nx"]:
    """Gains of ``u + K dx`` with the costs of a problem, about a motion.

    Deviations at the goal have a finite weight. Inputs at a bound have none to give: their feedback vanishes.
    """
    fixed = Transcription(
        problem.model,
        problem.start,
        problem.K,
        problem.costs,
        problem.bounds,
        problem.goal,
        (at.duration, at.duration),
    )
    fixed.begin = problem.begin
    linear, _ = fixed.linearize(at)
    return gains_of(linear)


def gains_of(linear: LinearQuadratic) -> Float[Array, "K nu nx"]:
    """Gains of a subproblem at its current motion."""
    N, nx, nu = linear.B.shape
    inputs, (rows, _) = linear.input_scales, linear.typical_sizes
    scale = np.concatenate([np.ones((N, nx)), inputs], axis=1)
    H = linear.H * scale[:, :, None] * scale[:, None, :]
    H[:, np.arange(nx, nx + nu), np.arange(nx, nx + nu)] += 1e-6
    D = linear.D[:-1] * inputs[:, None, :] / rows[:-1, :, None]
    active = (np.minimum(linear.upper, -linear.lower) / rows)[:-1] < _ACTIVE
    of_input = np.concatenate([np.zeros((*D.shape[:2], nx)), D], axis=2) * active[:, :, None]
    H = H + _BOUND * of_input.mT @ of_input
    equal = linear.lower[-1] == linear.upper[-1]
    C = linear.C[-1, equal] / rows[-1, equal, None]
    AB = np.concatenate([linear.A, linear.B * inputs[:, None, :]], axis=2)
    factors = RiccatiFactors(AB, H, linear.H_end + _GOAL * C.T @ C)
    return inputs[:, :, None] * factors.K
