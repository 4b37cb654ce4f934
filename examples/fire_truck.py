"""Figure 8 of the paper: the fire truck drives to the origin, and its trailer slithers after it."""

import rnc_pin as rnc
from rnc_pin.control import SlitheringReference, SteeringController
from rnc_pin.motion.planning import CarPath
from rnc_pin.visualization.recording import Recording

robot = rnc.Robot.from_urdf("fire_truck.urdf", base="planar")
system = rnc.NonholonomicSystem(
    robot,
    constraints=[rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("tractor_axle"), rnc.NoSideSlip("rear_axle")],
    actuators=[rnc.FrameForce("tractor", "x"), "front_steering", "rear_steering"],
)
reduced = system.reduce(
    reducing=[rnc.FrameSpeed("tractor"), rnc.JointPosition("front_steering"), rnc.JointPosition("rear_steering")],
    vertical=[rnc.FramePosition("tractor", "xy"), rnc.FrameYaw("tractor"), rnc.FrameYaw("trailer")],
)
print("redundancy class:", rnc.analyze(reduced, redundant=["rear_steering"]).redundancy_class)

start = (-8.0, 3.0, 0.0)
path = CarPath(start, goal=(0.0, 0.0, 0.0), duration=8.0, wheelbase=1.0)
task = rnc.Task.of(reduced, ["tractor_speed_x", "front_steering"], ["rear_steering"], vertical=["trailer_yaw"])
behind = SlitheringReference(reduced, task, tractor="tractor", axle="rear_axle")  # along the path as it is driven
steering = SteeringController(reduced, task, primary=path.reference, vertical=behind)

q0 = robot.configuration({"root_joint": start})
run = rnc.simulate(
    reduced, rnc.tuned_tracker(reduced, steering, q0, duration=8.0, dt=0.004), q0, duration=9.0, dt=0.004
)
x, y, _, heading = run.x1[-1]
print(f"tractor at ({x:.4f}, {y:.4f}) m, trailer heading {heading:.3f} rad")
print("to see it, open", Recording(reduced, run).save("fire_truck.html"))
