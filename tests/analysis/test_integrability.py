"""Integrable rows of systems written down, from both sides of every limit."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import integrability
from systems import free_flying_panda, leaning_wheel, random_states
from textbook_systems import rail_sliders


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


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_row_is_integrable_to_a_part_in_a_hundred_thousand(share):
    """``a1 = dw + 1e-5 beta``, of unit length."""
    weak = share * 1e-5
    reduced = contact_rows((7 * weak / np.sqrt(1.09), 0.0, [7.0]), (-2.0, 0.0, [0.0]))
    found = integrability(reduced, np.array([[0.3, 0.0, 0.5, -0.2]]))  # beta has the length of sqrt(1.09) here
    expected = (("a1",), ("a2",)) if share < 1 else ((), ("a1", "a2"))
    assert (found.integrable, found.nonholonomic) == expected


@pytest.mark.parametrize("count", [2, 3])
def test_places_where_brackets_are_fewer_than_elsewhere_do_not_count(count):
    """``dz = x^2 dy``: on x = 0 the bracket vanishes, so that there nothing seems to lead out."""
    rows = (lambda q: np.array([[0.0, -(q[0] ** 2), 1.0]]), lambda q, v: np.array([[0.0, -2 * q[0] * v[0], 0.0]]))
    row = rnc.Pfaffian(*rows, ["row"])
    reduced = rnc.NonholonomicSystem(rail_sliders(3), [row]).reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])
    for where in range(count):
        x = np.full(count, 0.7)
        x[where] = 0.0
        found = integrability(reduced, places(*x, size=3))
        assert (found.growth_vector, found.nonholonomic) == ((2, 3), ("row",))
    found = integrability(reduced, places(0.0, size=3))
    assert (found.growth_vector, found.integrable) == ((2,), ("row",))


def sorted_rows(reduced, seed=13):
    return integrability(reduced, np.stack([q for q, _ in random_states(reduced, 3, seed=seed)]))


def test_a_single_row_is_integrable_exactly_if_frobenius_says_so():
    """``dz = y dx + s x dy``: the differential of x y for s = 1, the contact form of Brockett for s = -1."""
    for s, expected, growth in ((1.0, ("row",), (2,)), (-1.0, (), (2, 3))):
        row = rnc.Pfaffian(
            lambda q, s=s: np.array([[-q[1], -s * q[0], 1.0]]),
            lambda q, v, s=s: np.array([[-v[1], -s * v[0], 0.0]]),
            ["row"],
        )
        system = rnc.NonholonomicSystem(rail_sliders(3), [row])
        found = sorted_rows(system.reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")]))
        assert (found.integrable, found.growth_vector) == (expected, growth)


def test_height_of_a_rolling_disk_and_centre_of_mass_of_a_free_robot_are_integrable():
    assert sorted_rows(leaning_wheel()).integrable == ("vertical(disk)",)
    assert sorted_rows(leaning_wheel()).nonholonomic == ("rolling(disk)", "lateral(disk)")
    found = sorted_rows(free_flying_panda())
    assert found.integrable == tuple(f"momentum(root_joint)[{k}]" for k in range(3))
