"""Margins inside second-order cones, beside a solver for smooth programs."""

import numpy as np
from scipy.optimize import minimize

from rnc_pin.math.convex_programs import cone_margin, least_shares


def vectors(count=12, m=4, k=3, d=2):
    """Random vectors, and their orthonormal directions."""
    generator = np.random.default_rng(5)
    offset = 0.3 * generator.normal(size=(count, m, k))
    offset[:, :, 0] += 1.0
    gain = np.linalg.qr(generator.normal(size=(count, m * k, d)))[0].reshape(count, m, k, d)
    return offset, gain, generator.uniform(0.5, 2.0, size=(count, m))


def largest(offset, gain, weights):
    """Largest margin of one program."""

    def room(x):
        c = offset + gain @ x[:-1]
        return c[:, 0] - np.sqrt((c[:, 1:] ** 2).sum(axis=1) + 1e-20) - x[-1] * weights

    start = np.append(np.zeros(gain.shape[2]), -5.0)
    options = {"ftol": 1e-13, "maxiter": 500}
    limits = [{"type": "ineq", "fun": room}]
    found = minimize(lambda x: -x[-1], start, constraints=limits, method="SLSQP", options=options)
    return found.x[-1]


def test_the_largest_margin_is_that_of_another_solver():
    offset, gain, weights = vectors()
    margin, _ = cone_margin(offset, gain, weights)
    expected = [largest(*each) for each in zip(offset, gain, weights, strict=True)]
    np.testing.assert_allclose(margin, expected, atol=1e-6)


def test_margins_that_grow_without_bound_end():
    margin, _ = cone_margin(np.array([[[1.0, 0.5]]]), np.array([[[[1.0], [0.0]]]]))
    np.testing.assert_allclose(margin, [10.0], rtol=1e-9)


def test_a_least_share_has_no_margin():
    offset, gain, weights = vectors()
    friction = weights[0]
    shares = least_shares(offset, gain, friction)
    worst = shares.max(axis=1)
    axis = np.ones(offset.shape)
    axis[:, :, 0] = friction * worst[:, None]
    np.testing.assert_allclose(cone_margin(axis * offset, axis[..., None] * gain)[0], 0.0, atol=1e-7)
