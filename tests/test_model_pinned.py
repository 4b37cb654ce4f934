"""What the model computes and refuses, to the number, the name and the threshold."""

from types import SimpleNamespace

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.independence import ROUNDING, TOLERANCE, row_scales, select_independent
from rnc_pin.model.kinematics import Kinematics
from textbook_systems import Flat, coupling, sliders

# ---------------------------------------------------------------------- assembly


def test_assembling_takes_the_shortest_way_as_inertia_measures_it():
    """By a constant inertia M: ``q - M^-1 A^T (A M^-1 A^T)^-1 r``, and with joints held the same of others."""
    robot = sliders()
    M = np.array([[10.0, 8, 5], [8, 8, 5], [5, 5, 5]])
    rows = [coupling("b", "a", 2.0, 0.3).bind(robot)]
    assembly, A = Assembly(robot, rows), np.array([[-2.0, 1.0, 0.0]])
    for scale in (0.1, 4.0):
        for q in scale * np.random.default_rng(1).normal(size=(3, 3)):
            residual = A @ q - 0.3
            np.testing.assert_allclose(assembly.residual(q), residual, atol=1e-12)
            assert assembly.worst(q) == ("coupling(b, a)", pytest.approx(residual[0]))
            for held in ((), ("a",), ("a", "c"), ("b",)):
                free = [k for k, name in enumerate("abc") if name not in held]
                inverse, part = np.linalg.inv(M[np.ix_(free, free)]), A[:, free]
                expected = q.copy()
                expected[free] -= inverse @ part.T @ np.linalg.solve(part @ inverse @ part.T, residual)
                np.testing.assert_allclose(assembly.project(q, held), expected, atol=1e-9 * scale)
    there = np.array([0.1, 0.5, 7.0])
    assert assembly.project(there) is there
    assert assembly.rank(there) == assembly.size == 1


def test_nothing_to_assemble():
    nothing = Assembly(sliders(), [])
    q = np.array([0.1, 0.2, 0.3])
    assert nothing.project(q) is q
    assert (nothing.rank(q), nothing.size, nothing.names, nothing.following) == (0, 0, (), ())
    assert nothing.leading.shape == (0,)
    assert nothing.residual(np.zeros((4, 2, 3))).shape == (4, 2, 0)
    assert nothing.random_configuration(np.random.default_rng(0)).shape == (3,)


def test_what_contradicts_itself_is_met_half_way_and_told():
    """``b = 2 a + 0.3`` and ``a = b / 2 + 0.5``: the least squares of both leave 0.26 of one and 0.52 of the other."""
    robot = sliders()
    rows = [coupling("b", "a", 2.0, 0.3).bind(robot), coupling("a", "b", 0.5, 0.5).bind(robot)]
    assembly = Assembly(robot, rows)
    assert assembly.names == ("coupling(b, a)", "coupling(a, b)")
    assert assembly.leading.tolist() == [True, False]
    assert assembly.following == ("coupling(a, b)",)
    q = np.array([0.2, 0.1, 0.0])
    assert assembly.rank(q) == 1
    words = r"satisfies coupling\(b, a\), coupling\(a, b\): coupling\(a, b\) has residual 0.52, limit 1e-11"
    with pytest.raises(rnc.ConstraintError, match="no configuration near q " + words):
        assembly.project(q)
    words = r"from 25 random configurations: coupling\(a, b\) has residual 0.52, limit 1e-11$"
    with pytest.raises(rnc.ConstraintError, match=words):
        assembly.random_configuration(np.random.default_rng(0))
    for wrong in (np.zeros(2), np.zeros((1, 3)), np.array([0.0, np.nan, 0.0])):
        with pytest.raises(rnc.InputError, match="one configuration of 3 finite numbers, found shape"):
            assembly.project(wrong)


@pytest.mark.parametrize(("off", "closes"), [(0.0, True), (3e-5, True), (3e-3, False)])
def test_a_row_that_follows_but_for_rounding_is_met_to_that(off, closes):
    """Found dependent by itself, or said to be; the row that leads is met exactly all the same."""
    robot = sliders()
    rows = [coupling("b", "a", 2.0, 0.3).bind(robot), coupling("a", "b", 0.5, -0.15 + off).bind(robot)]
    for assembly in (Assembly(robot, rows), Assembly(robot, rows, ["coupling(a, b)"])):
        q = np.array([0.4, -0.2, 0.1])
        if closes:
            np.testing.assert_allclose(np.abs(assembly.residual(assembly.project(q))), [0.0, off], atol=1e-12)
        else:
            with pytest.raises(rnc.ConstraintError, match="has residual"):
                assembly.project(q)
    loose = [coupling("b", "a", 2.0, 0.3).bind(robot), coupling("c", "a").bind(robot)]
    assert Assembly(robot, loose).leading.all()
    assert Assembly(robot, loose, ["coupling(c, a)"]).following == ("coupling(c, a)",)


