"""Equilibria, steady motions and the symmetries along which they go."""

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg
import scipy.optimize

import rnc_pin as rnc
import systems
import textbook_systems as textbook
from benchmarks.validation.bicycle import REAR, bicycle, upright
from bodies import add_body
from rnc_pin.analysis.equilibrium import _Search, find_symmetries
from rnc_pin.model.user_functions import gradient
from systems import ALL, floating_robot, four_bar, in_joints
from textbook_systems import G


def check(reduced, found):
    assert found.residual < 1e-8
    linear = rnc.linearize(reduced, found.q, T=found.T)  # which checks that it rests
    np.testing.assert_allclose(linear.T, found.T, atol=1e-7)


@pytest.mark.parametrize(("start", "end"), [(0.3, 0.0), (-1.4, 0.0), (1.7, np.pi), (3.0, np.pi)])
def test_the_pendulum_stands_or_hangs_whatever_is_nearer(start, end):
    reduced = textbook.wheeled_pendulum()
    guess = reduced.robot.configuration({"root_joint": (0.4, -0.3, 2.0), "pitch": start, "left_axle": 1.0})
    found = rnc.equilibrium(reduced, guess)
    expected = reduced.robot.configuration({"root_joint": (0.4, -0.3, 2.0), "pitch": end, "left_axle": 1.0})
    np.testing.assert_allclose(found.q, expected, atol=1e-9)
    np.testing.assert_allclose(found.T, 0, atol=1e-9)
    check(reduced, found)


def test_a_loop_is_closed_and_rests():
    reduced = four_bar()
    loop = rnc.NonholonomicSystem(reduced.robot, [rnc.LoopClosure("coupler_tip", "rocker_tip", "point")])
    free = loop.reduce([rnc.JointPosition("crank")])
    guess = reduced.robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5})
    found = rnc.equilibrium(free, guess)
    assert np.abs(free.assembly.residual(found.q)).max() < 1e-9
    check(free, found)
    held = rnc.equilibrium(reduced, reduced.assembled(guess, hold=["crank"]), hold=["crank"])
    assert held.q[0] == pytest.approx(1.0)
    assert np.abs(held.T).max() > 0.1
    check(reduced, held)


@pytest.mark.parametrize("guess", [(2.6382, 0.1483, -2.6641), (-0.3365, -2.6001, -0.4021)])
def test_a_step_that_leads_away_is_made_shorter(guess):
    """From these an open loop overshoots: the first step is halved up to ten times."""
    reduced = four_bar()
    found = rnc.equilibrium(reduced, np.array(guess))
    assert np.abs(reduced.assembly.residual(found.q)).max() < 1e-9
    check(reduced, found)


@pytest.mark.parametrize(("call", "error", "words"), [
    (lambda r, q: rnc.equilibrium(r, q, hold=["pitch"]), rnc.ConstraintError, "rate of 'pitch' changes by"),
    (lambda r, q: rnc.equilibrium(r, q, hold=["pich"]), rnc.ModelError, "did you mean 'pitch'"),
    (lambda r, q: rnc.equilibrium(r, q[:-1]), rnc.InputError, "q has shape"),
    (lambda r, q: rnc.equilibrium(r, np.tile(q, (2, 1))), rnc.InputError, "expected one configuration"),
    (lambda r, q: rnc.equilibrium(r, q, v2=[1.0]), rnc.InputError, "v2 has shape"),
    (lambda r, q: rnc.equilibrium(r, q, v2={"pich": 1.0}), rnc.ModelError, "v2: no reducing output 'pich'; did you"),
    (lambda r, q: rnc.equilibrium(r, q, v2={"pitch": np.nan}), rnc.InputError, "v2"),
    (lambda r, q: rnc.equilibrium(r, q, v2=[1.0, 0.0, 0.0], cyclic=["pich"]), rnc.ModelError, "pich"),
])  # fmt: skip
def test_what_is_not_found_or_makes_no_sense_is_said(call, error, words):
    reduced = textbook.wheeled_pendulum()
    with pytest.raises(error, match=words) as raised:
        call(reduced, reduced.robot.configuration({"pitch": 0.3}))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("guess", "hold"), [((0.5, 0.9, -0.4), ()), ((-0.6, 0.3, 1.4), ()), ((0.5, 0.9, -0.4), (1,))])
