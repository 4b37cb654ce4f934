"""Data of a reduction at other velocities, and the lengths of its rows."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.generalized_forces import Actuation, PassiveForces
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduction_data import ReductionData, VelocityRows, row_scales
from rnc_pin.model.rows import OutputStack, RowStack
from textbook_systems import Flat, Turning, sliders


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


def test_a_reduction_is_put_together_again_in_other_velocities():
    robot = sliders("XXXX", (2.0, 3.0, 5.0, 7.0))
    rows = [Flat(np.arange(8.0).reshape(2, 4), "ab"), Flat([[1.0, 0, 0, -1.0]], "c")]
    outputs = OutputStack([VelocityRows(np.eye(4)[[1, 3]], ["x", "y"], ["m/s", "rad/s"])])
    vertical = OutputStack([rnc.JointPosition("c").bind(robot)])
    lengths, actuation = np.array([5.0, 7.0, 0.5, 2.0, 4.0]), Actuation(["a"], robot)
    shared = (Kinematics(robot), PassiveForces((), robot))
    parts = ReductionData(robot, RowStack(rows), (0, 2), actuation, outputs, vertical, 1e5, lengths, *shared)
    assert (parts.n, parts.m, parts.r, parts.p, parts.has_alternatives) == (4, 2, 2, 1, True)
    assert (parts.fast_limit, parts.fast_length) == (pytest.approx(1e6), pytest.approx(25.0 + 0.25 + 4.0 + 16.0))
    np.testing.assert_array_equal(parts.lengths, [5.0, 0.5, 2.0, 4.0])
    np.testing.assert_array_equal(parts.template, [*rows[0].matrix[:1], *rows[1].matrix, *np.eye(4)[[1, 3]]])
    W = np.array([[0.6, 0, 0.8, 0], [0, 1.0, 0, 0]])
    for other, names, matrix, sizes, free in (
        (parts.in_velocities(W), ("w[0]", "w[1]"), W, [1.0, 1.0], False),
        (parts.in_velocities(W, ["u", "w"], free=True), ("u", "w"), W, [1.0, 1.0], True),
        (parts.in_entries([2, 0]), ("c", "a"), np.eye(4)[[2, 0]], [1.0, 1.0], False),
        (parts.in_entries((1, 3), free=True), ("b", "d"), np.eye(4)[[1, 3]], [1.0, 1.0], True),
    ):
        assert (other.reducing.names, other.free, other.kept) == (names, free, (0, 2))
        assert (other.reducing.quasi.tolist(), other.reducing.units) == ([True, True], ("", ""))
        np.testing.assert_array_equal(other.template[2:], matrix)
        np.testing.assert_array_equal(other.lengths, [5.0, 0.5, *sizes])
        assert (other.kinematics, other.singularity_limit) == (parts.kinematics, 1e5)
        assert (other.vertical, other.actuation, other.rows) == (vertical, parts.actuation, parts.rows)
    other, strict = parts.keeping([1, 2]), replace(parts, singularity_limit=1e2)
    pairs = (strict, replace(strict)), (strict, parts), (parts, strict)
    assert [one.has_rows_of(two) for one, two in pairs] == [True, False, False]
    assert (other.kept, other.reducing, other.free) == ((1, 2), outputs, False)
    np.testing.assert_array_equal(other.lengths, [7.0, 0.5, 2.0, 4.0])
