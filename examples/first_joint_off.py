"""Section 4.1 of the paper: the first joint's actuator off, no rate measured, and the platform does not move."""

import numpy as np

import rnc_pin as rnc
from rnc_pin.control import JacobianTransposeController, PositionTracker, design_position_gains, effective_inertia
from rnc_pin.motion.planning import MinimumJerk
from rnc_pin.visualization.recording import Recording

robot = rnc.Robot.from_urdf("space_robot.urdf")
joints = ["joint_1", "joint_2", "joint_3"]
system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], actuators=joints)
reduced = system.reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")])

q0 = robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
_, x2 = reduced.at(q0).outputs()
dt, tip, active = 0.002, np.array([0, 1]), ["joint_2", "joint_3"]
gains = design_position_gains(lambda q: effective_inertia(reduced, q, tip, active), q0, dt)
tracker = PositionTracker(MinimumJerk(x2[tip], [1.15, 0.6], duration=4.0), gains, outputs=tip)
controller = JacobianTransposeController(reduced, tracker, active)

run = rnc.simulate(reduced, controller, q0, duration=6.0, dt=dt)
errors = rnc.summarize(run)["final_error"]
print("tip ends off by [m]:", {name: f"{error:.1e}" for name, error in errors.items()})
print(f"platform moved by {np.abs(run.x1 - run.x1[0]).max():.0e} rad")
print("to see it, open", Recording(reduced, run).save("first_joint_off.html"))
