"""References: derivatives belong together, ends are at rest, and the profile is the one named."""

import numpy as np
import pytest

from rnc_pin.errors import InputError
from rnc_pin.planning import Harmonic, Hold, Joined, MinimumJerk, ViaPoints
from tolerances import ROUNDING

STEP = 1e-3
REFERENCES = {
    "minimum jerk": MinimumJerk([0.0, 1.0], [2.0, -1.0], duration=3.0, begin=0.5),
    "via points": ViaPoints([0.0, 1.0, 2.5, 4.0], [[0.0, 0.0], [1.0, 0.5], [0.5, 2.0], [2.0, 1.0]]),
    "harmonic": Harmonic([0.3, -0.1], [0.5, 0.2], [0.25, 0.5], phase=[0.0, 1.0], ramp=2.0),
    "joined": Joined([MinimumJerk([1.0], [2.0], 3.0), Harmonic([0.0], 1.0, 0.3), Hold([4.0])]),
    "hold": Hold([1.0, 2.0]),
}


@pytest.mark.parametrize("reference", REFERENCES.values(), ids=REFERENCES)
def test_each_derivative_is_that_of_the_one_before(reference):
    for t in np.linspace(0.6, 3.3, 12):
        points = [reference.at(t + k * STEP) for k in (-2, -1, 1, 2)]
        here = reference.at(t)
        assert all(part.shape == (reference.size,) for part in here)
        for order in range(3):
            f = [point[order] for point in points]
            difference = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * STEP)
            np.testing.assert_allclose(here[order + 1], difference, atol=1e-6)


def test_minimum_jerk_is_the_quintic_of_flash_and_hogan():
    start, goal, duration = np.array([0.2, -1.0]), np.array([1.0, 3.0]), 4.0
    reference = MinimumJerk(start, goal, duration)
    for s in np.linspace(0, 1, 9):
        expected = start + (goal - start) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        np.testing.assert_allclose(reference.at(s * duration).position, expected, atol=ROUNDING)


@pytest.mark.parametrize("name", ["minimum jerk", "via points"])
def test_rests_before_and_after(name):
    reference = REFERENCES[name]
    for t, end in ((-1.0, reference.at(0.0)), (reference.duration + 9.0, reference.at(reference.duration))):
        np.testing.assert_array_equal(reference.at(t).position, end.position)
        for part in reference.at(t)[1:]:
            np.testing.assert_array_equal(part, 0.0)


def test_velocity_and_acceleration_are_continuous_at_the_ends():
    for name in ("minimum jerk", "via points"):
        reference = REFERENCES[name]
        nearly = reference.at(reference.duration - 1e-9)
        np.testing.assert_allclose(nearly.velocity, 0.0, atol=1e-6)
        np.testing.assert_allclose(nearly.acceleration, 0.0, atol=1e-6)


def test_via_points_are_passed_at_their_times():
    for t, point in zip([0.0, 1.0, 2.5, 4.0], [[0, 0], [1, 0.5], [0.5, 2], [2, 1]], strict=True):
        np.testing.assert_allclose(REFERENCES["via points"].at(t).position, point, atol=ROUNDING)


def test_harmonic_settles_on_the_sine():
    reference, t = REFERENCES["harmonic"], 2.7
    expected = np.array([0.3, -0.1]) + [0.5, 0.2] * np.sin(2 * np.pi * np.array([0.25, 0.5]) * t + [0.0, 1.0])
    np.testing.assert_allclose(reference.at(t).position, expected, atol=ROUNDING)
    np.testing.assert_array_equal(reference.at(0.0).velocity, 0.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: MinimumJerk([0.0], [1.0, 2.0], 1.0), "shape"),
        (lambda: MinimumJerk([0.0], [1.0], 0.0), "positive"),
        (lambda: MinimumJerk([np.nan], [1.0], 1.0), "finite"),
        (lambda: ViaPoints([0.0, 0.0], [[1.0], [2.0]]), "increasing"),
        (lambda: ViaPoints([0.0], [[1.0]]), "at least two"),
        (lambda: Harmonic([0.0, 1.0], [1.0, 2.0, 3.0], 1.0), "numbers or lists of 2"),
    ],
)
def test_nonsense_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
