"""A velocity-commanded mobile manipulator in the structure of a ROS 2 node: callbacks, a timer, two publishers.

In ROS 2, `Node` is rclpy's, and publishers send `geometry_msgs/Twist` and `std_msgs/Float64MultiArray`.
"""

import numpy as np

import rnc_pin as rnc

DT = 0.02


class HandController:  # (Node)
    """Moves the hand along a line while the platform turns; the reach is kept."""

    def __init__(self, publish_twist, publish_joints):
        self.publish_twist, self.publish_joints = publish_twist, publish_joints  # self.create_publisher(...)
        robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        drives = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
        system = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")], drives)
        outputs = [rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")]
        self.reduced, self.q, self.loop = system.reduce(outputs, [rnc.Distance("base", "tip")]), None, None

    def make_loop(self, q):  # the reference starts where the hand is at the first message
        task = rnc.Task.of(self.reduced, ["tip_x", "tip_y", "base_yaw"], ["base_speed_x"])
        x1, x2 = self.reduced.at(q).outputs()
        start = x2[task.primary]
        way = rnc.planning.MinimumJerk(start, start + np.array([0.8, 0.3, 0.4]), duration=3.0)
        target = rnc.control.RedundancyController(task, way, rnc.planning.Hold(x1[task.vertical]), k21=2.0)
        return rnc.VelocityLoop(self.reduced, target, DT, velocity="commanded", fallback="brake")

    def on_state(self, pose, joints):  # self.create_subscription(...): odometry and joint states, synchronized
        self.q = self.reduced.robot.configuration({"root_joint": list(pose), **joints})
        self.loop = self.loop or self.make_loop(self.q)

    def on_timer(self, now):  # self.create_timer(DT, ...)
        q, self.q = self.q, None  # without a new message the loop holds its command for 5 DT, then brakes
        command = self.loop.step(now, q)
        self.publish_twist(command.twist)
        self.publish_joints(dict(zip(self.loop.joints, command.joints, strict=True)))


pose, joints = np.zeros(3), {"joint_1": 0.5, "joint_2": -1.2}  # a robot that follows velocities exactly


def on_twist(twist):
    heading = pose[2] + 0.5 * DT * twist.yaw
    pose[:] += DT * np.array([twist.forward * np.cos(heading), twist.forward * np.sin(heading), twist.yaw])


def on_joints(velocities):
    joints.update({name: joints[name] + DT * velocity for name, velocity in velocities.items()})


node = HandController(on_twist, on_joints)
for sample in range(200):
    node.on_state(pose, joints)
    node.on_timer(DT * sample)
error = np.abs(node.loop.last.measurement.x2 - node.loop.last.command.x2_desired)[:2].max()
print(f"hand {error * 1000:.1f} mm from its goal; fault: {node.loop.state.fault}")
