"""Tasks, limits and programs that are refused, each with its message."""

import numpy as np

import rnc_pin as rnc
from refusals import refused
from rnc_pin.control import InverseDynamicsQP, VelocityQP, limits, tasks
from rnc_pin.motion.planning import Hold
from systems import tiago

YAW = rnc.FrameYaw("base_link")
TASKS = [
    (lambda: tasks.PostureTask({}), "at least one joint"),
    (lambda: tasks.CenterOfMassTask(Hold([0.0, 0.0]), "xx"), "each of x, y, z at most once"),
    (lambda: tasks.CenterOfMassTask(Hold([0.0]), "xy"), "centre-of-mass reference has 1 values for 2"),
    (lambda: tasks.BasePoseTask("base_link", Hold([0.0, 0.0])), "base pose reference has 2 values for 3"),
    (lambda: tasks.OutputTask(YAW, Hold([0.0]), weight=[1.0, 2.0]), "weight of OutputTask has to be a number or 1"),
    (lambda: tasks.OutputTask(YAW, Hold([0.0]), weight=np.inf), "weight of OutputTask has to be a number or 1"),
    (lambda: tasks.OutputTask(YAW, Hold([0.0]), gain=-1.0), "gain of OutputTask has to be a number or 1 numbers"),
    (lambda: tasks.OutputTask(YAW, Hold([0.0, 0.0])), "reference has 2 values for 1 outputs"),
    (lambda: tasks.DampingTask(joints=["arm"]), "no joint 'arm'"),
    (lambda: YAW, "a task has to be a ControlTask, found FrameYaw"),
]
LIMITS = [
    (
        lambda: limits.JointPositionLimit(deceleration=-1.0),
        "deceleration of JointPositionLimit has to be above 0, found",
    ),
    (lambda: limits.JointPositionLimit(margin=0.5), "has to be at least 0 and below 0.5, found 0.5"),
    (lambda: limits.JointPositionLimit(joints=["wheel_left_joint"]), "no position limits"),
    (lambda: limits.JointVelocityLimit(margin=1.0), "at least 0 and below 1, found 1.0"),
    (lambda: limits.JointVelocityLimit(limit=0.0), "above 0, found 0.0"),
    (lambda: limits.JointVelocityLimit(joints=["arm_8_joint"]), "no joint 'arm_8_joint'"),
    (lambda: limits.JointVelocityLimit(joints=["root_joint"]), "has no velocity limit"),
    (lambda: limits.AccelerationLimit(0.0), "positive number or 12"),
    (lambda: limits.AccelerationLimit([1.0, 2.0]), "positive number or 12"),
    (lambda: limits.AccelerationLimit({}), "give one or more"),
    (lambda: limits.AccelerationLimit({"arm_1_joint": 1.0}, joints=["arm_2_joint"]), "no 'joints'"),
    (lambda: limits.AccelerationLimit({"arm_1_joint": -1.0}), "positive number or 1"),
    (lambda: limits.BaseSpeedLimit("base_link", 0.0), "limit of BaseSpeedLimit"),
    (lambda: limits.RegionLimit("base_link"), "give a box or a polygon"),
    (lambda: limits.RegionLimit("base_link", box={"x": (1.0, 0.0)}), "x from 1.0 to 0.0 is empty"),
    (lambda: limits.RegionLimit("base_link", polygon=[(0, 0), (1, 0), (1, 1), (0.9, 0.1)]), "convex polygon"),
    (lambda: limits.RegionLimit("base_link", polygon=[(0, 0, 0), (1, 0, 0), (0, 1, 0)]), "convex polygon"),
    (lambda: limits.CollisionAvoidance(clearance=0.2, influence=0.1), "clearance < influence"),
    (lambda: limits.CollisionAvoidance(clearance=-1e-3), "clearance of CollisionAvoidance has to be .*, found -0.001"),
    (lambda: limits.CollisionAvoidance(rate=0.0), "rate of CollisionAvoidance has to be .*, found 0.0"),
    (
        lambda: limits.CollisionAvoidance(deceleration=np.inf),
        "deceleration of CollisionAvoidance has to be .*, found inf",
    ),
    (lambda: limits.CollisionAvoidance(deceleration=0.0), "deceleration of CollisionAvoidance has to be .*, found 0.0"),
    (lambda: 3, "a limit has to be a ControlLimit, found int"),
]
PROGRAMS = [
    (lambda model: VelocityQP(model, [], dt=-1.0), "dt: expected a positive number, found -1"),
    (lambda model: VelocityQP(model, [], damping=-1.0), "cannot be negative"),
    (lambda model: VelocityQP(model, [], damping=np.inf), "cannot be negative"),
    (lambda model: InverseDynamicsQP(model, [], dt=0.0), "dt: expected a positive"),
    (lambda model: InverseDynamicsQP(model, [], dt=0.01, friction=-1.0), "friction: expected a positive"),
    (lambda model: VelocityQP(model, []).initial_state(rnc.Measurement(v2=np.zeros((2, 12)))), "takes one state"),
    (lambda model: VelocityQP(model, [tasks.DampingTask()]).step(0.0, rnc.Measurement(), None), "has no q"),
]
CASES = [(lambda model, make=make: VelocityQP(model, [make()]), words) for make, words in TASKS]
CASES += [(lambda model, make=make: VelocityQP(model, [], [make()]), words) for make, words in LIMITS]
test_what_does_not_fit_is_refused_in_words = refused([*CASES, *PROGRAMS], lambda make: make(tiago()))


def test_a_clearance_of_zero_is_one():
    assert limits.CollisionAvoidance(clearance=0).clearance == 0
