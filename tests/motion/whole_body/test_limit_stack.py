"""Nearest points within bounds, and levels of tasks that are solved by them: conditions of optimality."""

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import LinearConstraint, minimize

from rnc_pin.math.convex_programs import nearest_point
from rnc_pin.motion.whole_body.limit_stack import ProgramBounds
from rnc_pin.motion.whole_body.task_hierarchy import SampledDamping, TaskLevels, solve_cascade


def test_nearest_points_satisfy_the_conditions_of_optimality():
    """Rows with a bound above, below, at both sides and none."""
    generator, active = np.random.default_rng(2), np.zeros(2, dtype=int)
    for _ in range(4):
        goal, rows = 3.0 * generator.normal(size=4), generator.normal(size=(5, 4))
        lower, upper = np.array([-np.inf, -0.5, -0.6, -np.inf, -0.2]), np.array([0.3, np.inf, 0.4, np.inf, 0.1])
        point, force = nearest_point(goal, rows, lower, upper)
        values = rows @ point
        np.testing.assert_allclose(point - goal + rows.T @ force, 0.0, atol=1e-8)
        assert (values <= upper + 1e-8).all()
        assert (values >= lower - 1e-8).all()
        np.testing.assert_allclose(values[force > 1e-9], upper[force > 1e-9], atol=1e-8)
        np.testing.assert_allclose(values[force < -1e-9], lower[force < -1e-9], atol=1e-8)
        active += (force > 1e-9).sum(), (force < -1e-9).sum()
    assert (active > 0).all()


def stacked(levels):
    J, rate = zip(*levels, strict=True)
    return TaskLevels(np.vstack(J), np.concatenate(rate), np.cumsum([len(each) for each in rate]))


def test_lower_levels_leave_what_damped_levels_within_limits_determine():
    """Three levels of ten unknowns in a small box: the third does its best where the first two leave it free."""
    generator, touched = np.random.default_rng(5), 0
    for _ in range(6):
        levels = [(generator.normal(size=(2, 10)), 2.0 * generator.normal(size=2)) for _ in range(3)]
        bounds = ProgramBounds(np.eye(10), np.full(10, -0.4), np.full(10, 0.4), np.arange(10), 10)
        levers = np.array([*(np.linalg.norm(J, axis=0).sum() for J, _ in levels[:2]), 0.0])
        curved = np.repeat([1.0, 1.0, 0.0], 2)
        two, three = (
            solve_cascade(stacked(levels[:k]), bounds, 0.0, None, SampledDamping(0.0005, levers[:k], curved[: 2 * k]))
            for k in (2, 3)
        )
        above, (J, rate) = np.vstack([levels[0][0], levels[1][0]]), levels[2]
        np.testing.assert_allclose(above @ three.unknowns, above @ two.unknowns, atol=1e-7)
        free = null_space(above)

        def miss(y, J=J, rate=rate, free=free, two=two):
            return float(np.sum((J @ (two.unknowns + free @ y) - rate) ** 2))

        inside = LinearConstraint(free, -0.4 - two.unknowns, 0.4 - two.unknowns)
        best = minimize(miss, np.zeros(6), method="SLSQP", constraints=inside, options={"ftol": 1e-12})
        assert np.sum((J @ three.unknowns - rate) ** 2) == pytest.approx(best.fun, abs=1e-5)
        touched += np.count_nonzero(two.multipliers[1])
    assert touched > 3


def test_each_level_moves_in_what_those_above_leave_free(generator):
    """Against null spaces; a level that repeats a row of one above, at another rate, changes nothing."""
    bounds = ProgramBounds(np.eye(7), np.full(7, -1e3), np.full(7, 1e3), np.arange(7), 7)
    levels = [(generator.normal(size=(k, 7)), generator.normal(size=k)) for k in (3, 2, 5)]
    repeated, expected, free = (levels[0][0][:1], np.array([9.0])), np.zeros(7), np.eye(7)
    for J, rate in levels:
        expected = expected + free @ np.linalg.lstsq(J @ free, rate - J @ expected)[0]
        free = free @ null_space(J @ free)
    found = solve_cascade(stacked([levels[0], repeated, *levels[1:]]), bounds, 0.0)
    np.testing.assert_allclose(found.unknowns, expected, atol=1e-12)


def test_what_a_task_leaves_free_costs_next_to_nothing():
    """``(x - 1)^2 + (y / 1000)^2`` within ``x <= y``: both are ``1 / (1 + 1e-6)``."""
    bounds = ProgramBounds(np.array([[1.0, -1.0]]), np.array([-np.inf]), np.array([0.0]), np.array([0]), 1)
    found = solve_cascade(TaskLevels(np.array([[1.0, 0.0]]), np.ones(1), np.array([1])), bounds, 0.0)
    np.testing.assert_allclose(found.unknowns, 1 / (1 + 1e-6), rtol=1e-8)


def test_rows_that_do_not_act_move_nothing():
    """Numbers whose squares are zero in floating point."""
    bounds = ProgramBounds(np.eye(2), np.array([0.1, -1.0]), np.ones(2), np.arange(2), 2)
    level = TaskLevels(np.array([[1e-200, 0.0]]), np.ones(1), np.array([1]))
    found = solve_cascade(level, bounds, 0.0, sampled=SampledDamping(0.01, np.ones(1), np.ones(1)))
    np.testing.assert_allclose(found.unknowns, [0.1, 0.0], atol=1e-12)


def test_a_level_that_is_nearly_attained_within_a_limit_does_not_slow_lower_levels():
    """The second row leaves a small residual, which damps a little."""
    bounds = ProgramBounds(np.eye(3), np.full(3, -10.0), np.array([0.9, 10.0, 10.0]), np.arange(3), 3)
    first = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), np.array([2.0, 1e-4])
    levels = stacked([first, (np.array([[0.0, 0.0, 1.0]]), np.array([5.0]))])
    sampled = SampledDamping(0.1, np.array([1.0, 0.0]), np.array([1.0, 1.0, 0.0]))
    found = solve_cascade(levels, bounds, 0.0, sampled=sampled)
    np.testing.assert_allclose(found.unknowns, [0.9, 1.1, 5.0], atol=1e-3)
