"""A way is followed within an acceleration; a robot that leaves its tube stops, and says so."""

import coal
import numpy as np
import pytest

import rnc_pin as rnc
from driven_bases import KINDS, drafted_model, with_gripper
from rnc_pin.motion.optimal import WayFollower
from rnc_pin.motion.planning import find_way
from rnc_pin.motion.planning.action_models import KinematicFlow
from systems import at_pose, knife_box

DT = 0.02


def wall(y, width):
    """A wall along y with a gap."""
    ends = [-4.0, y - width / 2, y + width / 2, 4.0]
    return [
        rnc.collision.Obstacle(coal.Box(0.2, high - low, 1.0), position=(1.5, (low + high) / 2, 0.0), name=f"wall {k}")
        for k, (low, high) in enumerate(zip(ends[::2], ends[1::2], strict=True))
    ]


def driven(controller, duration, *, push=None, dt=DT):
    """Times, configurations and velocities of a robot that holds each velocity until the next sample."""
    reduced, q, state, rows = controller.reduced, controller.way.q[0], None, []
    flow, v2 = KinematicFlow(reduced), np.zeros(reduced.r)
    for k in range(round(duration / dt)):
        if push is not None and k == round(1.5 / dt):
            q = flow.manifold.integrate(q[None], push[None])[0]
        measured = reduced.at(q, v2).measure(np.zeros(reduced.r))
        state = controller.initial_state(measured) if state is None else state
        target, state = controller.step(k * dt, measured, state)
        v2 = target.v2
        rows.append((k * dt, q, v2, state))
        q = flow.step(q[None], dt * v2[None])[0]
    return rows


def test_along_a_straight_way_the_speed_is_a_trapezoid():
    reduced = knife_box()
    way = find_way(reduced, at_pose(reduced, 0.0, 0.0), at_pose(reduced, 3.0, 0.0))
    rows = driven(WayFollower(reduced, way, acceleration=0.5, speed=0.8), 6.0)
    speed = np.array([state.speed for *_, state in rows])
    assert speed.max() == pytest.approx(0.8)
    assert np.abs(np.diff(speed)).max() <= 0.5 * DT + 1e-9
    # 3 m at 0.8 m/s, and half of the time to accelerate and to stop.
    assert np.count_nonzero(speed) * DT == pytest.approx(3.0 / 0.8 + 0.8 / 0.5, abs=0.06)


def test_joints_that_steer_turn_quickly_while_the_car_stands():
    reduced = drafted_model(with_gripper(KINDS["car"]))
    q0, goal = reduced.robot.configuration(), {rnc.FramePosition("base", "xy"): [1.0, 0.5], rnc.FrameYaw("base"): 0.0}
    rows = driven(WayFollower(reduced, find_way(reduced, q0, goal)), 20.0)
    v = np.array([reduced.at(q).R @ v2 for _, q, v2, _ in rows])
    pivot, rates = reduced.robot.velocity_indices("turn_fl_joint").start, np.abs(np.diff(v, axis=0)) / DT
    assert rates[:, :2].max() <= 0.5 * 1.01
    assert 3.9 < rates[:, pivot].max() < 5.0  # the feedback is beside
    np.testing.assert_allclose(v[-1], 0.0, atol=1e-9)


def test_a_robot_that_is_pushed_off_its_way_stops_and_a_new_way_leads_on():
    reduced, goal, aside = knife_box(), at_pose(knife_box(), 3.0, 0.0), np.array([0.0, 0.15, 0.1, 0.0])
    obstacles = wall(0.0, 1.6)
    controller = WayFollower(reduced, find_way(reduced, at_pose(reduced, -1.0, 0.0), goal, obstacles))
    *_, (_, q, v2, _) = rows = driven(controller, 6.0, push=aside)
    assert not v2.any()
    speed = abs(rows[round(1.5 / DT) - 1][2][0])
    assert q[0] - rows[round(1.5 / DT)][1][0] == pytest.approx(speed**2 / (2 * 0.5), abs=0.03)
    assert "more than the tube of 0.05 off its way" in controller.missed_goals(6.0, q, v2)[0].reason
    controller = WayFollower(reduced, find_way(reduced, q, goal, obstacles))
    end = driven(controller, 14.0)[-1]
    assert not controller.missed_goals(*end[:3])
    # A small push is for the feedback.
    controller = WayFollower(reduced, find_way(reduced, at_pose(reduced, -1.0, 0.0), goal, obstacles))
    end = driven(controller, 9.0, push=0.2 * aside)[-1]
    assert not controller.missed_goals(*end[:3])


def test_a_robot_that_is_there_stays():
    reduced = knife_box()
    q = at_pose(reduced, 0.0, 0.0)
    controller = WayFollower(reduced, find_way(reduced, q, q))
    rows = driven(controller, 0.1)
    assert not any(v2.any() for _, _, v2, _ in rows)
    assert not controller.missed_goals(*rows[-1][:3])
