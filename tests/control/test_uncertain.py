"""Uncertain kinematics (14)-(21) beyond class 1: class 2, 2s and 3, each learning its wheels while it drives."""

import numpy as np
import pytest

import rnc_pin as rnc
from bodies import add_body, add_frame
from rnc_pin.control import (
    Estimator,
    PositionGains,
    PositionTracker,
    RedundancyController,
    SplitController,
    SteeringController,
    UncertainController,
    UnicycleStabilizer,
    UnknownRadius,
    UnknownTrack,
    VelocityGains,
    VelocityTracker,
    WheelRegressor,
)
from rnc_pin.planning import Hold, MinimumJerk
from systems import rolling_base

RADIUS, TRACK, WHEELS = 0.08, 0.5, ("left", "right")
BOUNDS = (0.02, 2.0)
DT = 0.02


def two_wheels():
    return rolling_base({"left": (0.0, TRACK / 2), "right": (0.0, -TRACK / 2)}, RADIUS)


def rolling(*wheels):
    return [rnc.RollingWheel(wheel, RADIUS) for wheel in wheels]


def wheels_of_an_axle(reduced):
    return WheelRegressor(reduced, [UnknownRadius(WHEELS), UnknownTrack(WHEELS)])


def learnt(run, truth):
    """Distances of the estimates from the truth, which Lemma 4 lets never grow, from the first to the last."""
    wrong = np.linalg.norm(run.estimates - truth, axis=1)
    assert (np.diff(wrong) < 1e-9).all()
    return wrong[-1] / wrong[0]


def late_miss(run):
    """Of the first vertical output, over the second half."""
    late = run.time > 0.5 * run.time[-1]
    return float(np.sqrt(np.mean((run.x1_desired - run.x1)[late, 0] ** 2)))


def class_2(alpha):
    """A turret on a differential drive keeps pointing: it has to know how the base turns under it."""
    model = two_wheels()
    add_body(model, "turret", "RZ", 2.0, 1, moments=0.2, at=(0.1, 0.0, 0.1), frame="gun")
    drives = ["left_spin", "right_spin", "turret"]
    system = rnc.NonholonomicSystem(rnc.Robot(model), rolling(*WHEELS), drives)
    reduced = system.reduce(list(map(rnc.JointPosition, drives)), [rnc.FrameYaw("gun"), rnc.FrameYaw("base")])
    report = rnc.analyze(reduced, redundant=["turret"], samples=8)
    assert (report.redundancy_class, report.redundancy.tracked) == ("2", ("gun_yaw",))
    estimator = Estimator(reduced, wheels_of_an_axle(reduced), [0.13, 0.3], BOUNDS, alpha)
    task = rnc.Task.of(reduced, drives[:2], drives[2:], ["gun_yaw"])
    drive = MinimumJerk([0.0, 0.0], [20.0, 32.0], 6.0)
    kinematic = RedundancyController(task, drive, Hold([0.0]), 2.0, 2.0)
    return reduced, estimator, kinematic, (RADIUS, TRACK)


def class_2s(alpha):
    """A tricycle whose rear wheel drives it: how far a turn of the wheel goes decides how it has to be steered."""
    model = rolling_base({"rear": (0.0, 0.0)}, RADIUS)
    add_body(model, "steer", "RZ", 1.0, 1, moments=0.1, at=(1.0, 0.0, 0.0), frame="front")
    drives = ["rear_spin", "steer"]
    system = rnc.NonholonomicSystem(rnc.Robot(model), [*rolling("rear"), rnc.NoSideSlip("front")], drives)
    reduced = system.reduce(list(map(rnc.JointPosition, drives)), [rnc.FrameYaw("base")])
    assert rnc.analyze(reduced, redundant=["steer"], samples=8).redundancy_class == "2s"
    estimator = Estimator(reduced, WheelRegressor(reduced, [UnknownRadius(["rear"])]), [0.2], BOUNDS, alpha)
    task = rnc.Task.of(reduced, drives[:1], drives[1:])
    drive = MinimumJerk([0.0], [40.0], 6.0)
    kinematic = SteeringController(estimator.model, task, drive, MinimumJerk([0.0], [0.9], 6.0))
    return reduced, estimator, kinematic, (RADIUS,)


@pytest.mark.parametrize("make", [class_2, class_2s])
def test_what_is_tracked_is_tracked_better_by_those_who_learn(make):
    missed = {}
    for alpha in (0.0, 5.0):
        reduced, estimator, kinematic, truth = make(alpha)
        q0 = reduced.robot.configuration()
        gains = VelocityGains.scaled(estimator.model, q0[None], DT, rnc.control.GainDesign(slowest=1.0))
        controller = UncertainController(estimator, VelocityTracker(kinematic, gains))
        run = rnc.simulate(reduced, controller, q0, 6.0, DT)
        missed[alpha] = late_miss(run)
        if alpha:
            assert learnt(run, truth) < 0.2
    assert missed[5.0] < 0.04
    assert missed[5.0] < 0.2 * missed[0.0]


def test_class_3_on_wheels_that_are_not_known():
    """Wheels turn a force on the platform into torques by their estimated radius and track; the hand stays."""
    model = two_wheels()
    shoulder = add_body(model, "shoulder", "RZ", 4.0, 1, com=(0.5, 0.0, 0.0), moments=0.1, at=(0.0, 0.0, 0.2))
    elbow = add_body(model, "elbow", "RZ", 4.0, shoulder, com=(0.5, 0.0, 0.0), moments=0.1, at=(1.0, 0.0, 0.0))
    add_frame(model, "tip", elbow, (1.0, 0.0, 0.0))
    drives = ["left_spin", "right_spin", "shoulder", "elbow"]
    system = rnc.NonholonomicSystem(rnc.Robot(model), rolling(*WHEELS), drives)
    x2 = [rnc.FramePosition("tip", "xy"), rnc.FrameSpeed("base"), rnc.FrameYaw("base")]
    reduced = system.reduce(x2, [rnc.FramePosition("base", "xy")])
    q0 = reduced.robot.configuration({"root_joint": (-1.4, 0.2, 0.1), "shoulder": 0.4, "elbow": -1.4})
    estimator = Estimator(reduced, wheels_of_an_axle(reduced), [0.11, 0.35], BOUNDS, 5.0)
    hand, platform = np.array([0, 1]), np.array([2, 3])
    H = estimator.model.at(q0).H[None]
    start = reduced.at(q0).outputs()[1][hand]
    there = start + np.array([0.1, -0.05])
    tracker = PositionTracker(MinimumJerk(start, there, 2.0), PositionGains.scaled(H[:, :2, :2], DT, 4.0, 1.5))
    goal = np.array([-1.0, -0.1, 0.6])
    stabilizer = UnicycleStabilizer(goal, np.array([0, 1]), 2.0, k=0.5, rate=1.0, tolerance=0.01)
    gains = VelocityGains.scaled(estimator.model, q0[None], DT, rnc.control.GainDesign(slowest=2.0), outputs=platform)
    split = SplitController([(tracker, hand), (VelocityTracker(stabilizer, gains), platform)], 4)
    run = rnc.simulate(reduced, UncertainController(estimator, split), q0, 18.0, DT)
    assert np.abs([*run.x1[-1] - goal[:2], run.x2[-1, 3] - goal[2]]).max() < 0.02
    assert np.abs(run.x2[run.time > 4.0][:, hand] - there).max() < 0.02
    assert learnt(run, (RADIUS, TRACK)) < 0.5
