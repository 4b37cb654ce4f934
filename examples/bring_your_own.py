"""Any URDF, put on a skate and driven: python bring_your_own.py my_robot.urdf (a UR10 where none is named)."""

import sys

import numpy as np

import rnc_pin as rnc
from rnc_pin.control import ComputedTorque, ReducingOutputController
from rnc_pin.motion.planning import MinimumJerk
from rnc_pin.visualization.recording import Recording

if len(sys.argv) > 1:
    robot = rnc.Robot.from_urdf(sys.argv[1], base="planar")
else:
    robot = rnc.Robot.from_example("ur10_robot", base="planar")
root = robot.model.frames[2].name  # behind the universe and the base joint: the link that the URDF begins with
joints = robot.joint_names[1:]

system = rnc.NonholonomicSystem(
    robot,
    constraints=[rnc.NoSideSlip(root)],
    actuators=[rnc.FrameForce(root, "x"), rnc.FrameTorque(root, "z"), *joints],
)
reduced = system.reduce([rnc.FrameSpeed(root), rnc.FrameYaw(root), *map(rnc.JointPosition, joints)])
report = rnc.analyze(reduced, samples=8)
print(f"{robot.name}: {reduced.n} degrees of freedom, growth vector {report.growth_vector}")

# One metre ahead while it turns by half a radian, and every joint moves a little.
q0 = robot.configuration()
_, start = reduced.at(q0).outputs()
goal = start + np.array([1.0, 0.5, *[0.3] * len(joints)])
kinematic = ReducingOutputController(reduced, MinimumJerk(start, goal, duration=3.0))
run = rnc.simulate(reduced, ComputedTorque(reduced, kinematic, k=20.0), q0, duration=4.0)

errors = rnc.summarize(run)
print(f"largest error under way {max(errors['max_error'].values()):.1e}", end=", ")
print(f"at the end {max(errors['final_error'].values()):.1e} [m, rad]; slip {run.constraint_residual.max():.0e} m/s")
print("to see it, open", Recording(reduced, run).save("bring_your_own.html"))
