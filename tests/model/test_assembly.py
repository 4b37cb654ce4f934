"""Assembly of configurations, step by step: gaps of which every iterate is known."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.independence import ROUNDING
from rnc_pin.model.kinematics import Kinematics
from textbook_systems import Flat, coupling, sliders

ROBOT = sliders(masses=(1.0, 1.0, 1.0), chain=False)


def test_residuals_of_many_states_stand_one_under_the_other():
    first, last = Flat(np.eye(3)[:2], "ab", holonomic=(True, False)), Flat(np.eye(3)[1:], "de", holonomic=(False, True))
    blocks = [first, coupling("c", "b", 2.0, 0.5).bind(ROBOT), last]
    assembly = Assembly(ROBOT, blocks)
    assert (assembly.names, assembly.size) == (("a", "coupling(c, b)", "e"), 3)
    q = np.random.default_rng(3).normal(size=(2, 4, 3))
    a, b, c = np.moveaxis(q, -1, 0)
    expected = np.stack([a - 1.0, c - 2 * b - 0.5, c - 1.0], axis=-1)
    np.testing.assert_allclose(assembly.residual(q), expected, atol=1e-14)
    np.testing.assert_allclose(assembly.residual(q[1, 2]), expected[1, 2], atol=1e-14)
    at = Kinematics(ROBOT).position(q[0, 0])
    np.testing.assert_array_equal(assembly.jacobian(at), [[1.0, 0, 0], [0, -2.0, 1.0], [0, 0, 1.0]])
    name, size = assembly.worst(np.array([1.5, 0.0, -4.0]))
    assert (name, size) == ("e", -5.0)


def test_assembling_takes_the_shortest_way_as_inertia_measures_it():
    """By a constant inertia M: ``q - M^-1 A^T (A M^-1 A^T)^-1 r``, and with joints held the same of others."""
    robot = sliders()
    M = np.array([[10.0, 8, 5], [8, 8, 5], [5, 5, 5]])
    assembly, A = Assembly(robot, [coupling("b", "a", 2.0, 0.3).bind(robot)]), np.array([[-2.0, 1.0, 0.0]])
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
    nothing, q = Assembly(sliders(), []), np.array([0.1, 0.2, 0.3])
    assert nothing.project(q) is q
    assert (nothing.rank(q), nothing.size, nothing.names) == (0, 0, ())
    assert (nothing.leading.shape, nothing.residual(np.zeros((4, 2, 3))).shape) == ((0,), (4, 2, 0))
    assert nothing.random_configuration(np.random.default_rng(0)).shape == (3,)


def test_what_contradicts_itself_is_met_half_way_and_told():
    """``b = 2 a + 0.3`` and ``a = b / 2 + 0.5``: the least squares of both leave 0.26 of one and 0.52 of the other."""
    robot = sliders()
    rows = [coupling("b", "a", 2.0, 0.3).bind(robot), coupling("a", "b", 0.5, 0.5).bind(robot)]
    assembly = Assembly(robot, rows)
    assert (assembly.names, assembly.leading.tolist()) == (("coupling(b, a)", "coupling(a, b)"), [True, False])
    assert np.array(assembly.names)[~assembly.leading].tolist() == ["coupling(a, b)"]
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


def test_random_configurations_need_rows_that_are_defined():
    def undefined(q):
        raise rnc.SingularityError("nowhere", q=q, condition=np.inf, rows=("one",))

    nowhere = Flat(np.eye(3)[:2], ["one", "two"], gap=undefined)
    with pytest.raises(rnc.ConstraintError, match=r"from any of 100 random configurations$"):
        Assembly(ROBOT, [nowhere]).random_configuration(np.random.default_rng(0))


def test_rows_of_the_ground_that_no_joint_moves_are_left_alone():
    """Zero, or zero but for rounding beside the longest of the same unit; elsewhere they have to be satisfied."""
    robot, flags = sliders(), (True, True, False, True, True)
    matrix = np.zeros((5, 3))
    matrix[1:, 0] = [0.8 * ROUNDING, 1.0, 1.3 * ROUNDING, 0.8 * ROUNDING]
    units = ("m/s",) * 4 + ("rad/s",)
    rows = (Flat(matrix, "vwxyz", None, flags, units, on_ground) for on_ground in (True, False))
    ground, given = (Assembly(robot, [each]) for each in rows)
    assert (ground.names, given.names) == (("y", "z"), ("v", "w", "y", "z"))
    q = np.ones(3)
    np.testing.assert_allclose(given.residual(q), matrix[[0, 1, 3, 4]].sum(axis=1) - 1.0)
    np.testing.assert_allclose(ground.residual(q), matrix[[3, 4]].sum(axis=1) - 1.0)
    np.testing.assert_array_equal(ground.jacobian(Kinematics(robot).position(q)), matrix[[3, 4]])


def test_a_row_that_was_thought_to_follow_and_does_not_is_met_with_the_others():
    robot = sliders()
    rows = [coupling("b", "a", 2.0, 0.3).bind(robot), coupling("c", "a", -1.0, 0.1).bind(robot)]
    assembly = Assembly(robot, rows, ["coupling(c, a)"])
    np.testing.assert_allclose(assembly.residual(assembly.project(np.array([0.4, -0.2, 0.1]))), 0.0, atol=1e-11)

    class Turning(Flat):
        def jacobian(self, at):
            return np.eye(3)[[0, 1 if at.q[0] > 0 else 0]]

    assert Assembly(robot, [Turning(np.eye(3)[:2], ["one", "two"])]).leading.all()  # of no one rank: nothing follows
    with pytest.raises(rnc.ConstraintError, match="constraint rows overflow: scale down their entries"):
        Assembly(robot, [coupling("b", "a", 1e170).bind(robot)]).project(np.ones(3))
