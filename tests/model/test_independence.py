"""Selection of rows, to the threshold: singular values of unit rows are known in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.independence import _candidates, _choose, block_row_scales, row_scales, select_independent
from rnc_pin.model.reduction_data import VelocityRows
from rnc_pin.model.rows import OutputStack, RowStack
from textbook_systems import Turning, sliders

TOLERANCE, ROUNDING = 1e-8, 1e-5  # sines of angles below which rows are dependent, and dependent but for rounding


def apart(angle):
    """Two rows of unit length at an angle."""
    return np.array([[1.0, 0, 0, 0], [np.cos(angle), np.sin(angle), 0, 0]])


def beside(*rows):
    """Samples, all of them these rows."""
    return np.array([rows, rows, rows])


def test_rows_take_part_in_a_combination_with_weights_beyond_the_tolerance():
    """Of rows of unit length; names come in the order given, whatever was kept first."""
    third = np.array([1.0, 2 * TOLERANCE, 0.5 * TOLERANCE, 0.0])
    (dropped,) = select_independent(beside(*np.eye(4)[:3], third), "dcba").dropped
    assert (dropped.name, dropped.reason, dropped.rounding) == ("a", "a combination of d, c", 0.0)
    many = np.array([[*np.eye(4)[:2], [0, 0, 1.0, 0], third], [*np.eye(4)[:2], [0, 0, 1.0, 0], np.eye(4)[2]]])
    (dropped,) = select_independent(many, "dcba").dropped
    assert dropped.reason == "a combination of d, c, b"


def test_a_row_is_short_beside_rows_of_its_own_unit():
    block = SimpleNamespace(units=("m/s", "rad/s", "m/s", "rad/s"), holonomic=(True, False, False, False))
    samples = np.zeros((2, 4, 3))
    samples[0, :, 0], samples[1, :, 1] = (0.3, 4.0, 0.1, 2.0), (0.2, 1.0, 0.5, 7.0)
    rows = SimpleNamespace(size=4, places=[(block, slice(0, 4), None)])
    np.testing.assert_array_equal(block_row_scales(rows, samples), [0.5, 7.0, 0.5, 7.0])


def test_rows_that_rounding_leaves_may_demand_what_differs_by_as_much():
    """Rows that are exactly dependent may not."""
    for size in (1.0, 1e-3, 40.0):
        rates = np.full((3, 2), size) * [1.0, 1.0 + 0.9 * ROUNDING]
        assert select_independent(beside(*apart(0.5 * ROUNDING)), "ab", rates).kept == [0]
        with pytest.raises(rnc.ConstraintError, match=r"^constraint row 'b' contradicts the others: it requires"):
            select_independent(beside(*apart(0.0)), "ab", rates)
    only = np.zeros((2, 1, 3))
    assert select_independent(only, "a", np.zeros((2, 1))).kept == []
    words = r"^constraint row 'a' contradicts the others: it requires 2, the others require 0"
    with pytest.raises(rnc.ConstraintError, match=words):
        select_independent(only, "a", np.array([[0.0], [2.0]]))


def test_zero_is_told_from_what_is_zero_but_for_rounding():
    rows = beside([1.0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 4e-6, 0], [0, 1.05e-12, 0, 0], [0, 0.95e-12, 0, 0])
    found = select_independent(rows, "abcde", lengths=np.array([1.0, 1.0, 0.5, 1.0, 1.0]))
    assert found.kept == [0]
    assert [(row.reason, row.rounding) for row in found.dropped] == [
        ("zero at every configuration", 0.0),
        ("zero except for rounding (8e-06)", pytest.approx(8e-6)),
        ("zero except for rounding (1e-12)", pytest.approx(1.05e-12)),
        ("zero at every configuration", 0.0),
    ]
    bare = select_independent(rows, "abcde")  # without lengths they are what they are
    assert (bare.kept, [row.name for row in bare.dropped]) == ([0, 2, 3], ["b", "e"])
    assert select_independent(rows[:, :0], "").kept == []


def test_a_rank_that_changes_is_told_with_both():
    """Exactly; a sample near a singular configuration loses rank by the rougher limit alone, and changes nothing."""
    good, lost, near = (np.array([*apart(angle), [0, 0, 1.0, 0]]) for angle in (0.7, 0.0, 0.5 * ROUNDING))
    words = r"^rank of the constraints .*, from 2 to 3 of 3 rows \(a, b, c\): the reduction needs a constant one"
    with pytest.raises(rnc.ConstraintError, match=words):
        select_independent(np.array([good, lost, good]), "abc")
    found = select_independent(np.array([near, good, near]), "abc")
    assert (found.kept, found.dropped) == ([0, 1, 2], [])
    assert found.margin == pytest.approx(np.sqrt(2) * np.sin(0.35))


def test_of_rows_that_are_never_well_independent_the_best_at_its_worst_are_kept(generator):
    for _ in range(5):
        matrices = np.array([1.0, 0.0, 0.0]) + 0.001 * generator.normal(size=(3, 4, 3))  # nearly parallel
        matrices /= np.linalg.norm(matrices, axis=-1, keepdims=True)

        def worst(kept, matrices=matrices):
            return min(np.linalg.svd(matrix[kept], compute_uv=False)[-1] for matrix in matrices)

        tried = [worst(kept) for kept in _candidates(matrices, 3, 1e-9) if len(kept) == 3]
        assert len(set(tried)) > 1
        assert max(tried) < 1e-3
        np.testing.assert_allclose(worst(_choose(matrices, 3, 1e-9)), max(tried))


def test_a_row_is_naturally_as_long_as_in_the_median_or_where_most_are_zero_at_its_longest():
    robot = sliders()
    sizes = np.array([[3.0, 0.0, 0.0, 6e-12], [1.0, 0.0, 5.0, 0.0], [2.0, 0.0, 0.0, 8e-12], [7.0, 4.0, 6.0, 0.0]])

    def rows(q):
        return np.outer(sizes[int(q[0])], [0.6, 0.0, -0.8])

    outputs = OutputStack([VelocityRows(np.array([[0.0, 3.0, 4.0]]), ["v"], [""])])
    q = np.zeros((4, 3))
    q[:, 0] = range(4)
    found = row_scales(robot, RowStack([Turning("abcd", rows)]), outputs, q)
    # The longest of all is 7, so that what is below 7e-12 is zero: of row d one is left, so that it is its longest.
    np.testing.assert_allclose(found, [2.5, 4.0, 2.5, 8e-12, 5.0])

    def seldom(q):
        if q[0] != 2:
            raise rnc.SingularityError("undefined", q=q, condition=np.inf, rows=("a",))
        return np.eye(3)[:1] * 3

    found = row_scales(robot, RowStack([Turning("a", seldom)]), outputs, q)
    np.testing.assert_allclose(found, [3.0, 5.0])
    np.testing.assert_array_equal(row_scales(robot, RowStack([Turning("a", seldom)]), outputs, q[:2]), [0.0, 0.0])
