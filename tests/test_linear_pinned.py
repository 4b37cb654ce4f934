"""Singular sets, bounds, reports and linear models of systems written down row by row, beside what they have to be."""

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg

import rnc_pin as rnc
from rnc_pin.analysis import boundedness, classify, integrability, lemma_1_residuals
from rnc_pin.analysis.linearization import Linearization
from rnc_pin.analysis.singularities import Singularity, stack_singularities, task_singularities
from systems import four_bar, leaning_wheel, random_states, spinning_space_robot
from test_analysis import planar_model, prismatic, unicycle


def sliders(count):
    """Bodies on rails of their own, ``s0`` to ``s<count - 1>``: q and v are their places and speeds."""
    model = pin.Model()
    model.name = "sliders"
    for k in range(count):
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), f"s{k}")
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return rnc.Robot(model)


def rates_of(rows, names):
    """Outputs with rows of a function of q; their own rates are not asked for."""
    return rnc.Output(None, lambda q: np.array(rows(q), float), lambda q, v: np.zeros((len(names), len(q))), names)


# ---------------------------------------------------------------------- singular configurations


def two_ways_to_be_singular():
    """a and b agree where q1 is a multiple of pi, c and d where q3 is zero."""
    return rnc.NonholonomicSystem(sliders(4), []).reduce(
        [
            rates_of(lambda q: [[0, 0, 2.0, 0], [3, 0, 0, 0]], ["c", "a"]),
            rates_of(lambda q: [[np.cos(q[1]), np.sin(q[1]), 0, 0], [0, 0, 1, q[3]]], ["b", "d"]),
        ]
    )


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
    """Of samples of the other sign the nearest counts, whichever comes first."""
    first, second, far = np.zeros((3, 4))
    first[:], second[:], far[:] = (0, -0.4, 0, 1), (0, 0.5, 0, 1), (0, -4.0, 0, 1)
    for configurations in ([first, second, far], [far, second, first]):
        (found,) = stack_singularities(two_ways_to_be_singular(), np.stack(configurations))
        assert abs(found.configuration["s1"]) < 1e-9
    (found,) = stack_singularities(two_ways_to_be_singular(), np.stack([first, far]))
    assert found.configuration["s1"] == pytest.approx(-np.pi, abs=1e-9)


@pytest.mark.parametrize(("part", "rows"), [(0.02, ("a", "b")), (0.5, ("a", "b", "c"))])
def test_rows_that_hardly_take_part_are_not_named(part, rows):
    """``b = a + part * c`` in the middle."""
    reduced = rnc.NonholonomicSystem(sliders(3), []).reduce(
        [rates_of(lambda q: [[1, 0, 0], [1, q[1], part], [0, 0, 1]], ["a", "b", "c"])]
    )
    (found,) = stack_singularities(reduced, np.array([[0.1, 0.7, 0.3], [0.2, -0.4, 0.1]]))
    assert found.located
    assert found.rows == rows


def test_of_two_sets_that_share_a_row_the_one_with_most_is_told():
    """a and b agree where q1 is zero, and c lies in their plane where q2 is."""
    reduced = rnc.NonholonomicSystem(sliders(3), []).reduce(
        [rates_of(lambda q: [[1, 0, 0], [1, q[1], 0], [1, 1, q[2]]], ["a", "b", "c"])]
    )
    samples = [[0.1, y, z] for y, z in ((0.7, 0.3), (-0.4, 0.3), (0.7, -0.2), (0.1, 0.5))]
    (found,) = stack_singularities(reduced, np.array(samples))
    assert found.rows == ("a", "b", "c")
    assert abs(found.configuration["s2"]) < 1e-9


def test_rows_of_a_long_chain_all_take_part():
    """Differences of neighbours round a ring: each has a small weight, and none a smaller one than another."""
    count = 16
    ring = np.eye(count) - np.roll(np.eye(count), 1, axis=1)
    last = np.outer(np.eye(count)[-1], np.eye(count)[3])
    names = [f"d{k}" for k in range(count)]
    reduced = rnc.NonholonomicSystem(sliders(count), []).reduce([rates_of(lambda q: ring + q[0] * last, names)])
    samples = np.zeros((2, count))
    samples[:, 0] = 0.3, -0.4
    (found,) = stack_singularities(reduced, samples)
    assert found.located
    assert found.rows == tuple(names)


