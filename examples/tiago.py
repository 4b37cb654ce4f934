"""TIAGo's hand stays on a line in the world while its base swerves on two rolling wheels."""

import numpy as np

import rnc_pin as rnc
from rnc_pin.control import RedundancyController
from rnc_pin.motion.planning import MinimumJerk, ViaPoints
from rnc_pin.visualization.recording import Recording

robot = rnc.Robot.from_example("tiago_no_hand", base="planar", lock={"head_1_joint": 0.0, "head_2_joint": -0.3})
wheels = ["wheel_left_joint", "wheel_right_joint"]
arm = [name for name in robot.joint_names if name not in ("root_joint", *wheels)]  # and the torso
rolling = [rnc.RollingWheel("wheel_left_link", 0.0985), rnc.RollingWheel("wheel_right_link", 0.0985)]
system = rnc.NonholonomicSystem(robot, rolling, actuators=[*wheels, *arm])
reduced = system.reduce(
    reducing=[rnc.FrameSpeed("base_link"), rnc.FrameYaw("base_link"), *map(rnc.JointPosition, arm)],
    vertical=[rnc.FramePosition("arm_tool_link")],
)

angles = [0.15, 0.7, -0.5, -1.2, 1.9, -1.0, 0.4, 0.0]
q0 = robot.configuration(dict(zip(arm, angles, strict=True)))
hand, _ = reduced.at(q0).outputs()
task = rnc.Task.of(reduced, primary=["base_link_speed_x", "base_link_yaw"], redundant=arm)
base = ViaPoints([0, 1.5, 3], [[0.0, 0.0], [0.2, 0.25], [0.4, 0.0]])  # distance driven, heading
line = MinimumJerk(hand, hand + np.array([0.4, 0.0, 0.0]), duration=3.0)
kinematic = RedundancyController(task, base, line, k3=2.0, k21=2.0)

# The tracker knows no model, but what holds the arm up at the start, and it learns gravity as fast as that changes.
design = rnc.control.GainDesign(adaptation=30.0)
tracker = rnc.tuned_tracker(reduced, kinematic, q0, duration=3.0, design=design, gravity_compensation=True)
run = rnc.simulate(reduced, tracker, q0, duration=3.5)

errors = rnc.summarize(run)["max_error"]
print("largest errors [m, rad]:", {name: f"{error:.1e}" for name, error in errors.items()})
print(f"wheels slip by less than {run.constraint_residual.max():.0e} m/s")
print("to see it, open", Recording(reduced, run).save("tiago.html"))
