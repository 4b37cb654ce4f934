"""A trailer on the path that its tractor has driven: the on-line reference; figure 8 is in test_built_in_runs."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

import rnc_pin as rnc
from controlled_tasks import TASK
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import DrivenPath, SlitheringReference, SteeringController
from rnc_pin.control.slithering import PathPoint, chord_end_between, chord_end_fitted
from rnc_pin.model.evaluation_results import Measurement
from rnc_pin.robots.robot_files import find_urdf
from systems import fire_truck


def derivatives(f, h):
    """First and second derivative of a function in the middle of five values, h apart."""
    first = (f[0] - 8 * f[1] + 8 * f[3] - f[4]) / (12 * h)
    return first, (-f[0] + 16 * f[1] - 30 * f[2] + 16 * f[3] - f[4]) / (12 * h * h)


def test_a_kingpin_ahead_of_the_tractors_axle_and_a_drawbar_aslant(tmp_path):
    """Straight behind the tractor, the trailer's own x axis is turned by the slant of its drawbar."""
    text = find_urdf("fire_truck.urdf").read_text()
    axle = '<child link="rear_axle"/>\n    <origin xyz="{} 0"'
    for before, after in (
        ('<child link="trailer"/>\n    <origin xyz="0 0 0"', '<child link="trailer"/>\n    <origin xyz="0.3 0 0"'),
        (axle.format("-1 0"), axle.format("-1.4 0.2")),
    ):
        assert before in text
        text = text.replace(before, after)
    path, slant = tmp_path / "semi.urdf", np.arctan2(0.2, 1.4)
    path.write_text(text)
    reduced = fire_truck(path, rnc.FramePosition("trailer", "xy"))
    law = SlitheringReference(reduced, rnc.Task.of(reduced, *TASK), "tractor", "rear_axle", "trailer")
    assert law.length == pytest.approx(np.hypot(1.4, 0.2), rel=1e-12)
    q = reduced.robot.configuration({"root_joint": [1.0, -2.0, 0.7], "hitch": 0.1})
    m = reduced.at(q, np.zeros(3)).measure()
    state = law.initial_state(m)
    assert state.heading == pytest.approx(0.7 + slant, abs=1e-12)
    assert law.step(m, np.zeros(3), state)[0].position == pytest.approx([0.7 + slant], abs=1e-12)


def test_a_scenario_that_cannot_slither_is_refused():
    for changes, words in (
        ({"reference.path.forward_only": False}, "cannot follow in reverse"),
        ({"controller.type": "redundancy"}, "reference.path.trailer: needs the controller type 'steering'"),
        ({"reference.path.trailer.kingpin": "front_axle"}, "vertical output 'front_axle_x'"),
    ):
        with pytest.raises(rnc.ConfigurationError, match=words):
            Scenario.load("fire-truck", {**changes, "comparisons": {}}).build()


def on_a_bend(reduced, s, speed=1.0, radius=2.0):
    """Measured on a circle after a straight, by default at unit speed."""
    x, y, heading = (s, 0.0, 0.0)
    if s > 0:
        x, y, heading = radius * np.sin(s / radius), radius - radius * np.cos(s / radius), s / radius
    values = {"root_joint": [x, y, heading], "front_steering": np.arctan(1 / radius) if s > 0 else 0.0}
    return reduced.at(reduced.robot.configuration(values), np.array([speed, 0.0, 0.0])).measure()


@pytest.mark.parametrize("back", [0.004, 0.5])
def test_backing_up_leads_back_along_the_same_path(back):
    """Along a bend, back a little or half a metre, and on again: where it was, the reference is what it was."""
    reduced = fire_truck()
    reference = SlitheringReference(reduced, rnc.Task.of(reduced, *TASK), "tractor", "rear_axle")
    way = [*np.arange(-1.0, 3.0, 0.005), *np.arange(3.0, 3.0 - back, -0.001), *np.arange(3.0 - back, 6.0, 0.005)]
    state, last = reference.initial_state(on_a_bend(reduced, way[0], 0.0)), -1.0
    for s in way:
        point, state = reference.step(on_a_bend(reduced, s, np.sign(s - last)), np.zeros(3), state)
        last = s
        if s > 1.3:  # chord of length 1 on a circle of radius 2
            np.testing.assert_allclose(point.position, s / 2 - np.arcsin(0.25), atol=1e-6)
            np.testing.assert_allclose(np.abs(point.velocity), 0.5, atol=1e-4)


