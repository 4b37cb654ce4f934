"""Braking motions that are verified before a sample: limits hold where the program alone would let them give way."""

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from bodies import add_body
from places import ROOT
from rnc_pin.collision import Obstacle
from rnc_pin.control import InverseDynamicsQP, limits, tasks
from rnc_pin.motion.planning import Hold, MinimumJerk
from rnc_pin.motion.whole_body import braking_motion
from rnc_pin.motion.whole_body.braking_motion import Braking
from rnc_pin.motion.whole_body.limits.control_limit import BoundLimit, ControlLimit, HeldMotion, LimitRows
from rnc_pin.simulation import replay_limits
from textbook_systems import high_cart

CLEARANCE = 0.05


def telescopic_arm():
    """A boom that cannot carry itself far extended, on a turret and a lift."""
    robot = rnc.Robot.from_urdf(ROOT / "tests" / "data" / "telescopic_arm.urdf")
    return rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce()


def reaching_run(reduced, seed, braking_time):
    """Run of a drawn reach among people who walk, and the distances and limits of its replay."""
    robot, draw = reduced.robot, np.random.default_rng(seed)
    starts = {"lift": (0.1, 0.6), "turn": (-1, 1), "telescope": (0.05, 0.15), "boom": (0, 0.5), "wrist": (-0.5, 0.5)}
    q0 = robot.configuration({name: draw.uniform(*ends) for name, ends in starts.items()})
    angle = draw.uniform(-2.3, 2.3)
    goal = [*(draw.uniform(0.7, 1.3) * np.array([np.cos(angle), np.sin(angle)])), draw.uniform(0.8, 1.5)]
    walks = [MinimumJerk([x, y, 0.9, 0], [-x, y, 0.9, 0], 5.0) for x, y in ((2.0, 1.6), (-2.5, -1.7))]
    people = [Obstacle(coal.Capsule(0.2, 1.4), motion=each, name=f"person {k}") for k, each in enumerate(walks)]
    position = rnc.FramePosition("hand").bind(robot)
    reference = MinimumJerk(position.value(reduced.at(q0).position), goal, 1.5)
    avoid = limits.CollisionAvoidance(clearance=CLEARANCE, influence=0.4, obstacles=people, q0=q0)
    hand = tasks.OutputTask(rnc.FramePosition("hand"), reference, gain=6.0)
    goals = [hand, tasks.PostureTask({"wrist": 0.0}, priority=1)]
    bounds = [limits.JointPositionLimit(), limits.JointVelocityLimit(), avoid]
    program = InverseDynamicsQP(reduced, goals, bounds, dt=0.025, braking_time=braking_time)
    run = rnc.simulate(reduced, program, q0, 1.6, dt=0.025)
    return run, replay_limits(robot, run, people, within=0.2)


def braking(run, where="program"):
    return next((each for each in reversed(run.info.findings) if each.where == where), None)


def test_a_weak_telescopic_arm_keeps_its_limits_among_people_who_walk():
    """Alone, the program extends the boom until its efforts cannot carry it: lift, boom and telescope then fall."""
    reduced = telescopic_arm()
    assert reaching_run(reduced, 1, None)[1].violations
    run, replay = reaching_run(reduced, 1, 2.0)
    used = braking(run)
    assert used is not None
    assert braking(run, "verification") is None
    assert max(use.excess for use in replay.uses) <= 1e-6
    mean = np.abs(np.diff(run.q, axis=0)) / np.diff(run.time)[:, None]  # inputs that are held let velocities bulge
    assert (mean <= reduced.robot.model.upperVelocityLimit).all()
    nearest = replay.nearest(obstacle=True)
    assert nearest is None or nearest.distance > CLEARANCE - 1e-4
    assert {each.kind for each in run.verdict.failures} <= {"goal"}  # people stand in its way
    assert used in run.verdict.findings
    assert f"{round(used.amount * len(run.time))} of {len(run.time)}" in str(used)


def cart(effort, mass=1.0, axis="PX", reach=1.0):
    """One joint of 1 kg on a level rail, with a range of 2 m and a limited force."""
    model = pin.Model()
    add_body(model, "rail", axis, mass, moments=0.1)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -reach, reach
    model.upperVelocityLimit[:], model.upperEffortLimit[:] = 10.0 * reach, effort
    return rnc.NonholonomicSystem(rnc.Robot(model), [], ["rail"]).reduce()


THERE = tasks.OutputTask(rnc.JointPosition("rail"), Hold([5.0]), gain=4.0)
LATE = limits.JointPositionLimit(deceleration=1e3, margin=0.0)