def test_random_configurations_give_up_only_where_all_end_alike():
    """A gap that nothing closes, each time another: all tries are made. Where no row is defined, none counts."""
    robot = sliders()
    stuck = Flat(np.zeros((1, 3)), ["stuck"], gap=lambda q: 1.0 + 0.1 * np.abs(q[..., :1]))
    with pytest.raises(rnc.ConstraintError, match="from any of 100 random configurations: stuck has residual"):
        Assembly(robot, [stuck]).random_configuration(np.random.default_rng(0))

    def undefined(q):
        raise rnc.SingularityError("nowhere", q=q, condition=np.inf, rows=("one",))

    nowhere = Flat(np.eye(3)[:2], ["one", "two"], gap=undefined)
    with pytest.raises(rnc.ConstraintError, match=r"from any of 100 random configurations$"):
        Assembly(robot, [nowhere]).random_configuration(np.random.default_rng(0))


def test_rows_of_the_ground_that_no_joint_moves_are_left_alone():
    """Zero, or zero but for rounding beside the longest of the same unit; elsewhere they have to be satisfied."""
    robot, flags = sliders(), (True, True, False, True, True)
    matrix = np.zeros((5, 3))
    matrix[1:, 0] = [0.8 * ROUNDING, 1.0, 1.3 * ROUNDING, 0.8 * ROUNDING]
    units = ("m/s",) * 4 + ("rad/s",)
    ground, given = (
        Assembly(robot, [Flat(matrix, "vwxyz", None, flags, units, on_ground)]) for on_ground in (True, False)
    )
    assert ground.names == ("y", "z")
    assert given.names == ("v", "w", "y", "z")
    q = np.ones(3)
    np.testing.assert_allclose(given.residual(q), matrix[[0, 1, 3, 4]].sum(axis=1) - 1.0)
    np.testing.assert_allclose(ground.residual(q), matrix[[3, 4]].sum(axis=1) - 1.0)
    at = Kinematics(robot).position(q)
    np.testing.assert_array_equal(ground.jacobian(at), matrix[[3, 4]])


def test_a_step_that_goes_too_far_is_halved():
    """Rows that are five times as steep as they say: the whole step would land four times as far beyond."""
    steep = Flat([[1.0, 0.0, 0.0]], ["steep"], gap=lambda q: 5.0 * q[..., :1] - 1.0)
    found = Assembly(sliders(), [steep]).project(np.array([0.3, 0.0, 0.0]))
    assert found[0] == pytest.approx(0.2, abs=1e-11)


def test_a_row_that_was_thought_to_follow_and_does_not_is_met_with_the_others():
    robot = sliders()
    rows = [coupling("b", "a", 2.0, 0.3).bind(robot), coupling("c", "a", -1.0, 0.1).bind(robot)]
    assembly = Assembly(robot, rows, ["coupling(c, a)"])
    found = assembly.project(np.array([0.4, -0.2, 0.1]))
    np.testing.assert_allclose(assembly.residual(found), 0.0, atol=1e-11)

    class Turning(Flat):
        def jacobian(self, at):
            return np.eye(3)[[0, 1 if at.q[0] > 0 else 0]]

    assert Assembly(robot, [Turning(np.eye(3)[:2], ["one", "two"])]).leading.all()  # of no one rank: nothing follows
    with pytest.raises(rnc.ConstraintError, match="constraint rows overflow: scale down their entries"):
        Assembly(robot, [coupling("b", "a", 1e170).bind(robot)]).project(np.ones(3))


# ---------------------------------------------------------------------- independence


def at_angle(angle, third=True):
    rows = [[1.0, 0, 0], [np.cos(angle), np.sin(angle), 0], [0, 0, 1.0]]
    return np.array([rows if third else rows[:2]])


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e7])
def test_two_rows_at_an_angle_have_the_margin_of_that_angle(scale):
    """``sqrt(1 - cos)`` of two, which are told; what is at right angles to both is not."""
    for angle in (0.3, 2e-3, 1.6 * ROUNDING):
        found = select_independent(scale * at_angle(angle), "abc")
        assert (found.kept, found.dropped) == ([0, 1, 2], [])
        assert found.margin == pytest.approx(np.sqrt(2) * np.sin(angle / 2), rel=1e-6)
        assert found.weak == ["a", "b"]
    best = select_independent(np.concatenate([at_angle(0.3), at_angle(0.9), at_angle(0.5)]), "abc")
    assert best.margin == pytest.approx(np.sqrt(2) * np.sin(0.45))
    assert select_independent(np.zeros((2, 0, 3)), "").margin == 1.0