@pytest.mark.parametrize("jump", [False, True])
def test_the_worst_sample_is_told_where_nothing_vanishes(jump):
    """Where a determinant jumps from one sign to the other there is no singular configuration between."""

    def side(q):
        return -1.0 if jump and q[0] < 0 else 1.0

    reduced = rnc.NonholonomicSystem(sliders(2), []).reduce(
        [rates_of(lambda q: [[1, 0], [2 * np.cos(q[1]), side(q) * 2 * np.sin(q[1])]], ["a", "b"])]
    )
    configurations = np.array([[-0.3, 1.2], [0.2, 0.4], [-0.1, 1.5], [0.3, 0.25], [0.1, 0.7], [0.2, 0.3]])
    (found,) = stack_singularities(reduced, configurations)
    assert not found.located
    assert found.configuration == {"s0": 0.3, "s1": 0.25}
    assert found.rows == ("a", "b")
    # Unit rows at an angle t: of the two singular values the smaller is sqrt(2) sin(t / 2).
    assert found.smallest_singular_value == pytest.approx(np.sqrt(2) * np.sin(0.125), rel=1e-12)


def test_the_way_to_a_singular_configuration_keeps_a_loop_closed():
    """A four-bar that its rocker drives is stuck where crank and coupler are in line."""
    reduced = rnc.NonholonomicSystem(
        four_bar().robot, [rnc.LoopClosure("coupler_tip", "rocker_tip", "point")], ["crank"]
    ).reduce([rnc.JointPosition("rocker")])
    generator = np.random.default_rng(2)
    found = stack_singularities(reduced, np.stack([reduced.random_configuration(generator) for _ in range(8)]))
    for each in found:
        assert each.located
        assert "rocker" in each.rows
        assert abs(np.sin(each.configuration["coupler"])) < 1e-7
        assert np.abs(reduced.position_residual(reduced.robot.configuration(each.configuration))).max() < 1e-10
    assert found


def steered(a, g):
    """``x11dot = a(w) u``, and the redundant output has the rate ``g(w) u``: A4 is a / g, and E is singular with g."""
    row = rnc.Pfaffian(lambda q: np.array([[1.0, -a(q[2]), 0.0]]), lambda q, v: np.zeros((1, 3)), ["steered"])
    return rnc.NonholonomicSystem(sliders(3), [row]).reduce(
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


def test_a_reducing_output_that_stands_still_is_the_only_row():
    """Constraint rows come first in E."""
    configurations = np.array([[0.0, 0.0, w] for w in (1.3, 1.9, -0.7)])
    (found,) = stack_singularities(steered(np.sin, np.cos), configurations)
    assert found.rows == ("x22",)
    assert found.configuration["s2"] == pytest.approx(np.pi / 2, abs=1e-9)


# ---------------------------------------------------------------------- bounds


@pytest.mark.parametrize("make", [spinning_space_robot, leaning_wheel])
def test_sizes_are_those_of_the_matrices(make):
    """V without what a given momentum adds to it, for the worst of the unit velocities."""
    reduced = make()
    configurations = np.stack([q for q, _ in random_states(reduced, 5)])
    bounds = boundedness(reduced, configurations)
    H, V, G = [], [], []
    for q in configurations:
        rest = reduced.terms(q, np.zeros(reduced.r))
        turned = [reduced.terms(q, unit).V - rest.V for unit in np.eye(reduced.r)]
        H.append(np.linalg.eigvalsh(rest.H)[-1])
        V.append(max(np.sqrt(np.linalg.eigvalsh(each.T @ each)[-1]) for each in turned))
        G.append(np.sqrt(rest.G @ rest.G))
    for found, sizes in ((bounds.H, H), (bounds.V, V), (bounds.G, G)):
        expected = min(sizes), sorted(sizes)[2], max(sizes)
        np.testing.assert_allclose((found.min, found.median, found.max), expected, rtol=1e-9, atol=1e-9)
    assert max(G) > 0.1
    assert bounds.everywhere
    assert bounds.approaches == ()


def test_growth_towards_a_singular_heading_is_that_of_the_closed_form():
    """A unicycle in x and yaw, at d from heading along y: ``H = 1 / sin(d)^2``, ``V = cos(d) / sin(d)^3``.

    Only the nearest sample lies straight across; sets that were not met, or are not of E, are no goals.
    """
    model, _ = planar_model()
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body")])
    reduced = system.reduce([rnc.FramePosition("body", "x"), rnc.FrameYaw("body")])

    def singularity(matrix="E", located=True):
        return Singularity(matrix, ("body_x",), 0.0, located, {"root_joint": [2.0, 1.0, np.pi / 2]})

    samples = [(5.0, 1.0, 1.5), (2.0, 1.0, np.pi / 2 - 0.4), (2.0, 1.0, np.pi / 2 + 0.9)]
    configurations = np.stack([reduced.robot.configuration({"root_joint": each}) for each in samples])
    goals = [singularity("A4"), singularity(located=False), singularity()]
    bounds = boundedness(reduced, configurations, goals)
    (way,) = bounds.approaches
    distances = np.array(way.distances)
    assert 0.1 > distances[0] > 10 * distances[-1] > 0
    assert (np.diff(distances) < 0).all()
    np.testing.assert_allclose(way.H, 1 / np.sin(distances) ** 2, rtol=1e-9)
    np.testing.assert_allclose(way.V, np.cos(distances) / np.sin(distances) ** 3, rtol=1e-9)
    assert (way.H_order, way.V_order) == (pytest.approx(2.0, abs=1e-3), pytest.approx(3.0, abs=1e-3))
    assert way.rows == ("body_x",)
    assert not way.bounded
    assert not bounds.everywhere


@pytest.mark.parametrize(("mass", "H_order", "V_order"), [(0.0, 0.0, 0.0), (1.0, 2.0, 3.0), (1e-15, 0.0, 3.0)])
def test_what_grows_without_inertia_leaves_h_bounded(mass, H_order, V_order):
    """The last slide moves at ``1 / q1`` times the first; of a grain of dust V grows where H hardly does."""
    row = rnc.Pfaffian(lambda q: np.array([[1.0, 0.0, -q[1]]]), lambda q, v: np.array([[0.0, 0.0, -v[1]]]), ["lever"])
    robot = sliders(3)
    robot.model.inertias[3] = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    reduced = rnc.NonholonomicSystem(robot, [row]).reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])
    goal = Singularity("E", ("lever", "s0"), 0.0, True, {"s0": 0.0, "s1": 0.0, "s2": 0.0})
    bounds = boundedness(reduced, np.array([[0.0, 0.5, 0.0]]), [goal])
    (way,) = bounds.approaches
    assert way.bounded == bounds.everywhere == (mass == 0)
    assert (way.H_order, way.V_order) == (pytest.approx(H_order, abs=0.01), pytest.approx(V_order, abs=0.01))
    np.testing.assert_allclose(way.H, 1 + mass / np.square(way.distances), rtol=1e-9)