def test_of_a_surface_of_equilibria_the_nearest_is_found(guess, hold):
    """A chain with a free first hinge rests with its centre of mass below that: the rest is a constrained minimum."""
    reduced = textbook.hanging_chain(["hinge_1", "hinge_2"])
    found = rnc.equilibrium(reduced, guess, hold=[f"hinge_{k}" for k in hold])

    def across(q):
        return np.array([2.5, 1.5, 0.5]) @ np.sin(np.cumsum(q))

    kept = [{"type": "eq", "fun": lambda q, k=k: q[k] - guess[k]} for k in hold]
    expected = scipy.optimize.minimize(
        lambda q: np.sum((q - guess) ** 2), guess, constraints=[{"type": "eq", "fun": across}, *kept],
        options={"ftol": 1e-14}, method="SLSQP",
    )  # fmt: skip
    np.testing.assert_allclose(found.q, expected.x, atol=1e-5)
    np.testing.assert_allclose(across(found.q), 0, atol=1e-9)
    q = np.cumsum(found.q)  # weights below a hinge, with their levers
    expected_T = [G * (1.5 * np.sin(q[1]) + 0.5 * np.sin(q[2])), G * 0.5 * np.sin(q[2])]
    np.testing.assert_allclose(found.T, expected_T, atol=1e-8)


def test_of_inputs_that_hold_the_smallest_are_taken():
    B = np.array([[1.0, 0.5, -2.0], [0.0, 1.0, 3.0]])
    found = rnc.equilibrium(textbook.hanging_chain(B, 2), [0.4, -1.1])
    np.testing.assert_array_equal(found.q, [0.4, -1.1])
    needed = G * np.array([1.5 * np.sin(0.4) + 0.5 * np.sin(-0.7), 0.5 * np.sin(-0.7)])
    np.testing.assert_allclose(found.T, np.linalg.pinv(B) @ needed, atol=1e-9)
    assert found.residual < 1e-9


def driven_bicycle():
    """One that nothing keeps upright."""
    robot = systems.bicycle().robot
    wheels = [rnc.RollingWheel("rear", 0.3), rnc.RollingWheel("front", 0.3)]
    return rnc.NonholonomicSystem(robot, wheels, ["rear_wheel"]).reduce()


@pytest.mark.parametrize("make", [
    textbook.wheeled_pendulum, lambda: textbook.hanging_chain(["hinge_1", "hinge_2"]), systems.four_bar, driven_bicycle,
], ids=["pendulum on wheels", "chain", "four-bar", "bicycle"])  # fmt: skip
def test_a_step_towards_an_equilibrium_is_that_of_newton(make):
    """Far from one, moving, loops open: forces that inputs do not reach vanish to first order, and so do gaps."""
    reduced = make()
    model, generator = reduced.robot.model, np.random.default_rng(5)
    q = reduced.robot.random_configuration(generator, 0.4)
    v2, free = 0.6 * generator.normal(size=reduced.r), np.ones(reduced.n, dtype=bool)
    free[-1] = False
    search = _Search(reduced, v2, free, q, None, np.zeros(reduced.r, dtype=bool))
    here, state = search._at(q, v2), reduced.at(q, v2)
    scale = 1 / np.sqrt(np.diag(state.H))
    influence = scale[:, None] * state.input_matrix
    np.testing.assert_allclose(influence.T @ here.force, 0, atol=1e-9)  # T leaves the least
    np.testing.assert_allclose(here.force, scale * (state.H @ here.v2_dot), atol=1e-9)
    np.testing.assert_allclose(here.v2_dot, reduced.forward_dynamics(q, v2, here.T), atol=1e-9)
    step, basis = search._newton(here)
    unreached = scipy.linalg.null_space(influence.T)

    def left(p):
        moved = reduced.at(p, v2)
        force = unreached.T @ (scale * (moved.H @ moved.v2_dot(here.T)))
        return np.concatenate([force, reduced.assembly.residual(p)[reduced.assembly.leading]])

    assert np.abs(left(q)).max() > 0.1
    h = 1e-5

    def along(way):
        return (left(pin.integrate(model, q, h * way)) - left(pin.integrate(model, q, -h * way))) / (2 * h)

    np.testing.assert_allclose(along(step), -left(q), atol=1e-5 * (1 + np.abs(left(q)).max()))
    assert step[-1] == 0.0
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-12)
    for way in basis.T:
        np.testing.assert_allclose(along(way), 0, atol=1e-5)
    assert basis.shape[1] == reduced.n - 1 - len(left(q))
    np.testing.assert_allclose(basis.T @ step, 0, atol=1e-9)  # no longer than it has to be