def test_braking_starts_at_the_stopping_distance():
    """A mass of 1 kg with 2 N stops from v in ``v^2 / 4``: a limit that plans with more leaves this to the last."""
    reduced, dt = cart(2.0), 0.02
    ends = []
    for braking_time in (None, 2.0):
        program = InverseDynamicsQP(reduced, [THERE], [LATE], dt=dt, braking_time=braking_time)
        run = rnc.simulate(reduced, program, reduced.robot.configuration({"rail": -1.0}), 2.5, dt=dt)
        ends.append(run.q[:, 0].max())
    assert ends[0] > 1.1
    assert 1.0 - 1e-3 < ends[1] <= 1.0 + 2e-6
    k = int(np.argmin(np.abs(run.time - braking(run).time)))
    q, v = run.q[:, 0], run.v[:, 0]
    # The motion is the fastest there is: full force to the middle at 2 m/s, then back to rest at the limit.
    np.testing.assert_allclose([q[k], v[k], v[k] ** 2 / 4.0], [0.0, 2.0, 1.0 - q[k]], atol=1e-9)


def test_a_start_that_cannot_stop_is_named_and_the_run_does_not_succeed():
    """At 2 m/s a mass of 1 kg needs 1 m to stop with 2 N, and has half of it."""
    reduced = cart(2.0)
    rest = tasks.OutputTask(rnc.JointPosition("rail"), Hold([0.5]), gain=4.0)
    program = InverseDynamicsQP(reduced, [rest], [limits.JointPositionLimit()], dt=0.02)
    run = rnc.simulate(reduced, program, reduced.robot.configuration({"rail": 0.5}), 1.0, dt=0.02, v2_0=[2.0])
    used = braking(run, "verification")
    assert (braking(run), used.time) == (None, 0.0)
    assert "rail position gives way" in used.message
    assert used.message.endswith(program.braking_problem(0.0, run.q[0], run.v2[0]))
    assert program.braking_problem(0.0, run.q[0], run.v2[0] / 2) is None
    assert not run.verdict.succeeded
    assert braking(run, "rail position").amount == pytest.approx(run.q.max() - 1.0, abs=1e-6)
    assert rnc.simulation.RunInfo.from_json(run.info.to_json()).findings == run.info.findings


def test_what_happens_within_a_step_counts():
    """A velocity that rises to 1 and falls again has the mean 2/3; a joint that turns back from 1 to -1 goes 1/4."""
    position = limits.JointPositionLimit().bind(cart(2.0))
    risen = HeldMotion(*np.array([[[0.0], [2 / 3]], [[0.0], [0.0]], [[0.0], [0.0]]]), mean=np.array([[2 / 3]]), h=1.0)
    assert risen.fastest([0]) == pytest.approx(1.0)
    turned = HeldMotion(*np.array([[[0.9], [0.9]], [[1.0], [-1.0]], [[1.0], [-1.0]]]), mean=np.zeros((1, 1)), h=1.0)
    assert position.along(turned) == pytest.approx(0.15)


@pytest.mark.parametrize("acceleration", [0.5, 1.0])
def test_limits_of_accelerations_lengthen_the_way_to_rest(acceleration):
    """It is ``v^2 / 2 a``, and 1 m is left; efforts alone would do with less."""
    reduced, bounds = cart(2.0), [limits.JointPositionLimit(), limits.AccelerationLimit(acceleration)]
    program = InverseDynamicsQP(reduced, [tasks.DampingTask()], bounds, dt=0.02, braking_time=3.0)
    fastest = np.sqrt(2.0 * acceleration)
    assert program.braking_problem(0.0, np.zeros(1), np.array([0.85 * fastest])) is None
    assert "gives way" in program.braking_problem(0.0, np.zeros(1), np.array([1.01 * fastest]))


@pytest.mark.parametrize(("axis", "effort", "speed", "rests"), [
    ("PZ", 9.0, 1.0, False), ("PZ", 10.0, 1.0, True), ("PX", 2.0, 3.5, True), ("PX", 2.0, 3.9, False),
])  # fmt: skip
def test_a_load_beyond_the_efforts_is_no_rest(axis, effort, speed, rests):
    """A lift that rises is at rest for an instant before it falls; level, a tenth of the time is in reserve."""
    reduced = cart(effort, axis=axis, reach=100.0)
    program = InverseDynamicsQP(reduced, [tasks.DampingTask()], [limits.JointPositionLimit()], dt=0.02)
    problem = program.braking_problem(0.0, np.zeros(1), np.array([speed]))
    assert problem == (None if rests else "the robot does not come to rest within 2 s")


