"""A spinning disk is dropped, bounces along the ground and then rolls: its contact opens and closes by itself."""

import numpy as np

import rnc_pin as rnc
from rnc_pin.visualization.drawn_state import DrawnModel
from rnc_pin.visualization.recording import Recording

radius, height, spin, restitution = 0.25, 0.6, 12.0, 0.6
robot = rnc.Robot.from_urdf("rolling_disk.urdf", base="free")
system = rnc.NonholonomicSystem(robot)  # in flight; the contact is that of the plant
reduced = system.reduce()
wheel = rnc.UnilateralContact(rnc.RollingWheel("disk", radius, axis="y"), restitution=restitution)
plant = rnc.ContactPlant(system, [wheel], substeps=4)
q0 = robot.configuration({"root_joint": [0, 0, radius + height, 0, 0, 0, 1]})
run = rnc.simulate(
    reduced, rnc.control.ZeroInput(reduced), q0, duration=2.5, dt=0.01, v2_0=[0, 0, 0, 0, spin, 0], plant=plant
)

for phase in run.info.phases[1:]:
    print(f"t = {phase.start:.3f} s: {phase.energy_loss:.3f} J are lost, then {phase.name}")
speed = np.linalg.norm(run.v[-1, :3])
print(f"the disk rolls at {speed:.3f} m/s; a third of the speed of its rim is {radius * spin / 3:.3f} m/s")
print(f"energy less work changes by {np.ptp(run.energy - run.work):.1e} J")
drawn = DrawnModel(robot, reduced, switching=(wheel.constraint,))  # with the forces of the contact
print("to see it, open", Recording(drawn, run).save("landing.html"))
