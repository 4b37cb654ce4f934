"""A Panda on a satellite that floats freely: the hand goes to a point and the satellite keeps its attitude."""

import numpy as np

import rnc_pin as rnc
from rnc_pin.control import RedundancyController
from rnc_pin.motion.planning import Hold, MinimumJerk
from rnc_pin.visualization.recording import Recording

satellite = rnc.Robot.from_urdf("satellite.urdf", base="free", gravity=(0, 0, 0))
arm = rnc.Robot.from_example("panda", lock={"panda_finger_joint1": 0.03, "panda_finger_joint2": 0.03})
robot = satellite.attach(arm, "mount")
joints = [f"panda_joint{i}" for i in range(1, 8)]
system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("root_joint")], actuators=joints)
reduced = system.reduce(
    reducing=[rnc.JointPosition(joint) for joint in joints],
    vertical=[rnc.FramePosition("panda_hand_tcp"), rnc.FrameOrientation("satellite")],
)

q0 = robot.configuration(dict(zip(joints, [-1.95, -0.9, 1.25, -1.9, 0.25, 0.7, 0.2], strict=True)))
x1, _ = reduced.at(q0).outputs()

# Seven joints for three coordinates of the hand and three of the attitude: one freedom is left.
task = rnc.Task.of(reduced, primary=[], redundant=joints)
goal = x1 + np.array([0.1, 0.0, -0.1, 0.0, 0.0, 0.0])
kinematic = RedundancyController(task, primary=Hold([]), vertical=MinimumJerk(x1, goal, duration=2.0))
tracker = rnc.tuned_tracker(reduced, kinematic, q0, duration=3.0)
run = rnc.simulate(reduced, tracker, q0, duration=3.0)

errors = rnc.summarize(run)["max_error"]
print("largest errors [m, rad]:", {name: f"{error:.1e}" for name, error in errors.items()})
moved = np.ptp(run.x2, axis=0).max()
print(f"momentum stays below {run.constraint_residual.max():.0e}, joints move by up to {moved:.2f} rad")
print("to see it, open", Recording(reduced, run).save("free_flying_arm.html"))
