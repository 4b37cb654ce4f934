"""Integrable rows and combinations of them, of systems written down, from both sides of every limit."""

import sys

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from rnc_pin.analysis import integrability
from rnc_pin.analysis.growth import Growth
from rnc_pin.analysis.report import Combination, _pivots
from systems import ackermann_car, free_flying_panda, leaning_wheel, random_states
from textbook_systems import planar_model, rail_sliders, unicycle
from tolerances import ROUNDING


def contact_rows(*parts):
    """Rows ``(b + slope x) beta + w dw`` in (x, y, z, w) with a contact form beta, by (b, slope, w).

    Beta is the differential of nothing, each dw is one.
    """
    count = len(parts[0][2])

    def beta(q):
        return np.array([-q[1], q[0], 1.0, *[0.0] * count])

    def beta_dot(v):
        return np.array([-v[1], v[0], 0.0, *[0.0] * count])

    def rows(q):
        return np.stack([(b + slope * q[0]) * beta(q) + np.array([0.0, 0.0, 0.0, *w]) for b, slope, w in parts])

    def rows_dot(q, v):
        return np.stack([(b + slope * q[0]) * beta_dot(v) + slope * v[0] * beta(q) for b, slope, _ in parts])

    names = [f"a{k}" for k in range(1, len(parts) + 1)]
    system = rnc.NonholonomicSystem(rail_sliders(3 + count), [rnc.Pfaffian(rows, rows_dot, names)])
    return system.reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])


def places(*x, size):
    found = np.random.default_rng(0).normal(size=(len(x), size))
    found[:, 0] = x
    return found


@pytest.mark.parametrize(("coefficients", "words"), [
    ({"a": 1.0}, "a"),
    ({"a": 1.0, "b": 0.4, "c": -1.0}, "a + 0.4 b - c"),
    ({"a": 1.0, "b": -0.12345678, "c": 1.0}, "a - 0.1235 b + c"),
    ({"a": 1.0, "b": -1 + 0.97e-5, "c": 1 + 1.03e-5}, "a - b + 1 c"),
])  # fmt: skip
def test_combinations_are_written_like_sums(coefficients, words):
    assert str(Combination(coefficients, True)) == words


def test_of_many_combinations_each_takes_the_fewest_rows():
    """The rows that lead out least stand alone as far as they can: ``dw1`` and ``dw2`` need the third row each."""
    reduced = contact_rows((1.0, 0.0, [1.0, 0.0]), (-3.0, 0.0, [0.0, 2.0]), (2.0, 0.0, [0.0, 0.0]))
    for configurations in (places(0.3, size=5), places(0.3, -0.8, 1.1, size=5)):
        found = integrability(reduced, configurations)
        assert found.growth_vector == (2, 3)
        assert (found.integrable, found.nonholonomic) == ((), ("a1", "a2", "a3"))
        assert {str(each) for each in found.combinations} == {"a1 - 0.5 a3", "0.6667 a2 + a3"}
        assert all(each.constant for each in found.combinations)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_row_is_integrable_to_a_part_in_a_hundred_thousand(share):
    """``a1 = dw + 1e-5 beta``, of unit length."""
    weak = share * 1e-5
    reduced = contact_rows((7 * weak / np.sqrt(1.09), 0.0, [7.0]), (-2.0, 0.0, [0.0]))
    found = integrability(reduced, np.array([[0.3, 0.0, 0.5, -0.2]]))  # beta has the length of sqrt(1.09) here
    expected = (("a1",), ("a2",)) if share < 1 else ((), ("a1", "a2"))
    assert (found.integrable, found.nonholonomic) == expected


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_coefficients_below_a_part_in_a_hundred_thousand_are_none(share):
    reduced = contact_rows((4 * share * 1e-5, 0.0, [3.0]), (4.0, 0.0, [0.0]))
    (combination,) = integrability(reduced, places(0.3, -0.4, size=4)).combinations
    assert set(combination.coefficients) == ({"a1"} if share < 1 else {"a1", "a2"})


@pytest.mark.parametrize(("share", "constant"), [(0.95, True), (1.05, False)])
@pytest.mark.parametrize("size", [0.5, 20.0])
def test_coefficients_are_constant_to_a_part_in_a_hundred_thousand(size, share, constant):
    """``a1 - size (1 + small x) a2`` is dw, at x = 0 and x = 1."""
    reduced = contact_rows((size, size * share * 1e-5 * max(1.0, 1.0 / size), [1.0]), (1.0, 0.0, [0.0]))
    found = integrability(reduced, places(0.0, 1.0, 0.5, size=4))
    (combination,) = found.combinations
    assert combination.constant == constant
    assert combination.coefficients == pytest.approx({"a1": 1 / max(1, size), "a2": -size / max(1, size)}, rel=1e-4)