def test_rows_are_dependent_below_an_angle_and_to_rounding_below_another():
    """By singular values of rows of unit length, which are the angle over the square root of two."""
    edge = np.sqrt(2.0)
    for angle, rounded in ((0.9 * edge * ROUNDING, True), (1.2 * TOLERANCE, True), (0.8 * TOLERANCE, False)):
        (dropped,) = select_independent(at_angle(angle), "abc").dropped
        assert dropped.name == "b"
        assert dropped.rounding == pytest.approx(angle * rounded, rel=1e-3)
        assert dropped.reason == "a combination of a" + f" except for rounding ({angle:.2g})" * rounded
    assert not select_independent(at_angle(1.1 * edge * ROUNDING), "abc").dropped


def test_of_rows_that_are_nearly_parallel_others_are_preferred():
    """In the order given where that is good enough; else whichever are best."""
    for angle, kept in ((2e-3, [[0, 1]]), (4e-4, [[0, 2], [1, 2]])):
        turned = np.array([[1.0, 0], [np.cos(angle), np.sin(angle)], [-0.1, 1.0]])
        found = select_independent(np.stack([turned, turned]), ["a", "b", "c"])
        assert found.kept in kept
        assert found.dropped[0].reason == "a combination of " + ", ".join("abc"[k] for k in found.kept)
        assert found.dropped[0].rounding == 0.0


def test_short_rows_are_zero_but_for_rounding_beside_their_lengths():
    rows = np.array([[[1.0, 0, 0], [0, 0.5 * 0.9 * ROUNDING, 0]]])
    found = select_independent(rows, "ab", lengths=np.array([0.5, 0.5]))
    assert found.kept == [0]
    assert found.dropped[0].reason == "zero except for rounding (9e-06)"
    assert found.dropped[0].rounding == pytest.approx(0.9 * ROUNDING)
    assert found.margin == 1.0
    for size, margin in ((1.1 * ROUNDING, 1.1 * ROUNDING), (2e-3, 1.0)):
        rows[0, 1, 1] = 0.5 * size
        found = select_independent(rows, "ab", lengths=np.array([0.5, 0.5]))
        assert found.kept == [0, 1]
        assert found.margin == pytest.approx(margin)
    rows[0, 1, 1] = 1e-9
    for lengths in (None, np.zeros(2)):
        assert select_independent(rows, "ab", lengths=lengths).margin == 1.0
    rows[0, 1, 1] = 1e-13
    assert select_independent(rows, "ab").dropped[0].reason == "zero at every configuration"


def test_rows_that_depend_may_not_demand_something_else():
    rows = np.array([[[1.0, 0], [0, 1], [2, -1]]])
    for scale in (1.0, 1e-4, 1e5):
        good = scale * np.array([[1.0, 0.5, 1.5]])
        found = select_independent(rows, "abc", good)
        assert found.kept == [0, 1]
        assert found.dropped[0].reason == "a combination of a, b"
        select_independent(rows, "abc", good + scale * np.array([[0, 0, 0.5 * TOLERANCE]]))
        with pytest.raises(rnc.ConstraintError) as said:
            select_independent(rows, "abc", good - scale * np.array([[0, 0, 5 * TOLERANCE]]))
        assert "constraint row 'c' contradicts the others" in str(said.value)
    words = "row 'c' contradicts the others: it requires 3, the others require 1.5"
    with pytest.raises(rnc.ConstraintError, match=words):
        select_independent(rows, "abc", np.array([[1.0, 0.5, 3.0]]))
    words = r"from 1 to 2 of 2 rows \(a, b\): the reduction needs a constant one"
    with pytest.raises(rnc.ConstraintError, match=words):
        select_independent(np.array([[[1.0, 0], [0, 1]], [[1.0, 0], [1, 0]]]), "ab")
    with pytest.raises(
        rnc.ConstraintError, match="row 'b' contradicts the others: it requires 1, the others require 0"
    ):
        select_independent(np.array([[[1.0, 0], [0, 0]]]), "ab", np.array([[0.0, 1.0]]))


def test_a_row_is_short_beside_the_longest_of_its_unit():
    block = SimpleNamespace(units=("m/s", "rad/s", "m/s"), holonomic=(False, False, True))
    samples = np.zeros((2, 3, 2))
    samples[0, 0], samples[1, 1], samples[1, 2] = [3, 4], [0, 0.5], [1, 0]
    np.testing.assert_array_equal(row_scales(block, samples), [5.0, 0.5, 5.0])
    block.holonomic = (False,) * 3
    np.testing.assert_array_equal(row_scales(block, samples), [0.0, 0.0, 0.0])
