"""The way to a singular configuration: where it is looked at, and what counts as growth."""

import sys

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import boundedness
from rnc_pin.analysis.boundedness import _order
from rnc_pin.analysis.singularities import Singularity
from textbook_systems import rail_sliders

SHARES = np.geomspace(0.1, 0.001, 7)


def lever():
    """The last slide moves at ``1 / q1`` times the first."""
    row = rnc.Pfaffian(lambda q: np.array([[1.0, 0.0, -q[1]]]), lambda q, v: np.array([[0.0, 0.0, -v[1]]]), ["lever"])
    return rnc.NonholonomicSystem(rail_sliders(3), [row]).reduce([rnc.JointPosition("s0"), rnc.JointPosition("s1")])


def goal(matrix="E", located=True):
    return Singularity(matrix, ("lever", "s0"), 0.0, located, {"s0": 0.2, "s1": 0.0, "s2": 0.0})


SAMPLES = np.array([[0.2, 3.0, 0.0], [0.2, 0.5, 0.0], [0.2, -0.9, 0.0]])


def test_the_way_is_looked_at_from_a_tenth_to_a_thousandth():
    """Of that to the nearest sample, in even proportions; only towards what was met and is of E."""
    bounds = boundedness(lever(), SAMPLES, [goal("A4"), goal(located=False), goal()])
    (way,) = bounds.approaches
    np.testing.assert_allclose(way.distances, 0.5 * SHARES, rtol=1e-9)
    np.testing.assert_allclose(way.H, 1 + 1 / np.square(way.distances), rtol=1e-9)
    assert way.rows == ("lever", "s0")
    assert way.H_order == pytest.approx(2.0, abs=1e-3)
    assert not way.bounded
    assert not bounds.everywhere


@pytest.fixture
def sizes(monkeypatch):
    """H and V as functions of the distance, regular everywhere but at places that a test names."""
    chosen = {"H": lambda d: 0 * d + 1.0, "V": lambda d: 0 * d + 1.0, "singular": 0, "error": None}

    def fake(reduced, configurations):
        d = np.abs(configurations[:, 1])
        if len(d) == 1 and chosen["singular"]:
            chosen["singular"] -= 1
            raise chosen["error"]
        return chosen["H"](d), chosen["V"](d), 0 * d

    monkeypatch.setattr(sys.modules["rnc_pin.analysis.boundedness"], "_sizes", fake)
    return chosen


@pytest.mark.parametrize("power", [0.19, 0.21, -0.5])
@pytest.mark.parametrize("which", "HV")
def test_less_than_the_fifth_root_is_no_growth(sizes, which, power):
    sizes[which] = lambda d: 3.0 * d**-power
    bounds = boundedness(lever(), SAMPLES, [goal()])
    (way,) = bounds.approaches
    found = {"H": way.H_order, "V": way.V_order}
    other = "V" if which == "H" else "H"
    assert found == pytest.approx({which: power, other: 0.0}, abs=1e-9)
    np.testing.assert_allclose(getattr(way, which), 3.0 * (0.5 * SHARES) ** -power, rtol=1e-9)
    np.testing.assert_allclose(getattr(way, other), 1.0)
    assert way.bounded == bounds.everywhere == (power < 0.2)


@pytest.mark.parametrize(("singular", "told"), [(4, True), (5, False)])
@pytest.mark.parametrize(
    "error",
    [rnc.SingularityError("there", q=np.zeros(3), condition=np.inf, rows=("lever",)), rnc.ConstraintError("open")],
    ids=["singular", "open"],
)
def test_three_places_make_a_way(sizes, singular, told, error):
    sizes.update(singular=singular, error=error)
    bounds = boundedness(lever(), SAMPLES, [goal()])
    assert bounds.everywhere
    assert [way.distances for way in bounds.approaches] == (
        [pytest.approx(tuple(0.5 * SHARES[singular:]))] if told else []
    )


@pytest.mark.parametrize(("count", "counted"), [(3, 3), (4, 3), (5, 3), (6, 3), (7, 4), (8, 4), (9, 5)])
def test_orders_are_of_the_nearer_half(count, counted):
    """Three places at least: what is farther does not count, and the farthest of these does."""
    distances = 2.0 * np.geomspace(1.0, 1e-3, count)
    sizes = 5.0 * distances**-1.7
    sizes[: count - counted] = 1e9
    assert _order(distances, sizes) == pytest.approx(1.7, rel=1e-9)
    sizes[count - counted] *= 2
    logs = np.log(distances[-counted:])
    tilt = (logs[0] - logs.mean()) * np.log(2) / np.sum((logs - logs.mean()) ** 2)
    assert _order(distances, sizes) == pytest.approx(1.7 - tilt, rel=1e-9)
    sizes[-1] = 0.0
    assert _order(distances, sizes) == 0.0
