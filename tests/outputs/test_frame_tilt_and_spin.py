"""FrameTilt and FrameAngularVelocity against Pinocchio's own kinematics, finite differences, and closed forms."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rolling import slope
from tolerances import FINITE_DIFFERENCE, ROUNDING

AXES = "xyz"


@pytest.fixture(scope="module")
def arm():
    return rnc.Robot.from_urdf("floating_arm.urdf", base="free", gravity=(0, 0, 0))


def free_of(robot, output):
    """No constraints: v2 is v, and A_star is the Jacobian of the output."""
    reduced = rnc.NonholonomicSystem(robot).reduce(vertical=[output])
    assert reduced.reducing.names == robot.velocity_names
    return reduced


def states(robot, count=5):
    generator = np.random.default_rng(3)
    return [(robot.random_configuration(generator), generator.uniform(-1, 1, robot.nv)) for _ in range(count)]


def rotation(robot, frame, q):
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.frame_id(frame)].rotation.copy()


def frame_jacobian(robot, frame, q):
    data = robot.model.createData()
    return pin.computeFrameJacobian(robot.model, data, q, robot.frame_id(frame), pin.ReferenceFrame.LOCAL)


# ---------------------------------------------------------------------- FrameTilt


@pytest.mark.parametrize("axis", AXES)
def test_a_tilt_is_the_angle_above_the_horizon(axis, arm):
    reduced = free_of(arm, rnc.FrameTilt("hand", axis))
    assert reduced.vertical.names == (f"hand_tilt_{axis}",)
    assert not reduced.vertical.quasi.any()
    for q, _ in states(arm):
        height = rotation(arm, "hand", q)[2, AXES.index(axis)]
        np.testing.assert_allclose(reduced.at(q).outputs()[0], [np.arcsin(height)], atol=ROUNDING)


@pytest.mark.parametrize("lean", [-1.2, 0.0, 0.3])
def test_the_lean_of_a_disk(lean):
    """Turned about the world's z by a heading, then about its own x by the lean, then about its axle."""
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    reduced = free_of(robot, rnc.FrameTilt("disk"))  # the axle is y
    turn = pin.utils.rotate("z", 0.8) @ pin.utils.rotate("x", lean) @ pin.utils.rotate("y", 2.1)
    q = robot.configuration({"root_joint": [1, 2, 0.3, *pin.Quaternion(turn).coeffs()]})
    own = pin.utils.rotate("y", 2.1).T
    leaning, heading, rolling = own @ [0.7, 0, 0], turn.T @ [0, 0, 0.5], np.array([0, 9.0, 0])
    state = reduced.at(q, np.r_[np.zeros(3), leaning + heading + rolling])
    np.testing.assert_allclose(reduced.at(q).outputs()[0], [lean], atol=ROUNDING)
    np.testing.assert_allclose(state.v1, [0.7], atol=ROUNDING)  # neither heading nor rolling matters


def test_the_tilt_of_a_vertical_axis_has_no_rate():
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    reduced = free_of(robot, rnc.FrameTilt("disk", "z"))
    with pytest.raises(rnc.SingularityError, match="the tilt of a vertical axis has no rate") as caught:
        _ = reduced.at(robot.configuration()).A_star
    assert caught.value.rows == ("disk_tilt_z",)


# ---------------------------------------------------------------------- FrameAngularVelocity


@pytest.mark.parametrize("axis", AXES)
def test_an_angular_velocity_is_in_the_frames_own_axes(axis, arm):
    row = AXES.index(axis)
    reduced = free_of(arm, rnc.FrameAngularVelocity("hand", axis))
    assert reduced.vertical.names == (f"hand_angular_velocity_{axis}",)
    assert reduced.vertical.quasi.all()
    assert not reduced.vertical.angular.any()  # its integral is no angle: a turn more is a turn more
    for q, v in states(arm):
        state = reduced.at(q, v)
        np.testing.assert_allclose(state.A_star, frame_jacobian(arm, "hand", q)[[3 + row]], atol=ROUNDING)
        here = rotation(arm, "hand", q)
        turned = slope(arm.model, lambda p, here=here: pin.log3(here.T @ rotation(arm, "hand", p)), q, v)
        assert state.v1[0] == pytest.approx(turned[row], abs=FINITE_DIFFERENCE)


def test_the_roll_rate_of_a_rolling_disk():
    """Spin about the axle times the radius is the speed."""
    robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
    system = rnc.NonholonomicSystem(robot, [rnc.RollingWheel("disk", 0.3, axis="y")])
    reduced = system.reduce([rnc.FrameAngularVelocity("disk", axis) for axis in AXES])
    q = reduced.assembled(robot.configuration())
    np.testing.assert_allclose(reduced.at(q, [0, 4.0, 0]).v, [1.2, 0, 0, 0, 4.0, 0], atol=ROUNDING)


def test_an_angular_velocity_has_no_value_but_its_integral(arm):
    reduced = rnc.NonholonomicSystem(arm).reduce(vertical=[rnc.FrameAngularVelocity("hand", "x")])
    q, v = states(arm, 1)[0]
    assert not np.nan_to_num(reduced.at(q, v).measure().x1).any()


def test_angular_velocities_about_world_axes(arm):
    """The rate of the rotation, by differences; with the kernel's comparison."""
    outputs = [rnc.FrameAngularVelocity("hand", axis, axes="world") for axis in AXES]
    reduced = rnc.NonholonomicSystem(arm).reduce(vertical=outputs)
    assert reduced.vertical.names == tuple(f"hand_angular_velocity_world_{axis}" for axis in AXES)
    generator, frame, data = np.random.default_rng(3), arm.frame_id("hand"), arm.model.createData()
    q, v = arm.random_configuration(generator), generator.normal(size=arm.nv)

    def rotation(step):
        pin.framesForwardKinematics(arm.model, data, pin.integrate(arm.model, q, step * v))
        return data.oMf[frame].rotation.copy()

    turned = pin.log3(rotation(1e-6) @ rotation(-1e-6).T) / 2e-6
    np.testing.assert_allclose(reduced.at(q, v=v).measure().v1, turned, atol=1e-7)
    with pytest.raises(rnc.ConfigurationError, match="axes 'wrold' is not known; did you mean 'world'"):
        rnc.FrameAngularVelocity("hand", axes="wrold").bind(arm)


@pytest.mark.parametrize(
    "output", [rnc.FrameTilt("hand", "w"), rnc.FrameAngularVelocity("hand", "w")], ids=["tilt", "velocity"]
)
def test_an_axis_that_is_none_is_refused(output, arm):
    with pytest.raises(rnc.RncError, match="w"):
        output.bind(arm)


@pytest.mark.parametrize("output", [rnc.FrameTilt("hnad"), rnc.FrameAngularVelocity("hnad")], ids=["tilt", "velocity"])
def test_a_frame_that_is_not_there_is_named(output, arm):
    with pytest.raises(rnc.ModelError, match="did you mean 'hand'"):
        output.bind(arm)
