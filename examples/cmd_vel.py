"""cmd_vel for a four-wheel swerve base, across a socket: twists come in, joint velocities and odometry go out.

Lines of JSON have the fields of geometry_msgs/Twist and sensor_msgs/JointState. A thread plays the other end: it drives
sideways, turns on the spot, and moves the joints as told. In ROS 2 the lines are subscriptions and publishers.
"""

import json
import socket
import threading

import numpy as np
import pinocchio as pin

import rnc_pin as rnc

DT, RADIUS = 0.02, 0.08
CORNERS = {"fl": (0.3, 0.2), "fr": (0.3, -0.2), "bl": (-0.3, 0.2), "br": (-0.3, -0.2)}

model = pin.Model()
base = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "root_joint")
model.addFrame(pin.Frame("base_link", base, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
model.appendBodyToJoint(base, pin.Inertia(20.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
for name, (x, y) in CORNERS.items():
    turn = model.addJoint(base, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([x, y, RADIUS])), f"{name}_turn")
    roll = model.addJoint(turn, pin.JointModelRY(), pin.SE3.Identity(), f"{name}_roll")
    model.appendBodyToJoint(roll, pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame(name, roll, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
motors = [f"{name}_{kind}" for name in CORNERS for kind in ("turn", "roll")]
model.upperVelocityLimit[3:] = [3.0, 30.0] * 4  # of turn and roll [rad/s]
wheels = [rnc.RollingWheel(name, RADIUS, lateral=name in ("fl", "br")) for name in CORNERS]  # two lateral rows suffice
reduced = rnc.NonholonomicSystem(rnc.Robot(model), wheels, motors).reduce()
controller = rnc.control.TwistController(reduced, "base_link", DT)
odometry = rnc.control.WheelOdometry(reduced, "base_link")


def play_the_other_end(address):
    angles = dict.fromkeys(motors, 0.0)
    with socket.create_connection(address) as connection, connection.makefile("rw") as lines:
        for sample in range(300):
            vy, wz = (0.4, 0.0) if sample < 150 else (0.0, 0.6)
            twist = {"linear": {"x": 0.0, "y": vy, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": wz}}
            joints = {"name": motors, "position": [*angles.values()]}
            print(json.dumps({"cmd_vel": twist, "joint_states": joints}), file=lines, flush=True)
            told = json.loads(lines.readline())["joint_command"]
            angles.update({n: angles[n] + DT * v for n, v in zip(told["name"], told["velocity"], strict=True)})


with socket.create_server(("127.0.0.1", 0)) as listening:
    threading.Thread(target=play_the_other_end, args=[listening.getsockname()], daemon=True).start()
    state, pose, before = controller.initial_state(), np.zeros(3), reduced.robot.configuration()
    with listening.accept()[0] as connection, connection.makefile("rw") as lines:
        for message in map(json.loads, lines):
            linear, angular, joints = *message["cmd_vel"].values(), message["joint_states"]
            q = reduced.robot.configuration(dict(zip(joints["name"], joints["position"], strict=True)))
            pose, before = odometry.step(pose, before, q).pose, q
            command, state = controller.step(q, [linear["x"], linear["y"], angular["z"]], state)
            told = {"name": controller.joints, "velocity": command.joints.tolist()}
            odom = dict(zip(("x", "y", "yaw"), (pose.round(2) + 0.0).tolist(), strict=True))
            print(json.dumps({"joint_command": told, "odom": odom}), file=lines, flush=True)
print("at " + ", ".join(f"{name} = {value:.2f}" for name, value in odom.items()))
