"""Classes and reports of systems written down row by row, beside what they have to be."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import classify
from rnc_pin.analysis.redundancy_class import stack_singularities, task_singularities
from systems import four_bar
from textbook_systems import prismatic, rail_sliders, sliders_with_rows


@pytest.mark.parametrize(("A", "redundant", "expected", "tracked", "reason"), [
    ([[5, 2]], "1", "1", "2", "A4 has full row rank"),
    ([[5, 2, 3]], "12", "1", "3", "A4 has full row rank (more redundant than vertical outputs: some freedom is left)"),
    ([[5, 2], [4, 3]], "1", None, "23", "2 vertical outputs moved by 1 redundant one: too few to steer them all"),
    ([[5, 1, 2], [4, 2, 4]], "12", None, "34",
        "2 vertical outputs moved by 2 redundant ones, but A4 has not full row rank"),
    ([[5, 1, 2], [4, 0, 0]], "12", None, "3",
        "1 vertical output moved by 2 redundant ones: class 2 needs as many of both"),
    ([[3, 5], [2, 0]], "0", None, "23", "2 vertical outputs moved by 1 redundant one: too few to steer them all"),
    ([[5, 0], [4, 3]], "1", "2", "3", "A6 = 0, A4 nonsingular and A5 independent of x22"),
    ([[5, 0], [4, 0]], "1", None, "", "A4 = 0, and the values of x22 do not steer A3 v21 either"),
])  # fmt: skip
def test_a_class_of_constant_blocks(A, redundant, expected, tracked, reason):
    A, free = np.array(A, float), [int(k) for k in redundant]
    k, r = A.shape
    reduced = sliders_with_rows(lambda q: A)
    task = rnc.Task.of(reduced, [f"s{i}" for i in range(r) if i not in free], [f"s{i}" for i in free])
    found = classify(reduced, task, np.random.default_rng(0).normal(size=(5, r + k)))
    A3, A4 = np.delete(A, free, axis=1), A[:, free]
    moved, vertical = A4.any(axis=1), [f"s{r + i}" for i in range(k)]
    names = tuple(f"s{r + i}" for i in range(k) if moved[i])
    assert names == tuple(f"s{i}" for i in tracked)
    assert (found.redundancy_class, found.reason) == (expected, reason)
    assert (found.tracked, found.driven) == (names, tuple(name for name in vertical if name not in names))
    evidence = found.evidence
    np.testing.assert_allclose(evidence.A3, np.abs(A3).max())
    values = np.linalg.svd(A4[moved], compute_uv=False) if moved.any() else np.zeros(2)
    np.testing.assert_allclose(evidence.A4_singular_values, (values.min(), values.max()), atol=1e-12)
    np.testing.assert_allclose((evidence.A6, evidence.A5_along_x22), 0.0, atol=1e-12)
    assert evidence.steering == (None if moved.any() else 0.0)


def test_figures_are_those_of_the_columns_and_rows_of_the_task():
    def A(q):
        return [[1.5 + np.sin(q[1]), 7.0, 0.0], [0.0, 0.3 * q[2], -4.0]]

    def A_dot(q, v):
        return [[np.cos(q[1]) * v[1], 0.0, 0.0], [0.0, 0.3 * v[2], 0.0]]

    reduced = sliders_with_rows(A, A_dot)
    task = rnc.Task.of(reduced, ["s2", "s1"], ["s0"], ["s4", "s3"])
    configurations = np.random.default_rng(1).normal(size=(5, 5))
    found = classify(reduced, task, configurations)
    assert (found.redundancy_class, found.tracked, found.driven) == ("2", ("s3",), ("s4",))
    A4 = 1.5 + np.sin(configurations[:, 1])
    np.testing.assert_allclose(found.evidence.A4_singular_values, (A4.min(), A4.max()))
    np.testing.assert_allclose(found.evidence.A3, 7.0)


def test_what_only_the_value_of_an_output_steers():
    """``x11dot = sin(x22) s0dot``: its derivative is the cosine, times a speed of about one."""
    reduced = sliders_with_rows(lambda q: [[np.sin(q[1]), 0], [3, 0]], lambda q, v: [[np.cos(q[1]) * v[1], 0], [0, 0]])
    task = rnc.Task.of(reduced, ["s0"], ["s1"])
    configurations = np.random.default_rng(1).uniform(-1, 1, size=(5, 4))
    found = classify(reduced, task, configurations)
    assert (found.redundancy_class, found.tracked, found.driven) == ("2s", ("s2",), ("s3",))
    assert 0.5 < found.evidence.steering / np.cos(configurations[:, 1]).max() < 1.5
    assert found.evidence.A4_singular_values == (0.0, 0.0)
    np.testing.assert_allclose(found.evidence.A3, 3.0)


def test_how_a5_depends_on_x22_is_its_partial_derivative():
    along = np.array([0.3, -0.4, 0.7, 1.1])
    reduced = prismatic(lambda q: 1 + 0.5 * np.sin(along @ q), lambda q: 0.5 * np.cos(along @ q) * along)
    configurations = np.random.default_rng(1).uniform(-1, 1, size=(5, 4))
    found = classify(reduced, rnc.Task.of(reduced, ["x21"], ["x22"]), configurations)
    assert found.reason == "1 vertical output moved by 1 redundant one, but A5 depends on x22"
    assert found.evidence.A5_along_x22 == pytest.approx(0.5 * 1.1 * np.abs(np.cos(configurations @ along)).max())


@pytest.mark.parametrize(("along", "expected"), [
    ((0, 0, 0, 0), "2"),
    ((0, 0, 1, 0), "2"),  # on x21
    ((0, 1, 0, 0), "2"),  # on x12
    ((1, 0, 0, 0), "2"),  # on x11, which x22 moves: the paper asks for A5(x11, x12, x21)
    ((0, 0, 0, 1), None),  # on x22
    ((1, 0, 0, -1), None),  # on x11 - x22, which x22 does not change under the constraints
    ((1, 1, 1, 0.2), None),
])  # fmt: skip
def test_class_2_asks_for_an_A5_without_x22_and_lets_it_depend_on_all_else(along, expected):
    along = np.array(along, dtype=float)
    reduced = prismatic(lambda q: 1 + 0.5 * np.sin(along @ q), lambda q: 0.5 * np.cos(along @ q) * along)
    found = rnc.analyze(reduced, ["x21"], ["x22"], samples=16).redundancy
    assert found.redundancy_class == expected
    assert (found.tracked, found.driven) == (("x11",), ("x12",))
    assert (found.evidence.A5_along_x22 > 0.01 * abs(along[3])) == (along[3] != 0)
    assert ("A5 depends on x22" in found.reason) == (expected is None)


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