# ---------------------------------------------------------------------- the regulator


def linear(A, B):
    """A system that is written down, with states x0, x1, ... and inputs u0, u1, ..."""
    A, B = np.array(A, float), np.array(B, float)
    states, inputs = (tuple(f"{letter}{k}" for k in range(count)) for letter, count in zip("xu", B.shape, strict=True))
    zero = np.zeros(1)
    return Linearization(A, B, states, inputs, zero, zero, zero, 0.0, (), None, None)


@pytest.mark.parametrize("a", [-0.7, 0.0, 1.3])
def test_the_gain_of_one_state_is_that_of_the_closed_form(a):
    b, q, r = 0.8, 3.0, 0.5
    expected = (a + np.sqrt(a**2 + b**2 * q / r)) / b
    for state_cost in (q, [q], {"x0": q}, [[q]]):
        for input_cost in (r, [r], {"u0": r}, [[r]]):
            np.testing.assert_allclose(rnc.lqr(linear([[a]], [[b]]), state_cost, input_cost), [[expected]])


def test_a_gain_for_inputs_that_cost_together_is_the_least():
    """No other gain costs less: the cost of a start x is ``x^T P x``, by the equation of Lyapunov."""
    generator = np.random.default_rng(0)
    system = linear(generator.normal(size=(3, 3)), generator.normal(size=(3, 2)))
    Q, R = np.diag([1.0, 0.0, 2.0]), np.array([[2.0, 0.7], [0.7, 0.5]])
    K = rnc.lqr(system, {"x0": 1.0, "x2": 2.0}, R)

    def cost(gain):
        closed = system.A - system.B @ gain
        assert np.linalg.eigvals(closed).real.max() < 0
        return np.trace(scipy.linalg.solve_continuous_lyapunov(closed.T, -(Q + gain.T @ R @ gain)))

    for i in np.ndindex(K.shape):
        step = np.zeros(K.shape)
        step[i] = 1e-4
        assert abs(cost(K + step) - cost(K - step)) / 2e-4 < 1e-6 * cost(K)
        assert cost(K) < min(cost(K + step), cost(K - step))


def test_what_grows_and_costs_nothing_is_mirrored():
    """The cheapest way to stop it: from a rate of 1.5 to one of -1.5. What fades by itself is left alone."""
    np.testing.assert_allclose(rnc.lqr(linear([[1.5]], [[0.5]]), 0.0), [[6.0]])
    K = rnc.lqr(linear(np.diag([-1.0, 1.5]), [[0.0], [0.5]]), {"x1": 0.0})
    np.testing.assert_allclose(K, [[0.0, 6.0]], atol=1e-9)


