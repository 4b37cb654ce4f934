"""A trailer on a driven path, beside chords found by bisection: rates of any motion, thresholds, what is remembered."""

import numpy as np
import pytest
from scipy.optimize import brentq

import rnc_pin as rnc
from places import ROOT
from rnc_pin.control import DrivenPath, SlitheringReference
from rnc_pin.model.measurement import Measurement
from systems import fire_truck

TASK = (["tractor_speed_x", "front_steering"], ["rear_steering"], ["trailer_yaw"])
NAMES = ("tractor_x", "tractor_y", "trailer_yaw", "tractor_yaw")
"""The truck's vertical outputs."""


def reference(reduced=None, **settings):
    reduced = reduced or fire_truck()
    assert reduced.vertical.names == NAMES
    return SlitheringReference(reduced, rnc.Task.of(reduced, *TASK), "tractor", "rear_axle", **settings)


def measured(place, heading, v=(0.0, 0.0), acceleration=(0.0, 0.0), q=None, trailer=0.3):
    """A tractor anywhere; its acceleration comes half of what is asked for, half of what the kinematics turn."""
    v2, v2_dot = np.array([0.5, -0.4, 2.0]), np.array([0.7, 0.2, -1.1])
    A, A_dot = np.zeros((4, 3)), np.zeros((4, 3))
    for row in (0, 1):
        A[row] = 0.5 * acceleration[row] * v2_dot / (v2_dot @ v2_dot)
        A_dot[row] = 0.5 * acceleration[row] * v2 / (v2 @ v2)
    x1, v1 = np.array([*place, trailer, heading]), np.array([*v, 3.0, -2.0])
    return Measurement(q=q, x1=x1, v1=v1, v2=v2, A_star=A, A_star_dot=A_dot), v2_dot


def circle(angle, radius):
    return np.array([radius * np.sin(angle), radius - radius * np.cos(angle)])


@pytest.mark.parametrize("radius", [2.0, -3.0])
def test_a_heading_turns_as_the_chord_to_the_path_does_whatever_the_kingpin_is_about(radius):
    """Speed and acceleration in any direction: two derivatives against differences of the chord."""
    generator, law, h = np.random.default_rng(4), reference(), 1e-3
    angles = np.arange(0.0, 3.0, 0.02) / radius
    path = np.column_stack([*circle(angles, radius), angles, 7.0 + radius * angles])
    for reached in (1.507, 1.93, 2.211):
        v, a, aside = generator.uniform(-1, 1, (3, 2))
        place = circle(reached / radius, radius) + 0.005 * aside

        def chord(t, place=place, v=v, a=a, reached=reached):
            p = place + v * t + a * t * t / 2
            here = brentq(lambda s: np.hypot(*(p - circle(s / radius, radius))) - 1.0, reached - 1.4, reached - 0.6)
            return np.arctan2(*(p - circle(here / radius, radius))[::-1])

        theta = [chord(k * h) for k in (-2, -1, 0, 1, 2)]
        state = DrivenPath(path[path[:, 3] < 7.0 + reached], theta[2] + 2 * np.pi - 0.6)
        point, after = law.step(*measured(place, reached / radius, v, a), state)
        np.testing.assert_allclose(point.position, theta[2] + 2 * np.pi, atol=1e-8)
        assert after.heading == point.position[0]
        rate = (theta[0] - 8 * theta[1] + 8 * theta[3] - theta[4]) / (12 * h)
        np.testing.assert_allclose(point.velocity, rate, atol=1e-7)
        acceleration = (-theta[0] + 16 * theta[1] - 30 * theta[2] + 16 * theta[3] - theta[4]) / (12 * h * h)
        np.testing.assert_allclose(point.acceleration, acceleration, atol=1e-4)
        assert np.isnan(point.jerk).all()


def test_before_the_oldest_place_the_path_is_straight():
    """Where all that is remembered is nearer than the trailer is long."""
    law, h = reference(), 1e-3
    for ox, oy, psi, ahead, aside, v, w in np.random.default_rng(3).uniform(-1, 1, (6, 7)):
        along, left = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
        place = np.array([ox, oy]) + 0.4 * ahead * along + 0.5 * aside * left

        def heading(t, place=place, v=v, w=w, left=left, along=along, ox=ox, oy=oy):
            p = place + t * np.array([v, w]) - [ox, oy]
            return np.arctan2(along[1], along[0]) + np.arcsin(left @ p)

        state = DrivenPath(np.array([[ox, oy, psi, 4.0]]), psi)
        point, _ = law.step(*measured(place, psi, (v, w)), state)
        theta = [heading(k * h) for k in (-2, -1, 0, 1, 2)]
        np.testing.assert_allclose(point.position, theta[2], atol=1e-12)
        np.testing.assert_allclose(
            point.velocity, (theta[0] - 8 * theta[1] + 8 * theta[3] - theta[4]) / (12 * h), atol=1e-9
        )


