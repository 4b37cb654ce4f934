"""Linear algebra over leading axes."""

import numpy as np

from rnc_pin.math.linear_algebra import solve_positive_definite


def test_a_singular_matrix_gives_nan_and_leaves_the_others_alone():
    matrices = np.stack([np.diag([2.0, 4.0]), np.zeros((2, 2)), np.eye(2)])
    right = np.random.default_rng(3).uniform(-1, 1, (3, 2))
    found = solve_positive_definite(matrices, right)
    np.testing.assert_allclose(found[0], right[0] / [2.0, 4.0])
    assert np.isnan(found[1]).all()
    np.testing.assert_array_equal(found[2], right[2])
    assert np.isnan(solve_positive_definite(matrices[1], right)).all()
