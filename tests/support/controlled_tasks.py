"""Tasks, references and controllers that several tests share."""

from functools import cache

import numpy as np

import rnc_pin as rnc
from rnc_pin import control
from rnc_pin.control import RedundancyController, UnknownMass
from rnc_pin.model.coordinates import Coordinates
from rnc_pin.motion.planning import Harmonic, Hold, MinimumJerk
from rnc_pin.references.reference import ReferencePoint
from systems import arm_on_base, mobile_manipulator, space_robot


class Cubic:
    """A reference that nowhere rests: its value and three rates at time 0."""

    def __init__(self, *orders):
        self.orders = [np.array(each) for each in orders]
        self.size = len(orders[0])

    def at(self, t):
        p, v, a, j = self.orders
        return ReferencePoint(p + v * t + a * t**2 / 2 + j * t**3 / 6, v + a * t + j * t**2 / 2, a + j * t, j)


class Rates:
    """A kinematic law in the place of a controller: ``v2`` as the desired one, its rate as inputs."""

    def __init__(self, law):
        self.initial_state, self._law = law.initial_state, law

    def step(self, t, measurement, state):
        target, state = self._law.step(t, measurement, state)
        return control.Command(T=target.v2_dot, v2_desired=target.v2), state


def estimating(alpha, believed):
    reduced = space_robot()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    law = RedundancyController(task, Harmonic([1.0, 0.5], 0.2, 0.2), Harmonic([0.0], [0.15], 0.1), 2.0, 2.0)
    masses = [UnknownMass(f"joint_{i}", unit=10.0) for i in (1, 2, 3)]
    regressor = control.MomentumRegressor(reduced.robot, "platform", masses)
    estimator = control.Estimator(reduced, regressor, believed, alpha=alpha)
    return reduced, law, regressor, control.UncertainController(estimator, Rates(law))


def wide(**changes):
    """The manipulator under a controller: A4 is 1 x 2."""
    reduced, task = manipulator()
    q0 = reduced.robot.configuration({"joint_1": 0.5, "joint_2": -1.2})
    x1, x2 = reduced.at(q0).outputs()
    tip = MinimumJerk(x2[:2], x2[:2] + np.array([0.8, 0.1]), 4.0)
    vertical = MinimumJerk(x1, x1 - 0.1, 4.0)
    secondary = control.Posture(task, Hold(x2[2:]), np.array([0.0, 2.0])) if changes.pop("posture", False) else None
    return reduced, RedundancyController(task, tip, vertical, 2.0, 2.0, secondary=secondary, **changes), q0


def task_at(primary, redundant, vertical):
    """Places of outputs; first names of all three are those of a list, and there are four outputs of either kind."""
    groups = (primary, redundant, vertical)
    names = [tuple(f"{kind}_{place}" for place in group) for kind, group in zip("abc", groups, strict=True)]
    on_lines = (Coordinates(np.zeros(len(group), dtype=bool)) for group in groups)
    places = (np.array(group, dtype=int) for group in groups)
    return rnc.Task(*places, *names, *on_lines, r=len(primary) + len(redundant))


def reaching(duration):
    """The manipulator whose tip and base go to a place and heading, in a kinematic law: model, law and start."""
    reduced = mobile_manipulator()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y", "base_yaw"], ["base_speed_x"], ["distance_base_tip"])
    q0 = reduced.robot.configuration({"joint_1": 0.5, "joint_2": -1.2})
    x1, x2 = reduced.at(q0).outputs()
    way = MinimumJerk(x2[task.primary], x2[task.primary] + [1.0, 0.4, 0.3], duration)
    return reduced, RedundancyController(task, way, Hold(x1[task.vertical]), k21=2.0), q0


LIMITS = {"joint_1": (-1.5, 1.5), "joint_2": (-1.5, -0.35)}


@cache
def manipulator():
    """Speed of the platform and shoulder are redundant for one heading; the elbow is no output, and has limits."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    low, high = robot.model.lowerPositionLimit.copy(), robot.model.upperPositionLimit.copy()
    for joint, (first, last) in LIMITS.items():
        index = robot.model.joints[robot.joint_id(joint)].idx_q
        low[index], high[index] = first, last
    robot.model.lowerPositionLimit, robot.model.upperPositionLimit = low, high
    outputs = [rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.JointPosition("joint_1")]
    reduced = arm_on_base(robot).reduce(outputs, [rnc.FrameYaw("base")])
    return reduced, rnc.Task.of(reduced, ["tip_x", "tip_y"], ["base_speed_x", "joint_1"])


TASK = (["tractor_speed_x", "front_steering"], ["rear_steering"], ["trailer_yaw"])

START, GOAL = np.array([-8.0, 3.0, 0.0]), np.zeros(3)


def learnt_over(elapsed, sigma, before, drive):
    """Return the solution of ``ydot = -sigma y + drive`` after a time."""
    fade = np.exp(-sigma * elapsed)
    return before * fade + drive * ((1 - fade) / sigma if sigma else elapsed)


ARM_START = {"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1}


def space_robot_task(duration=6.0, k3=2.0, k21=2.0):
    reduced = space_robot()
    q0 = reduced.robot.configuration(ARM_START)
    _, x2 = reduced.at(q0).outputs()
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    tip, platform = MinimumJerk(x2[:2], [1.15, 0.6], duration), MinimumJerk([0.0], [0.4], duration)
    return reduced, RedundancyController(task, tip, platform, k3, k21), q0


def gains_along(reduced, kinematic, q0, duration, dt=0.002, step=0.1):
    _, region = rnc.kinematic_rollout(reduced, kinematic, q0, duration, step)
    return control.design_velocity_gains(reduced, region, dt)