OSCILLATOR = [[0.3, 2.7, 0.0, 0.0], [-1.9, -0.3, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("A", "B", "cost", "words"),
    [
        (
            OSCILLATOR,
            [[0, 0], [0, 0], [0, 1], [1, 0]],
            1.0,
            "the actuators u0, u1 do not reach a mode that does not fade by itself: it moves x0, x1",
        ),
        (
            OSCILLATOR,
            [[1, 0], [0, 0], [0, 0], [0, 0]],
            1.0,
            "the actuators u0, u1 do not reach a mode that does not fade by itself: it moves x3",
        ),
        (
            OSCILLATOR,
            [[1, 0], [0, 0], [0, 0], [0, 1]],
            {"x2": 1.0, "x3": 2.0},
            "state_cost: a mode that does not fade by itself costs nothing: it moves x0, x1",
        ),
        (
            OSCILLATOR,
            [[1, 0], [0, 0], [0, 0], [0, 1]],
            {"x0": 1.0},
            "state_cost: a mode that does not fade by itself costs nothing: it moves x3",
        ),
        (
            np.diag([0.5, 0.2]),
            [[1.0], [0.0]],
            1.0,
            "the actuators u0 do not reach a mode that does not fade by itself: it moves x1",
        ),
    ],
)
@pytest.mark.parametrize("rate", [1.0, 1e5])
def test_modes_that_cannot_be_held_are_named(A, B, cost, words, rate):
    """However fast they are."""
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.lqr(linear(rate * np.array(A), rate * np.array(B)), cost)
    assert str(told.value) == words


def test_a_mode_that_moves_many_states_names_them_all():
    """Their mean grows, and the inputs do not move it."""
    mean = np.full((16, 16), 1 / 16)
    B = np.zeros((16, 1))
    B[:2, 0] = 1.0, -1.0
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.lqr(linear(1.5 * mean - np.eye(16), B), 1.0)
    assert str(told.value).endswith(f"it moves {', '.join(f'x{k}' for k in range(16))}")


def test_only_the_proportion_of_the_costs_counts():
    system = linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
    np.testing.assert_allclose(rnc.lqr(system, 1e-8, 1e-8), rnc.lqr(system, 1.0, 1.0), rtol=1e-6)


@pytest.mark.parametrize("size", [1e-4, 1.0, 1e4])
def test_a_double_integrator_in_other_units_of_time_is_regulated(size):
    K = rnc.lqr(linear([[0.0, size], [0.0, 0.0]], [[0.0], [size]]), 1.0)
    np.testing.assert_allclose(K, [[1.0, np.sqrt(3.0)]], rtol=1e-7)


@pytest.mark.parametrize(
    ("cost", "inputs", "words"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], 1.0, "state_cost: no weight may be negative"),
        ([1.0, -1e-3], 1.0, "state_cost: no weight may be negative"),
        ([[1.0, 0.5], [0.0, 1.0]], 1.0, "or a symmetric matrix, found"),
        ([1.0, np.nan], 1.0, "or a symmetric matrix, found"),
        ([[1.0, 2.0]], 1.0, "or a symmetric matrix, found"),
        ([1.0], 1.0, "state_cost: expected a number, one for each of x0, x1, or a symmetric matrix, found"),
        (1.0, [1.0, 1.0], "input_cost: expected a number, one for each of u0, or a symmetric matrix, found"),
        (1.0, 0.0, "input_cost: every input has to weigh something"),
        (1.0, -1.0, "input_cost: every input has to weigh something"),
        (1.0, {"u": 1.0}, "input_cost: no 'u'; did you mean 'u0'"),
    ],
)
def test_costs_that_are_none_are_refused(cost, inputs, words):
    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.lqr(linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]), cost, inputs)


def test_a_cost_that_is_negative_by_rounding_is_none():
    """A square of a row has no negative weight, but its computed eigenvalue is less than zero."""
    row = np.array([[1.0, 1.0 / 3.0]])
    cost = row.T @ row - 1e-15 * np.eye(2)
    assert np.linalg.eigvalsh(cost).min() < 0
    K = rnc.lqr(linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]), cost)
    np.testing.assert_allclose(K, [[1.0, np.sqrt(1 / 9 + 2.0)]], rtol=1e-6)


# ---------------------------------------------------------------------- classes of redundancy