def test_a_load_that_efforts_cannot_hold_is_said_and_rolled_out_once(monkeypatch):
    """Until the state changes: a lift that hangs on a stop is where it was."""
    reduced = cart(9.0, axis="PZ")
    program = InverseDynamicsQP(reduced, [tasks.DampingTask()], [limits.JointPositionLimit()], dt=0.02)
    start = reduced.at(np.zeros(1), np.zeros(1)).measure()
    tried, motion = [], Braking.motion
    monkeypatch.setattr(Braking, "motion", lambda self, *given: tried.append(given) or motion(self, *given))
    state = program.initial_state(start)
    for sample in range(5):
        _, state = program.step(0.02 * sample, start, state)
    assert state.braking.unverified[:2] == (5, 0.0)
    assert {given[1] for given in tried} <= {0.0, 0.02}
    for sample in range(5, 8):
        _, state = program.step(0.02 * sample, start, state)
    assert any(given[1] > 0.1 for given in tried)  # after some time once more


def test_a_joint_near_its_limit_stays_there_while_another_one_stops(monkeypatch):
    """The forearm pulls outwards by the square of the speed: under one torque it would leave its place by far."""
    model = pin.Model()
    elbow = add_body(model, "forearm", "RZ", 2.0, add_body(model, "arm", "RZ", 2.0), at=(1.0, 0.0, 0.0))
    model.inertias[elbow].lever = np.array([0.5, 0.0, 0.0])
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -2.0, 2.0
    model.upperVelocityLimit[:], model.upperEffortLimit[:] = 10.0, 20.0
    reduced = rnc.NonholonomicSystem(rnc.Robot(model), [], ["arm", "forearm"]).reduce()
    motions, motion = [], Braking.motion
    monkeypatch.setattr(Braking, "motion", lambda self, *given: motions.append(motion(self, *given)) or motions[-1])
    program = InverseDynamicsQP(reduced, [tasks.DampingTask()], [limits.JointPositionLimit()], dt=0.01)
    q, v = np.array([0.0, 1.5]), np.array([2.0, 0.0])
    assert program.braking_problem(0.0, q, v) is None
    plant, places = rnc.ReducedPlant(reduced), []
    plant.reset(q, v)
    for T in motions[0].inputs:
        plant.apply(T)
        plant.advance(0.01)
        places.append(plant.read()[0][1])
    assert np.abs(np.subtract(places, 1.5)).max() < 1e-3
    assert np.abs(plant.read()[1]).max() < 1e-4
    assert motions[0].work < 100  # in Runge-Kutta steps: two decisions


@dataclass(frozen=True)
class OwnSpeed(ControlLimit):
    """A user's limit of the forward speed by rows alone."""

    least: float

    def bind(self, reduced):
        return type("Bound", (BoundLimit,), {"names": ("own speed",), "rows": lambda _, sample: self.rows(sample)})()

    def rows(self, sample):
        return LimitRows(np.eye(1, 3), np.array([self.least]), np.array([3.0]))


def test_braking_keeps_the_ground_and_a_users_limit(monkeypatch):
    """More than 4.9 m/s^2 lift the rear of the cart: the law leaves a part of them unused."""
    reduced = high_cart()
    q, rest = reduced.robot.configuration(), [tasks.DampingTask()]
    programs = [InverseDynamicsQP(reduced, rest, [OwnSpeed(least)], dt=0.02) for least in (-1.0, 1.0)]
    assert programs[0].braking_problem(0.0, q, np.array([2.5])) is None
    assert "own speed gives way" in programs[0].braking_problem(0.0, q, np.array([3.5]))
    assert "does not come to rest" in programs[1].braking_problem(0.0, q, np.array([2.5]))
    monkeypatch.setattr(braking_motion, "_GROUND", -1.0)
    assert "rear normal force gives way" in programs[0].braking_problem(0.0, q, np.array([2.5]))


def test_a_plant_that_is_not_the_model_stops_too():
    """The motion is rolled out again from each measured state, and a lighter cart stops earlier than its model."""
    reduced, dt = cart(2.0), 0.02
    program = InverseDynamicsQP(reduced, [THERE], [LATE], dt=dt)
    lighter = rnc.ReducedPlant(cart(2.0, 0.95))
    run = rnc.simulate(reduced, program, np.array([-1.0]), 3.0, dt=dt, plant=lighter)
    assert 0.8 < run.q[:, 0].max() < 1.0 + 1e-3
    assert braking(run) is not None


@pytest.mark.parametrize("seed", [3, 29])
def test_a_robot_that_brakes_often_does_not_alternate(seed):
    """Braking motions from one sample to the next begin with different inputs; the way back does not follow them."""
    run, _ = reaching_run(telescopic_arm(), seed, 2.0)
    assert braking(run).amount > 0.3
    assert rnc.verdict.FindingKind.REVERSAL not in {each.kind for each in run.verdict.findings}
