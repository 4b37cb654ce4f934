"""Lie brackets beside those in coordinates, and limits of what counts as a direction."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import growth, growth_vector
from rnc_pin.analysis.growth import (
    _Brackets,
    _derivative,
    _first_brackets,
    _found_twice,
    _in_blocks,
    _rest,
    frame_bracket,
    grow,
)
from test_analysis import trailers
from test_singular_pinned import sliders

# ---------------------------------------------------------------------- the bracket of a joint's own axes


def every_joint():
    """Joints in an order in which no entries of v have the place of those of q."""
    model = pin.Model()
    kinds = (
        pin.JointModelRUBX(),
        pin.JointModelFreeFlyer(),
        pin.JointModelPY(),
        pin.JointModelPlanar(),
        pin.JointModelSpherical(),
        pin.JointModelTranslation(),
        pin.JointModelSphericalZYX(),
        pin.JointModelPlanar(),
    )
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
    others = np.delete(found, np.r_[1:7, 8:14, 20:23], axis=-1)
    np.testing.assert_array_equal(others, 0.0)


def test_a_joint_whose_bracket_is_not_known_is_named():
    model, both = pin.Model(), pin.JointModelComposite()
    both.addJoint(pin.JointModelRUBX())
    both.addJoint(pin.JointModelRUBY())
    model.addJoint(0, both, pin.SE3.Identity(), "both")
    with pytest.raises(rnc.ConstraintError) as told:
        frame_bracket(model)
    assert str(told.value) == "no growth vector for a robot with a joint of type JointModelComposite"
    single = pin.JointModelComposite()
    single.addJoint(pin.JointModelRUBX())
    model = pin.Model()
    model.addJoint(0, single, pin.SE3.Identity(), "single")
    assert frame_bracket(model)(np.ones(1), np.ones(1)).tolist() == [0.0]


# ---------------------------------------------------------------------- brackets of fields


def in_coordinates(p):
    """A car with a trailer at (x, y, yaw, hitch): its q, and what takes entries of v to rates of these."""
    c, s = np.cos(p[2]), np.sin(p[2])
    turned = np.eye(4)
    turned[:2, :2] = [[c, -s], [s, c]]
    return np.array([p[0], p[1], c, s, p[3]]), turned


def bracket_in_coordinates(X, Y, h):
    """``DY X - DX Y`` of two fields of p, by differences."""

    def value(p):
        x, y = X(p), Y(p)
        return (Y(p + h * x) - Y(p - h * x) - X(p + h * y) + X(p - h * y)) / (2 * h)

    return value


def test_brackets_are_those_in_coordinates():
    """Of generators with each other, and of these with a generator again: at many points, other than where they are."""
    reduced = trailers(1)
    p_0, generator = np.array([0.4, -0.3, 0.7, 0.5]), np.random.default_rng(2)
    brackets = _Brackets(reduced, in_coordinates(p_0)[0])
    np.testing.assert_allclose(brackets.generators.T @ brackets.generators, np.eye(2), atol=1e-12)
    scaling = np.linalg.lstsq(reduced.at(in_coordinates(p_0)[0]).R, brackets.generators, rcond=None)[0]
    combinations = generator.normal(size=(3, 2))

    def field(combination):
        def value(p):
            q, turned = in_coordinates(p)
            return turned @ reduced.at(q).R @ scaling @ combination

        return value

    X, Y, Z = (field(each) for each in combinations)
    once = bracket_in_coordinates(X, Y, 1e-4)
    twice = bracket_in_coordinates(Z, bracket_in_coordinates(X, Y, 1e-3), 1e-3)
    pair = brackets.of_pair(combinations[0], combinations[1])
    nested = brackets.of(combinations[2], pair)
    points = p_0 + 0.5 * generator.normal(size=(3, 4))
    q = np.stack([in_coordinates(p)[0] for p in points])
    for found, expected, accuracy in ((pair, once, 1e-6), (nested, twice, 1e-4)):
        values = found(q, 0.01)
        assert values.shape == (3, 4)
        for p, value in zip(points, values, strict=True):
            wanted = np.linalg.solve(in_coordinates(p)[1], expected(p))
            assert np.abs(wanted).max() > 0.05
            np.testing.assert_allclose(value, wanted, atol=accuracy * (1 + np.abs(wanted).max()))


def test_a_derivative_is_of_eighth_order():
    """Exact up to the eighth power; of the ninth ``4! 4! h^8`` is missing, whatever the length of the direction."""
    model, step = sliders(2).model, 0.3
    directions = np.array([[2.0, 0.0], [0.0, 0.0], [-0.3, 0.4], [0.0, -3.0]])
    points = np.array([[0.0, 0.7], [0.3, 0.4], [0.0, 0.0], [0.5, 0.0]])

    def powers(at, h):
        assert h == step
        return np.stack([at[:, 0] ** 9 + at[:, 1] ** 8, at[:, 1] ** 9 + 5.0], axis=-1)

    found = _derivative(model, powers, points, directions, step)
    missing = -576 * step**8
    expected = [[2.0, 0.0], [0.0, 0.0], [-0.5 * 0.6**9, 0.5 * 0.8**9], [0.0, -3.0]]
    np.testing.assert_allclose(found, missing * np.array(expected), atol=1e-12)


def test_fields_are_asked_for_few_configurations_at_a_time():
    sizes = []

    def field(points, step):
        sizes.append(len(points))
        return step * points

    points = np.random.default_rng(0).normal(size=(600, 3))
    np.testing.assert_array_equal(_in_blocks(field)(points, 0.5), 0.5 * points)
    assert sizes == [256, 256, 88]


# ---------------------------------------------------------------------- what counts


@pytest.mark.parametrize(("share", "found"), [(0.97, True), (1.03, False), (-0.97, True), (-1.03, False)])
def test_a_direction_has_to_be_there_with_both_steps(share, found):
    """Of 0.01 and 0.007: unit vectors a fifth apart are not the same."""
    basis, q = np.eye(4)[:, :1], np.zeros(4)
    apart = 2 * np.arcsin(0.1)

    def field(points, step):
        angle = share * apart * (0.01 - step) / 0.003
        return np.array([[-4.0, 3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.0]])

    direction = _found_twice(basis, field, q)
    if found:
        np.testing.assert_allclose(direction, [0.0, 1.0, 0.0, 0.0], atol=1e-12)
    else:
        assert direction is None


@pytest.mark.parametrize(
    ("length", "out", "found"),
    [(50.0, 0.97e-5, False), (50.0, 1.03e-5, True), (0.97e-10, 1.0, False), (1.03e-10, 1.0, True)],
)
def test_a_direction_has_to_lead_out(length, out, found):
    """By a part in a hundred thousand, of what is not short itself."""
    basis, q = np.eye(3)[:, :2], np.zeros(3)
    inside = np.sqrt(1 - out**2)
    direction = _found_twice(basis, lambda points, step: length * np.array([[inside, 0.0, out]]), q)
    assert (direction is not None) == found
    if found:
        np.testing.assert_allclose(direction, [0.0, 0.0, 1.0], atol=1e-6)


def test_what_leads_out_is_square_to_the_basis():
    """To rounding, however little it is."""
    generator = np.random.default_rng(1)
    basis, _ = np.linalg.qr(generator.normal(size=(6, 3)))
    out = np.linalg.qr(np.column_stack([basis, generator.normal(size=6)]))[0][:, 3]
    rest = _rest(basis, 7.0 * (basis @ [0.6, -0.8, 0.0]) + 7e-8 * out)
    assert np.linalg.norm(rest) == pytest.approx(1e-8, rel=1e-6)
    assert np.abs(basis.T @ rest).max() < 1e-22


def contact(A, A_dot):
    """Slides whose last ``k`` move at ``A(q)`` (k, r) times the rates of the first ``r``."""
    k, r = np.shape(A(np.zeros(20)))

    def rows(q):
        return np.hstack([-np.array(A(q), float), np.eye(k)])

    def rows_dot(q, v):
        return np.hstack([-np.array(A_dot(q, v), float), np.zeros((k, k))])

    system = rnc.NonholonomicSystem(sliders(r + k), [rnc.Pfaffian(rows, rows_dot)])
    return system.reduce([rnc.JointPosition(f"s{i}") for i in range(r)])


@pytest.mark.parametrize(("weak", "expected"), [(0.97e-5, (2,)), (1.03e-5, (2, 3))])
def test_a_first_bracket_has_to_be_a_part_in_a_hundred_thousand(weak, expected):
    reduced = contact(lambda q: [[0.0, weak * q[0]]], lambda q, v: [[0.0, weak * v[0]]])
    found = grow(reduced, np.zeros(3))
    assert found.vector == growth_vector(reduced, np.zeros(3)) == expected
    assert found.closure.shape == (3, expected[-1])


@pytest.mark.parametrize(("apart", "expected"), [(0.97e-5, (3, 4)), (1.03e-5, (3, 5)), (0.3, (3, 5))])
@pytest.mark.parametrize("weak", [1e-3, 1.0])
def test_first_brackets_are_judged_by_their_directions(weak, apart, expected):
    """``d3`` and ``weak (d3 + apart d4)``: the second counts however weak it is, but not along the first."""
    apart = apart / np.sqrt(1 - apart**2)

    def A(q):
        return [[0.0, q[0], weak * q[0]], [0.0, 0.0, weak * apart * q[0]]]

    reduced = contact(A, lambda q, v: A(v))
    found = grow(reduced, np.zeros(5))
    assert found.vector == expected
    np.testing.assert_allclose(found.closure.T @ found.closure, np.eye(expected[-1]), atol=1e-12)


def test_what_hardly_leads_out_is_square_to_the_rest():
    """Under ``x2' = 50000 x0' + 9 x0 x1'`` the bracket, along x2, is next to a generator."""
    reduced = contact(lambda q: [[5e4, 9.0 * q[0]]], lambda q, v: [[0.0, 9.0 * v[0]]])
    found = grow(reduced, np.array([0.2, -0.3, 0.1]))
    assert found.vector == (2, 3)
    np.testing.assert_allclose(found.closure.T @ found.closure, np.eye(3), atol=1e-14)


