"""Linear algebra over leading axes."""

import numpy as np
import pytest

from rnc_pin.math.linear_algebra import apply_transposed, complex_step, inverse, solve, solve_positive_definite


@pytest.mark.parametrize("solution", [solve, solve_positive_definite])
def test_a_singular_matrix_has_no_solution_and_leaves_the_others_alone(solution):
    matrices = np.stack([np.diag([2.0, 4.0]), np.zeros((2, 2)), np.eye(2)])
    right, none = np.random.default_rng(3).uniform(-1, 1, (3, 2)), [np.nan, np.nan]
    found = solution(matrices, right)
    np.testing.assert_allclose(found, [right[0] / [2.0, 4.0], none, right[2]], rtol=1e-15)
    np.testing.assert_array_equal(solution(matrices[1], right), np.full((3, 2), np.nan))
    np.testing.assert_array_equal(solution(matrices[1], right[0]), none)
    np.testing.assert_array_equal(inverse(matrices), [np.diag([0.5, 0.25]), [none, none], np.eye(2)])


def test_complex_numbers_are_not_conjugated(generator):
    """One vector and a stack of them: derivatives by the complex step need this."""
    matrix, vector = (generator.normal(size=(*shape, 2)) @ [1.0, 1j] for shape in ((4, 3, 2), (4, 3)))
    expected = np.einsum("snk,sn->sk", matrix, vector)
    np.testing.assert_allclose(apply_transposed(matrix, vector), expected, rtol=1e-14)
    np.testing.assert_allclose([apply_transposed(*each) for each in zip(matrix, vector, strict=True)], expected)


def test_the_complex_step_differentiates_along_all_directions_at_once():
    value, gradient = np.array([0.3, -0.4]), np.array([[1.0, 0.0, 2.0], [0.0, 1.0, -1.0]])
    factor = np.array([0.7]), np.array([[0.0, 1.0, 0.5]])

    def function(x, a):
        return np.stack([a[..., 0] * np.sin(x[..., 0]) * x[..., 1], x[..., 0] ** 3], axis=-1)

    (x, y), a = value, 0.7
    by_x, by_a = np.array([[a * np.cos(x) * y, a * np.sin(x)], [3 * x * x, 0.0]]), np.array([[np.sin(x) * y], [0.0]])
    expected = by_x @ gradient + by_a @ factor[1]
    np.testing.assert_allclose(complex_step(function, (value, gradient), factor), expected, rtol=1e-14)
