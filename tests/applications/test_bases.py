"""Ten kinds of bases, each with an arm and a mimic gripper: what ``docs/own_robot.md`` lists, judged by verdicts."""

from functools import cache

import coal
import numpy as np
import pytest

import rnc_pin as rnc
from driven_bases import KINDS, drafted_file, with_gripper
from drives import prepared
from rnc_pin.applications.drive.run import drive
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.control import ActuatorVelocityController, TwistController, WheelOdometry, tasks
from rnc_pin.simulation import distance_findings, replay_limits

BASES = {name: with_gripper(base) for name, base in KINDS.items() if "side" not in name and name[:10] != "four-wheel"}
SLIDING = ("two steered drives", "four steered drives", "two carts", "Mecanum", "turret")
DT, TWIST = 0.02, [0.4, None, 0.3]
DOOR = [rnc.collision.Obstacle(coal.Box(0.1, 2.0, 2.0), position=(2.0, y, 0.0), name=f"wall {y}") for y in (1.5, -1.5)]


@pytest.fixture(scope="module")
def draft(tmp_path_factory):
    return cache(lambda name: Scenario.load(drafted_file(BASES[name], tmp_path_factory.mktemp("base"))))


def driven(scenario, samples, forward, left, turn):
    """Run with keys held."""
    key = {"kind": "base_velocity", "forward": forward, "left": left, "turn": turn}
    keys = [(k, key) for k in range(0, samples, 20)]
    run = drive(prepared(str(scenario.folder / "unit.yaml"), keys, simulation__dt=DT), samples=samples).trajectory
    assert np.linalg.norm(run.v[-1, :3] * np.sign([forward, left, turn])) > 0.4
    return run


def with_servos(scenario, target, duration):
    reduced, servos = scenario.reduced, rnc.plants.VelocityPlant(scenario.reduced, servo_time=0.01)
    motors, q0 = ActuatorVelocityController(reduced, target), scenario.experiment.q0
    return rnc.simulate(reduced, motors, q0, duration, DT, plant=servos)


def pose_of(q):
    return np.array([*q[:2], np.arctan2(q[3], q[2])])


def posed(scenario, *goal):
    """Run to a pose by a whole-body program that decides inputs."""
    task = tasks.BasePoseTask("base", rnc.planning.Hold(goal), gain=1.0)
    program = rnc.control.InverseDynamicsQP(scenario.reduced, [task], dt=DT)
    run = rnc.simulate(scenario.reduced, program, scenario.experiment.q0, 6.0, DT)
    np.testing.assert_allclose(pose_of(run.q[-1]), goal, atol=0.02)
    return run


class Commanded(TwistController):
    """Kinematic controller with a constant command."""

    def initial_state(self, measurement):
        return super().initial_state()

    def step(self, t, measurement, state):
        command, state = super().step(measurement.q, TWIST, state)
        at = self._reduced.at(measurement.q)
        return rnc.control.VelocityTarget(v2=at.J2 @ command.v, v2_dot=np.zeros(at.R.shape[1])), state


def twisted(scenario):
    """Run with ``TwistController``; odometry follows it."""
    reduced, pose = scenario.reduced, np.zeros(3)
    odometry, most = WheelOdometry(reduced, "base"), (0.5, 0.5, 1.0)
    run = with_servos(scenario, Commanded(reduced, "base", DT, max_acceleration=most), 3.0)
    assert run.v[-1, [0, 2]] == pytest.approx(TWIST[::2], abs=1e-3)
    for before, after in zip(run.q[:-1], run.q[1:], strict=True):
        pose = odometry.step(pose, before, after).pose
    np.testing.assert_allclose(pose, pose_of(run.q[-1]), atol=1e-3)
    return run


def planned(scenario, *goal, obstacles=(), along=False):
    """Plan to a pose, beside obstacles, or along a way."""
    near = rnc.collision.CollisionDistances(scenario.reduced.robot, obstacles, rnc.collision.PairSelection(links=False))
    bounds = [rnc.optimal.DistanceBound(near, 0.01)] if obstacles else []
    pose = {rnc.FramePosition("base", "xy"): goal[:2], rnc.FrameYaw("base"): goal[2]}
    given = {"guess": rnc.planning.find_way(scenario.reduced, scenario.experiment.q0, pose)} if along else {}
    return rnc.optimal.plan(scenario.reduced, scenario.experiment.q0, pose, 10.0, bounds=bounds, seeds=2, **given)


def through_a_door(scenario):
    """Run along a way through a door of 1 m."""
    reduced, goal = scenario.reduced, {rnc.FramePosition("base", "xy"): [4.0, 0.3], rnc.FrameYaw("base"): 0.0}
    way = rnc.planning.find_way(reduced, scenario.experiment.q0, goal, DOOR)
    run = with_servos(scenario, rnc.optimal.WayFollower(reduced, way), 2.0 * way.duration + 8.0)
    assert not distance_findings(replay_limits(reduced.robot, run, DOOR))
    return run


USES = {
    "drive": lambda scenario: driven(scenario, 150, 1.0, 0.0, 1.0),
    "drive sideways": lambda scenario: driven(scenario, 250, 0.0, 1.0, 0.0),
    "pose ahead": lambda scenario: posed(scenario, 1.0, 0.0, 0.0),
    "pose aside": lambda scenario: posed(scenario, 0.5, 0.4, 0.5),
    "plan": lambda scenario: planned(scenario, 1.5, 0.4, 0.5),
    "plan through a door": lambda scenario: planned(scenario, 4.0, 0.3, 0.0, obstacles=DOOR),
    "plan along a way": lambda scenario: planned(scenario, 1.5, 0.4, 0.5, along=True),
    "way": through_a_door,
    "twist": twisted,
}
ONLY = {"drive sideways": SLIDING, "pose aside": SLIDING, "plan through a door": ["car with trailer"]}
ONLY |= {"plan": {*BASES} - {"two carts"}, "plan along a way": ["two carts"]}
ONLY |= {"way": {*BASES} - {"car with trailer"}}  # ``docs/own_robot.md`` says why


def sideways(base, robot, q, v):
    """Largest speed of a wheel along its axle; a wheel at (x, y) moves along (vx - w y, vy + w x)."""
    angles, (vx, vy, w) = robot.joint_values(q), v[:3]
    headings = [(each, angles.get(each.pivot, 0.0)) for each in base.wheels.values() if not base.rollers]
    return max((abs(np.cos(a) * (vy + w * e.x) - np.sin(a) * (vx - w * e.y)) for e, a in headings), default=0.0)


@pytest.mark.parametrize(
    ("name", "use"), [(each, use) for each in BASES for use in USES if each in ONLY.get(use, BASES)]
)
def test_a_base_is_used_with_success_and_no_wheel_slides(name, use, draft, brief):
    found = USES[use](draft(name))
    assert found.verdict.word == "succeeded", found.verdict
    if "plan" not in use:
        robot = draft(name).reduced.robot
        assert max(sideways(BASES[name], robot, *each) for each in zip(found.q, found.v, strict=True)) < 0.01