def test_what_varies_fast_still_grows():
    """``x2' = sin(20 x0) x1'`` and ``x3' = cos(21 x0) x1'``: the second derivatives point elsewhere than the first."""

    def A(q):
        return [[0.0, np.sin(20 * q[0])], [0.0, np.cos(21 * q[0])]]

    def A_dot(q, v):
        return [[0.0, 20 * np.cos(20 * q[0]) * v[0]], [0.0, -21 * np.sin(21 * q[0]) * v[0]]]

    reduced = contact(A, A_dot)
    for x in (0.1, 0.33, -0.52):
        found = grow(reduced, np.array([x, 0.4, -0.2, 0.3]))
        assert found.vector == (2, 3, 4)
        np.testing.assert_allclose(found.closure.T @ found.closure, np.eye(4), atol=1e-9)


def test_the_first_brackets_that_lead_out_are_kept_as_fields():
    """Three generators, of whose brackets one lies in their span and two are the same."""

    def A(q):
        return [[0.0, 2.0 * q[0], 2.0 * q[0]], [0.0, 0.0, 0.0]]

    reduced, q = contact(A, lambda q, v: A(v)), np.array([0.3, 0.2, -0.1, 0.5, 0.4])
    brackets = _Brackets(reduced, q)
    basis, fields = _first_brackets(brackets, np.linalg.qr(brackets.generators)[0])
    assert basis.shape == (5, 4)
    (field,) = fields
    (value,) = field(q[None], 0.01)
    np.testing.assert_allclose(np.delete(value, 3), 0.0, atol=1e-12)
    assert abs(value[3]) > 0.1
    np.testing.assert_allclose(basis @ (basis.T @ value), value, atol=1e-12)