@pytest.mark.parametrize("x", [(0.0, 0.6, -1.5), (0.6, 0.0, -1.5), (-1.5, 0.6, 0.0)])
def test_a_coefficient_that_vanishes_somewhere_is_no_unit(x):
    """``x a1 - a2`` is dw: at x = 0 a2 alone. What is told is of where the first row takes part most."""
    reduced = contact_rows((1.0, 0.0, [0.0]), (0.0, 1.0, [-1.0]))
    (combination,) = integrability(reduced, places(*x, size=4)).combinations
    assert not combination.constant
    assert combination.coefficients == pytest.approx({"a1": 1.0, "a2": 1 / 1.5})
    assert str(combination) == "a combination of a1, a2 whose coefficients vary"


@pytest.mark.parametrize("count", [2, 3])
def test_places_where_brackets_are_fewer_than_elsewhere_do_not_count(count):
    """``dz = x^2 dy``: on x = 0 the bracket vanishes, so that there nothing seems to lead out."""
    row = rnc.Pfaffian(
        lambda q: np.array([[0.0, -(q[0] ** 2), 1.0]]), lambda q, v: np.array([[0.0, -2 * q[0] * v[0], 0.0]]), ["row"]
    )
    reduced = rnc.NonholonomicSystem(rail_sliders(3), [row]).reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])
    for where in range(count):
        x = np.full(count, 0.7)
        x[where] = 0.0
        found = integrability(reduced, places(*x, size=3))
        assert (found.growth_vector, found.nonholonomic, found.combinations) == ((2, 3), ("row",), ())
    found = integrability(reduced, places(0.0, size=3))
    assert (found.growth_vector, found.integrable) == ((2,), ("row",))
    assert [str(each) for each in found.combinations] == ["row"]


def test_the_largest_dimension_of_each_level_is_generic(monkeypatch):
    """Though no sample has them all; closures are those of the samples that end highest."""
    whole, less = Growth((3, 4, 6), np.eye(6), 1e9, False), Growth((3, 5), np.eye(6)[:, :5], 1e9, False)
    monkeypatch.setattr(sys.modules["rnc_pin.analysis.growth"], "grow", lambda reduced, q: less if q[0] > 0 else whole)
    row = np.eye(6)[:3]
    system = rnc.NonholonomicSystem(rail_sliders(6), [rnc.Pfaffian(lambda q: row, lambda q, v: 0 * row)])
    reduced = system.reduce([rnc.JointPosition(f"s{k}") for k in (3, 4, 5)])
    for x in ((1.0, -1.0), (-1.0, 1.0)):
        found = integrability(reduced, places(*x, size=6))
        assert (found.growth_vector, found.evidence.agreeing, found.integrable) == ((3, 5, 6), 0, ())


@pytest.mark.parametrize(("share", "chosen"), [(0.97, [0, 2]), (1.03, [0, 1])])
def test_rows_next_to_each_other_are_no_pair(share, chosen):
    """Two unit vectors at an angle have the smaller singular value ``sqrt(2) sin(angle / 2)``."""
    angle = 2 * np.arcsin(share * 1e-3 / np.sqrt(2))
    space = np.array([[3.0, 0.0], [5 * np.cos(angle), 5 * np.sin(angle)], [0.0, 0.2], [1.0, 1.0]])
    assert _pivots(space, np.arange(4), 2) == chosen
    assert _pivots(space, np.array([3, 1, 0, 2]), 2) == [3, 1]


@pytest.mark.parametrize(("share", "chosen"), [(0.97, [1, 2]), (1.03, [0, 1])])
def test_a_row_of_hardly_any_combination_is_no_pivot(share, chosen):
    """It would stand for a combination with coefficients above a thousand."""
    space = np.array([[0.0, share * 2e-3], [2.0, 0.0], [1.0, 1.0], [1e-16, 2e-16]])
    assert _pivots(space, np.array([3, 0, 1, 2]), 2) == chosen