def written(A, A_dot=None):
    """Slides whose last ``k`` move at ``A(q)`` (k, r) times the rates of the first ``r``."""
    k, r = np.shape(A(np.zeros(99)))

    def rows(q):
        return np.hstack([-np.array(A(q), float), np.eye(k)])

    def rows_dot(q, v):
        return np.zeros((k, r + k)) if A_dot is None else np.hstack([-np.array(A_dot(q, v), float), np.zeros((k, k))])

    names = [f"row_{i}" for i in range(k)]
    reduced = rnc.NonholonomicSystem(sliders(r + k), [rnc.Pfaffian(rows, rows_dot, names)])
    return reduced.reduce(
        [rnc.JointPosition(f"s{i}") for i in range(r)], [rnc.JointPosition(f"s{i}") for i in range(r, r + k)]
    )


@pytest.mark.parametrize(
    ("A", "redundant", "expected", "tracked", "reason"),
    [
        ([[5, 2]], "1", "1", "2", "A4 has full row rank"),
        (
            [[5, 2, 3]],
            "12",
            "1",
            "3",
            "A4 has full row rank (more redundant than vertical outputs: some freedom is left)",
        ),
        ([[5, 2], [4, 3]], "1", None, "23", "2 vertical outputs moved by 1 redundant one: too few to steer them all"),
        (
            [[5, 1, 2], [4, 2, 4]],
            "12",
            None,
            "34",
            "2 vertical outputs moved by 2 redundant ones, but A4 has not full row rank",
        ),
        (
            [[5, 1, 2], [4, 0, 0]],
            "12",
            None,
            "3",
            "1 vertical output moved by 2 redundant ones: class 2 needs as many of both",
        ),
        ([[3, 5], [2, 0]], "0", None, "23", "2 vertical outputs moved by 1 redundant one: too few to steer them all"),
        ([[5, 0], [4, 3]], "1", "2", "3", "A6 = 0, A4 nonsingular and A5 independent of x22"),
        ([[5, 0], [4, 0]], "1", None, "", "A4 = 0, and the values of x22 do not steer A3 v21 either"),
    ],
)
def test_a_class_of_constant_blocks(A, redundant, expected, tracked, reason):
    """Names, words and figures."""
    A, free = np.array(A, float), [int(k) for k in redundant]
    k, r = A.shape
    reduced = written(lambda q: A)
    task = rnc.Task.of(reduced, [f"s{i}" for i in range(r) if i not in free], [f"s{i}" for i in free])
    configurations = np.random.default_rng(0).normal(size=(5, r + k))
    found = classify(reduced, task, configurations)
    A3, A4 = np.delete(A, free, axis=1), A[:, free]
    moved = A4.any(axis=1)
    vertical = [f"s{r + i}" for i in range(k)]
    names = tuple(f"s{r + i}" for i in range(k) if moved[i])
    assert names == tuple(f"s{i}" for i in tracked)
    assert (found.redundancy_class, found.reason) == (expected, reason)
    assert (found.tracked, found.driven) == (names, tuple(name for name in vertical if name not in names))
    evidence = found.evidence
    np.testing.assert_allclose(evidence.A3, np.abs(A3).max())
    values = np.linalg.svd(A4[moved], compute_uv=False) if moved.any() else np.zeros(2)
    np.testing.assert_allclose(evidence.A4_singular_values, (values.min(), values.max()), atol=1e-12)
    np.testing.assert_allclose((evidence.A6, evidence.A5_along_x22), 0.0, atol=1e-12)
    spread = next(block.smallest_singular_value for block in evidence.blocks if block.name == "A4")
    if moved.any():
        np.testing.assert_allclose((spread.min, spread.max), values.min(), atol=1e-12)
    assert evidence.steering == (None if moved.any() else 0.0)
    shapes = {block.name: block.shape for block in evidence.blocks if block.name.startswith("A")}
    above, below = moved.sum(), k - moved.sum()
    assert shapes == {"A3": (above, r - len(free)), "A4": (above, len(free))} | {
        "A5": (below, r - len(free)),
        "A6": (below, len(free)),
    }


