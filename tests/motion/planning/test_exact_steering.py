"""Exact motions of bases whose axle stands anywhere: they arrive, keep the rows, and are as long as closed forms."""

import numpy as np
import pinocchio as pin
import pytest
from ompl import base

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.motion.planning.exact_steering import reeds_shepp_words, word_length
from textbook_systems import planar_model

WHEELBASE = 1.2
AXLE = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 2.3), np.array([0.3, -0.2, 0.0]))
ASIDE = AXLE.inverse().translation[1]  # of the axle's point nearest to the origin of the base [m]


def vehicle(steered, limits=(-0.6, 0.9)):
    """A base with an arm and a mimic finger, whose axle is turned and beside its origin; joints steer a wheel ahead."""
    model, body = planar_model()
    add_frame(model, "axle", body, AXLE)
    add_frame(model, "point", body, AXLE * pin.SE3(np.eye(3), np.array([0.0, ASIDE, 0.0])))
    arm = add_body(model, "arm", "RZ", 1.0, body)
    for name in ("finger", "mimic"):
        add_body(model, name, "PX", 0.1, arm)
    ahead = AXLE * pin.SE3(np.eye(3), np.array([WHEELBASE, 0.0, 0.0]))
    for name in ("wheel", "knuckle")[:steered]:
        body, ahead = add_body(model, name, "RZ", 1.0, body, at=ahead), pin.SE3.Identity()
        entry = model.joints[body].idx_q
        model.lowerPositionLimit[entry], model.upperPositionLimit[entry] = limits
    add_frame(model, "front", body)
    rows = [rnc.NoSideSlip(frame) for frame in (("axle", "front") if steered else ("axle",))]
    rows += [rnc.JointCoupling("mimic", "finger", ratio=-0.5, offset=0.1)]
    pose = [rnc.FramePosition("point", "xy"), rnc.FrameYaw("point")]
    return rnc.NonholonomicSystem(rnc.Robot(model), rows).reduce(None, pose)


@pytest.mark.parametrize(("steered", "room"), [(0, 0.0), (1, 0.0), (1, 0.1)])
@pytest.mark.parametrize("seed", range(3))
def test_every_motion_arrives_along_the_rows_by_the_shortest_way(steered, room, seed):
    reduced, generator = vehicle(steered), np.random.default_rng(seed)
    model, ends = reduced.robot.model, []
    for _ in range(2):
        bent = {"wheel": generator.uniform(-0.4, 0.4)} if steered else {}
        base, (arm, finger) = generator.uniform(-3.0, 3.0, 3), generator.uniform(-1.0, 1.0, 2)
        bent |= {"root_joint": base, "arm": arm, "finger": finger, "mimic": 0.1 - 0.5 * finger}
        ends.append(reduced.robot.configuration(bent))
    start, goal = ends
    steering = rnc.planning.find_steering(reduced, start, room=room)
    first, second = (reduced.at(q).outputs()[0] for q in ends)
    c, s, here, there = np.cos(first[2]), np.sin(first[2]), first[2], second[2]
    seen = np.array([[c, s], [-s, c]]) @ (second - first)[:2]
    straight = reduced.robot.joint_values(start) | ({"wheel": 0.0} if steered else {})
    np.testing.assert_allclose(steering.prepared(start), reduced.robot.configuration(straight), atol=1e-9)
    lengths, turns, axle = [], [], rnc.FrameSpeed("point").bind(reduced.robot)
    for motion in steering.motions(start, goal):
        np.testing.assert_allclose(pin.difference(model, motion.q[-1], goal), 0.0, atol=1e-9)
        lengths.append(0.0)
        for q, step, after in zip(motion.q, motion.steps, motion.q[1:], strict=False):
            np.testing.assert_allclose(reduced.at(q).A @ step, 0.0, atol=1e-9)
            np.testing.assert_allclose(pin.difference(model, pin.integrate(model, q, step), after), 0.0, atol=1e-9)
            assert step[3] * (goal[4] - start[4]) >= 0.0  # the arm never turns back
            lengths[-1] += abs(float((axle.jacobian(reduced.at(q).position) @ step)[0]))
        turns.append(np.abs(motion.steps[:, 2]).sum())
    if steered:
        radius = max(abs(WHEELBASE / np.tan(angle) - ASIDE) for angle in (-0.6 + 1.5 * room, 0.9 - 1.5 * room))
        assert steering.radius == pytest.approx(radius)
        words = [radius * word_length(word) for word in reeds_shepp_words(*seen / radius, there - here)]
        np.testing.assert_allclose(lengths, words[:3], atol=1e-9)
        found = [radius * word_length(word) for _, word in steering.paths(start, goal)]
        np.testing.assert_allclose(found, words, atol=1e-9)
    else:
        bearing = np.arctan2(*seen[::-1])
        ways = (np.array([bearing, there - here - bearing]) + each for each in (0.0, np.pi))
        expected = [np.abs((way + np.pi) % (2 * np.pi) - np.pi).sum() for way in ways]
        np.testing.assert_allclose(turns, sorted(expected))
        np.testing.assert_allclose(lengths, np.linalg.norm(seen))


