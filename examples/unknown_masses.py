"""Figure 6 of the paper: the masses of the links are not known, and learnt while the robot moves."""

import numpy as np

import rnc_pin as rnc
from rnc_pin.control import Estimator, MomentumRegressor, RedundancyController, UncertainController, UnknownMass
from rnc_pin.motion.planning import Harmonic
from rnc_pin.visualization.recording import Recording

robot = rnc.Robot.from_urdf("space_robot.urdf")
joints = ["joint_1", "joint_2", "joint_3"]
system = rnc.NonholonomicSystem(robot, [rnc.MomentumConservation("platform")], actuators=joints)
reduced = system.reduce([rnc.FramePosition("tip", "xy"), rnc.JointPosition("joint_1")], [rnc.JointPosition("platform")])

q0 = robot.configuration({"joint_2": 1.4, "joint_3": -1.6})
_, x2 = reduced.at(q0).outputs()
task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
tip = Harmonic(x2[:2], amplitude=[0.3, 0.1], frequency=[0.2, 0.13], ramp=3.0)
platform = Harmonic([0.0], amplitude=[0.15], frequency=0.1, ramp=3.0)
exact = RedundancyController(task, tip, platform, k21=2.0)

# In units of the platform's inertia: 1 is true.
unknown = MomentumRegressor(robot, "platform", [UnknownMass(joint, unit=10.0) for joint in joints])
for alpha in (0.0, 20.0):
    estimator = Estimator(reduced, unknown, [1.6, 0.4, 1.5], alpha=alpha)
    tracker = rnc.tuned_tracker(estimator.model, exact, q0, duration=10.0, dt=0.005)  # gains for the estimated masses
    run = rnc.simulate(reduced, UncertainController(estimator, tracker), q0, duration=16.0, dt=0.005)
    late = run.time > run.time[-1] / 2
    error = np.sqrt(np.mean(run.prediction_error[late] ** 2))
    print(f"alpha {alpha:4.1f}: estimates {run.estimates[-1].round(3)}, prediction error {error:.4f} rad/s")
print("to see it, open", Recording(reduced, run).save("unknown_masses.html"))
