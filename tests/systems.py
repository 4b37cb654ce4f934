"""The systems that invariants are tested on: the paper's three, and robots nobody prepared for this."""

from functools import cache

import numpy as np
import pinocchio as pin

import rnc_pin as rnc


@cache
def space_robot() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], ["joint_1", "joint_2", "joint_3"])
    return system.reduce(
        [rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")]
    )


@cache
def space_robot_in_joints() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    joints = ["joint_1", "joint_2", "joint_3"]
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], joints)
    return system.reduce([rnc.JointPosition(joint) for joint in joints], [rnc.JointPosition("platform")])


@cache
def mobile_manipulator() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    system = rnc.NonholonomicSystem(
        robot,
        [rnc.NoSideSlip("axle")],
        [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"],
    )
    return system.reduce(
        [rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")],
        [rnc.Distance("base", "tip"), rnc.FramePosition("base", "xy")],
    )


@cache
def fire_truck() -> rnc.ReducedModel:
    robot = rnc.Robot.from_urdf("fire_truck.urdf", base="planar")
    system = rnc.NonholonomicSystem(
        robot,
        [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("tractor_axle"), rnc.NoSideSlip("rear_axle")],
        [rnc.FrameForce("tractor", "x"), "front_steering", "rear_steering"],
    )
    return system.reduce(
        [rnc.FrameSpeed("tractor"), rnc.JointPosition("front_steering"), rnc.JointPosition("rear_steering")],
        [rnc.FramePosition("tractor", "xy"), rnc.FrameYaw("trailer"), rnc.FrameYaw("tractor")],
    )


@cache
def free_flying_panda() -> rnc.ReducedModel:
    """A free-flyer base with six momentum rows, gravity off, hand and joint outputs."""
    fingers = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
    robot = rnc.Robot.from_example("panda", base="free", gravity=(0, 0, 0), lock=fingers)
    joints = [f"panda_joint{i}" for i in range(1, 8)]
    system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], joints)
    return system.reduce(
        [rnc.FramePosition("panda_hand")] + [rnc.JointPosition(joints[i]) for i in (0, 2, 4, 6)],
        [rnc.FramePosition("panda_link0"), rnc.FrameYaw("panda_link0")],
    )


@cache
def tiago() -> rnc.ReducedModel:
    """A planar base on two rolling wheels (six contact rows of rank three) under gravity, with an arm."""
    robot = rnc.Robot.from_example("tiago_no_hand", base="planar")
    wheels = ["wheel_left_joint", "wheel_right_joint"]
    arm = [name for name in robot.joint_names if name not in ("root_joint", *wheels)]
    system = rnc.NonholonomicSystem(
        robot,
        [rnc.RollingWheel("wheel_left_link", 0.0985), rnc.RollingWheel("wheel_right_link", 0.0985)],
        [*wheels, *arm],
    )
    return system.reduce(
        [rnc.FrameSpeed("base_link"), rnc.FrameYaw("base_link"), *(rnc.JointPosition(name) for name in arm)],
        [rnc.FramePosition("arm_7_link"), rnc.Distance("base_link", "arm_7_link")],
    )


@cache
def leaning_wheel() -> rnc.ReducedModel:
    """A free disk that rolls and leans, under gravity: the contact arm and its rate depend on q."""
    model = pin.Model()
    model.name = "disk"
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), np.diag([0.05, 0.09, 0.05])), pin.SE3.Identity())
    model.addFrame(pin.Frame("disk", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    system = rnc.NonholonomicSystem(
        rnc.Robot(model),
        [rnc.RollingWheel("disk", 0.3, axis="y")],
        np.eye(6)[:, 3:],
    )

    def spin(q: np.ndarray) -> np.ndarray:
        return np.eye(6)[3:]

    def no_rate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.zeros((3, 6))

    return system.reduce([rnc.Output(None, spin, no_rate, ["spin_x", "spin_y", "spin_z"])], [])


ALL = {
    function.__name__: function
    for function in (
        space_robot,
        space_robot_in_joints,
        mobile_manipulator,
        fire_truck,
        free_flying_panda,
        tiago,
        leaning_wheel,
    )
}


def random_states(reduced: rnc.ReducedModel, count: int, seed: int = 0, condition: float = 3e2):
    """Seeded random (q, v2) at which the outputs parametrise the motion well."""
    generator = np.random.default_rng(seed)
    drawn = (reduced.robot.random_configuration(generator, spread=1.2) for _ in range(100 * count))
    states = [(q, generator.uniform(-1, 1, reduced.r)) for q in drawn if reduced.condition(q) < condition][:count]
    assert len(states) == count, f"only {len(states)} of {count} configurations have condition below {condition:g}"
    return states