def test_figures_are_those_of_the_columns_and_rows_of_the_task():
    """The redundant output stands first, primary ones and vertical ones in another order than in the model."""

    def A(q):
        return [[1.5 + np.sin(q[1]), 7.0, 0.0], [0.0, 0.3 * q[2], -4.0]]

    def A_dot(q, v):
        return [[np.cos(q[1]) * v[1], 0.0, 0.0], [0.0, 0.3 * v[2], 0.0]]

    reduced = written(A, A_dot)
    task = rnc.Task.of(reduced, ["s2", "s1"], ["s0"], ["s4", "s3"])
    configurations = np.random.default_rng(1).normal(size=(5, 5))
    found = classify(reduced, task, configurations)
    assert (found.redundancy_class, found.tracked, found.driven) == ("2", ("s3",), ("s4",))
    A4, A5 = 1.5 + np.sin(configurations[:, 1]), np.hypot(4.0, 0.3 * configurations[:, 2])
    np.testing.assert_allclose(found.evidence.A4_singular_values, (A4.min(), A4.max()))
    spreads = {block.name: block.smallest_singular_value for block in found.evidence.blocks if block.rows}
    for name, sizes in (("A3", np.full(5, 7.0)), ("A4", A4), ("A5", A5), ("A6", np.zeros(5))):
        expected = sizes.min(), np.median(sizes), sizes.max()
        np.testing.assert_allclose((spreads[name].min, spreads[name].median, spreads[name].max), expected, atol=1e-12)
    assert [block.largest_entry for block in found.evidence.blocks] == pytest.approx([7.0, A4.max(), 4.0, 0.0])
    assert found.evidence.blocks[2].columns == ("s2", "s1")
    np.testing.assert_allclose(found.evidence.A3, 7.0)


def test_what_only_the_value_of_an_output_steers():
    """``x11dot = sin(x22) s0dot``: its derivative is the cosine, times a speed of about one."""
    reduced = written(lambda q: [[np.sin(q[1]), 0.0], [3.0, 0.0]], lambda q, v: [[np.cos(q[1]) * v[1], 0], [0, 0]])
    task = rnc.Task.of(reduced, ["s0"], ["s1"])
    configurations = np.random.default_rng(1).uniform(-1, 1, size=(5, 4))
    found = classify(reduced, task, configurations)
    assert (found.redundancy_class, found.tracked, found.driven) == ("2s", ("s2",), ("s3",))
    rates = np.cos(configurations[:, 1])
    *_, block = found.evidence.blocks
    assert (block.name, block.shape, block.largest_entry) == ("d(A3 v21)/dx22", (1, 1), found.evidence.steering)
    spread = block.smallest_singular_value
    assert spread.min / spread.max == pytest.approx(rates.min() / rates.max())
    assert 0.5 < spread.max / rates.max() < 1.5
    assert found.evidence.A4_singular_values == (0.0, 0.0)
    np.testing.assert_allclose(found.evidence.A3, 3.0)


def test_how_a5_depends_on_x22_is_its_partial_derivative():
    along = np.array([0.3, -0.4, 0.7, 1.1])
    reduced = prismatic(lambda q: 1 + 0.5 * np.sin(along @ q), lambda q: 0.5 * np.cos(along @ q) * along)
    configurations = np.random.default_rng(1).uniform(-1, 1, size=(5, 4))
    found = classify(reduced, rnc.Task.of(reduced, ["x21"], ["x22"]), configurations)
    assert found.reason == "1 vertical output moved by 1 redundant one, but A5 depends on x22"
    assert found.evidence.A5_along_x22 == pytest.approx(0.5 * 1.1 * np.abs(np.cos(configurations @ along)).max())


# ---------------------------------------------------------------------- the report


@pytest.mark.parametrize(
    ("B", "rank", "missing"),
    [
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], 3, ()),
        ([[1, 0], [0, 1], [0, 0]], 2, ("s2",)),
        ([[0, 0], [2, 0], [0, 3]], 2, ("s0",)),
        ([[1, 1], [1, 1], [0, 0]], 1, ("s0", "s1", "s2")),
        ([[1, 0], [1, 0], [0, 5]], 2, ("s0", "s1")),
        ([[0.0], [0.0], [0.0]], 0, ("s0", "s1", "s2")),
    ],
)
@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e7])
def test_forces_that_are_missing(B, rank, missing, unit):
    """Where q1 is positive one more is, so that this is no worst sample."""
    B, more = unit * np.array(B, float), np.array([[3.0, 1.0, 0.0], [0.0, 2.0, 1.0], [1.0, 0.0, 1.0]])

    def drives(q):
        return np.hstack([B, unit * more * (q[1] > 0)])

    reduced = rnc.NonholonomicSystem(sliders(3), [], drives).reduce([rnc.JointPosition(f"s{k}") for k in range(3)])
    report = rnc.analyze(reduced, samples=12)
    assert (report.actuation_rank, report.unactuated) == (rank, missing)


