"""Derivatives and linearisations: against differences of the dynamics, closed forms and published numbers."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis.derivatives import state_derivatives
from rnc_pin.analysis.differences import gradient
from systems import ALL, random_states

DIFFERENCES = 1e-8  # eighth-order differences of the dynamics themselves, relative
STEP = 1e-3


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("moving", [True, False])
def test_derivatives_are_those_of_the_dynamics(name, moving):
    """Every kind of row, joint and actuator, at states that are no equilibria."""
    reduced = ALL[name]()
    model = reduced.robot.model
    generator = np.random.default_rng(3)
    for q, v2 in random_states(reduced, 2, seed=8):
        v2 = v2 * moving
        T = generator.normal(size=reduced.p)
        found = state_derivatives(reduced, q, v2, T)

        def close(actual, expected):
            np.testing.assert_allclose(actual, expected, rtol=0, atol=DIFFERENCES * max(1.0, np.abs(expected).max()))

        close(found.v2_dot_q, gradient(model, lambda p: reduced.forward_dynamics(p, v2, T), q, STEP))
        close(found.v_q, gradient(model, lambda p: reduced.flow(p, v2, T).v, q, STEP))
        # Accelerations are quadratic in v2 and linear in T: plain central differences have no truncation error.
        close(
            found.v2_dot_v2,
            np.stack(
                [
                    (reduced.forward_dynamics(q, v2 + e, T) - reduced.forward_dynamics(q, v2 - e, T)) / 2
                    for e in np.eye(reduced.r)
                ],
                axis=-1,
            ),
        )
        close(
            found.v2_dot_T,
            np.stack(
                [reduced.forward_dynamics(q, v2, T + e) - reduced.forward_dynamics(q, v2, T) for e in np.eye(reduced.p)],
                axis=-1,
            ),
        )
