"""Odometry by the rows: exact arcs, all kinds of bases, hidden joints, slip."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import frame_placement
from driven_bases import KINDS, RADIUS, KinematicPlant, drafted_model
from rnc_pin.constraints.wheeled_base import WheeledBase
from rnc_pin.control import TwistController, WheelOdometry
from systems import differential_drive, mobile_manipulator

pytestmark = pytest.mark.usefixtures("brief")


def pose_of(reduced, q, frame="base"):
    placed = frame_placement(reduced.robot, q, frame)
    return np.array([*placed.translation[:2], np.arctan2(placed.rotation[1, 0], placed.rotation[0, 0])])


@pytest.mark.parametrize("turn", [0.0, 1e-9, 0.3, 1.0, -1.3])
def test_one_step_of_any_size_is_an_arc(turn):
    """Wheels at 0.2 m: the arc has the length (l + r) R / 2 and the angle (r - l) R / 0.4. A full circle returns."""
    reduced, length = differential_drive(), 0.04
    mean, half = length / RADIUS, 0.2 * turn / RADIUS
    after = reduced.robot.configuration({"left_wheel_joint": mean - half, "right_wheel_joint": mean + half})
    found = WheelOdometry(reduced, "base").step([1.0, 2.0, 0.5], reduced.robot.configuration(), after)
    chord = length * np.sinc(turn / 2 / np.pi)
    expected = [1.0 + chord * np.cos(0.5 + turn / 2), 2.0 + chord * np.sin(0.5 + turn / 2), 0.5 + turn]
    np.testing.assert_allclose(found.pose, expected, atol=1e-12)
    assert found.slip < 1e-12


def test_the_covariance_of_a_step_is_that_of_its_wheels():
    """Independent errors of two wheels at 0.2 m: the forward motion has their mean, the turn their difference / 0.4."""
    reduced, encoder, slip = differential_drive(), 0.03, 0.002
    after = reduced.robot.configuration({"left_wheel_joint": 1.0, "right_wheel_joint": 1.5})
    step = WheelOdometry(reduced, "base").increment(reduced.robot.configuration(), after)
    wheel = (RADIUS * encoder) ** 2 + slip**2
    expected = np.diag([wheel / 2, slip**2, 2 * wheel / 0.4**2])
    np.testing.assert_allclose(step.covariance(encoder, slip), expected, atol=1e-15)


def driven_errors(reduced, frame, dt):
    """Largest error of the pose by odometry after 1 s of a bent path with turning pivots, and the way [m]."""
    q = reduced.assembled(reduced.robot.configuration())
    controller, odometry = TwistController(reduced, frame, dt), WheelOdometry(reduced, frame)
    assert {*odometry.measured} <= {*reduced.actuation.names}
    plant, state = KinematicPlant(reduced, q), controller.initial_state()
    first = pose = pose_of(reduced, q, frame)
    for k in range(round(1.0 / dt)):
        before = plant.q
        command, state = controller.step(plant.q, [0.5, None, 0.4 * np.sin(4.0 * dt * k)], state)
        plant.advance(command.u, dt, hold=controller.steering)
        pose = odometry.step(pose, before, plant.q).pose
    true = pose_of(reduced, plant.q, frame)
    return np.abs((pose - true + np.pi) % (2 * np.pi) - np.pi).max(), np.linalg.norm(true[:2] - first[:2])


def test_odometry_is_of_second_order_while_the_steering_turns():
    reduced = drafted_model(KINDS["tricycle, driven in front"])
    coarse, fine = (driven_errors(reduced, "sensor", dt)[0] for dt in (0.04, 0.02))
    assert 3.0 < coarse / fine < 5.5


def test_a_caster_shows_the_motion_without_the_motors():
    """Any joints do, if their rows determine the base: here the swivel and the roll of a caster, with one wheel."""
    reduced = drafted_model(KINDS["differential drive"])
    joints = [name for name in reduced.robot.joint_names if "swivel" in name]
    odometry = WheelOdometry(reduced, "base", [*joints, "left_joint"])
    q = reduced.robot.configuration()
    h, controller = 1e-3, TwistController(reduced, "base")
    v = controller.step(q, [0.5, 0.0, 0.8], controller.initial_state())[0].v
    found = odometry.step(np.zeros(3), *(pin.integrate(reduced.robot.model, q, s * h * v) for s in (-0.5, 0.5)))
    np.testing.assert_allclose(found.pose / h, [0.5, 0.0, 0.8], atol=1e-3)


def test_a_slow_twist_turns_the_pivots_as_a_fast_one_does():
    """Also where limits of 1 rad leave the nearer of two angles that miss it."""
    reduced = drafted_model(KINDS["four-wheel steering"])
    base, q, still = WheeledBase(reduced, "base"), reduced.robot.configuration(), np.zeros(4)
    q[base.places[base.pivots]] = 0.4
    motion = base.at(q)
    for aim in np.random.default_rng(0).normal(size=(20, 3)):
        fast, slow = (base.turns(motion, q, speed * aim, still) for speed in (1.0, 1e-7))
        np.testing.assert_allclose(slow, fast, atol=1e-9)


def test_slip_is_the_motion_that_no_motion_of_the_base_explains():
    """Four Mecanum wheels have one motion in which all slip: fl and br against fr and bl."""
    from systems import WHEEL, mecanum

    reduced = mecanum()
    after = reduced.robot.configuration({"fl_spin": 0.1, "fr_spin": 0.1, "bl_spin": -0.1, "br_spin": -0.1})
    found = WheelOdometry(reduced, "base").step(np.zeros(3), reduced.robot.configuration(), after)
    np.testing.assert_allclose(found.pose, 0.0, atol=1e-12)
    assert found.slip == pytest.approx(0.1 * WHEEL * np.cos(np.pi / 4), rel=1e-9)  # along each roller


def test_joints_that_do_not_show_the_base_are_refused():
    with pytest.raises(rnc.ConfigurationError, match="positions of left_wheel_joint do not show the motion of 'base'"):
        WheelOdometry(differential_drive(), "base", ["left_wheel_joint"])
    with pytest.raises(rnc.ConfigurationError, match="positions of joint_1, joint_2 do not show"):
        WheelOdometry(mobile_manipulator(), "base")  # forces drive its base
    with pytest.raises(rnc.ModelError, match="did you mean 'left_wheel_joint'"):
        WheelOdometry(differential_drive(), "base", ["left_wheel_joit"])
    q = differential_drive().robot.configuration()
    with pytest.raises(rnc.InputError, match="pose"):
        WheelOdometry(differential_drive(), "base").step([0.0, 1.0], q, q)
