"""Growth vectors: limits of what counts as a direction, how deep brackets go, and which sample is generic."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import growth, growth_vector
from rnc_pin.analysis.growth import MARGIN, generic_growth, grow
from rnc_pin.analysis.lie_brackets import frame_bracket
from systems import fire_truck, free_flying_panda, leaning_wheel, random_states, space_robot, tiago
from textbook_systems import sliders_with_rows, tractor_trailers, unicycle, unicycle_with_trailers


def every_joint():
    """Joints in an order in which no entries of v have the place of those of q."""
    model = pin.Model()
    kinds = (
        pin.JointModelRUBX(), pin.JointModelFreeFlyer(), pin.JointModelPY(), pin.JointModelPlanar(),
        pin.JointModelSpherical(), pin.JointModelTranslation(), pin.JointModelSphericalZYX(), pin.JointModelPlanar(),
    )  # fmt: skip
    for k, kind in enumerate(kinds):
        model.addJoint(k, kind, pin.SE3.Identity(), f"j{k}")
    return model


def as_matrix(kind, x):
    """Of se(2), so(3) or se(3)."""
    whole = np.zeros((4, 4))
    if kind == "planar":
        whole[:2, :2], whole[:2, 3] = [[0.0, -x[2]], [x[2], 0.0]], x[:2]
    elif kind == "spherical":
        whole[:3, :3] = pin.skew(x)
    else:
        whole[:3, :3], whole[:3, 3] = pin.skew(x[3:]), x[:3]
    return whole


def test_brackets_of_joints_are_commutators_of_matrices():
    model, generator = every_joint(), np.random.default_rng(0)
    x, y = generator.normal(size=(2, 2, 5, model.nv))
    found = frame_bracket(model)(x, y)
    assert found.shape == x.shape
    parts = {"free": slice(1, 7), "planar": slice(8, 11), "spherical": slice(11, 14), "second planar": slice(20, 23)}
    assert model.nv == 23
    for i in np.ndindex(2, 5):
        for name, where in parts.items():
            kind = name.split()[-1]
            a, b, c = (as_matrix(kind, each[i][where]) for each in (x, y, found))
            np.testing.assert_allclose(c, a @ b - b @ a, atol=1e-12)
    np.testing.assert_array_equal(np.delete(found, np.r_[1:7, 8:14, 20:23], axis=-1), 0.0)


def test_a_joint_whose_bracket_is_not_known_is_named():
    model, both = pin.Model(), pin.JointModelComposite()
    both.addJoint(pin.JointModelRUBX())
    both.addJoint(pin.JointModelRUBY())
    model.addJoint(0, both, pin.SE3.Identity(), "both")
    with pytest.raises(rnc.ConstraintError, match="no Lie bracket is known for a joint of type JointModelComposite"):
        frame_bracket(model)
    single = pin.JointModelComposite()
    single.addJoint(pin.JointModelRUBX())
    model = pin.Model()
    model.addJoint(0, single, pin.SE3.Identity(), "single")
    assert frame_bracket(model)(np.ones(1), np.ones(1)).tolist() == [0.0]


@pytest.mark.parametrize(("apart", "expected"), [(0.97e-5, (3, 4)), (1.03e-5, (3, 5)), (0.3, (3, 5))])
@pytest.mark.parametrize("weak", [1e-3, 1.0])
def test_first_brackets_are_judged_by_their_directions(weak, apart, expected):
    """``d3`` and ``weak (d3 + apart d4)``: the second counts however weak it is, but not along the first."""
    apart = apart / np.sqrt(1 - apart**2)

    def A(q):
        return [[0.0, q[0], weak * q[0]], [0.0, 0.0, weak * apart * q[0]]]

    found = grow(sliders_with_rows(A, lambda q, v: A(v)), np.zeros(5))
    assert found.vector == expected
    np.testing.assert_allclose(found.closure.T @ found.closure, np.eye(expected[-1]), atol=1e-12)


def test_what_varies_fast_still_grows():
    """``x2' = sin(20 x0) x1'`` and ``x3' = cos(21 x0) x1'``: the second derivatives point elsewhere than the first."""

    def A(q):
        return [[0.0, np.sin(20 * q[0])], [0.0, np.cos(21 * q[0])]]

    def A_dot(q, v):
        return [[0.0, 20 * np.cos(20 * q[0]) * v[0]], [0.0, -21 * np.sin(21 * q[0]) * v[0]]]

    reduced = sliders_with_rows(A, A_dot)
    for x in (0.1, 0.33, -0.52):
        found = grow(reduced, np.array([x, 0.4, -0.2, 0.3]))
        assert found.vector == (2, 3, 4)
        np.testing.assert_allclose(found.closure.T @ found.closure, np.eye(4), atol=1e-9)


def monomials(exponents):
    """``x_k' = x0^a x1^b x1'`` for pairs (a, b), exact rates included."""

    def A(q):
        return [[0.0, q[0] ** a * q[1] ** b] for a, b in exponents]

    def A_dot(q, v):
        return [
            [0.0, a * q[0] ** max(a - 1, 0) * q[1] ** b * v[0] + b * q[0] ** a * q[1] ** max(b - 1, 0) * v[1]]
            for a, b in exponents
        ]

    return sliders_with_rows(A, A_dot)


@pytest.mark.parametrize("depth", [1, 4, 8])
def test_a_chain_grows_by_one_a_level(depth):
    """``x_k' = x0^k x1'``, a chained form, whose k-th brackets are constant."""
    found = grow(monomials([(k, 0) for k in range(1, depth + 1)]), np.full(depth + 2, 0.3))
    assert found.vector == tuple(range(2, depth + 3))
    assert not found.doubtful
    assert found.margin > MARGIN


def test_a_level_may_bring_more_directions_than_a_flow_shows():
    """All monomials of a degree: (2, 3, 5, 8, 12), the last level four at once, and three functions a flow."""
    reduced = monomials([(a, degree - a) for degree in range(1, 5) for a in range(1, degree + 1)])
    assert grow(reduced, np.linspace(-0.3, 0.4, 12)).vector == (2, 3, 5, 8, 12)


def test_a_level_that_nothing_leads_to_ends_the_growth():
    reduced = monomials([(1, 0), (0, 1), (2, 0), (0, 2)])
    found = grow(reduced, np.linspace(-0.3, 0.4, 6))  # x1' and x1 x1' can be integrated
    assert (found.vector, found.doubtful) == ((2, 3, 4), False)
    assert found.closure.shape == (6, 4)


@pytest.mark.parametrize(("x", "vector", "doubtful"), [
    (0.3, (2, 3, 4), False), (1e-3, (2, 3, 4), False), (1e-9, (2, 3), True), (0.0, (2, 3), False),
])  # fmt: skip
def test_next_to_a_singular_configuration_a_direction_is_in_doubt(x, vector, doubtful):
    """``x2' = x0 x1'`` and ``x3' = x0^3 x1'``, whose second bracket ``6 x0`` vanishes at ``x0 = 0``."""
    found = grow(monomials([(1, 0), (3, 0)]), np.array([x, 0.2, 0.1, -0.4]))
    assert (found.vector, found.doubtful) == (vector, doubtful)


def test_the_largest_dimensions_are_generic_not_the_longest_vector(monkeypatch):
    told = {0: (2, 3, 3 + 1, 5), 1: (2, 3, 5), 2: (2, 3, 5), 3: (2, 3, 4)}

    def vector_of(reduced, q):
        return growth.Growth(told[int(q[0])], np.eye(5), 1e6 * (1 + q[0]), q[0] == 3)

    monkeypatch.setattr(growth, "grow", vector_of)
    evidence, agreeing = generic_growth(None, np.array([[0.0], [1.0], [2.0], [3.0]]))
    assert [(each.vector, q[0]) for each, q in agreeing] == [((2, 3, 5), 1.0), ((2, 3, 5), 2.0)]
    assert (evidence.samples, evidence.agreeing, evidence.doubtful) == (4, 2, 1)
    assert (dict(evidence.others), evidence.margin) == ({(2, 3, 4, 5): 1, (2, 3, 4): 1}, 2e6)
    assert evidence.decided
    assert not generic_growth(None, np.array([[3.0]]))[0].decided
    others = "(2, 3, 4, 5) at 1, (2, 3, 4) at 1"
    assert str(evidence) == f"2 of 4 samples agree, others: {others}; at 1 a direction is in doubt"


def test_samples_with_the_last_dimension_are_shown_if_none_has_all(monkeypatch):
    told = {0: (2, 4, 5), 1: (2, 3, 6)}
    monkeypatch.setattr(growth, "grow", lambda _, q: growth.Growth(told[int(q[0])], np.eye(6), 1e6 * (1 + q[0]), False))
    evidence, shown = generic_growth(None, np.array([[0.0], [1.0]]))
    assert [(each.vector, q[0]) for each, q in shown] == [((2, 4, 6), 1.0)]
    assert (evidence.agreeing, evidence.margin, evidence.decided) == (0, 2e6, False)


@pytest.mark.parametrize("n", [0, 3, pytest.param(5, marks=pytest.mark.long)])
def test_a_car_with_n_trailers_grows_by_one_a_level(n):
    """At generic configurations, of uniformly drawn hitches (Jean 1996; Sordalen 1993)."""
    report = rnc.analyze(tractor_trailers(n), samples=16)
    assert report.growth_vector == tuple(range(2, 5 + n))
    assert report.completely_nonholonomic
    evidence = report.growth_evidence
    assert evidence.agreeing >= 3
    assert evidence.margin >= MARGIN
    assert report.to_dict()["growth_evidence"]["samples"] == evidence.samples
    assert evidence.agreeing + sum(count for _, count in evidence.others) == evidence.samples


@pytest.mark.parametrize(
    ("apart", "last", "doubtful"), [(1e-2, 6, False), (1e-4, 6, False), (3e-6, 5, True), (1e-13, 5, False)]
)
def test_a_hitch_at_a_right_angle_is_singular(apart, last, doubtful):
    """Any hitch but that of the last trailer: there one level brings nothing (Jean 1996)."""
    reduced = tractor_trailers(2)
    found = grow(reduced, reduced.robot.configuration({"hitch_1": np.pi / 2 - apart, "front_steering": 0.3}))
    assert (found.vector, found.doubtful) == (tuple(range(2, last + 1)), doubtful)


def test_a_growth_vector_that_is_not_found_is_refused():
    """The degree of nonholonomy is 8, the largest of three trailers: the sixth Fibonacci number (Jean 1996)."""
    reduced = unicycle_with_trailers(3)
    q = reduced.robot.configuration({"hitch_1": np.pi / 2, "hitch_2": np.pi / 2})
    assert len(growth_vector(reduced, q)) == 8
    words = r"brackets up to depth 5 give the dimensions .2, 3, 4, 4, 5.*raise 'deepest'"
    with pytest.raises(rnc.InfeasibleError, match=words):
        growth_vector(reduced, q, deepest=4)
    with pytest.raises(rnc.InputError, match="deepest: expected a positive integer, found 0"):
        growth_vector(reduced, q, deepest=0)


def test_the_rounding_of_a_file_is_no_direction_at_any_depth():
    """``x2' = 1e-6 x0 x1'`` and a deeper ``x3' = 1e-6 x0^2 x1'`` beside ``x4' = x0 x1'``."""
    reduced = sliders_with_rows(
        lambda q: [[0.0, 1e-6 * q[0]], [0.0, 1e-6 * q[0] ** 2], [0.0, q[0]]],
        lambda q, v: [[0.0, 1e-6 * v[0]], [0.0, 2e-6 * q[0] * v[0]], [0.0, v[0]]],
    )
    assert grow(reduced, np.array([0.3, 0.2, -0.1, 0.4, 0.1])).vector == (2, 3)


@pytest.mark.parametrize(("make", "expected"), [
    (unicycle, (2, 3)),
    (fire_truck, (3, 5, 6)),
    (space_robot, (3, 4)),
    (leaning_wheel, (3, 4, 5)),  # the height above the plane is holonomic
    # Linear momentum is holonomic, because the centre of mass stays: test_integrability shows it too.
    pytest.param(free_flying_panda, (7, 10), marks=pytest.mark.long),
    (tiago, (12, 13, 14)),  # the difference of the wheels' angles is the heading
], ids=["unicycle", "fire truck", "space robot", "disk", "panda", "tiago"])  # fmt: skip
def test_growth_vector(make, expected):
    reduced = make()
    q, _ = random_states(reduced, 1, seed=11)[0]
    assert growth_vector(reduced, q) == expected
