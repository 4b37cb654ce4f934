"""Parts of a feedback, and adaptation under noise, delay and saturation."""

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.control.controller import check_size, elapsed_time
from rnc_pin.control.feedback import Feedback, apply_dead_zone, fed_back, saturation_mask
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.references.reference import ReferencePoint


def test_time_passes_from_sample_to_sample_and_may_stand_still():
    assert (elapsed_time(7.0, None), elapsed_time(7.0, 7.0), elapsed_time(7.25, 7.0)) == (0.0, 0.0, 0.25)
    with pytest.raises(rnc.InputError) as caught:
        elapsed_time(6.5, 7.0)
    assert str(caught.value) == "time runs backwards: 6.5 s after 7 s"
    with pytest.raises(rnc.ConfigurationError) as caught:
        check_size(rnc.planning.Hold([1.0, 2.0]), 3, "tip's")
    assert str(caught.value) == "the tip's reference has 2 values for 3 outputs"
    check_size(rnc.planning.Hold([1.0, 2.0]), 2, "tip's")


def test_an_output_without_a_value_needs_none_where_nothing_is_fed_back():
    gains, error = np.array([2.0, 0.0, -3.0]), np.array([[0.5, np.nan, 2.0], [1.5, 4.0, -1.0]])
    np.testing.assert_array_equal(fed_back(gains, error, error), [[1.0, 0.0, -6.0], [3.0, 0.0, 3.0]])
    np.testing.assert_array_equal(fed_back(0.0, error, error), np.zeros((2, 3)))
    assert fed_back(0.0, error, error).shape == (2, 3)
    np.testing.assert_array_equal(fed_back(2.0, error[1], error[1]), [3.0, 8.0, -2.0])
    np.testing.assert_array_equal(fed_back(gains, lost := np.array([np.inf, np.nan, 1.0]), lost), [np.inf, 0.0, -3.0])
    for gain in (2.0, -2.0, np.array([0.0, 1e-9, 0.0])):
        words = r"without a value: it is a quasi-velocity, .* measure\(q, v2, integrals\)"
        with pytest.raises(rnc.InputError, match=words):
            fed_back(gain, error, error)
    orientation = Feedback(Coordinates([0, 0, 0], [0]), 0.0)
    absent = ReferencePoint(np.full(3, np.nan), *np.zeros((3, 3)))
    np.testing.assert_array_equal(orientation(absent, np.zeros(3), np.ones(3))[0], np.zeros(3))


@pytest.mark.parametrize("gain", [2.0, np.array([1.5, 0.0, 0.7])])
def test_feedback_compares_angles_within_a_half_turn(gain, generator):
    """Zero gains need no values."""
    law = Feedback(Coordinates([False, False, True]), gain)
    desired = ReferencePoint(*generator.normal(size=(4, 3)))
    for turns in (-3, -1, 0, 2):
        x, rate = generator.normal(size=(2, 3))
        x[2] += 2 * np.pi * turns
        x[1] = np.nan if np.ndim(gain) else x[1]
        error = desired.position - x
        error[2] = np.angle(np.exp(1j * error[2]))
        expected = desired.velocity + np.where(np.broadcast_to(gain, 3) == 0.0, 0.0, gain * error)
        np.testing.assert_allclose(law(desired, x, rate)[0], expected, rtol=1e-13, atol=1e-14)
        expected = desired.acceleration + gain * (desired.velocity - rate)
        np.testing.assert_allclose(law(desired, x, rate)[1], expected, rtol=1e-14, atol=1e-15)
    with pytest.raises(rnc.InputError, match="without a value"):
        law(desired, np.array([np.nan, 0.0, 0.0]), rate)
    for x in (np.zeros(3), np.zeros((2, 3))):  # of one run and of many
        with pytest.raises(rnc.InputError, match="the reference is NaN at output 3 of 3"):
            law(desired._replace(position=np.array([0.0, 0.0, np.nan])), x, np.zeros_like(x))


def test_what_is_beyond_a_zone_is_no_longer_than_the_true_error():
    """Noise within the zone is taken away: zero, or the true error shortened, entry by entry."""
    generator, zone = np.random.default_rng(0), np.array([0.1, 0.5, 0.0])
    true = generator.normal(size=(1000, 3))
    learnt_from = apply_dead_zone(true + zone * generator.uniform(-1, 1, size=true.shape), zone)
    share = learnt_from / true
    assert share.min() >= 0.0
    assert share.max() <= 1.0 + 1e-12
    assert np.abs(true - learnt_from).max() <= 2 * zone.max() + 1e-12
    np.testing.assert_array_equal(apply_dead_zone(true, 0.0), true)


def test_the_mask_has_outputs_whose_force_would_grow_towards_the_deficit():
    values = np.array([-2.5, -0.5, 0.0, 0.5, 2.5])
    deficit, added = np.meshgrid(values, values)
    expected = ((deficit > 0) & (added > 0)) | ((deficit < 0) & (added < 0))
    np.testing.assert_array_equal(saturation_mask(deficit, added), expected)
