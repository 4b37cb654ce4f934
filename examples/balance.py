"""A wheeled inverted pendulum balances: linearise, solve for an LQR, and close the loop on the nonlinear model."""

import numpy as np
from scipy.linalg import solve_continuous_are

import rnc_pin as rnc
from rnc_pin.control import Command
from rnc_pin.visualization.recording import Recording

robot = rnc.Robot.from_urdf("wheeled_pendulum.urdf", base="planar")
system = rnc.NonholonomicSystem(
    robot,
    constraints=[rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)],
    actuators=["left_axle", "right_axle"],
)
heading = rnc.FrameYaw("base")
reduced = system.reduce([rnc.FrameSpeed("base"), rnc.JointPosition("pitch"), heading])  # three velocities, two motors

upright = robot.configuration()
linear = rnc.linearize(reduced, upright, coordinates=["root_joint[0]", "pitch", heading])
print("states:", ", ".join(linear.state_names))
print("eigenvalues, open loop:", np.round(linear.eigenvalues, 3))

A, B = linear.A, linear.B  # what python-control's ss(A, B, C, D) takes
R = 0.1 * np.eye(2)
K = np.linalg.solve(R, B.T @ solve_continuous_are(A, B, np.diag([10.0, 1, 10, 1, 1, 1]), R))
print("eigenvalues, closed loop:", np.round(np.sort_complex(np.linalg.eigvals(A - B @ K)), 3))


class Regulator:
    """State feedback, sampled and held."""

    def initial_state(self, measurement):
        return None

    def step(self, t, measurement, state):
        return Command(T=linear.T - K @ linear.deviation(measurement.q, measurement.v2)), state


run = rnc.simulate(
    reduced,
    Regulator(),
    robot.configuration({"pitch": 0.2}),
    duration=8.0,
    dt=0.005,
    plant=rnc.ReducedPlant(reduced, actuator_limits=True),
)
print(f"starts {np.degrees(run.x2[0, 1]):.1f} deg off, ends {np.degrees(run.x2[-1, 1]):.1e} deg off")
print(f"rolled {np.ptp(run.q[:, 0]):.2f} m to catch itself, ends {abs(run.q[-1, 0]):.1e} m from where it began")
print("to see it, open", Recording(reduced, run).save("balance.html"))
