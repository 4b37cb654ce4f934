"""Section 4.2 of the paper: the hand of a mobile manipulator goes to a point while the reach of its arm is kept."""

import numpy as np

import rnc_pin as rnc
from rnc_pin.control import ComputedTorque, RedundancyController
from rnc_pin.motion.planning import Hold, MinimumJerk, TaskReference
from rnc_pin.visualization.recording import Recording

robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
system = rnc.NonholonomicSystem(
    robot,
    constraints=[rnc.NoSideSlip("axle")],
    actuators=[rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"],
)
reduced = system.reduce(
    reducing=[rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")],
    vertical=[rnc.Distance("base", "tip")],
)
task = rnc.Task.of(reduced, primary=["tip_x", "tip_y", "base_yaw"], redundant=["base_speed_x"])
print("redundancy class:", rnc.analyze(reduced, task.primary_names, task.redundant_names).redundancy_class)

q0 = robot.configuration({"joint_1": 0.5, "joint_2": -1.2})
reach, x2 = reduced.at(q0).outputs()
start = x2[task.primary]
reference = TaskReference(MinimumJerk(start, start + np.array([2.0, 0.5, 0.4]), duration=4.0), Hold(reach))
margins = rnc.preflight(reduced, task, reference, q0)
print(f"closest to a singular configuration: A4 = {margins.A4.value:.2f} at {margins.A4.time:.1f} s")

kinematic = RedundancyController(task, reference.primary, reference.vertical, k21=2.0)
# The adaptive tracker knows no model; computed torque knows it exactly, and is there for comparison.
for controller in (ComputedTorque(reduced, kinematic, k=20.0), rnc.tuned_tracker(reduced, kinematic, q0, duration=4.0)):
    run = rnc.simulate(reduced, controller, q0, duration=6.0)
    errors = rnc.summarize(run)["final_error"]
    print(type(controller).__name__, {name: f"{error:.1e}" for name, error in errors.items()})
print("to see it, open", Recording(reduced, run).save("mobile_manipulator.html"))