def test_a_hinge_that_turns_under_gravity_is_no_steady_motion():
    words = "no steady motion found near the guess: at best the shape variable 'hinge_0' moves by 0.7 a second"
    with pytest.raises(rnc.ConstraintError, match=f"^{words}$"):
        rnc.equilibrium(textbook.sideways_pendulum(), [0.0], v2=[0.7])


def test_a_loop_that_a_motor_holds_has_to_be_closed():
    reduced = four_bar()
    robot = reduced.robot
    q = reduced.assembled(robot.configuration({"crank": 1.0, "coupler": -0.4, "rocker": 1.5}), hold=["crank"])
    np.testing.assert_array_equal(rnc.equilibrium(reduced, q, robot.joint_names).q, q)
    apart = q + np.array([0.0, 0.0, 2e-3])
    gap = np.abs(reduced.assembly.residual(apart)).max()
    with pytest.raises(
        rnc.ConstraintError, match=rf"closure_.*\(coupler_tip, rocker_tip\) is left {gap:.3g} from zero"
    ):
        rnc.equilibrium(reduced, apart, robot.joint_names)


@pytest.mark.parametrize(("gear", "holds"), [(1e-8, True), (1e-12, False)])
def test_a_motor_without_strength_is_none(gear, holds):
    reduced = textbook.hanging_chain(np.diag([1.0, gear]), 2)
    guess = np.array([0.9, -0.4])
    found = rnc.equilibrium(reduced, guess)
    if holds:
        np.testing.assert_array_equal(found.q, guess)
        assert found.T[1] == pytest.approx(0.5 * G * np.sin(0.5) / gear, rel=1e-6)
    else:  # the second link hangs down
        assert found.q.sum() == pytest.approx(0, abs=1e-9)


def test_a_grain_of_dust_hangs_too():
    """Its forces are ten million times smaller than those of the other pendulum, in roots of the inertias."""
    model = pin.Model()
    for k, mass in enumerate((1.0, 1e-14)):
        add_body(model, f"hinge_{k}", "RY", mass, com=(0.0, 0.0, -0.5), moments=0.1 * mass)
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), []).reduce()
    np.testing.assert_allclose(rnc.equilibrium(reduced, [0.6, -0.9]).q, 0.0, atol=1e-8)


L = 0.8


def hoop(rate):
    """A bead on a hoop of radius L that turns about the vertical: a pendulum in a plane that turns."""
    model = pin.Model()
    plane = add_body(model, "plane", "RZ", 1.0)
    add_body(model, "bead", "RY", pin.Inertia(0.3, np.array([0.0, 0.0, -L]), np.zeros((3, 3))), plane)
    moves = {"rate": lambda q: np.array([rate]), "rate_dot": lambda q, v: np.zeros(1)}
    turned = rnc.Pfaffian(lambda q: np.array([[1.0, 0.0]]), lambda q, v: np.zeros((1, 2)), ["turned"], **moves)
    return rnc.NonholonomicSystem(rnc.Robot(model), [turned], []).reduce([rnc.JointPosition("bead")])


