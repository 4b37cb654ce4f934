"""Outputs of a frame: orientations on SO(3), tilt, angular velocity, beside Pinocchio, differences and closed forms."""

from math import factorial

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body, frame_placement
from rnc_pin.model.coordinates import Coordinates, left_jacobian
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.motion.planning import Harmonic, Hold, MinimumJerk
from rnc_pin.references.reference import RelativeMinimumJerk
from rolling import slope
from systems import random_states
from tolerances import FINITE_DIFFERENCE, ROUNDING

ROTATION = Coordinates([False] * 3, [0])


def reaction_wheels():
    """A satellite that three wheels turn while an antenna moves: class 1 with no singular configuration."""
    model = pin.Model()
    model.name = "satellite"
    base = add_body(model, "root_joint", "FreeFlyer", 50.0, moments=(5.0, 7.0, 6.0), frame="bus")
    kinds = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}
    for axis, kind in kinds.items():
        add_body(model, f"wheel_{axis}", kind(), 2.0, base, moments=0.5)
    add_body(model, "antenna", "RY", 1.0, base, com=(0.2, 0, 0.1), moments=0.05, at=(0.5, 0, 0))
    model.gravity.linear = np.zeros(3)
    wheels = [f"wheel_{axis}" for axis in kinds]
    system = rnc.NonholonomicSystem(rnc.Robot(model), [rnc.MomentumConservation("root_joint")], ["antenna", *wheels])
    return system.reduce([rnc.JointPosition("antenna"), *map(rnc.JointPosition, wheels)], [rnc.FrameOrientation("bus")])


@pytest.mark.parametrize("length", [0.0, 1e-7, 9e-3, 1.1e-2, 1.0, 3.0, 5.0])
def test_left_jacobian_and_its_rate(length, generator):
    axis, r_dot = generator.normal(size=3), generator.normal(size=3)
    r = length * axis / np.linalg.norm(axis)
    J, J_dot = left_jacobian(r, r_dot)
    # The series sum of K^k / (k + 1)!, and its derivative by a complex step.
    K = np.cross(r + 1e-30j * r_dot, np.eye(3)).T
    series = sum(np.linalg.matrix_power(K, k) / factorial(k + 1) for k in range(45))
    accurate = 1e-13 if length < 1e-2 else 1e-11
    np.testing.assert_allclose(J, series.real, atol=accurate)
    np.testing.assert_allclose(J_dot, series.imag / 1e-30, atol=accurate)


def test_rate_of_the_error(generator):
    h = 1e-6
    for _ in range(20):
        rd, r, wd, w = generator.normal(size=(4, 3))
        error = ROTATION.difference(rd, r)

        def after(s, rd=rd, r=r, wd=wd, w=w):
            moved = [pin.log3(pin.exp3(s * spin) @ pin.exp3(start)) for spin, start in ((wd, rd), (w, r))]
            return ROTATION.difference(*moved)

        if np.linalg.norm(error) < 3.0:  # at a half turn the error jumps
            rate = (after(h) - after(-h)) / (2 * h)
            np.testing.assert_allclose(ROTATION.difference_rate(error, wd, w), rate, atol=1e-6)


def test_errors_take_batch_axes(generator):
    mixed = Coordinates([False, False, False, False, True], [1])
    desired, actual, rate = generator.normal(size=5), generator.normal(size=(4, 2, 5)), generator.normal(size=(4, 2, 5))
    error = mixed.difference(desired, actual)
    change = mixed.difference_rate(error, np.ones(5), rate)
    for at in np.ndindex(4, 2):
        np.testing.assert_array_equal(error[at], mixed.difference(desired, actual[at]))
        np.testing.assert_array_equal(change[at], mixed.difference_rate(error[at], np.ones(5), rate[at]))
        np.testing.assert_allclose(error[at][0], desired[0] - actual[at][0])


def test_any_reference_in_rotation_vectors_has_its_angular_acceleration():
    reference, h = Harmonic([0.2, -1.0, 2.0], [0.8, 0.5, 0.9], [0.3, 0.2, 0.4]), 1e-4
    for t in np.linspace(1.2, 4.0, 8):
        spins = [ROTATION.to_rates(*reference.at(each)[:3])[0] for each in (t - h, t + h)]
        spin_dot = ROTATION.to_rates(*reference.at(t)[:3])[1]
        np.testing.assert_allclose(spin_dot, (spins[1] - spins[0]) / (2 * h), atol=1e-5)


