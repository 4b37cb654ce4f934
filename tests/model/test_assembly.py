"""How configurations are assembled, step by step: gaps of which every iterate is known."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.model.assembly import Assembly
from rnc_pin.model.kinematics import Kinematics
from textbook_systems import Flat, coupling, sliders

ROBOT = sliders(masses=(1.0, 1.0, 1.0), chain=False)


def one_row(gap, visited=None):
    """A row along the first slide, whose gap is whatever is given of its place."""

    def told(q):
        if visited is not None and q.ndim == 1:
            visited.append(float(q[0]))
        return np.asarray(gap(q[..., :1]), dtype=float)

    return Assembly(ROBOT, [Flat([[1.0, 0, 0]], ["row"], told)])


def test_steps_are_no_longer_than_half_a_metre_and_no_more_than_a_hundred():
    visited = []
    near = one_row(lambda x: x - 10.0, visited)
    visited.clear()
    assert near.project(np.zeros(3))[0] == 10.0
    np.testing.assert_allclose(visited, np.arange(0.0, 10.5, 0.5))
    assert one_row(lambda x: x - 50.0).project(np.zeros(3))[0] == 50.0
    with pytest.raises(rnc.ConstraintError, match=r"near q satisfies row: row has residual 0.4, limit 1e-11$"):
        one_row(lambda x: x - 50.4).project(np.zeros(3))


def test_what_goes_too_far_is_halved_eleven_times_at_most():
    """Of a gap that is k times as steep as its row says, ``1 - k / 2^j`` is left by the first j that leaves less."""
    for k, halvings in ((3.0, 1), (1500.0, 10), (4000.0, 11)):
        visited, start = [], -1e-5 * k
        one_row(lambda x, k=k, start=start: k * x + start, visited)._closest(np.zeros(3))
        gaps = (k * np.array(visited) + start).tolist()
        after = gaps[gaps.index(start) + 1 :]
        expected = [start * (1 - k / 2**j) for j in range(halvings + 1)]
        np.testing.assert_allclose(after[: halvings + 1], expected)
    found, residual, closed = one_row(lambda x: 4200.0 * x - 1e-3)._closest(np.zeros(3))
    assert (found[0], residual.tolist(), closed) == (0.0, [-1e-3], False)


def test_what_is_zero_enough_is_left_alone():
    straight = one_row(lambda x: x)
    here, there = np.array([0.95e-14, 1.0, 2.0]), np.array([1.05e-14, 1.0, 2.0])
    assert straight.project(here) is here
    assert straight.project(there) is not there
    assert one_row(lambda x: 0 * x + 0.95e-11).project(np.ones(3)).tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(rnc.ConstraintError, match=r"row has residual 1.05e-11, limit 1e-11"):
        one_row(lambda x: 0 * x + 1.05e-11).project(np.ones(3))
    for off, good in ((0.95e-4, True), (1.05e-4, False)):
        rows = [coupling("b", "a", 2.0, 0.3), coupling("a", "b", 0.5, -0.15 + off)]
        q, assembly = np.array([0.4, -0.2, 0.1]), Assembly(ROBOT, [each.bind(ROBOT) for each in rows])
        if good:
            np.testing.assert_allclose(assembly.residual(assembly.project(q)), [0.0, -off], atol=1e-12)
        else:
            with pytest.raises(rnc.ConstraintError, match="has residual"):
                assembly.project(q)


def test_it_gives_up_after_two_steps_in_a_row_that_hardly_help():
    """Each leaves ``1 - k``: more than 0.999 of it, and that more than a millimetre."""
    for k, start, steps in ((1.1e-3, 0.4, 100), (0.9e-3, 0.4, 2), (0.9e-3, 1.003e-3, 2), (0.9e-3, 1.0005e-3, 100)):
        _, residual, closed = one_row(lambda x, k=k: k * x)._closest(np.array([start / k, 0.0, 0.0]))
        assert residual[0] == pytest.approx(start * (1 - k) ** steps, rel=1e-9)
        assert not closed


def test_directions_that_hardly_move_a_row_are_not_corrected():
    """By a billionth of the longest, as inertia measures it; ranks are told from a hundred-millionth on."""
    for slope, closes in ((1.05e-9, True), (0.95e-9, False)):
        rows = Flat([[1.0, 0, 0], [0, slope, 0]], "ab", units=("m/s", "rad/s"))
        gap = Flat(rows.matrix, "ab", lambda q, A=rows.matrix: np.matvec(A, q - 0.25), units=("m/s", "rad/s"))
        found, residual, closed = Assembly(ROBOT, [gap])._closest(np.zeros(3))
        assert closed == closes
        np.testing.assert_allclose(found, [0.25, 0.25 * closes, 0.0], atol=1e-3)
        assert residual[0] == pytest.approx(0.0, abs=1e-12)
    for slope, rank in ((1.05e-8, 2), (0.95e-8, 1)):
        assembly = Assembly(ROBOT, [Flat([[3.0, 0, 0], [0, 3.0 * slope, 0]], "ab", units=("m/s", "rad/s"))])
        assert assembly.rank(np.zeros(3)) == rank


def test_rows_of_the_ground_that_nothing_moves_are_left_out_to_rounding():
    for size, names in ((1.05e-12, ("a",)), (0.95e-12, ())):
        row = Flat([[size, 0, 0]], "a", on_ground=True)
        assert Assembly(ROBOT, [row]).names == names
    assert Assembly(ROBOT, [Flat([[0.0, 0, 0]], "a")]).names == ("a",)


def test_residuals_of_many_states_stand_one_under_the_other():
    blocks = [
        Flat(np.eye(3)[:2], "ab", holonomic=(True, False)),
        coupling("c", "b", 2.0, 0.5).bind(ROBOT),
        Flat(np.eye(3)[1:], "de", holonomic=(False, True)),
    ]
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
