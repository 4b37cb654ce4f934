"""Refusals of the room: what is wrong, in one line."""

from dataclasses import replace
from functools import cache

import coal
import numpy as np

import rnc_pin as rnc
import systems
from refusals import refused
from rnc_pin.motion import optimal
from rnc_pin.motion.optimal import SetPoint, SetPointController, SolverSettings

PLACE, YAW = rnc.FramePosition("sleigh", "xy"), rnc.FrameYaw("sleigh")
GOAL = {PLACE: [1.0, 0.0], YAW: 0.0}


def planned(**change):
    reduced = systems.sleigh()
    return rnc.optimal.plan(reduced, reduced.robot.configuration(), **{"goal": GOAL, "duration": 1.0, **change})


@cache
def short_plan():
    return planned(settings=SolverSettings(nodes=4, accuracy=1.0))


def bound(kind, system, form):
    return kind.bind(optimal.action_model(system, form))


def predictive(**options):
    return optimal.PredictiveController(systems.sleigh(), [optimal.SetPointCost(GOAL)], 2.0, **options)


def to_set_point(**options):
    return SetPointController(systems.sleigh(), GOAL, 5.0, **options)


def follower(steering="exact", **options):
    reduced = systems.differential_drive()
    way = rnc.planning.find_way(reduced, reduced.robot.configuration(), reduced.robot.configuration())
    return optimal.WayFollower(reduced, replace(way, info=replace(way.info, steering=steering)), **options)


def out_of_reach():
    tip, axle = rnc.FramePosition("tip", "xy"), rnc.FramePosition("axle", "xy")
    return SetPoint(systems.mobile_manipulator(), {tip: [9.0, 0.0], axle: [0.0, 0.0], rnc.FrameYaw("axle"): 0.0})


def moving_obstacle():
    motion = rnc.planning.MinimumJerk([5.0, 5.0, 0.0, 0.0], [6.0, 5.0, 0.0, 0.0], 1.0)
    ball = rnc.collision.Obstacle(coal.Sphere(0.2), name="ball", motion=motion)
    bound = rnc.optimal.DistanceBound(rnc.collision.CollisionDistances(systems.sleigh().robot, [ball]))
    return planned(duration=(1.0, 2.0), bounds=[bound])


WRONG, INPUT, NONE = rnc.ConfigurationError, rnc.InputError, rnc.InfeasibleError
test_mistakes_are_refused_in_one_line = refused([
    (lambda: planned(form="kinematics"), WRONG, "did you mean 'kinematic'"),
    (lambda: planned(duration=0.0), INPUT, "duration"),
    (lambda: rnc.optimal.DistanceBound([], clearance=0.1), WRONG, "distances: expected CollisionDistances, found []"),
    (lambda: planned(goal={"sleigh_spede_x": 1.0}), WRONG, "no output 'sleigh_spede_x'"),
    (lambda: planned(bounds=[optimal.InputBound(1.0, -1.0)]), INPUT, "above upper limit"),
    (lambda: SetPointController(systems.sleigh(), GOAL, 4.0, bounds=[optimal.VelocityBound(1.0, -1.0)]), INPUT,
        "above upper limit"),
    (lambda: SetPointController(systems.sleigh(), GOAL, 4.0, nodes=1), INPUT, "nodes: expected at least 2"),
    (lambda: planned(costs=[1.0]), WRONG, "costs: expected a list of CostKind objects"),
    (lambda: planned(costs=optimal.EffortCost(1.0)), WRONG, "costs: expected a list of CostKind objects, found Eff"),
    (lambda: planned(bounds=optimal.InputBound(-1.0, 1.0)), WRONG, "bounds: expected a list of BoundKind objects"),
    (lambda: planned(settings={"nodes": 20}), WRONG, "expected SolverSettings, found a mapping with keys nodes"),
    (lambda: planned(settings=SolverSettings(nodes=10.5)), WRONG, "integer, at least 2 and at most 1000, found 10.5"),
    (lambda: planned(settings=SolverSettings(accuracy=-1)), WRONG, "accuracy of SolverSettings has to be above 0"),
    (lambda: planned(seeds=-1), WRONG, "seeds: expected an integer of at least 0, found -1"),
    (lambda: planned(time_weight="1"), WRONG, "time_weight: expected a number of at least 0, found '1'"),
    (lambda: planned(feedback=lambda _: np.zeros((2, 2))), WRONG, r"feedback: gains of shape \(2, 2\), expected"),
    (moving_obstacle, WRONG, "an obstacle moves over time"),
    (lambda: planned(settings=SolverSettings(reserve=0.5)), WRONG, "reserve of SolverSettings has to be at least 0"),
    (lambda: bound(optimal.VelocityCost({"sleigh_jaw": 1.0}), systems.sleigh(), "acceleration"), WRONG, "did you mean"),
    (lambda: bound(optimal.VelocityCost(-1.0), systems.sleigh(), "acceleration"), WRONG, "no weight may be negative"),
    (lambda: rnc.tvlqr(systems.space_robot_in_joints(), short_plan()), WRONG, "the plan is for inputs"),
    (lambda: short_plan().reference("sleigh_z"), WRONG, "no output 'sleigh_z'"),
    (lambda: optimal.driven_configurations(systems.sleigh(), np.array([0, 0, 1, 0.0]), rnc.planning.Hold([1.0])), WRONG,
        "reference of 1 outputs: the model has 2"),
    (lambda: predictive(form="kinematic"), WRONG, "a predictive controller needs"),
    (lambda: SetPoint(systems.sleigh(), {PLACE: [0.0, 0.0]}), WRONG, "does not determine the position of root_joint"),
    (lambda: SetPoint(systems.differential_drive(), systems.differential_drive().robot.configuration()), NONE,
        "4 of 5 dimensions"),  # the difference of the wheels' angles follows from the yaw
    (out_of_reach, NONE, "no configuration reaches the goal"),
    (lambda: optimal.SetPointCost(np.zeros(4), precision=0.0), WRONG, "precision of SetPointCost has to be above 0"),
    (lambda: bound(optimal.SetPointCost(GOAL, weight={"x": 1.0}), systems.sleigh(), "kinematic"), WRONG, "no 'x'"),
    *(
        (lambda name=name: to_set_point(**{name: 0.0}), WRONG, f"{name}: expected a positive number")
        for name in ("tolerance", "tube", "check", "bandwidth", "braking")
    ),
    (lambda: to_set_point(velocities=True), WRONG, "expected the form 'acceleration'"),
    (lambda: follower(speed=1.2), WRONG, "speed: expected a share of the velocity of the way up to 1"),
    (lambda: follower(tube=0.0), WRONG, "tube: expected a positive number"),
    (lambda: follower("propagated"), WRONG, "this way has propagated motions"),
])  # fmt: skip