def test_noise_of_positions_is_not_differentiated():
    """Of 0.1 mm and mrad; through each two places, as before, 2 rad/s^2 come of it."""
    reduced = fire_truck()
    task, worst = rnc.Task.of(reduced, *TASK), []
    for window in (None, 0.02):
        reference = SlitheringReference(reduced, task, "tractor", "rear_axle", window=window)
        generator, errors = np.random.default_rng(1), []
        state = reference.initial_state(on_a_bend(reduced, -0.5))
        for s in np.arange(-0.5, 4.0, 0.01):
            m = on_a_bend(reduced, s)
            m = m._replace(x1=m.x1 + 1e-4 * generator.normal(size=m.x1.shape))
            point, state = reference.step(m, np.zeros(3), state)
            if s > 1.5:  # a chord of length 1 on the circle turns steadily
                error = np.sin(point.position[0] - s / 2 + np.arcsin(0.25))
                errors.append(np.abs([error, point.velocity[0] - 0.5, point.acceleration[0]]))
        worst.append(np.max(errors, axis=0))
    np.testing.assert_array_less(worst[0], [5e-4, 5e-4, 1e-2])
    assert worst[1][2] > 0.5


@pytest.mark.parametrize(("arguments", "words"), [
    (("trailer", "rear_axle"), "needs the vertical output 'trailer_x'; did you mean"),
    (("tractor", "rear"), "no frame 'rear'"),
    (("tractor", "front_axle"), "'tractor' and 'front_axle' are not two fixed places on a body with trailer_yaw"),
    (("tractor", "rear_axle", "rear_axle"), "needs the vertical output 'rear_axle_x'"),
    (("tractor", "rear_axle", None, 0.0), "spacing: expected a positive number, found 0"),
    (("tractor", "rear_axle", None, None, -1.0), "window: expected a positive number, found -1"),
])  # fmt: skip
def test_what_is_no_tractor_with_a_trailer_is_refused(arguments, words):
    reduced = fire_truck()
    with pytest.raises(rnc.RncError, match=words):
        SlitheringReference(reduced, rnc.Task.of(reduced, *TASK), *arguments)


def test_steering_along_the_driven_path_needs_its_state():
    reduced = fire_truck()
    task = rnc.Task.of(reduced, *TASK)
    path = rnc.planning.CarPath((0, 0, 0), (5, 0, 0), 5.0, 1.0)
    law = SlitheringReference(reduced, task, "tractor", "rear_axle")
    steering = SteeringController(reduced, task, path.reference, law)
    with pytest.raises(rnc.InputError, match="initial_state"):
        steering.step(0.0, reduced.at(reduced.robot.configuration(), np.zeros(3)).measure())


def test_a_kingpin_as_far_ahead_as_the_axle_is_behind():
    """Of a tractor that is led by its front axle: the chord of the path would not be one."""
    system = rnc.NonholonomicSystem(fire_truck().robot, [rnc.NoSideSlip(f"{axle}_axle") for axle in ("front", "rear")])
    steering = [rnc.JointPosition("front_steering"), rnc.JointPosition("rear_steering")]
    vertical = [rnc.FramePosition(frame, "xy") for frame in ("front_axle", "hitch")]
    vertical += [rnc.FrameYaw(frame) for frame in ("trailer", "front_axle")]
    reduced = system.reduce([rnc.FrameSpeed("tractor"), *steering, rnc.FrameYaw("tractor")], vertical)
    primary = ["tractor_speed_x", "front_steering", "tractor_yaw"]
    task = rnc.Task.of(reduced, primary, ["rear_steering"], ["trailer_yaw"])
    with pytest.raises(rnc.ConfigurationError, match="kingpin 'hitch' has to be a fixed place on the tractor, nearer"):
        SlitheringReference(reduced, task, "front_axle", "rear_axle", "hitch")


def reference(reduced=None, **settings):
    reduced = reduced or fire_truck()
    assert reduced.vertical.names == ("tractor_x", "tractor_y", "trailer_yaw", "tractor_yaw")
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
        rate, acceleration = derivatives(theta, h)
        np.testing.assert_allclose(point.velocity, rate, atol=1e-7)
        np.testing.assert_allclose(point.acceleration, acceleration, atol=1e-4)
        assert np.isnan(point.jerk).all()


