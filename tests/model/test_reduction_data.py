"""Data of a reduction at other velocities, and the lengths of its rows."""

from dataclasses import replace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.generalized_forces import Actuation, PassiveForces
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.model.reduction_data import ReductionData, VelocityRows
from rnc_pin.model.rows import OutputStack, RowStack
from textbook_systems import Flat, sliders


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
    np.testing.assert_array_equal(
        parts.stack.template(parts.n), [*rows[0].matrix[:1], *rows[1].matrix, *np.eye(4)[[1, 3]]]
    )
    W = np.array([[0.6, 0, 0.8, 0], [0, 1.0, 0, 0]])
    for other, names, matrix, sizes, free in (
        (parts.in_velocities(W), ("w[0]", "w[1]"), W, [1.0, 1.0], False),
        (parts.in_velocities(W, ["u", "w"], free=True), ("u", "w"), W, [1.0, 1.0], True),
        (parts.in_entries([2, 0]), ("c", "a"), np.eye(4)[[2, 0]], [1.0, 1.0], False),
        (parts.in_entries((1, 3), free=True), ("b", "d"), np.eye(4)[[1, 3]], [1.0, 1.0], True),
    ):
        assert (other.reducing.names, other.free, other.kept) == (names, free, (0, 2))
        assert (other.reducing.quasi.tolist(), other.reducing.units) == ([True, True], ("", ""))
        np.testing.assert_array_equal(other.stack.template(other.n)[2:], matrix)
        np.testing.assert_array_equal(other.lengths, [5.0, 0.5, *sizes])
        assert (other.kinematics, other.singularity_limit) == (parts.kinematics, 1e5)
        assert (other.vertical, other.actuation, other.rows) == (vertical, parts.actuation, parts.rows)
    other, strict = replace(parts, kept=(1, 2)), replace(parts, singularity_limit=1e2)
    pairs = (strict, replace(strict)), (strict, parts), (parts, strict)
    assert [one.has_rows_of(two) for one, two in pairs] == [True, False, False]
    assert (other.kept, other.reducing, other.free) == ((1, 2), outputs, False)
    np.testing.assert_array_equal(other.lengths, [7.0, 0.5, 2.0, 4.0])
