"""Figure 7 of the paper: the hand goes to its goal quickly and stays there while the platform drives to its own."""

import numpy as np

import rnc_pin as rnc
from rnc_pin.control import (
    PositionTracker,
    SplitController,
    UnicycleStabilizer,
    VelocityTracker,
    design_position_gains,
    design_velocity_gains,
)
from rnc_pin.motion.planning import MinimumJerk
from rnc_pin.visualization.recording import Recording

robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
system = rnc.NonholonomicSystem(
    robot,
    constraints=[rnc.NoSideSlip("axle")],
    actuators=[rnc.FrameForce("base", "x"), rnc.FrameTorque("base", "z"), "joint_1", "joint_2"],
)
reduced = system.reduce(
    reducing=[rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")],
    vertical=[rnc.FramePosition("base", "xy")],
)
hand, platform = np.array([0, 1]), np.array([2, 3])  # their places in x2

dt = 0.004  # sampling period [s]
q0 = robot.configuration({"root_joint": (-1.6, 0.4, 0.2), "joint_1": 0.4, "joint_2": -1.4})
_, x2 = reduced.at(q0).outputs()
gains = design_position_gains(lambda q: reduced.at(q).H[:2, :2], q0, dt)
tracker = PositionTracker(MinimumJerk(x2[hand], [0.0, 0.0], 3.0), gains)
stabilizer = UnicycleStabilizer(goal=(-1.3, 0.0, 0.0), position=np.array([0, 1]), begin=4.0, k=0.4, rate=1.0)
drive = VelocityTracker(stabilizer, design_velocity_gains(reduced, q0, dt, outputs=platform))
controller = SplitController([(tracker, hand), (drive, platform)], reduced.r)

run = rnc.simulate(reduced, controller, q0, duration=17.0, dt=dt)
off = np.linalg.norm(run.x2[:, hand], axis=1)
print(f"hand within 0.02 m of its goal after {run.time[off > 0.02][-1]:.1f} s")
print(f"hand strays {1e3 * off[run.time > 4.0].max():.2f} mm while the platform drives")
print(f"platform ends at ({run.x1[-1, 0]:.3f}, {run.x1[-1, 1]:.3f}) m, heading {run.x2[-1, 3]:.3f} rad")
print("to see it, open", Recording(reduced, run).save("two_phases.html"))