def test_before_the_oldest_place_the_path_is_straight():
    """All remembered places are nearer than the trailer is long."""
    law, h = reference(), 1e-3
    for ox, oy, psi, ahead, aside, v, w in np.random.default_rng(3).uniform(-1, 1, (6, 7)):
        along, left = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
        place = np.array([ox, oy]) + 0.4 * ahead * along + 0.5 * aside * left

        def heading(t, place=place, v=v, w=w, left=left, along=along, ox=ox, oy=oy):
            p = place + t * np.array([v, w]) - [ox, oy]
            return np.arctan2(along[1], along[0]) + np.arcsin(left @ p)

        point, _ = law.step(*measured(place, psi, (v, w)), DrivenPath(np.array([[ox, oy, psi, 4.0]]), psi))
        theta = [heading(k * h) for k in (-2, -1, 0, 1, 2)]
        np.testing.assert_allclose(point.position, theta[2], atol=1e-12)
        np.testing.assert_allclose(point.velocity, derivatives(theta, h)[0], atol=1e-9)


def test_between_the_last_place_and_the_tractor_the_path_leads_to_the_tractor():
    """Places are farther apart than the trailer is long."""
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


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_trailer_that_would_stand_askew_or_jump_is_refused_with_its_state(side):
    law, q = reference(), np.array([0.4, -5.0])
    path = straight(*np.arange(-2.0, 0.01, 0.02))
    for heading, before in ((side * 1.2, 0.0), (0.0, side * 0.6)):
        step, _ = law.step(*measured((0.0, 0.0), heading, q=q), DrivenPath(path, before))
        assert np.isfinite(step.acceleration)
    for heading, before in ((side * 1.5, 0.0), (0.0, side * 0.8)):
        with pytest.raises(rnc.SingularityError, match="bends too tightly for the trailer") as caught:
            law.step(*measured((0.0, 0.0), heading, q=q), DrivenPath(path, before))
        assert caught.value.rows == ("trailer_yaw", "tractor_yaw")
        np.testing.assert_array_equal(caught.value.q, q)


def test_places_two_lengths_behind_are_forgotten():
    law, path = reference(window=0.1), straight(*np.arange(-5.0, 0.001, 0.02))
    after = law.step(*measured((0.001, 0.0), 0.0), DrivenPath(path, 0.0))[1].path
    first = np.flatnonzero(path[:, 0] >= path[-1, 0] - 2.0 * law.length)[0]
    np.testing.assert_array_equal(after, path[first - 1 :])


def test_a_tractor_has_come_straight_along_its_heading_and_its_trailer_behind_it():
    """Twice the trailer's length; the heading goes on from the trailer's own, whatever full turns that has."""
    law, q = reference(), np.array([0.4, -0.7, 2.3])
    for trailer, turns in ((2.3 + 0.4, 0), (2.3 - 4 * np.pi + 0.3, -2), (2.3 + 2 * np.pi - 3.0, 1)):
        m, _ = measured(q[:2], q[2], trailer=trailer)
        state = law.initial_state(m)
        behind = q[:2] - 2.0 * np.array([np.cos(2.3), np.sin(2.3)])
        np.testing.assert_allclose(state.path, [[*behind, 2.3, -2.0], [*q, 0.0]], rtol=1e-12)
        assert state.heading == pytest.approx(2.3 + 2 * np.pi * turns)


# ---------------------------------------------------------------------- path fit


def curvature_of(d, dd):
    """Curvature of a plane curve by its derivatives."""
    return (d[0] * dd[1] - d[1] * dd[0]) / np.hypot(*d) ** 3


def hermite(begin, end):
    """The cubic between two places whose speeds are as long as the straight way."""
    h = np.hypot(end[0] - begin[0], end[1] - begin[1])
    slopes = [h * np.array([np.cos(heading), np.sin(heading)]) for heading in (begin[2], end[2])]
    return CubicHermiteSpline([0.0, 1.0], [begin[:2], end[:2]], slopes)


def parameter_at(curve, place, L):
    """Parameter, from 0 to 1, at which a chord of length L from a place meets the curve."""
    return brentq(lambda s: np.hypot(*(place - curve(s))) - L, 0, 1, xtol=1e-15, rtol=1e-15)


