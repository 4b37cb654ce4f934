"""What counts as steady, zero, of full rank or missing in an analysis, from both sides."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import classify
from rnc_pin.analysis.redundancy import _full_row_rank
from textbook_systems import SIZE, SPEED, angle_of, rail_sliders, sideways_pendulum, sliders_with_rows


def test_a_motion_is_steady_to_a_part_in_ten_to_the_eight():
    """Of the whole gravity and the square of the speed."""
    reduced = sideways_pendulum()
    near, far = (np.array([share * angle_of(1e-8 * SIZE)]) for share in (0.97, 1.03))
    v2 = [SPEED]
    found = rnc.linearize(reduced, near, v2, [])
    np.testing.assert_allclose(found.A, [[0.0, 1.0], [-1 / angle_of(1.0), 0.0]], rtol=1e-6, atol=1e-9)
    with pytest.raises(rnc.ConstraintError) as told:
        rnc.linearize(reduced, far, v2, [])
    assert str(told.value) == (
        "not an equilibrium and not a steady motion: under T = [] "
        f"the rate of 'hinge_0' changes by {-1.03e-8 * SIZE:.3g} a second"
    )


def test_a_state_of_nothing_is_refused():
    reduced = rnc.NonholonomicSystem(rail_sliders(2), []).reduce()
    with pytest.raises(rnc.InputError) as told:
        rnc.linearize(reduced, np.zeros(2), coordinates=[], rates=[])
    assert str(told.value) == "coordinates and rates are both empty: the state needs at least one entry"
    assert rnc.linearize(reduced, np.zeros(2), coordinates=[]).state_names == ("s0", "s1")


def test_coordinates_next_to_each_other_are_not_independent():
    """``s0`` and ``s0 + small s1``: singular values are next to sqrt(2) and small / sqrt(2)."""
    reduced = rnc.NonholonomicSystem(rail_sliders(2), []).reduce()
    for small, said in ((0.97 * 2e-10, True), (1.03 * 2e-10, False)):
        J = np.array([[1.0, 0.0], [1.0, small]])
        pair = rnc.Output(lambda q, J=J: J @ q, lambda q, J=J: J, lambda q, v: np.zeros((2, 2)), ["one", "two"])
        words = ""
        try:
            rnc.linearize(reduced, np.zeros(2), coordinates=[pair])
        except rnc.ConstraintError as error:  # so near each other, what they say of the rest is rounded
            words = str(error)
        assert (words == "coordinates one, two are not independent under the constraints") == said


@pytest.mark.parametrize("size", [0.5, 1.0, 20.0])
@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_part_in_ten_to_the_nine_of_the_largest_entry_moves_nothing(size, share):
    """Or of one, where all are smaller."""
    weak = share * 1e-9 * max(1.0, size)
    reduced = sliders_with_rows(lambda q: [[size, weak], [0.3, 0.4]])
    task = rnc.Task.of(reduced, ["s0"], ["s1"])
    found = classify(reduced, task, np.random.default_rng(0).normal(size=(3, 4)))
    assert found.tracked == (("s3",) if share < 1 else ("s2", "s3"))
    left = weak if share < 1 else 0.0
    assert pytest.approx(left) == found.evidence.A6


@pytest.mark.parametrize("unit", [1.0, 1e-4, 1e7])
def test_rows_are_of_full_rank_to_a_part_in_a_million(unit):
    """At more than nine of ten configurations."""

    def matrices(*shares):
        return unit * np.stack([[[0.0, 1.0, 0.0], [0.0, 0.0, share * 1e-6]] for share in shares])

    assert not _full_row_rank(matrices(0.97))
    assert _full_row_rank(matrices(1.03))
    assert not _full_row_rank(matrices(*[1.03] * 9, 0.97))
    assert _full_row_rank(matrices(*[1.03] * 10, 0.97))
    assert not _full_row_rank(matrices(1.03).mT)
    assert not _full_row_rank(0 * matrices(1.03))


@pytest.mark.parametrize(("share", "rank", "missing"), [(0.97, 1, ("s1",)), (1.03, 2, ())])
def test_a_drive_is_one_to_a_part_in_ten_to_the_ten(share, rank, missing):
    B = 30.0 * np.diag([1.0, share * 1e-10])
    report = rnc.analyze(rnc.NonholonomicSystem(rail_sliders(2), [], B).reduce(), samples=3)
    assert (report.actuation_rank, report.unactuated) == (rank, missing)


@pytest.mark.parametrize(("share", "missing"), [(0.97, ("s1",)), (1.03, ("s0", "s1"))])
def test_a_millionth_of_a_force_is_missing(share, missing):
    """One drive for two bodies: the force across it has a part along both."""
    B = np.array([[1.0], [share * 1e-6]])
    report = rnc.analyze(rnc.NonholonomicSystem(rail_sliders(2), [], B).reduce(), samples=3)
    assert (report.actuation_rank, report.unactuated) == (1, missing)
