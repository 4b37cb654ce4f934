"""Descent on slides: closed forms of its bounds and of its ends."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.motion.planning.bounded_descent import Residuals, TangentBounds, descend


def slides(kinds):
    """Model of joints of one or three slides."""
    model = pin.Model()
    for k, kind in enumerate(kinds):
        add_body(model, f"joint_{k}", kind, 1.0, k)
    return rnc.Robot(model).model


def test_each_of_three_slides_stops_at_its_own_limit():
    """Behind a ball, so that places in q and in v differ. The nearest point of a box is its clipped goal."""
    model = slides([pin.JointModelSpherical(), pin.JointModelPX(), pin.JointModelTranslation()])
    high = np.array([np.inf, np.inf, np.inf, np.inf, 0.5, 0.1, 0.2, 0.3])
    low, high[6] = -high, np.inf  # limits on one side are limits
    low[5] = -np.inf
    bounds = TangentBounds(model, low, high, np.zeros(7, dtype=bool))
    assert bounds.v_index.tolist() == [3, 4, 5, 6]
    goal = np.array([0.4, 3.0, -2.0, 0.25])
    J = np.eye(7)[3:]
    nothing = np.zeros((0, 7))

    def evaluate(q):
        return Residuals(goal - q[4:], J, nothing[:, 0], nothing)

    found = descend(evaluate, bounds, pin.neutral(model))
    np.testing.assert_allclose(found.q[4:], [0.4, 0.1, -0.2, 0.25], atol=1e-9)
    assert found.error == pytest.approx(np.hypot(2.9, 1.8), abs=1e-9)


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


def test_eight_stalled_steps_in_a_row_end_a_descent():
    """A goal that steps of at most a metre reach slowly; a step stalls if it leaves most of the squared error."""
    bounds = TangentBounds(slides([pin.JointModelPX()]), -np.full(1, np.inf), np.full(1, np.inf), np.zeros(1, bool))
    far = lambda q: Residuals(100.0 - q, np.eye(1), np.zeros(0), np.zeros((0, 1)))  # noqa: E731
    slow = descend(far, bounds, np.zeros(1), progress=0.999)
    assert slow.steps == 8
    assert 0 < slow.q[0] < 8.0
    assert descend(far, bounds, np.full(1, 100.0)).steps == 0  # it begins at its goal
    whole = descend(far, bounds, np.zeros(1))
    assert whole.error < 1e-12
    assert 100 <= whole.steps < 120