@pytest.mark.parametrize("limits", [(0.0, 0.0), (-1e30, 1e30)])
def test_a_steering_joint_without_limits_turns_by_80_degrees(limits):
    reduced = vehicle(1, limits)
    radius = max(abs(WHEELBASE / np.tan(angle) - ASIDE) for angle in np.deg2rad([-80.0, 80.0]))
    assert rnc.planning.find_steering(reduced, reduced.robot.configuration()).radius == pytest.approx(radius)


def test_long_turns_are_divided_and_long_slides_are_not():
    """Into turns of at most 1.7 rad: of a base, a ball, an endless joint; a joint with a number for its angle tells."""
    model, body = planar_model()
    for name, kind in (("plate", "Planar"), ("ball", "Spherical"), ("endless", "RUBZ"), ("arm", "RZ")):
        add_body(model, name, kind, 1.0, body)
    reduced = rnc.NonholonomicSystem(rnc.Robot(model)).reduce()
    steps = np.zeros((7, 11))
    steps[range(7), [0, 1, 2, 5, 7, 9, 10]] = 9.0, -9.0, -5.0, 3.5, 1.8, 6.9, 9.0
    steering, start = rnc.planning.find_steering(reduced, reduced.robot.configuration()), reduced.robot.configuration()
    found, counts = steering.along(start, steps), [1, 1, 3, 3, 2, 5, 1]
    np.testing.assert_allclose(found.steps, np.repeat(steps / np.array(counts)[:, None], counts, axis=0))
    end = start
    for step in steps:
        end = pin.integrate(model, end, step)
    np.testing.assert_allclose(found.q[-1], end, atol=1e-12)


def test_a_wheel_that_two_joints_steer_is_refused():
    reduced = vehicle(2)
    with pytest.raises(rnc.ConfigurationError, match="motion of the base is not that of a car with one steering joint"):
        rnc.planning.find_steering(reduced, reduced.robot.configuration({"wheel": 0.1, "knuckle": 0.2, "mimic": 0.1}))


# ---------------------------------------------------------------------- shortest paths


def length_to(x, y, heading):
    """Length of the shortest word, and all words end at the pose."""
    words = reeds_shepp_words(x, y, heading)
    for word in words:
        place, turned = 0.0, 0.0
        for curvature, length in word:
            turn = 1j * curvature * length
            place += np.exp(1j * turned) * length * ((np.exp(turn) - 1.0) / turn if turn else 1.0)
            turned += turn.imag
        assert abs(place - x - 1j * y) + abs(np.exp(1j * turned) - np.exp(1j * heading)) < 1e-12
    return word_length(words[0])


def test_lengths_are_those_of_ompl():
    generator, space = np.random.default_rng(1), base.ReedsSheppStateSpace(1.0)
    begin, end = space.allocState(), space.allocState()
    begin.setXY(0.0, 0.0)
    begin.setYaw(0.0)
    for digits in [9, 0] * 150:  # whole numbers are ends of the ranges of formulas
        x, y, heading = generator.uniform([-4.0, -4.0, -np.pi], [4.0, 4.0, np.pi]).round(digits)
        end.setXY(x, y)
        end.setYaw(heading)
        assert length_to(x, y, heading) == pytest.approx(space.distance(begin, end), abs=1e-6)
    assert length_to(0.0, 0.0, np.pi) == pytest.approx(np.pi)  # three arcs of a third of a half turn each