def test_a_record_does_not_jump_at_a_half_turn():
    angles = np.linspace(-4 * np.pi, 4 * np.pi, 401)  # and whole turns
    axis = np.array([0.6, 0.0, 0.8])
    wrapped = np.array([pin.log3(pin.exp3(angle * axis)) for angle in angles])
    assert np.abs(np.diff(wrapped, axis=0)).max() > 1.0
    smooth = ROTATION.unwrap(wrapped)
    np.testing.assert_allclose(smooth, wrapped[0] + (angles - angles[0])[:, None] * axis, atol=1e-9)


def test_the_exact_rate_of_the_class_1_target():
    reduced = reaction_wheels()
    task = rnc.Task.of(reduced, ["antenna"], ["wheel_x", "wheel_y", "wheel_z"])
    references = MinimumJerk([0.0], [0.8], 2.0), Harmonic([0.1, 0.4, -0.3], [0.5, 0.4, 0.6], [0.2, 0.3, 0.25])
    controller = rnc.control.RedundancyController(task, *references, k3=2.0, k21=2.0)
    h, t = 1e-5, 1.3
    for q, v2 in random_states(reduced, 4):
        v = reduced.terms(q, v2).v

        def target(s, q=q, v2=v2, v=v):
            moved = pin.integrate(reduced.robot.model, q, s * v)
            return controller.step(t + s, reduced.at(moved, v2).measure(), None)[0]

        # v2 stands still here, as in every kinematic controller that takes its rate from positions.
        np.testing.assert_allclose(target(0).v2_dot, (target(h).v2 - target(-h).v2) / (2 * h), rtol=1e-5, atol=1e-5)


def test_the_position_tracker_refuses_orientations():
    with pytest.raises(rnc.ConfigurationError, match="not orientations"):
        rnc.control.PositionTracker(Hold(np.zeros(3)), angular=ROTATION)


def test_an_orientation_is_not_torn_apart():
    reduced = reaction_wheels()
    with pytest.raises(rnc.ConfigurationError, match="'bus_orientation' have to stay together"):
        rnc.Task.of(reduced, ["antenna"], ["wheel_x", "wheel_y", "wheel_z"], ["bus_orientation_y"])


def test_displacements_in_scenario_files_turn_in_world_axes():
    reference = RelativeMinimumJerk(by=[0.0, 0.0, 0.5], duration=1.0)
    start = np.array([1.0, 0.2, 0.0])
    goal = reference.from_start(start, ROTATION).at(2.0).position
    np.testing.assert_allclose(pin.exp3(goal), pin.exp3(np.array([0, 0, 0.5])) @ pin.exp3(start), atol=ROUNDING)


AXES = "xyz"


@pytest.fixture(scope="module")
def arm():
    return rnc.Robot.from_urdf("floating_arm.urdf", base="free", gravity=(0, 0, 0))


def free_of(robot, outputs):
    """No constraints: v2 is v, and A_star is the Jacobian of the outputs."""
    reduced = rnc.NonholonomicSystem(robot).reduce(vertical=outputs)
    assert reduced.reducing.names == robot.velocity_names
    return reduced


def states(robot, count=5):
    generator = np.random.default_rng(3)
    return [(robot.random_configuration(generator), generator.uniform(-1, 1, robot.nv)) for _ in range(count)]


@pytest.mark.parametrize("axis", AXES)
def test_a_tilt_is_the_angle_above_the_horizon(axis, arm):
    reduced = free_of(arm, [rnc.FrameTilt("hand", axis)])
    assert reduced.vertical.names == (f"hand_tilt_{axis}",)
    assert not reduced.vertical.quasi.any()
    for q, _ in states(arm):
        height = frame_placement(arm, q, "hand").rotation[2, AXES.index(axis)]
        np.testing.assert_allclose(reduced.at(q).outputs()[0], [np.arcsin(height)], atol=ROUNDING)