def circle(steering, hitches):
    """Hitch angles in a circle: axles of 1 m bars hitched on axles stand at radii ``r_k^2 = r_(k-1)^2 - 1``."""
    radius, found = 1 / np.tan(steering), []
    for _ in range(hitches):
        radius = np.sqrt(radius**2 - 1)
        found.append(-np.arctan2(1.0, radius))
    return found


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("speed", [1.0, -0.4])
def test_trailers_in_a_circle_stand_at_the_angles_of_geometry(count, speed):
    reduced = textbook.tractor_trailers(count)
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
    reduced = textbook.tractor_trailers(1)
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
    reduced = textbook.tractor_trailers(1)
    with pytest.raises(rnc.ConstraintError, match=f"no steady motion found .* shape variable {words}") as told:
        rnc.equilibrium(reduced, reduced.robot.configuration(joints), hold, v2)
    assert "\n" not in str(told.value)


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


def free_body(inertia, gravity=(0, 0, 0)):
    model = pin.Model()
    add_body(model, "root_joint", "FreeFlyer", 1.0, moments=inertia, frame="body")
    model.gravity.linear = np.array(gravity, float)
    return rnc.NonholonomicSystem(rnc.Robot(model), [])


def in_the_world(system):
    return system.reduce([rnc.FramePosition("body", "xyz"), rnc.FrameOrientation("body")])


@pytest.mark.parametrize(("make", "whole", "own"), [
    (lambda: hoop(2.0), 1, 1),  # the plane turns, and with it everything
    (textbook.vertical_disk, 3, 1),  # on flat ground, its axle
    (textbook.wheeled_pendulum, 3, 2),
    (ALL["fire_truck"], 3, 0),
    (ALL["four_bar"], 0, 0),
    (bicycle, 3, 2),
    (lambda: free_body((1, 2, 3)).reduce(), 6, 0),
    (lambda: free_body((1, 2, 3), (0, 0.6, -0.8)).reduce(), 4, 0),  # turning about gravity alone
    (lambda: in_the_world(free_body((1, 1, 1))), 3, 3),  # a ball may be turned in its own axes
    (lambda: in_the_world(free_body((1, 2, 1))), 3, 1),
], ids=["hoop", "disk", "pendulum", "truck", "four-bar", "bicycle", "free", "falling", "ball", "spindle"])  # fmt: skip
def test_symmetries_are_those_of_ground_and_wheels(make, whole, own):
    reduced = make()
    q = upright() if reduced is bicycle() else reduced.robot.configuration()
    found = find_symmetries(reduced, q)
    assert (found._twists.shape[1], found._joints.shape[1]) == (whole, own)


@pytest.mark.parametrize("make", [bicycle, ALL["fire_truck"], textbook.vertical_disk])
def test_how_symmetries_vary_is_exact(make):
    reduced = make()
    q = upright() if reduced is bicycle() else reduced.robot.configuration({})
    generator, found = np.random.default_rng(3), find_symmetries(reduced, q)
    q = pin.integrate(reduced.robot.model, q, 0.4 * generator.normal(size=reduced.n))
    coefficients = generator.normal(size=found.directions(q).shape[1])
    expected = gradient(reduced.robot.model, lambda p: found.directions(p) @ coefficients, q)
    np.testing.assert_allclose(found.gradient(q, coefficients), expected, atol=1e-9)


def test_a_bicycle_leans_in_a_circle():
    """By about ``v^2 steer cos(tilt) / (g wheelbase)``, and a free run goes on like this; the frame pitches too."""
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
