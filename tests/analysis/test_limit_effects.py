"""Effects of limits on tasks, against closed forms."""

import json

import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.control import VelocityQP, limits, tasks


def arm(**options):
    """Mobile manipulator whose second joint moves at most at 0.5 rad/s, towards a posture at one per second."""
    robot = rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar")
    reduced = rnc.NonholonomicSystem(robot, [rnc.NoSideSlip("axle")]).reduce()
    posture = tasks.PostureTask({"joint_1": 0.0, "joint_2": 0.0})
    slow = limits.JointVelocityLimit(joints=["joint_1", "joint_2"], limit=0.5, margin=0.0)
    return reduced, VelocityQP(reduced, [posture, tasks.DampingTask(weight=1e-9, priority=1)], [slow], **options)


def test_effects_are_those_of_independent_joints():
    reduced, program = arm(dt=0.01)
    states = [(0.0, reduced.robot.configuration({"joint_1": a, "joint_2": b}), np.zeros(reduced.r))
              for a, b in ((0.2, -0.3), (0.2, -1.3), (2.0, -1.3))]  # fmt: skip
    report = rnc.analyze(reduced, samples=8, program=program, states=states)
    free, one, both = report.limit_effects
    assert (free.active, free.freedom, dict(free.exceeded)) == ((), reduced.r, {})
    assert max(map(abs, free.task_error.values())) < 1e-12
    assert one.active == ("joint_2 velocity",)
    assert one.freedom == reduced.r - 1
    # The posture asks for 1.3 rad/s.
    assert one.task_error["joint_2 posture"] == pytest.approx(0.5 - 1.3, abs=1e-9)
    assert one.task_error["joint_1 posture"] == pytest.approx(0.0, abs=1e-9)
    assert both.freedom == reduced.r - 2
    assert both.task_error["joint_1 posture"] == pytest.approx(-0.5 + 2.0, abs=1e-9)
    content = json.loads(json.dumps(report.to_dict()))
    assert content["limit_effects"][1]["active"] == ["joint_2 velocity"]


def test_limits_that_exclude_each_other_are_named():
    reduced, program = arm(dt=0.01)
    fast = limits.AccelerationLimit(1.0)  # cannot stop from 3 rad/s within the velocity limit
    program = VelocityQP(reduced, program.tasks, [*program.limits, fast], dt=0.01)
    q, v2 = reduced.robot.configuration(), np.zeros(reduced.r)
    v = np.zeros(reduced.n)
    v[reduced.robot.velocity_indices("joint_1")] = 3.0
    v2 = np.linalg.lstsq(reduced.at(q).R, v, rcond=None)[0]
    (effect,) = rnc.analyze(reduced, samples=8, program=program, states=[(0.0, q, v2)]).limit_effects
    assert max(effect.exceeded.values()) == pytest.approx(3.0 - 0.01 - 0.5, rel=0.5)
    assert all("acceleration" in name for name in effect.exceeded)


def test_unusable_requests_are_refused():
    reduced, program = arm(dt=0.01)
    state = (0.0, reduced.robot.configuration(), np.zeros(reduced.r))
    for options, words in (
        ({"states": [state]}, "program and states belong together"),
        ({"program": program}, "program and states belong together"),
        ({"program": program, "states": [(0.0, state[1], [0.0])]}, "state 0: q and v2 have shapes"),
        ({"program": program, "states": [state[1]]}, r"state 0: expected \(t, q, v2\)"),
        ({"program": arm()[1], "states": [state]}, "give the program a dt"),
        ({"program": object(), "states": [state]}, "reports no effects"),
    ):
        with pytest.raises(rnc.InputError, match=words):
            rnc.analyze(reduced, samples=4, **options)
