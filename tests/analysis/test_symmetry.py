"""Relative equilibria and their symmetries: against closed forms and published speeds."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from benchmarks.validation.bicycle import REAR, bicycle, upright
from bodies import add_body
from rnc_pin.analysis.symmetry import find_symmetries
from rnc_pin.model.user_functions import gradient
from systems import ALL, floating_robot, in_joints
from textbook_systems import tractor_trailers, vertical_disk, wheeled_pendulum

G, L = 9.81, 0.8


def hoop(rate):
    """A bead on a hoop of radius L that turns about the vertical: a pendulum in a plane that turns."""
    model = pin.Model()
    plane = add_body(model, "plane", "RZ", 1.0)
    add_body(model, "bead", "RY", pin.Inertia(0.3, np.array([0.0, 0.0, -L]), np.zeros((3, 3))), plane)
    turned = rnc.Pfaffian(
        lambda q: np.array([[1.0, 0.0]]), lambda q, v: np.zeros((1, 2)), ["turned"], rate=lambda q: np.array([rate]),
        rate_dot=lambda q, v: np.zeros(1),
    )  # fmt: skip
    return rnc.NonholonomicSystem(rnc.Robot(model), [turned], []).reduce([rnc.JointPosition("bead")])


def circle(steering, hitches):
    """Hitch angles in a circle: axles of 1 m bars hitched on axles stand at radii ``r_k^2 = r_(k-1)^2 - 1``."""
    radius, found = 1 / np.tan(steering), []
    for _ in range(hitches):
        radius = np.sqrt(radius**2 - 1)
        found.append(-np.arctan2(1.0, radius))
    return found


# ---------------------------------------------------------------------- steady motions


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("speed", [1.0, -0.4])
def test_trailers_in_a_circle_stand_at_the_angles_of_geometry(count, speed):
    reduced = tractor_trailers(count)
    guess = reduced.robot.configuration({"front_steering": 0.3, "root_joint": (1.0, -2.0, 0.7)})
    found = rnc.equilibrium(reduced, guess, ["front_steering"], [speed, 0.0])
    joints = reduced.robot.joint_values(found.q)
    assert joints["front_steering"] == 0.3
    np.testing.assert_allclose([joints[f"hitch_{k + 1}"] for k in range(count)], circle(0.3, count), atol=1e-9)
    np.testing.assert_allclose(joints["root_joint"], (1.0, -2.0, 0.7), atol=1e-6)
    # Under these inputs it goes on like this, around a circle.
    run = rnc.free_motion(reduced, found.q, found.v2, 2.0, dt=0.5, inputs=found.T)
    np.testing.assert_allclose(run.q[:, 4:], np.tile(found.q[4:], (len(run.q), 1)), atol=1e-8)
    centre = np.array([1.0, -2.0]) + np.array([-np.sin(0.7), np.cos(0.7)]) / np.tan(0.3)
    np.testing.assert_allclose(np.linalg.norm(run.q[:, :2] - centre, axis=1), 1 / np.tan(0.3), atol=1e-6)


def test_rates_that_are_not_given_are_found():
    reduced = tractor_trailers(1)
    guess = reduced.robot.configuration({"front_steering": 0.3, "hitch_1": -0.2})
    found = rnc.equilibrium(reduced, guess, ["front_steering"], {"tractor_speed_x": 2.0})
    np.testing.assert_allclose(found.v2, [2.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.q[5], circle(0.3, 1)[0], atol=1e-9)


@pytest.mark.parametrize(("joints", "hold", "v2", "words"), [
    ({"front_steering": 1.15}, ["front_steering"], [1.0, 0.0], "'hitch_1' moves by -1"),  # the circle is too small
    ({"front_steering": 0.3}, ["front_steering", "hitch_1"], [1.0, 0.0], r"'hitch_1' moves by -0\.309 a second"),
    ({"front_steering": 0.3}, [], [1.0, 0.1], r"'front_steering' moves by 0\.1 a second"),
])  # fmt: skip
def test_where_there_is_none_the_shape_variable_that_moves_is_named(joints, hold, v2, words):
    reduced = tractor_trailers(1)
    with pytest.raises(rnc.ConstraintError, match=f"no steady motion found .* shape variable {words}") as told:
        rnc.equilibrium(reduced, reduced.robot.configuration(joints), hold, v2)
    assert "\n" not in str(told.value)


def test_what_turns_stands_upright_or_is_thrown_out():
    """``(m h^2 + I_x - I_z) cos(pitch) = -m h (g / w^2 + r)``: motors that keep it on its circle push the body."""
    reduced = wheeled_pendulum()
    robot, rate = reduced.robot, 7.0
    body = robot.model.inertias[robot.model.getJointId("pitch")]
    h, inertia = body.lever[2], np.diag(body.inertia)
    expected = np.arccos(-body.mass * h * (G / rate**2 + 0.1) / (body.mass * h**2 + inertia[0] - inertia[2]))
    for guess, pitch in ((1.2, expected), (-1.2, -expected), (0.05, 0.0)):
        found = rnc.equilibrium(reduced, robot.configuration({"pitch": guess}), v2=[0.0, 0.0, rate])
        assert robot.joint_values(found.q)["pitch"] == pytest.approx(pitch, abs=1e-8)
        np.testing.assert_allclose(reduced.forward_dynamics(found.q, found.v2, found.T), 0, atol=1e-7)


def test_a_bead_on_a_hoop_that_turns():
    """``cos(angle) = g / (l w^2)``: affine constraints move, and yet the bead rests on the hoop."""
    reduced = hoop(5.0)
    for guess, angle in ((1.0, np.arccos(G / (L * 25))), (-1.0, -np.arccos(G / (L * 25))), (0.1, 0.0), (3.0, np.pi)):
        found = rnc.equilibrium(reduced, reduced.robot.configuration({"bead": guess}))
        assert found.q[1] == pytest.approx(angle, abs=1e-8)
        np.testing.assert_array_equal(found.v2, [0.0])


def test_under_a_momentum_a_robot_turns_as_one_piece():
    """Its motors hold what the recursive Newton-Euler algorithm says of platform and arm in rigid rotation."""
    reduced = in_joints(floating_robot(6.0))
    robot = reduced.robot
    guess = robot.configuration({"joint_1": 0.4, "joint_2": 1.1, "joint_3": -0.7})
    found = rnc.equilibrium(reduced, guess)
    np.testing.assert_allclose(found.q, guess, atol=1e-9)
    data = robot.model.createData()
    v = np.array([6.0 / pin.crba(robot.model, data, found.q)[0, 0], 0.0, 0.0, 0.0])
    np.testing.assert_allclose(found.T, pin.rnea(robot.model, data, found.q, v, np.zeros(4))[1:], atol=1e-7)


def test_a_wheel_that_is_unbalanced_may_be_named():
    reduced = ALL["bicycle"]()
    robot = reduced.robot
    guess, speed = reduced.assembled(robot.configuration()), {reduced.reducing.names[-1]: 3.0}
    with pytest.raises(rnc.ConstraintError, match="no steady motion"):
        rnc.equilibrium(reduced, guess, v2=speed)
    found = rnc.equilibrium(reduced, guess, v2=speed, cyclic=["rear_wheel", "front_wheel"])
    v = dict(zip(robot.velocity_names, reduced.at(found.q, found.v2).v, strict=True))
    assert abs(v["steer"]) < 1e-9
    assert abs(v["rear_wheel"]) > 1.0


# ---------------------------------------------------------------------- symmetries


def free_body(inertia, gravity=(0, 0, 0)):
    model = pin.Model()
    add_body(model, "root_joint", "FreeFlyer", 1.0, moments=inertia, frame="body")
    model.gravity.linear = np.array(gravity, float)
    return rnc.NonholonomicSystem(rnc.Robot(model), [])


def in_the_world(system):
    return system.reduce([rnc.FramePosition("body", "xyz"), rnc.FrameOrientation("body")])


@pytest.mark.parametrize(
    ("make", "whole", "own"),
    [
        (lambda: hoop(2.0), 1, 1),  # the plane turns, and with it everything
        (vertical_disk, 3, 1),  # on flat ground, its axle
        (wheeled_pendulum, 3, 2),
        (ALL["fire_truck"], 3, 0),
        (ALL["four_bar"], 0, 0),
        (bicycle, 3, 2),
        (lambda: free_body((1, 2, 3)).reduce(), 6, 0),
        (lambda: free_body((1, 2, 3), (0, 0.6, -0.8)).reduce(), 4, 0),  # turning about gravity alone
        (lambda: in_the_world(free_body((1, 1, 1))), 3, 3),  # a ball may be turned in its own axes
        (lambda: in_the_world(free_body((1, 2, 1))), 3, 1),
    ],
    ids=["hoop", "disk", "pendulum", "fire truck", "four-bar", "bicycle", "free", "falling", "ball", "spindle"],
)
def test_symmetries_are_those_of_ground_and_wheels(make, whole, own):
    reduced = make()
    q = upright() if reduced is bicycle() else reduced.robot.configuration()
    found = find_symmetries(reduced, q)
    assert (found._twists.shape[1], found._joints.shape[1]) == (whole, own)


@pytest.mark.parametrize("make", [bicycle, ALL["fire_truck"], vertical_disk])
def test_how_symmetries_vary_is_exact(make):
    reduced = make()
    q = upright() if reduced is bicycle() else reduced.robot.configuration({})
    generator = np.random.default_rng(3)
    found = find_symmetries(reduced, q)
    q = pin.integrate(reduced.robot.model, q, 0.4 * generator.normal(size=reduced.n))
    coefficients = generator.normal(size=found.size)
    expected = gradient(reduced.robot.model, lambda p: found.directions(p) @ coefficients, q)
    np.testing.assert_allclose(found.gradient(q, coefficients), expected, atol=1e-9)


# ---------------------------------------------------------------------- a bicycle


def test_a_bicycle_leans_in_a_circle():
    """Steered by 0.02, it leans by about ``v^2 steer cos(tilt) / (g wheelbase)``, and a free run goes on like this.

    The lean rate that goes with it is no zero: the frame pitches a little, and turns about its own x axis too.
    """
    reduced = bicycle()
    robot = reduced.robot
    guess = reduced.assembled(robot.configuration({"root_joint": (0, 0, REAR, 0, 0, 0, 1), "steering": 0.02}))
    found = rnc.equilibrium(reduced, guess, ["steering"], {"rear_axle": 4.0 / REAR})
    steering = robot.joint_values(found.q)["steering"]
    roll = pin.rpy.matrixToRpy(pin.Quaternion(found.q[3:7]).toRotationMatrix())[0]
    assert abs(roll) == pytest.approx(16.0 * abs(steering) * np.cos(np.pi / 10) / (1.02 * G), rel=0.01)
    run = rnc.free_motion(reduced, found.q, found.v2, 1.0, dt=0.25, inputs=found.T)
    np.testing.assert_allclose(run.v2, np.tile(found.v2, (len(run.v2), 1)), atol=1e-6)
    np.testing.assert_allclose(run.q[:, 2], found.q[2], atol=1e-7)
    assert np.ptp(run.q[:, 1]) > 0.05
    with pytest.raises(rnc.ConstraintError, match="no steady motion"):
        rnc.equilibrium(reduced, guess, ["steering"], [0.0, 0.0, 4.0 / REAR])


@pytest.mark.parametrize(("call", "error", "words"), [
    (lambda r, q: rnc.equilibrium(r, q, v2={"axel": 1.0}), rnc.ModelError, "v2: no reducing output 'axel'; did you"),
    (lambda r, q: rnc.equilibrium(r, q, v2={"axle": np.nan}), rnc.InputError, "v2"),
    (lambda r, q: rnc.equilibrium(r, q, v2=[1.0, 0.0], cyclic=["axel"]), rnc.ModelError, "axel"),
])  # fmt: skip
def test_what_makes_no_sense_is_refused(call, error, words):
    reduced = vertical_disk()
    with pytest.raises(error, match=words) as told:
        call(reduced, reduced.robot.configuration())
    assert "\n" not in str(told.value)
