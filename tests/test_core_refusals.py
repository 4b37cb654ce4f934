"""What model, constraints, control and analysis refuse beside what other tests meet: one line, with the name."""

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.analysis.singularities import stack_singularities
from rnc_pin.control import (
    JacobianTransposeController,
    JointLimits,
    PositionGains,
    PositionTracker,
    SingularityDistance,
    SlitheringReference,
)
from rnc_pin.control.wheel_regressor import _axles
from rnc_pin.model.rows import Rows, check_defined
from rnc_pin.planning import Hold
from systems import fire_truck, four_bar_robot, free_flying_panda, mobile_manipulator, sleigh

PAIR = [rnc.RollingWheel(f"{side}_wheel", 0.1) for side in ("left", "right")]
AXLES = ["left_wheel_joint", "right_wheel_joint"]


def differential_drive():
    return rnc.Robot.from_urdf("differential_drive.urdf", base="planar")


def test_a_batch_with_a_quaternion_that_is_none():
    reduced = free_flying_panda()
    q = reduced.robot.configuration()
    with pytest.raises(rnc.InputError, match=r"pair or a quaternion that is not of unit length"):
        reduced.inertia(np.stack([q, 1.1 * q]))


def test_no_actuators_reach_nothing():
    reduced = rnc.NonholonomicSystem(sleigh().robot, [rnc.NoSideSlip("sleigh")]).reduce()
    q = reduced.robot.configuration()
    with pytest.raises(rnc.ConstraintError, match=r"actuators \(none\) reach rank 0 of the 2 reduced forces"):
        reduced.allocate(q, [1.0, 0.0])


def test_a_coupling_beyond_all_numbers():
    robot = four_bar_robot()
    with pytest.raises(rnc.ConstraintError, match=r"overflow|not finite"):
        rnc.NonholonomicSystem(robot, [rnc.JointCoupling(robot.joint_names[1], robot.joint_names[0], 1e200)])


def test_forces_beyond_all_numbers():
    reduced = sleigh()
    q = reduced.robot.configuration()
    with pytest.raises(rnc.DivergenceError, match="reduced acceleration is not finite"):
        reduced.forward_dynamics(q, [0.0, 0.0], [1e308, 1e308])


class Undefined:
    """A row that is defined to the right of a line only."""

    def __init__(self, line):
        self.line = line

    def bind(self, robot):
        return UndefinedRows(self.line, robot)


class UndefinedRows(Rows):
    names, units, holonomic, on_ground, affine, joints = ("half",), ("m/s",), (False,), False, False, ()

    def __init__(self, line, robot):
        self.line, self.matrix = line, np.eye(robot.nv)[1:2]

    def jacobian(self, at):
        check_defined("to the left of the line", at, at.q[..., 0] - self.line, 0.0, self.names)
        return np.broadcast_to(self.matrix, (*at.q.shape[:-1], *self.matrix.shape))

    def jacobian_dot(self, at):
        return np.zeros((*at.q.shape[:-1], *self.matrix.shape))

    def bias_acceleration(self, at):
        return self._zeros(at)


def test_rows_that_are_undefined_at_some_configurations():
    """Samples are taken where they are; nowhere at all is an error."""
    robot = sleigh().robot
    assert rnc.NonholonomicSystem(robot, [Undefined(0.0)]).r == 2
    with pytest.raises(rnc.ConstraintError, match="constraints half are undefined at every sampled configuration"):
        rnc.NonholonomicSystem(robot, [Undefined(1e9)])


def test_rows_that_are_not_numbers():
    robot = sleigh().robot

    class NoNumber(UndefinedRows):
        def jacobian(self, at):
            return np.full((*at.q.shape[:-1], 1, 3), np.nan)

    class Kind(Undefined):
        def bind(self, robot):
            return NoNumber(0.0, robot)

    with pytest.raises(rnc.ConstraintError, match=r"constraint row 'half' is not finite at q = \["):
        rnc.NonholonomicSystem(robot, [Kind(0.0)])