@pytest.mark.parametrize("axes", ["own", "world"])
def test_an_angular_velocity_is_the_rate_of_the_rotation(axes, arm):
    reduced = free_of(arm, [rnc.FrameAngularVelocity("hand", axis, axes=axes) for axis in AXES])
    assert reduced.vertical.names == tuple(f"hand_angular_velocity_{'world_' * (axes == 'world')}{x}" for x in AXES)
    assert reduced.vertical.quasi.all()
    assert not reduced.vertical.angular.any()  # its integral is no angle: a turn more is a turn more
    for q, v in states(arm):
        own = frame_placement(arm, q, "hand").inverse()
        turned = slope(arm.model, lambda p, own=own: pin.log3((own * frame_placement(arm, p, "hand")).rotation), q, v)
        expected = turned if axes == "own" else own.rotation.T @ turned
        np.testing.assert_allclose(reduced.at(q, v).v1, expected, atol=FINITE_DIFFERENCE)


def test_other_axes_of_an_angular_velocity_are_refused(arm):
    with pytest.raises(rnc.ConfigurationError, match="axes 'wrold' is not known; did you mean 'world'"):
        rnc.FrameAngularVelocity("hand", axes="wrold").bind(arm)


@pytest.mark.parametrize("kind", [rnc.FrameTilt, rnc.FrameAngularVelocity])
def test_an_axis_or_a_frame_that_is_not_there_is_named(kind, arm):
    with pytest.raises(rnc.RncError, match="w"):
        kind("hand", "w").bind(arm)
    with pytest.raises(rnc.ModelError, match="did you mean 'hand'"):
        kind("hnad").bind(arm)


# ---------------------------------------------------------------------- robot outputs


ROBOTS = {
    "floating arm": lambda: rnc.Robot.from_urdf("floating_arm.urdf", base="free", gravity=(0, 0, 0)),
    "bicycle": lambda: rnc.Robot.from_urdf("bicycle.urdf", base="free"),
    "truck": lambda: rnc.Robot.from_urdf("fire_truck.urdf", base="planar"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_the_centre_of_mass_is_pinocchios(name):
    robot = ROBOTS[name]()
    rows, kinematics = rnc.CenterOfMass().bind(robot), Kinematics(robot)
    assert rows.names == ("center_of_mass_x", "center_of_mass_y", "center_of_mass_z")
    generator, data = np.random.default_rng(5), robot.model.createData()
    for _ in range(3):
        q, v = robot.random_configuration(generator), generator.normal(size=robot.nv)
        at = kinematics.position(q).with_velocity(v)
        pin.centerOfMass(robot.model, data, q, v, np.zeros(robot.nv))
        np.testing.assert_allclose(rows.value(at), data.com[0], atol=ROUNDING)
        np.testing.assert_allclose(rows.jacobian(at) @ v, data.vcom[0], atol=ROUNDING)
        np.testing.assert_allclose(rows.bias_acceleration(at), data.acom[0], atol=100 * ROUNDING)
        np.testing.assert_allclose(rows.jacobian(at), pin.jacobianCenterOfMass(robot.model, data, q), atol=ROUNDING)


def test_a_free_robot_moves_its_centre_of_mass_as_gravity_says(generator):
    """As a reducing output it obeys Newton's law: no torque of a joint moves it."""
    model = rnc.Robot.from_urdf("floating_arm.urdf", base="free").model.copy()
    model.gravity.linear = np.array([0.0, 0.0, -1.6])
    robot = rnc.Robot(model)
    others = [*(rnc.FrameAngularVelocity("satellite", axis) for axis in "xyz"), rnc.JointPosition("shoulder")]
    system = rnc.NonholonomicSystem(robot, [], ["shoulder", "elbow"])
    reduced = system.reduce([rnc.CenterOfMass(), *others, rnc.JointPosition("elbow")])
    q, v2 = robot.random_configuration(generator), generator.normal(size=8)
    found = reduced.forward_dynamics(q, v2, [3.0, -2.0])
    np.testing.assert_allclose(found[:3], [0.0, 0.0, -1.6], atol=1e-10)
    np.testing.assert_allclose(rnc.state_derivatives(reduced, q, v2, [3.0, -2.0]).v2_dot_q[:3], 0, atol=1e-8)


def test_axes_of_a_centre_of_mass():
    robot = ROBOTS["truck"]()
    assert rnc.CenterOfMass("yx").bind(robot).names == ("center_of_mass_y", "center_of_mass_x")
    words = "axes 'xx' of the centre of mass: name each of x, y, z at most once"
    with pytest.raises(rnc.ConfigurationError, match=words):
        rnc.CenterOfMass("xx").bind(robot)
