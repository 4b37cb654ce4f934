"""Figure 4 of the paper through the Python API: tip and platform of the space robot tracked at once."""

import rnc_pin as rnc
from rnc_pin.control import RedundancyController
from rnc_pin.motion.planning import MinimumJerk
from rnc_pin.visualization.recording import Recording

robot = rnc.Robot.from_urdf("space_robot.urdf")
system = rnc.NonholonomicSystem(
    robot, constraints=[rnc.MomentumConservation("platform")], actuators=["joint_1", "joint_2", "joint_3"]
)
reduced = system.reduce(
    reducing=[rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], vertical=[rnc.JointPosition("platform")]
)

q0 = robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1})
x1, x2 = reduced.at(q0).outputs()

# The tip and the platform have goals; nothing drives the platform: the first joint is spent on turning it.
task = rnc.Task.of(reduced, primary=["tip_x", "tip_y"], redundant=["joint_1"])
kinematic = RedundancyController(
    task,
    primary=MinimumJerk(x2[:2], [1.15, 0.6], duration=6.0),
    vertical=MinimumJerk(x1, [0.4], duration=6.0),
    k3=2.0,
    k21=2.0,
)

# The tracker below it knows no model; its gains suit the inertia along the way.
tracker = rnc.tuned_tracker(reduced, kinematic, q0, duration=6.0)
run = rnc.simulate(reduced, tracker, q0, duration=8.0)

summary = rnc.summarize(run)
print("final errors [m, rad]:", {name: f"{error:.1e}" for name, error in summary["final_error"].items()})
print(f"angular momentum stays below {summary['constraint_residual_max']:.0e} N m s")
print("to see it, open", Recording(reduced, run).save("space_robot.html"))