def test_a_momentum_that_is_kept_where_nobody_knows():
    """Of a disc that floats on a lift: its momentum keeps its direction in the world, not in its own axes."""
    model = pin.Model()
    lift = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "lift")
    disc = model.addJoint(lift, pin.JointModelPlanar(), pin.SE3.Identity(), "disc")
    for joint in (lift, disc):
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    robot = rnc.Robot(model)
    assert rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("disc")]).r == 1
    with pytest.raises(rnc.ConstraintError, match=r"'disc' has to be zero, .* JointModelPlanar on 'lift'"):
        rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("disc", [1.0, 0.0, 0.0])])


def test_a_wheel_on_a_joint_that_slides():
    model = differential_drive().model
    joint = model.addJoint(1, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(joint, pin.Inertia(0.1, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("skid", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    with pytest.raises(rnc.ConstraintError, match="joint of wheel 'skid' is not revolute: give the axle"):
        rnc.NonholonomicSystem(rnc.Robot(model), [rnc.RollingWheel("skid", 0.1)])


def test_an_actuator_that_is_active_twice():
    reduced = mobile_manipulator()
    tracker = PositionTracker(Hold([0.0, 0.0]), PositionGains(), outputs=[0, 1])
    with pytest.raises(rnc.ConfigurationError, match="active actuator 'joint_1' is named twice"):
        JacobianTransposeController(reduced, tracker, ["joint_1", "joint_1"])


def test_more_active_actuators_than_outputs_share_the_work():
    """By the transpose of the Jacobian; fewer are refused."""
    reduced = mobile_manipulator()
    tracker = PositionTracker(Hold([0.0, 0.0]), PositionGains(), outputs=np.array([0, 1]))
    names = ["joint_1", "joint_2", "torque(base.z)"]
    controller = JacobianTransposeController(reduced, tracker, names)
    q = reduced.robot.configuration({"joint_1": 0.4, "joint_2": -1.1})
    measured = reduced.measure(q, np.zeros(4))
    command, _ = controller.step(0.1, measured, controller.initial_state(measured))
    forces, _ = tracker.step(0.1, measured, tracker.initial_state(measured))
    drive = reduced.drive_jacobian(q)[[0, 1]]
    np.testing.assert_allclose(command.T[[2, 3, 1]], drive[:, [2, 3, 1]].T @ forces.F[:2])
    assert command.T[0] == 0.0
    with pytest.raises(rnc.ConfigurationError, match="1 active actuators cannot drive 2 outputs"):
        JacobianTransposeController(reduced, tracker, ["joint_1"])


def test_a_robot_without_ends_has_none_to_keep_from():
    reduced = sleigh()
    task = rnc.Task.of(reduced, reduced.reducing.names[:1], reduced.reducing.names[1:])
    with pytest.raises(rnc.ConfigurationError, match=r"no joint of robot .* has position limits"):
        JointLimits(reduced, task)


def test_a_distance_to_singular_configurations_where_one_is():
    """The platform's coordinate x across its heading: driving does not move it."""
    robot = mobile_manipulator().robot
    system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")])
    reduced = system.reduce(
        [rnc.JointPosition("joint_1"), rnc.JointPosition("joint_2"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")],
        [rnc.FramePosition("base", "y")],
    )
    task = rnc.Task.of(reduced, ["joint_1", "joint_2", "base_yaw"], ["base_speed_x"], ["base_y"])
    with pytest.raises(rnc.SingularityError, match=r"cannot move the vertical ones") as told:
        SingularityDistance(reduced, task).gradient(robot.configuration({"root_joint": [0.3, 0.1, 0.0]}))
    assert told.value.rows == ("base_y", "base_speed_x")
    assert told.value.condition == np.inf
    np.testing.assert_allclose(told.value.q[:2], [0.3, 0.1])


def test_a_kingpin_as_far_ahead_as_the_axle_is_behind():
    """Of a tractor that is led by its front axle: the chord of the path would not be one."""
    system = rnc.NonholonomicSystem(fire_truck().robot, [rnc.NoSideSlip(f"{axle}_axle") for axle in ("front", "rear")])
    steering = [rnc.JointPosition("front_steering"), rnc.JointPosition("rear_steering")]
    reduced = system.reduce(
        [rnc.FrameSpeed("tractor"), *steering, rnc.FrameYaw("tractor")],
        [
            rnc.FramePosition("front_axle", "xy"),
            rnc.FramePosition("hitch", "xy"),
            rnc.FrameYaw("trailer"),
            rnc.FrameYaw("front_axle"),
        ],
    )
    primary = ["tractor_speed_x", "front_steering", "tractor_yaw"]
    task = rnc.Task.of(reduced, primary, ["rear_steering"], ["trailer_yaw"])
    with pytest.raises(rnc.ConfigurationError, match="kingpin 'hitch' has to be a fixed place on the tractor, nearer"):
        SlitheringReference(reduced, task, "front_axle", "rear_axle", "hitch")


def test_a_kingpin_that_is_on_the_trailer_alone():
    """Fixed on the trailer, but not where it turns about the tractor."""
    truck = fire_truck()
    model = truck.robot.model.copy()
    trailer = model.getJointId("hitch")
    model.addFrame(pin.Frame("pole", trailer, 0, pin.SE3(np.eye(3), np.array([-0.2, 0, 0])), pin.FrameType.OP_FRAME))
    rows = [rnc.NoSideSlip(f"{axle}_axle") for axle in ("front", "tractor", "rear")]
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), rows).reduce(
        [rnc.FrameSpeed("tractor"), rnc.JointPosition("front_steering"), rnc.JointPosition("rear_steering")],
        [
            *(rnc.FramePosition(frame, "xy") for frame in ("tractor", "pole")),
            *map(rnc.FrameYaw, ("trailer", "tractor")),
        ],
    )
    task = rnc.Task.of(reduced, ["tractor_speed_x", "front_steering"], ["rear_steering"], ["trailer_yaw"])
    with pytest.raises(rnc.ConfigurationError, match="kingpin 'pole' has to be a fixed place on the tractor, nearer"):
        SlitheringReference(reduced, task, "tractor", "rear_axle", "pole")


def with_wheel(frame, kind, place, centre=(0.0, 0.0, 0.0)):
    """The differential drive with another wheel on a joint of its own."""
    model = differential_drive().model
    joint = model.addJoint(1, kind, pin.SE3(np.eye(3), np.array(place)), f"{frame}_joint")
    model.appendBodyToJoint(joint, pin.Inertia(0.1, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame(frame, joint, 0, pin.SE3(np.eye(3), np.array(centre)), pin.FrameType.OP_FRAME))
    return rnc.Robot(model)


@pytest.mark.parametrize(
    ("kind", "place", "message"),
    [
        (pin.JointModelSpherical(), (0.0, 0.0, 0.0), "frame 'third' is not on the axis of its joint"),
        (pin.JointModelRY(), (0.0, 0.2, 0.0), "have the same position: the direction of their axle is undefined"),
    ],
)
def test_wheels_without_a_track(kind, place, message):
    robot = with_wheel("third", kind, place)
    left = robot.model.jointPlacements[robot.joint_id("left_wheel_joint")].translation
    np.testing.assert_allclose(left, [0.0, 0.2, 0.0])  # where one of them is
    with pytest.raises(rnc.ConfigurationError, match=message):
        _axles(robot, 0, "left_wheel", "third")


def test_no_configuration_has_no_singular_ones():
    reduced = sleigh()
    assert stack_singularities(reduced, np.zeros((0, reduced.robot.nq))) == []