def test_between_the_last_place_and_the_tractor_the_path_leads_to_the_tractor():
    """Where places are farther apart than the trailer is long."""
    law = reference(spacing=3.0)
    path = np.array([[-3.0, 0, 0, 1.0], [0.0, 0.0, 0.0, 4.0]])
    point, after = law.step(*measured((2.5, 0.0), 0.0, (1.0, 0.2)), DrivenPath(path, 0.0))
    np.testing.assert_allclose([point.position[0], point.velocity[0]], [0.0, 0.2], atol=1e-12)
    assert after.path is path
    # On the way the path turns left: a cubic from the last place to the tractor's heading.
    turned, _ = law.step(*measured((2.5, 0.5), 0.4), DrivenPath(path, 0.0))
    assert 0.2 < turned.position[0] < 0.4


def straight(*driven):
    return np.array([[s, 0.0, 0.0, 2.0 + s] for s in driven])


def test_a_trailer_may_stand_askew_up_to_a_cosine_of_a_fifth_and_jump_by_seven_tenths():
    law, q = reference(), np.array([0.4, -5.0])
    path, edge = straight(*np.arange(-2.0, 0.01, 0.02)), np.arccos(0.2)
    for side in (1.0, -1.0):
        for over, refused in ((-1e-6, False), (1e-6, True)):
            angle = side * (edge + over)
            # The path is straight on; the kingpin is aside, and the tractor points as the trailer does.
            across = (*measured((np.cos(angle) - 0.5, np.sin(angle)), angle, q=q), DrivenPath(path, angle))
            bent = (*measured((0.0, 0.0), angle, q=q), DrivenPath(path, 0.0))
            jump = (*measured((0.0, 0.0), 0.0, q=q), DrivenPath(path, -side * (0.7 + over)))
            for arguments, condition in ((across, 1 / np.cos(angle)), (bent, 1.0), (jump, 1.0)):
                if not refused:
                    assert np.isfinite(law.step(*arguments)[0].acceleration)
                    continue
                with pytest.raises(rnc.SingularityError, match="bends too tightly for the trailer") as caught:
                    law.step(*arguments)
                assert caught.value.condition == pytest.approx(condition)
                assert caught.value.rows == ("trailer_yaw", "tractor_yaw")
                np.testing.assert_array_equal(caught.value.q, q)
    with pytest.raises(rnc.SingularityError) as caught:
        law.step(*measured((0.0, 0.0), 2.0), DrivenPath(path, 0.0))
    assert caught.value.q.shape == (0,)


@pytest.fixture
def long_truck(tmp_path):
    """With a trailer of 1.5 m."""
    text = (ROOT / "urdf/fire_truck.urdf").read_text()
    path = tmp_path / "long_truck.urdf"
    path.write_text(text.replace('<origin xyz="-1 0 0" rpy="0 0 0"/>', '<origin xyz="-1.5 0 0" rpy="0 0 0"/>'))
    return fire_truck(path)


@pytest.mark.parametrize("window", [0.1, 1.3])
def test_places_two_lengths_behind_are_forgotten_but_for_those_that_the_path_is_fitted_to(window, long_truck):
    """And one before them."""
    law = reference(long_truck, window=window)
    L = law.length
    assert L > 1.4
    kept = set()
    for first, step in ((-5.0, 0.02), (-3.0, 0.1), (-2.1, 0.5), (-2.1, 0.7), (-2.02, 0.02), (-1.9, 0.1), (-4.0, 0.9)):
        path = straight(*np.arange(L * first, 0.001, L * step))
        newest = path[-1, 3]
        place = (path[-1, 0] + 0.001, 0.0)
        older = np.flatnonzero(path[:, 0] <= place[0] - L)[-1]
        after = law.step(*measured(place, 0.0), DrivenPath(path, 0.0))[1].path
        needed = np.flatnonzero((path[:, 3] >= path[older, 3] - window) | (path[:, 3] >= newest - 2.0 * L))
        expected = path[max(needed[0] - 1, 0) :]
        if older < 2 or path[1, 3] >= newest - 2.0 * L:
            assert len(expected) == len(path)
        np.testing.assert_array_equal(after, expected)
        kept.add(len(after) < len(path))
    assert kept == {False, True}


def test_a_tractor_has_come_straight_along_its_heading_and_its_trailer_behind_it():
    """Twice the trailer's length; the heading goes on from the trailer's own, whatever full turns that has."""
    law, q = reference(), np.array([0.4, -0.7, 2.3])
    for trailer, turns in ((2.3 + 0.4, 0), (2.3 - 4 * np.pi + 0.3, -2), (2.3 + 2 * np.pi - 3.0, 1)):
        m, _ = measured(q[:2], q[2], trailer=trailer)
        state = law.initial_state(m)
        behind = q[:2] - 2.0 * np.array([np.cos(2.3), np.sin(2.3)])
        np.testing.assert_allclose(state.path, [[*behind, 2.3, -2.0], [*q, 0.0]], rtol=1e-12)
        assert state.heading == pytest.approx(2.3 + 2 * np.pi * turns)


@pytest.mark.parametrize("size", [0.0, -0.5])
def test_a_length_along_the_path_is_positive(size):
    for name in ("spacing", "window"):
        with pytest.raises(rnc.ConfigurationError) as caught:
            reference(**{name: size})
        assert str(caught.value) == f"{name} of a slithering reference has to be positive, found {size}"