def test_the_two_combinations_of_a_car_differ():
    """Its linkage, and its rear wheels: their difference is the heading. Lateral rows take part in neither."""
    reduced = ackermann_car()
    for seed in range(5):
        found = sorted_rows(reduced, seed)
        assert len(found.combinations) == reduced.n - found.growth_vector[-1] == 2
        assert {str(each) for each in found.combinations} == {
            "ackermann(left_steer, right_steer)",
            "rolling(bl) - rolling(br)",
        }
        assert all(each.constant for each in found.combinations)


def two_upright_wheels():
    """Wheels of radius 0.1 at 0.3 either side of a planar base, every row written down by hand.

    Of the two rolling rows, ``u + 0.3 w = 0.1 right`` and ``u - 0.3 w = 0.1 left``, the difference is
    ``d(0.6 yaw - 0.1 (right - left)) = 0``.
    """
    model, joint = planar_model("differential drive")
    for name, y in (("left", 0.3), ("right", -0.3)):
        add_body(model, name, "RY", 0.5, joint, moments=0.01, at=(0.0, y, 0.1), frame=f"{name}_hub")
    wheels = [rnc.RollingWheel(f"{name}_hub", 0.1) for name in ("left", "right")]
    system = rnc.NonholonomicSystem(rnc.Robot(model), wheels, ["left", "right"])
    return system.reduce([rnc.FrameSpeed("body"), rnc.FrameYaw("body")])


def three_sliders(rows, rows_dot, names):
    """Three prismatic joints with rows of one's own, coordinates (x, y, z)."""
    model = pin.Model()
    parent = 0
    for name, joint in (("x", pin.JointModelPX()), ("y", pin.JointModelPY()), ("z", pin.JointModelPZ())):
        parent = add_body(model, name, joint, 1.0, parent, moments=0.1)
    return rnc.NonholonomicSystem(rnc.Robot(model), [rnc.Pfaffian(rows, rows_dot, names)], ["x", "y"])


def sorted_rows(reduced, seed=13):
    return integrability(reduced, np.stack([q for q, _ in random_states(reduced, 3, seed=seed)]))


def test_a_unicycle_has_no_integrable_row():
    found = sorted_rows(unicycle())
    assert found.nonholonomic == ("no_side_slip(body.y)",)
    assert found.integrable == found.combinations == ()


def test_the_difference_of_two_wheels_is_the_heading():
    reduced = two_upright_wheels()
    found = sorted_rows(reduced)
    assert found.growth_vector == (2, 3, 4)
    assert found.integrable == ()
    assert len(found.nonholonomic) == 3
    (combination,) = found.combinations
    assert str(combination) == "rolling(left_hub) - rolling(right_hub)"
    assert combination.constant
    report = rnc.analyze(reduced, samples=8)
    assert report.integrable_combinations == (str(combination),)
    assert not report.completely_nonholonomic
    # The combination of rows is the differential that was written down: constant, in (x, y, yaw, left, right).
    names = reduced.constraints.names
    c = np.array([combination.coefficients.get(name, 0.0) for name in names])
    for q, _ in random_states(reduced, 4, seed=14):
        row = c @ reduced.at(q).E[: reduced.m]
        assert np.abs(row / row[2] - np.array([0, 0, 0.6, 0.1, -0.1]) / 0.6).max() < ROUNDING


def test_a_single_row_is_integrable_exactly_if_frobenius_says_so():
    """``dz = y dx + s x dy``: the differential of x y for s = 1, the contact form of Brockett for s = -1."""
    for s, expected, growth in ((1.0, ("row",), (2,)), (-1.0, (), (2, 3))):
        system = three_sliders(
            lambda q, s=s: np.array([[-q[1], -s * q[0], 1.0]]),
            lambda q, v, s=s: np.array([[-v[1], -s * v[0], 0.0]]),
            ["row"],
        )
        found = sorted_rows(system.reduce([rnc.JointPosition("x"), rnc.JointPosition("y")]))
        assert (found.integrable, found.growth_vector) == (expected, growth)


def test_height_of_a_rolling_disk_and_centre_of_mass_of_a_free_robot_are_integrable():
    assert sorted_rows(leaning_wheel()).integrable == ("vertical(disk)",)
    assert sorted_rows(leaning_wheel()).nonholonomic == ("rolling(disk)", "lateral(disk)")
    found = sorted_rows(free_flying_panda())
    assert found.integrable == tuple(f"momentum(root_joint)[{k}]" for k in range(3))