# ---------------------------------------------------------------------- how deep, and how often


@pytest.fixture
def draws(monkeypatch):
    """Let each draw find what a list says: a new direction or none."""
    seen = {"finds": [], "draws": 0}

    def found(basis, field, q):
        seen["draws"] += 1
        if not (seen["finds"] and seen["finds"].pop(0)):
            return None
        return np.linalg.svd(basis)[0][:, basis.shape[1]]

    monkeypatch.setattr(growth, "_found_twice", found)
    return seen


def seven_more():
    return contact(lambda q: [[0.0, q[0]], *[[0.0, 0.0]] * 11], lambda q, v: [[0.0, v[0]], *[[0.0, 0.0]] * 11])


def test_a_field_is_done_after_two_draws_in_vain(draws):
    draws["finds"] = [False, True, False, True, False, False, False, True, False, False]
    found = grow(seven_more(), np.zeros(14))
    # Four draws for the first bracket find two more, then two in vain; the first of these finds one, and so on.
    assert found.vector == (2, 3, 5, 6)
    assert draws["draws"] == 6 + 4 + 2 + 2


def test_brackets_are_taken_seven_deep(draws):
    draws["finds"] = [True, False, False] * 20
    assert grow(seven_more(), np.zeros(14)).vector == (2, 3, 4, 5, 6, 7, 8, 9)
    assert draws["draws"] == 3 * 6


def test_nothing_is_drawn_where_everything_is_reached(draws):
    """Nor for the rest of the fields once it is."""
    draws["finds"] = [True] * 20
    found = grow(seven_more(), np.zeros(14))
    assert found.vector == (2, 3, 14)
    assert draws["draws"] == 11