def test_a_report_is_of_the_samples_it_says():
    """Those that its seed draws; Lemma 1 and the class are judged on the better half."""
    wall = -0.5

    def coordinate(q):
        if q[0] < wall:
            raise rnc.SingularityError("behind the wall", q=q, condition=np.inf, rows=("ahead",))
        return q[:1]

    def rows(q):
        coordinate(q)
        return np.array([[q[2], -q[3], 0.0]])

    ahead = rnc.Output(coordinate, rows, lambda q, v: np.array([[-q[3] * v[2], -q[2] * v[2], 0.0]]), ["ahead"])
    model, _ = planar_model()
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.NoSideSlip("body")], np.eye(3)[:, :1])
    reduced = system.reduce([ahead, rnc.FrameYaw("body")], [rnc.FramePosition("body", "y")])
    seed, samples, generator = 5, 21, np.random.default_rng(5)
    drawn = np.stack([reduced.random_configuration(generator) for _ in range(samples)])
    regular = drawn[drawn[:, 0] >= wall]
    conditions = np.array([reduced.condition(q) for q in regular])
    good = regular[conditions <= np.median(conditions)]
    report = rnc.analyze(reduced, redundant=["body_yaw"], samples=samples, seed=seed)
    assert 0 < samples - len(regular) < samples
    assert (report.samples, report.singular_samples) == (samples, samples - len(regular))
    assert report.condition == pytest.approx(
        {"min": conditions.min(), "median": np.median(conditions), "max": conditions.max()}
    )
    assert report.lemma1 == pytest.approx(lemma_1_residuals(reduced, good, seed))
    assert report.lemma1_holds
    task = rnc.Task.of(reduced, ["ahead"], ["body_yaw"])
    assert report.redundancy == classify(reduced, task, good, seed)
    assert (report.n, report.r, report.p, report.rank) == (3, 2, 1, 1)
    assert (report.actuation_rank, report.unactuated) == (1, ("body_yaw",))
    assert report.completely_nonholonomic
    assert report.lemma1_bounds.H.max == pytest.approx(boundedness(reduced, regular).H.max)


# ---------------------------------------------------------------------- linear models


CENTER = np.array([3.0, 2.0])


def round_a_center():
    """Distance from a point, and heading against the bearing from there; rows in the body's own axes."""

    def parts(q):
        (x, y), (c, s) = q[:2] - CENTER, q[2:]
        ahead, beside = x * c + y * s, y * c - x * s
        return ahead, beside, np.hypot(x, y)

    def value(q):
        ahead, beside, rho = parts(q)
        return np.array([rho, np.arctan2(-beside, ahead)])

    def rows(q):
        ahead, beside, rho = parts(q)
        return np.array([[ahead / rho, beside / rho, 0.0], [beside / rho**2, -ahead / rho**2, 1.0]])

    def rows_dot(q, v):
        ahead, beside, rho = parts(q)
        ahead_dot, beside_dot = v[0] + v[2] * beside, v[1] - v[2] * ahead
        rho_dot = (ahead * ahead_dot + beside * beside_dot) / rho
        first = np.array([ahead_dot, beside_dot, 0.0]) / rho - np.array([ahead, beside, 0.0]) * rho_dot / rho**2
        second = np.array([beside_dot, -ahead_dot, 0.0]) - 2 * np.array([beside, -ahead, 0.0]) * rho_dot / rho
        return np.stack([first, second / rho**2])

    return rnc.Output(value, rows, rows_dot, ["rho", "phi"])


def test_a_circle_in_coordinates_that_do_not_move():
    """``rho' = u cos(phi)``, ``phi' = w - u sin(phi) / rho`` of a unicycle; its rates in another order."""
    reduced, speed, turn = unicycle(), 6.0, 4.0
    rho = speed / turn
    q = reduced.robot.configuration(
        {"root_joint": (3.0, 2.0 - rho, 0.0)}
    )  # heading along x, to the left of its bearing
    found = rnc.linearize(reduced, q, [speed, turn], coordinates=[round_a_center()], rates=["body_yaw", "body_speed_x"])
    assert found.state_names == ("rho", "phi", "body_yaw_dot", "body_speed_x")
    A = np.zeros((4, 4))
    A[0, 1], A[1, 0], A[1, 2], A[1, 3] = -speed, speed / rho**2, 1.0, -1.0 / rho
    np.testing.assert_allclose(found.A, A, atol=1e-8)
    np.testing.assert_allclose(found.B, [[0, 0], [0, 0], [0, 1 / 0.1], [1 / 1.0, 0]], atol=1e-9)
    moved = reduced.robot.configuration({"root_joint": (3.0, 2.0 - rho - 0.1, 0.2)})
    np.testing.assert_allclose(found.deviation(moved, [6.3, 3.9]), [0.1, 0.2, -0.1, 0.3], atol=1e-12)


