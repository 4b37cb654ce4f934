"""The same across a socket: whatever answers a line of inputs with a line of q and v can be controlled.

Here a thread plays the robot, in lines of JSON over the loopback address.
"""

import json
import socket
import threading

import numpy as np

import rnc_pin as rnc

DT = 0.005
GOAL = np.array([1.5, 0.6])

robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
wheels = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
system = rnc.NonholonomicSystem(robot, wheels, ["left_wheel_joint", "right_wheel_joint"])
reduced = system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base")])


def play_robot(listening: socket.socket) -> None:
    """Positions alone, as encoders give them: 4,096 counts a turn."""
    plant = rnc.plants.FaultyPlant(rnc.ReducedPlant(reduced), rnc.Faults(counts=4096), reduced)
    plant.reset(robot.configuration(), np.zeros(robot.nv))
    with listening.accept()[0] as connection, connection.makefile("rw") as lines:
        for line in lines:
            plant.apply(np.array(json.loads(line)))
            plant.advance(DT)
            print(json.dumps(plant.read()[0].tolist()), file=lines, flush=True)


way = rnc.planning.MinimumJerk(np.zeros(2), GOAL, duration=3.0)
target = rnc.control.ReducingOutputController(reduced, way)
design = rnc.control.GainDesign(bandwidth=8.0)
tracker = rnc.tuned_tracker(reduced, target, robot.configuration(), duration=3.0, dt=DT, design=design)
loop = rnc.ControlLoop(reduced, tracker, DT, velocity="observer", cutoff=40.0)

with socket.create_server(("127.0.0.1", 0)) as listening:
    threading.Thread(target=play_robot, args=[listening], daemon=True).start()
    with socket.create_connection(listening.getsockname()) as connection, connection.makefile("rw") as lines:
        T = np.zeros(2)
        for step in range(round(4.0 / DT)):
            print(json.dumps(T.tolist()), file=lines, flush=True)
            T = loop.step(step * DT, np.array(json.loads(lines.readline())))

error = np.abs(loop.last.measurement.x2 - GOAL)
print(f"off its goal by {error[0]:.4f} m and {error[1]:.4f} rad, from positions alone")
