"""A trailer on the path that its tractor has driven: the on-line reference; figure 8 is in test_built_in_runs."""

import numpy as np
import pytest
from scipy.optimize import brentq

import rnc_pin as rnc
from controlled_tasks import TASK
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import DrivenPath, SlitheringReference, SteeringController
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
    for before, after in (
        ('<child link="trailer"/>\n    <origin xyz="0 0 0"', '<child link="trailer"/>\n    <origin xyz="0.3 0 0"'),
        (
            '<child link="rear_axle"/>\n    <origin xyz="-1 0 0"',
            '<child link="rear_axle"/>\n    <origin xyz="-1.4 0.2 0"',
        ),
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
    task = rnc.Task.of(reduced, *TASK)
    worst = []
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


def test_places_are_remembered_a_spacing_apart_and_forgotten_when_the_tractor_backs_over_them():
    reduced = fire_truck()
    reference = SlitheringReference(reduced, rnc.Task.of(reduced, *TASK), "tractor", "rear_axle", spacing=0.25)
    assert reference.window == 1.25
    path = np.array([[0.0, 0, 0, 0], [0.5, 0, 0, 0.5], [1.0, 0.0, 0.0, 1.0]])
    for ahead, kept, new in (
        (0.25, 3, True),
        (0.2499, 3, False),
        (-0.2499, 3, False),
        (-0.25, 2, True),  # as far as that ahead of the place before
        (-0.2501, 2, False),
        (-0.7499, 2, False),
        (-0.75, 1, True),
        (-0.7501, 1, False),
        (-5.0, 1, False),
    ):
        found = reference._recorded(path, 1.0 + ahead, 0.1, 0.3)
        assert len(found) == kept + new
        np.testing.assert_array_equal(found[:kept], path[:kept])
        if new:
            np.testing.assert_allclose(found[-1], [1.0 + ahead, 0.1, 0.3, path[kept - 1, 3] + np.hypot(0.25, 0.1)])
    turned = np.array([[0.0, 0.0, np.pi / 2, 0.0]])
    assert len(reference._recorded(turned, 5.0, 0.2499, 0.0)) == 1
    assert len(reference._recorded(turned, -5.0, 0.2501, 0.0)) == 2
    at_rest = reduced.at(reduced.robot.configuration(), np.zeros(3)).measure()
    assert isinstance(reference.initial_state(at_rest), DrivenPath)


def test_a_kingpin_as_far_ahead_as_the_axle_is_behind():
    """Of a tractor that is led by its front axle: the chord of the path would not be one."""
    system = rnc.NonholonomicSystem(fire_truck().robot, [rnc.NoSideSlip(f"{axle}_axle") for axle in ("front", "rear")])
    steering = [rnc.JointPosition("front_steering"), rnc.JointPosition("rear_steering")]
    reduced = system.reduce(
        [rnc.FrameSpeed("tractor"), *steering, rnc.FrameYaw("tractor")],
        [rnc.FramePosition(frame, "xy") for frame in ("front_axle", "hitch")]
        + [rnc.FrameYaw(frame) for frame in ("trailer", "front_axle")],
    )
    primary = ["tractor_speed_x", "front_steering", "tractor_yaw"]
    task = rnc.Task.of(reduced, primary, ["rear_steering"], ["trailer_yaw"])
    with pytest.raises(rnc.ConfigurationError, match="kingpin 'hitch' has to be a fixed place on the tractor, nearer"):
        SlitheringReference(reduced, task, "front_axle", "rear_axle", "hitch")


NAMES = ("tractor_x", "tractor_y", "trailer_yaw", "tractor_yaw")


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

        state = DrivenPath(np.array([[ox, oy, psi, 4.0]]), psi)
        point, _ = law.step(*measured(place, psi, (v, w)), state)
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


@pytest.mark.parametrize("window", [0.1, 1.3])
def test_places_two_lengths_behind_are_forgotten_but_for_those_that_the_path_is_fitted_to(window, tmp_path):
    """And one before them, of a trailer of 1.5 m."""
    text = find_urdf("fire_truck.urdf").read_text()
    urdf = tmp_path / "long_truck.urdf"
    urdf.write_text(text.replace('<origin xyz="-1 0 0" rpy="0 0 0"/>', '<origin xyz="-1.5 0 0" rpy="0 0 0"/>'))
    law = reference(fire_truck(urdf), window=window)
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