def test_a_coordinate_in_the_world_does_not_turn_with_the_body():
    """In a turn, of ``y' = u sin(yaw)`` the heading is missing; where the body is along x is not."""
    reduced = unicycle()
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, reduced.robot.configuration(), [0.5, 2.0], coordinates=[rnc.FramePosition("body", "y")])
    missing = "the motion depends on more than body_y, body_speed_x, body_yaw: on 'root_joint[2]' among others"
    assert str(told.value) == missing


def test_of_coordinates_that_move_the_fastest_is_named():
    reduced = unicycle()
    q = reduced.robot.configuration({"root_joint": (0.0, 0.0, 0.3)})
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, q, [1.0, 0.0], coordinates=[rnc.FrameYaw("body"), rnc.FramePosition("body", "yx")])
    assert str(told.value) == "coordinate 'body_x' moves in this motion: leave it out of the coordinates"


def test_a_loop_has_the_coordinates_that_it_leaves():
    """The crank alone: differences of its acceleration, over configurations at which the loop is closed."""
    reduced = four_bar()
    guess = reduced.robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5})

    def closed(crank):
        return reduced.assembled(np.array([crank, *guess[1:]]), hold=["crank"])

    q = closed(1.0)
    found = rnc.linearize(reduced, q, coordinates=["crank"])
    assert abs(found.T[0]) > 0.1
    h, rest = 1e-4, np.zeros(1)
    ahead, behind = (reduced.forward_dynamics(closed(1.0 + sign * h), rest, found.T)[0] for sign in (1, -1))
    np.testing.assert_allclose(found.A, [[0.0, 1.0], [(ahead - behind) / (2 * h), 0.0]], rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(found.B, [[0.0], [1 / reduced.inertia(q)[0, 0]]], rtol=1e-9)
    moved = closed(1.3)
    np.testing.assert_allclose(found.deviation(moved, [0.7]), [0.3, 0.7], atol=1e-12)


def test_inputs_that_hold_are_the_smallest():
    """Three drives for two velocities, on a slope."""
    model, _ = planar_model()
    model.gravity.linear = np.array([-2.0, 0.0, 0.0])
    slope = rnc.Robot(model)
    B = np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    reduced = rnc.NonholonomicSystem(slope, [rnc.NoSideSlip("body")], B).reduce(
        [rnc.FrameSpeed("body"), rnc.FrameYaw("body")]
    )
    found = rnc.linearize(reduced, slope.configuration())
    np.testing.assert_allclose(found.T, [0.4, 0.8, 0.0], atol=1e-12)  # 2 N in all
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, slope.configuration(), T=[0.0, 0.0, 0.05])
    assert str(told.value) == (
        "not an equilibrium and not a steady motion: under T = [0. 0. 0.05] "
        "the rate of 'body_speed_x' changes by -2 a second"
    )


def test_eigenvalues_stand_by_real_part_and_then_by_imaginary_part():
    A = np.zeros((5, 5))
    A[:2, :2], A[2:4, 2:4], A[4, 4] = [[-1, 3], [-3, -1]], [[-1, 2], [-2, -1]], -4
    np.testing.assert_allclose(linear(A, np.zeros((5, 1))).eigenvalues, [-4, -1 - 3j, -1 - 2j, -1 + 2j, -1 + 3j])


# ---------------------------------------------------------------------- integrable combinations


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (2.0, "first - 2.5 second"),
        (-2.0, "first + 2.5 second"),
        (5.0, "first - second"),
    ],
)
def test_a_combination_of_rows_as_they_are_is_put_in_words(share, words):
    """Rows ``5 b + dw`` and ``k b + 3 dw`` with a contact form b: what is left of b is the differential of w."""

    def contact(q):
        return np.array([-q[1], q[0], 1.0, 0.0])

    def rows(q):
        return np.stack([5 * contact(q) + [0, 0, 0, 1], share * contact(q) + [0, 0, 0, 3]])

    def rows_dot(q, v):
        rate = np.array([-v[1], v[0], 0.0, 0.0])
        return np.stack([5 * rate, share * rate])

    system = rnc.NonholonomicSystem(sliders(4), [rnc.Pfaffian(rows, rows_dot, ["first", "second"])])
    reduced = system.reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])
    found = integrability(reduced, np.random.default_rng(0).normal(size=(3, 4)))
    assert found.growth_vector == (2, 3)
    assert found.nonholonomic == ("first", "second")
    (combination,) = found.combinations
    assert combination.constant
    assert str(combination) == words
    report = rnc.analyze(reduced, samples=8)
    assert report.integrable_combinations == (words,)
    assert not report.completely_nonholonomic
