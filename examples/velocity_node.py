"""A velocity-commanded mobile manipulator, in the structure of a ROS 2 node, without ROS.

The node has a subscription to joint states and odometry, a timer, and two publishers: the twist of the base and the
velocities of the arm's joints. In ROS 2, `Node` is `rclpy.node.Node`, and the messages are `sensor_msgs/JointState`,
`nav_msgs/Odometry`, `geometry_msgs/Twist` and `std_msgs/Float64MultiArray`. The class below needs no other change.
"""

import time
from collections import defaultdict
from types import SimpleNamespace

import numpy as np

import rnc_pin as rnc

DT, DURATION = 0.02, 4.0


class Node:
    """The part of rclpy's Node that the controller uses: topics without a network, timers without a clock."""

    def __init__(self, name):
        self.name, self.timers, self.subscriptions = name, [], defaultdict(list)

    def create_subscription(self, kind, topic, callback, queue):
        self.subscriptions[topic].append(callback)

    def create_publisher(self, kind, topic, queue):
        return SimpleNamespace(publish=lambda message: [each(message) for each in self.subscriptions[topic]])

    def create_timer(self, period, callback):
        self.timers.append(callback)


class HandController(Node):
    """Moves the hand along a line while the platform turns; the reach is kept."""

    def __init__(self):
        super().__init__("hand_controller")
        robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
        drives = [rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"]
        self.reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")], drives).reduce(
            [rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")],
            [rnc.Distance("base", "tip")],
        )
        self.task = rnc.Task.of(self.reduced, ["tip_x", "tip_y", "base_yaw"], ["base_speed_x"])
        self.loop = rnc.VelocityLoop(self.reduced, self.controller, DT, velocity="commanded", fallback="brake")
        self.create_subscription("Odometry", "odom", self.on_odometry, 10)
        self.create_subscription("JointState", "joint_states", self.on_joint_states, 10)
        self.base = self.create_publisher("Twist", "cmd_vel", 10)
        self.arm = self.create_publisher("Float64MultiArray", "arm_controller/commands", 10)
        self.odometry = self.joints = None
        self.create_timer(DT, self.on_timer)

    def controller(self, measurement):
        """The reference starts where the hand is at the first message."""
        task, start = self.task, measurement.x2[self.task.primary]
        way = rnc.planning.MinimumJerk(start, start + np.array([0.8, 0.3, 0.4]), duration=DURATION - 1.0)
        reach = rnc.planning.Hold(measurement.x1[task.vertical])
        return rnc.control.RedundancyController(task, way, reach, k21=2.0)

    def on_odometry(self, message):
        self.odometry = message.pose

    def on_joint_states(self, message):
        self.joints = dict(zip(message.name, message.position, strict=True))

    def on_timer(self):
        q = None
        if self.odometry is not None and self.joints is not None:
            x, y, yaw = self.odometry
            q = self.reduced.robot.configuration({"root_joint": [x, y, yaw], **self.joints})
        self.odometry = self.joints = None  # without new messages the loop holds its command, then brakes
        command = self.loop.step(self.now(), q)
        self.base.publish(SimpleNamespace(linear=command.twist.forward, angular=command.twist.yaw))
        self.arm.publish(SimpleNamespace(data=command.joints))

    def now(self):
        return time.monotonic()


class FakeRobot:
    """Robot that follows velocities exactly: it integrates the twist and the joint velocities that it receives."""

    def __init__(self, node):
        self.pose, self.joints = np.zeros(3), np.array([0.5, -1.2])
        self.twist, self.rates = np.zeros(2), np.zeros(2)
        node.subscriptions["cmd_vel"].append(self.on_twist)
        node.subscriptions["arm_controller/commands"].append(self.on_rates)

    def on_twist(self, message):
        self.twist = np.array([message.linear, message.angular])

    def on_rates(self, message):
        self.rates = np.array(message.data)

    def move(self, dt):
        speed, turn = self.twist
        middle = self.pose[2] + 0.5 * turn * dt
        self.pose += dt * np.array([speed * np.cos(middle), speed * np.sin(middle), turn])
        self.joints += dt * self.rates


node = HandController()
robot = FakeRobot(node)
clock = 0.0
node.now = lambda: clock
for _ in range(round(DURATION / DT)):
    node.subscriptions["odom"][0](SimpleNamespace(pose=robot.pose))
    node.subscriptions["joint_states"][0](SimpleNamespace(name=["joint_1", "joint_2"], position=robot.joints))
    node.timers[0]()
    robot.move(DT)
    clock += DT

decision = node.loop.last
error = np.abs(decision.measurement.x2 - decision.command.x2_desired)[:2].max()
print(f"hand {error * 1000:.1f} mm from its goal after {clock:.1f} s; fault: {node.loop.state.fault}")
