"""Channels: samples in order, gaps, values between samples, and counters that wrap."""

import numpy as np
import pinocchio as pin
import pytest

from rnc_pin.lab.logs import Channel, unwrapped


def test_samples_are_put_in_order_and_repairs_are_counted():
    time = [0.0, 0.3, 0.1, 0.2, 0.2, 0.4, 0.5]
    channel = Channel("velocity", "wheel", time, [[0.0], [3.0], [1.0], [2.0], [7.0], [np.nan], [5.0]])
    assert channel.time.tolist() == [0.0, 0.1, 0.2, 0.3, 0.5]
    assert channel.values[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 5.0]  # the first of two duplicates
    assert channel.repairs == ("1 sample without a number", "3 samples out of order", "1 duplicate stamp")


def test_values_in_gaps_and_outside_are_nan():
    time = np.concatenate([np.arange(10) * 0.1, 5.0 + np.arange(10) * 0.1])
    channel = Channel("position", "wheel", time, (2.0 * time)[:, None])
    assert channel.gaps.tolist() == [[pytest.approx(0.9), 5.0]]
    found = channel.at([-0.1, 0.0, 0.45, 0.9, 3.0, 5.0, 5.9, 6.0])[:, 0]
    np.testing.assert_allclose(found, [np.nan, 0.0, 0.9, 1.8, np.nan, 10.0, 11.8, np.nan])


def test_rotations_between_samples_are_those_of_the_group(generator):
    first = pin.SE3.Random()
    turn = pin.Motion(np.zeros(3), generator.normal(size=3))
    last = first * pin.exp6(turn)
    poses = np.array([np.concatenate([each.translation, pin.Quaternion(each.rotation).coeffs()])
                      for each in (first, last)])  # fmt: skip
    poses[1, 3:] *= -1  # the same rotation
    channel = Channel("pose", "tool", [0.0, 2.0], poses)
    for share in (0.0, 0.25, 0.8, 1.0):
        rotation = pin.Quaternion(channel.at([2.0 * share])[0, 3:]).matrix()
        np.testing.assert_allclose(rotation, first.rotation @ pin.exp3(share * turn.angular), atol=1e-12)


@pytest.mark.parametrize("span", [8192, 2**32])
def test_a_counter_is_continuous_over_its_wraps(span, generator):
    true = 3 + np.cumsum(generator.integers(-span // 3, span // 3, size=2000))
    found = unwrapped(np.mod(true, span), span)
    np.testing.assert_array_equal(np.diff(found), np.diff(true))
    assert abs(found[0]) <= span / 2
