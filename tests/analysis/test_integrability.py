"""Integrable rows of systems written down, from both sides of every limit."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import integrability
from systems import free_flying_panda, leaning_wheel, random_states
from textbook_systems import rail_sliders


def places(*x, size):
    found = np.random.default_rng(0).normal(size=(len(x), size))
    found[:, 0] = x
    return found


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
    assert sorted_rows(free_flying_panda()).integrable == tuple(f"momentum(root_joint)[{k}]" for k in range(3))
