"""A controller of ours in a loop of yours: the robot is in MuJoCo, on wheels that grip by friction.

Only measured q and v come back. It needs the extra ``mujoco``.
"""

import numpy as np

import rnc_pin as rnc
from rnc_pin.lab.mujoco import MuJoCoPlant

DT = 0.005
GOAL = [1.5, 0.6]  # metres along the way, heading

robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
reduced = system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")], [rnc.FramePosition("base", "xy")])

way = rnc.planning.MinimumJerk(np.zeros(2), GOAL, duration=4.0)
target = rnc.control.ReducingOutputController(reduced, way)
design = rnc.control.GainDesign(bandwidth=20.0)
tracker = rnc.tuned_tracker(reduced, target, robot.configuration(), duration=4.0, dt=DT, design=design)
loop = rnc.ControlLoop(reduced, tracker, DT, fallback="brake")

plant = MuJoCoPlant(reduced)
plant.reset(robot.configuration(), np.zeros(robot.nv))
slip = 0.0
for step in range(round(5.0 / DT)):
    q, v = plant.read()
    plant.apply(loop.step(step * DT, q, v))
    plant.advance(DT)
    slip = max(slip, np.abs(plant.slip()).max())

x, y = reduced.at(plant.read()[0]).outputs()[0]
error = np.abs(loop.last.measurement.x2 - GOAL)
print(f"at ({x:.3f}, {y:.3f}) m, off its goal by {error[0]:.4f} m and {error[1]:.4f} rad; slip up to {slip:.4f} m/s")
