"""Descent on slides: closed forms of its bounds and of its ends."""

import numpy as np
import pinocchio as pin
import pytest
import scipy

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.planning.bounded_descent import Residuals, TangentBounds, descend


def slides(kinds):
    """Model of joints of one or three slides."""
    model = pin.Model()
    for k, kind in enumerate(kinds):
        add_body(model, f"joint_{k}", kind, 1.0, k)
    return rnc.Robot(model).model


def linear(J, goal):
    """Residuals of ``J q = goal`` without equalities."""
    nothing = np.zeros((0, J.shape[1]))
    return lambda q: Residuals(goal - J @ q, J, nothing[:, 0], nothing)


def test_each_of_three_slides_stops_at_its_own_limit():
    """Behind a ball, so that places in q and in v differ. The nearest point of a box is its clipped goal."""
    model = slides([pin.JointModelSpherical(), pin.JointModelPX(), pin.JointModelTranslation()])
    high = np.array([np.inf, np.inf, np.inf, np.inf, 0.5, 0.1, 0.2, 0.3])
    bounds = TangentBounds(model, -high, high, np.zeros(7, dtype=bool))
    assert bounds.v_index.tolist() == [3, 4, 5, 6]
    goal = np.array([0.4, 3.0, -2.0, 0.25])
    J = np.eye(7)[3:]
    nothing = np.zeros((0, 7))

    def evaluate(q):
        return Residuals(goal - q[4:], J, nothing[:, 0], nothing)

    found = descend(evaluate, bounds, pin.neutral(model))
    np.testing.assert_allclose(found.q[4:], [0.4, 0.1, -0.2, 0.25], atol=1e-9)
    assert found.error == pytest.approx(np.hypot(2.9, 1.8), abs=1e-9)


def test_bounds_of_coupled_joints_satisfy_the_conditions_of_optimality():
    model = slides([pin.JointModelPX()] * 4)
    generator, high, active = np.random.default_rng(3), np.array([0.3, 0.4, 0.5, 0.6]), 0
    bounds = TangentBounds(model, -high, high, np.zeros(4, dtype=bool))
    for _ in range(8):
        J, goal = generator.normal(size=(4, 4)), generator.normal(size=4)
        q = descend(linear(J, goal), bounds, np.zeros(4)).q
        slope, at_limit = J.T @ (goal - J @ q), np.abs(q) >= high - 1e-12
        np.testing.assert_allclose(slope[~at_limit], 0.0, atol=1e-9)
        assert (slope[at_limit] * np.sign(q[at_limit]) > 0).all()
        active += at_limit.sum()
    assert 8 < active < 24


def test_joints_that_all_meet_their_limits_go_there():
    bounds = TangentBounds(slides([pin.JointModelPX()] * 2), -np.ones(2), np.ones(2), np.zeros(2, dtype=bool))
    np.testing.assert_array_equal(descend(linear(np.eye(2), np.array([9.0, -9.0])), bounds, np.zeros(2)).q, [1.0, -1.0])


def test_an_equality_of_coupled_joints_satisfies_the_conditions_of_optimality():
    """Joints within their limits have one slope; the others would go beyond."""
    model, high = slides([pin.JointModelPX()] * 4), np.array([0.3, 0.4, 0.5, 0.6])
    generator, bounds = np.random.default_rng(5), TangentBounds(model, -high, high, np.zeros(4, dtype=bool))
    for _ in range(12):
        J, goal, total = generator.normal(size=(4, 4)), generator.normal(size=4), generator.uniform(-0.8, 0.8)

        def evaluate(q, J=J, goal=goal, total=total):
            return Residuals(goal - J @ q, J, np.array([q.sum() - total]), np.ones((1, 4)))

        found = descend(evaluate, bounds, np.zeros(4))
        slope, at_limit = J.T @ (goal - J @ found.q), np.abs(found.q) >= high - 1e-12
        assert found.residual < 1e-12
        shared = slope[~at_limit].mean()
        np.testing.assert_allclose(slope[~at_limit], shared, atol=1e-8)
        assert ((slope - shared)[at_limit] * np.sign(found.q[at_limit]) > 0).all()


def test_an_equality_within_bounds_shifts_all_free_joints_alike():
    """The nearest point with a given sum is ``clip(goal - shift)``."""
    high, goal, total = np.array([0.3, 0.4, 0.5, 0.6]), np.array([0.9, -0.2, 0.1, -0.7]), -0.45
    bounds = TangentBounds(slides([pin.JointModelPX()] * 4), -high, high, np.zeros(4, dtype=bool))
    shift = scipy.optimize.brentq(lambda each: np.clip(goal - each, -high, high).sum() - total, -2.0, 2.0, xtol=1e-15)

    def evaluate(q):
        return Residuals(goal - q, np.eye(4), np.array([q.sum() - total]), np.ones((1, 4)))

    found = descend(evaluate, bounds, np.zeros(4))
    np.testing.assert_allclose(found.q, np.clip(goal - shift, -high, high), atol=1e-9)
    assert (np.abs(found.q) == high).sum() == 2
    assert found.residual < 1e-12


def test_eight_stalled_steps_in_a_row_end_a_descent():
    """A goal that steps of at most a metre reach slowly; a step stalls if it leaves most of the squared error."""
    bounds = TangentBounds(slides([pin.JointModelPX()]), -np.full(1, np.inf), np.full(1, np.inf), np.zeros(1, bool))
    far = linear(np.eye(1), np.array([100.0]))
    slow = descend(far, bounds, np.zeros(1), progress=0.999)
    assert slow.steps == 8
    assert 0 < slow.q[0] < 8.0
    whole = descend(far, bounds, np.zeros(1))
    assert whole.error < 1e-12
    assert 100 <= whole.steps < 120