def test_the_end_of_a_chord_between_two_places_is_on_the_cubic_through_them():
    for x, y, h0, turn, far, side in np.random.default_rng(4).uniform(-1, 1, (30, 6)):
        step, across = 0.4 + 0.2 * far, 0.1 * side
        begin, direction = [x, y, 3 * h0], 3 * h0 + 0.2 * turn + 0.1
        end = (x + step * np.cos(direction), y + step * np.sin(direction), 3 * h0 + 0.4 * turn)
        curve = hermite(begin, end)
        px, py = end[0] + 0.9 * np.cos(end[2]) - across * np.sin(end[2]), end[1] + 0.9 * np.sin(end[2])
        nearest, farthest = (np.hypot(px - place[0], py - place[1]) for place in (end, begin))
        L = 0.7 * nearest + 0.3 * farthest
        s = parameter_at(curve, np.array([px, py]), L)
        point = chord_end_between(begin, end, px, py, L)
        d, dd = curve(s, 1), curve(s, 2)
        expected = [*curve(s), np.arctan2(d[1], d[0]), curvature_of(d, dd)]
        np.testing.assert_allclose(point, expected, rtol=1e-10, atol=1e-11)
        for length, place in ((0.5 * nearest, 1.0), (1.5 * farthest, 0.0)):  # beyond the places: the nearer one
            point, d, dd = chord_end_between(begin, end, px, py, length), curve(place, 1), curve(place, 2)
            expected = [*curve(place), np.arctan2(d[1], d[0]), curvature_of(d, dd)]
            np.testing.assert_allclose(point, expected, rtol=1e-11, atol=1e-12)


def driven(count, spacing, noise, seed, turn=0.8):
    """Places along a winding way, with noise; x, y, heading and distance."""
    generator, s = np.random.default_rng(seed), spacing * np.arange(count)
    heading = 1.1 + turn * np.sin(1.5 * s)
    x, y = (np.concatenate([[0.3], 0.3 + np.cumsum(spacing * f(heading[:-1]))]) for f in (np.cos, np.sin))
    path = np.column_stack([x, y, heading, s + 5.0])
    path[:, :3] += noise * generator.normal(size=(count, 3))
    return path


def near_to(path, older, share):
    """A place between two of a path, not quite on it."""
    begin, end = path[older], path[older + 1]
    x, y, heading, _ = (1 - share) * begin + share * end
    return PathPoint(x + 1e-3, y - 2e-3, heading + 0.01, 0.5)


def fitted(path, older, near, kingpin, L, window):
    """Of all quintics that with the least weighed errors of place and heading, and where on it the chord ends."""
    reached = path[older, 3] + np.hypot(near.x - path[older, 0], near.y - path[older, 1])
    c, s = np.cos(near.heading), np.sin(near.heading)
    axes, rows = np.array([[c, s], [-s, c]]), []
    for x, y, heading, distance in path:
        turned = np.angle(np.exp(1j * (heading - near.heading)))
        if abs(distance - reached) <= window and abs(turned) < 1.0:
            along, left = axes @ [x - near.x, y - near.y]
            rows.append((along, left, turned, 1 - ((distance - reached) / window) ** 2))
    along, left, turned, weight = np.array(rows).T

    def errors(a):
        """Of heading the slope's, linear as in the small: by cos^2 of it, at a lever of L."""
        y = np.polynomial.Polynomial(a)
        slope = (y.deriv()(along) - np.tan(turned)) * np.cos(turned) ** 2
        return np.concatenate([weight * (y(along) - left), weight * L * slope])

    design = np.stack([errors(each) - errors(np.zeros(6)) for each in np.eye(6)], axis=1)
    curve = np.polynomial.Polynomial(np.linalg.lstsq(design, -errors(np.zeros(6)), rcond=None)[0])
    p = axes @ (np.array(kingpin) - [near.x, near.y])
    u = brentq(lambda u: np.hypot(p[0] - u, p[1] - curve(u)) - L, -window, 0.3 * window, xtol=1e-15, rtol=1e-15)
    slope, second = curve.deriv()(u), curve.deriv(2)(u)
    place = np.array([near.x, near.y]) + axes.T @ [u, curve(u)]
    return PathPoint(*place, near.heading + np.arctan(slope), second / (1 + slope**2) ** 1.5), len(rows)


@pytest.mark.parametrize(("noise", "window"), [(0.0, 0.35), (3e-3, 0.35), (3e-3, 0.21)])
def test_the_end_of_a_chord_on_a_fitted_path_is_that_of_the_best_quintic(noise, window):
    for seed, (share, off) in enumerate(np.random.default_rng(2).uniform(0.1, 0.9, (8, 2))):
        path = driven(24, 0.07, noise, seed)
        near = near_to(path, 9, share)
        direction, L = near.heading + 0.4 * off, 0.8
        kingpin = (near.x + 0.82 * np.cos(direction), near.y + 0.82 * np.sin(direction))
        expected, count = fitted(path, 9, near, kingpin, L, window)
        assert count >= 6
        point = chord_end_fitted(path, 9, near, *kingpin, L, window)
        np.testing.assert_allclose(point[:3], expected[:3], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(point.curvature, expected.curvature, rtol=1e-7, atol=1e-7)
        assert np.hypot(kingpin[0] - point.x, kingpin[1] - point.y) == pytest.approx(L, rel=1e-12)
