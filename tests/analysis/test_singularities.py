"""Singular sets and bounds of systems written down row by row, beside what they have to be."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis.redundancy_class import stack_singularities, task_singularities
from systems import four_bar
from textbook_systems import rail_sliders


def rates_of(rows, names):
    """Outputs with rows of a function of q."""
    return rnc.Output(None, lambda q: np.array(rows(q), float), names=names)


def two_ways_to_be_singular():
    """a and b agree where q1 is a multiple of pi, c and d where q3 is zero."""
    first = rates_of(lambda q: [[0, 0, 2.0, 0], [3, 0, 0, 0]], ["c", "a"])
    second = rates_of(lambda q: [[np.cos(q[1]), np.sin(q[1]), 0, 0], [0, 0, 1, q[3]]], ["b", "d"])
    return rnc.NonholonomicSystem(rail_sliders(4), []).reduce([first, second])


def test_each_singular_set_is_met_with_the_rows_that_are_dependent_there():
    configurations = np.random.default_rng(3).uniform(-1.5, 1.5, (16, 4))
    found = {each.rows: each for each in stack_singularities(two_ways_to_be_singular(), configurations)}
    assert set(found) == {("a", "b"), ("c", "d")}
    for each in found.values():
        assert (each.matrix, each.located) == ("E", True)
        assert each.smallest_singular_value < 1e-9
    assert abs(found["a", "b"].configuration["s1"]) < 1e-9
    assert abs(found["c", "d"].configuration["s3"]) < 1e-9


def test_a_singular_set_is_looked_for_between_neighbours():
    first, second, far = np.zeros((3, 4))
    first[:], second[:], far[:] = (0, -0.4, 0, 1), (0, 0.5, 0, 1), (0, -4.0, 0, 1)
    for configurations in ([first, second, far], [far, second, first]):
        (found,) = stack_singularities(two_ways_to_be_singular(), np.stack(configurations))
        assert abs(found.configuration["s1"]) < 1e-9
    (found,) = stack_singularities(two_ways_to_be_singular(), np.stack([first, far]))
    assert found.configuration["s1"] == pytest.approx(-np.pi, abs=1e-9)


@pytest.mark.parametrize(("rows", "samples", "expected"), [
    # Rows that hardly take part are not named: b is a, and a little or much of c, in the middle.
    (lambda q: [[1, 0, 0], [1, q[1], 0.02], [0, 0, 1]], [[0.1, 0.7, 0.3], [0.2, -0.4, 0.1]], {"ab": {}}),
    (lambda q: [[1, 0, 0], [1, q[1], 0.5], [0, 0, 1]], [[0.1, 0.7, 0.3], [0.2, -0.4, 0.1]], {"abc": {}}),
    # Of two sets that share rows both are found: a and b agree where q1 is zero, and c is in their plane where q2 is.
    (lambda q: [[1, 0, 0], [1, q[1], 0], [1, 1, q[2]]],
        [[0.1, y, z] for y, z in ((0.7, 0.3), (-0.4, 0.3), (0.7, -0.2), (0.1, 0.5))],
        {"abc": {"s2": 0.0}, "ab": {"s1": 0.0}}),
    # Of one set the point with most rows: b is a + q0 c where q1 is zero, and at small q0 the part of c is small.
    (lambda q: [[1, 0, 0], [1, q[1], q[0]], [0, 0, 1]],
        [[0.01, 0.5, 0.0], [0.01, -0.5, 0.0], [0.9, 0.5, 0.0], [0.9, -0.5, 0.0]], {"abc": {"s0": 0.9}}),
])  # fmt: skip
def test_each_set_is_named_once_by_the_rows_that_take_part(rows, samples, expected):
    reduced = rnc.NonholonomicSystem(rail_sliders(3), []).reduce([rates_of(rows, ["a", "b", "c"])])
    found = {"".join(each.rows): each for each in stack_singularities(reduced, np.array(samples))}
    assert found.keys() == expected.keys()
    for name, where in expected.items():
        assert found[name].located
        assert {joint: found[name].configuration[joint] for joint in where} == pytest.approx(where, abs=1e-9)


def test_samples_and_ways_where_an_output_is_undefined_are_left_out():
    """Beyond q0 = 2 the first output is undefined: samples there and ways across count for nothing, others do."""

    def rows(q):
        if q[0] > 2.0:
            raise rnc.SingularityError("undefined", q=q, condition=np.inf, rows=())
        return [[1, 0, 0], [1, np.sin(q[1]), 0], [0, 0, 1]]

    reduced = rnc.NonholonomicSystem(rail_sliders(3), []).reduce([rates_of(rows, ["a", "b", "c"])])
    beyond, left, right = (3.0, 0.2, 0.0), (0.0, 0.4, 0.0), (0.0, -0.7, 0.0)
    for samples in ([beyond, left, right], [left, beyond, right], [left, right, beyond]):
        (found,) = stack_singularities(reduced, np.array(samples))
        assert (found.rows, found.located) == (("a", "b"), True)
        assert abs(found.configuration["s1"]) < 1e-9
    assert stack_singularities(reduced, np.array([beyond, beyond])) == []


def test_a_way_that_meets_an_undefined_output_does_not_end_the_search():
    def rows(q):
        if abs(q[0] - 0.5) < 0.1:
            raise rnc.SingularityError("undefined", q=q, condition=np.inf, rows=())
        return [[1, 0], [1, np.sin(q[1])]]

    reduced = rnc.NonholonomicSystem(rail_sliders(2), []).reduce([rates_of(rows, ["a", "b"])])
    samples = [(0.2, 0.4), (5.0, 0.3), (0.8, -0.5), (5.1, -0.2), (5.2, -0.4)]
    (found,) = stack_singularities(reduced, np.array(samples))
    assert found.located
    assert found.configuration["s0"] > 4.9
    assert abs(found.configuration["s1"]) < 1e-9


def test_rows_of_a_long_chain_all_take_part():
    """Differences of neighbours round a ring: each has a small weight, and none a smaller one than another."""
    count = 16
    ring = np.eye(count) - np.roll(np.eye(count), 1, axis=1)
    last = np.outer(np.eye(count)[-1], np.eye(count)[3])
    names = [f"d{k}" for k in range(count)]
    reduced = rnc.NonholonomicSystem(rail_sliders(count), []).reduce([rates_of(lambda q: ring + q[0] * last, names)])
    samples = np.zeros((2, count))
    samples[:, 0] = 0.3, -0.4
    (found,) = stack_singularities(reduced, samples)
    assert found.located
    assert found.rows == tuple(names)


@pytest.mark.parametrize("jump", [False, True])
def test_the_worst_sample_is_told_where_nothing_vanishes(jump):
    """A determinant that jumps from one sign to the other has no singular configuration between."""

    def side(q):
        return -1.0 if jump and q[0] < 0 else 1.0

    rows = rates_of(lambda q: [[1, 0], [2 * np.cos(q[1]), side(q) * 2 * np.sin(q[1])]], ["a", "b"])
    reduced = rnc.NonholonomicSystem(rail_sliders(2), []).reduce([rows])
    configurations = np.array([[-0.3, 1.2], [0.2, 0.4], [-0.1, 1.5], [0.3, 0.25], [0.1, 0.7], [0.2, 0.3]])
    (found,) = stack_singularities(reduced, configurations)
    assert not found.located
    assert (found.configuration, found.rows) == ({"s0": 0.3, "s1": 0.25}, ("a", "b"))
    # Unit rows at an angle t: of the two singular values the smaller is sqrt(2) sin(t / 2).
    assert found.smallest_singular_value == pytest.approx(np.sqrt(2) * np.sin(0.125), rel=1e-12)


def test_the_way_to_a_singular_configuration_keeps_a_loop_closed():
    """A four-bar that its rocker drives is stuck where crank and coupler are in line."""
    loop = rnc.LoopClosure("coupler_tip", "rocker_tip", "point")
    reduced = rnc.NonholonomicSystem(four_bar().robot, [loop], ["crank"]).reduce([rnc.JointPosition("rocker")])
    generator = np.random.default_rng(2)
    found = stack_singularities(reduced, np.stack([reduced.random_configuration(generator) for _ in range(8)]))
    for each in found:
        assert each.located
        assert "rocker" in each.rows
        assert abs(np.sin(each.configuration["coupler"])) < 1e-7
        assert np.abs(reduced.assembly.residual(reduced.robot.configuration(each.configuration))).max() < 1e-10
    assert found


def steered(a, g):
    """``x11dot = a(w) u``, and the redundant output has the rate ``g(w) u``: A4 is a / g, and E is singular with g."""
    row = rnc.Pfaffian(lambda q: np.array([[1.0, -a(q[2]), 0.0]]), names=["steered"])
    return rnc.NonholonomicSystem(rail_sliders(3), [row]).reduce(
        [rates_of(lambda q: [[0, 0, 1]], ["w"]), rates_of(lambda q: [[0, g(q[2]), 0]], ["x22"])],
        [rnc.JointPosition("s1"), rnc.JointPosition("s0")],
    )


def test_a4_is_not_called_singular_where_it_has_a_pole():
    """A4 is the tangent of w: between samples either side of its pole nothing vanishes, between the others it does."""
    reduced = steered(np.sin, np.cos)
    task = rnc.Task.of(reduced, ["w"], ["x22"])
    configurations = np.array([[0.0, 0.0, w] for w in (1.3, 1.9, -0.7)])
    (found,) = task_singularities(reduced, task, ["s0"], configurations)
    assert (found.matrix, found.located, found.rows) == ("A4", True, ("s0",))
    assert abs(found.configuration["s2"]) < 1e-9
    (worst,) = task_singularities(reduced, task, ["s0"], configurations[:2])
    assert not worst.located
    assert worst.smallest_singular_value == pytest.approx(abs(np.tan(1.9)))  # as it is, no row of unit length
    assert worst.configuration["s2"] == 1.9


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_a4_in_other_units_is_singular_at_the_same_place(unit):
    reduced = steered(lambda w: unit * np.sin(w - 0.2), lambda w: 1.0)
    task = rnc.Task.of(reduced, ["w"], ["x22"])
    configurations = np.array([[0.0, 0.0, w] for w in (1.3, 1.9, -0.7)])
    (found,) = task_singularities(reduced, task, ["s0"], configurations)
    assert found.located
    assert found.configuration["s2"] == pytest.approx(0.2, abs=1e-9)
