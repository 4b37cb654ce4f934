"""Plans against closed forms, and refusals."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.motion.optimal.guesses import resampled
from rnc_pin.motion.optimal.transcription import Iterate
from systems import goal_of


def test_straight_motion_with_least_acceleration_is_a_cubic():
    """Integral of squared acceleration over a distance d in time t, from rest to rest: 12 d^2 / t^3."""
    reduced = systems.sleigh()
    plan = rnc.optimal.plan(reduced, reduced.robot.configuration(), goal_of("sleigh", 1.0), 2.0)
    assert plan.info.outcome == "solved"
    # Constant inputs over 40 intervals cost 1 / (1 - 1/K^2) times as much.
    assert plan.info.cost == pytest.approx(0.5 * 12 / 8 / (1 - 1 / 40**2), rel=1e-6)
    reference = plan.reference("sleigh_speed_x")
    np.testing.assert_allclose(reference.at(1.0).position, 0.5, atol=1e-6)
    np.testing.assert_allclose(reference.at(1.0).velocity, 0.75, rtol=2e-3)


def test_a_motion_begins_with_its_initial_velocity():
    """Least squared acceleration from speed v to rest, over d in time t: (12 d^2 - 12 d v t + 4 v^2 t^2) / t^3."""
    reduced, goal = systems.sleigh(), goal_of("sleigh", 1.0)
    plan = rnc.optimal.plan(reduced, reduced.robot.configuration(), goal, 2.0, v2_0=[0.5, 0.0])
    assert plan.info.cost == pytest.approx(0.5 * (12 - 12 + 4) / 8, rel=2e-3)
    assert plan.info.verification.violation < 1e-6
    elsewhere = reduced.robot.configuration({"root_joint": [0.5, 0.0, 0.0]})
    again = rnc.optimal.plan(reduced, elsewhere, goal, 2.0, guess=plan, seeds=0)
    np.testing.assert_array_equal(again.q[0], elsewhere)
    assert again.info.cost == pytest.approx(0.5 * 12 * 0.25 / 8, rel=2e-3)


def test_sideways_motion_of_least_velocity_is_brocketts():
    """A knife edge moves aside by a small y at the cost 1/2 (4 pi y) / t: a circle of area y (Brockett 1981)."""
    reduced, y, t = systems.sleigh(), 1e-3, 1.0
    goal = goal_of("sleigh", 0.0, y, 0.0)
    settings = rnc.optimal.SolverSettings(nodes=60, tolerance=1e-8)
    # The start is a circle in (integral of v, integral of w), which encloses the area y.
    phase, radius = np.linspace(0, 2 * np.pi, 61), np.sqrt(y / np.pi)
    x, yaw = radius * np.sin(phase), radius * (1 - np.cos(phase))
    side = np.concatenate([[0], np.cumsum((yaw[1:] + yaw[:-1]) / 2 * np.diff(x))])
    path = np.column_stack([x, side, np.cos(yaw), np.sin(yaw)])
    options = {"form": "kinematic", "guess": path * [1, -np.sign(side[-1]), 1, 1], "settings": settings}
    plan = rnc.optimal.plan(reduced, path[0], goal, t, **options)
    assert plan.info.cost == pytest.approx(2 * np.pi * y / t, rel=1e-2)


ARMS = [("panda", [0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8], [1.2, 0.5, -0.4, -1.2, 0.6, 2.2, 0.2], 1.5)]
ARMS += [("ur5_robot", [-1.5, -2.0, 1.8, 0.0, 0.0, 0.0], [1.0, -0.6, 0.4, 0.0, 0.0, 0.0], 2.0)]


@pytest.mark.parametrize(("name", "start", "goal", "duration"), ARMS)
def test_arms_reach_configurations_by_their_efforts(name, start, goal, duration):
    """Efforts turn their light last links at hundreds of rad/s^2; no plan was found."""
    robot = rnc.Robot.from_example(name, lock=systems.FINGERS if name == "panda" else None)
    reduced = rnc.NonholonomicSystem(robot, [], robot.joint_names).reduce(map(rnc.JointPosition, robot.joint_names))
    plan = rnc.optimal.plan(reduced, start, goal, duration, form="dynamic", seeds=0)
    run = rnc.simulate(reduced, rnc.tvlqr(reduced, plan), start, duration, 0.005)
    assert (np.abs(run.q[-1] - goal).max() < 5e-3, run.verdict.succeeded) == (True, True)


def test_free_duration_ends_where_time_and_effort_balance():
    """Cost 6 d^2 / t^3 + c t is least at t^4 = 18 d^2 / c."""
    reduced = systems.sleigh()
    start, goal = reduced.robot.configuration(), goal_of("sleigh", 1.0)
    plan = rnc.optimal.plan(reduced, start, goal, (0.5, 10.0), time_weight=2.0)
    assert plan.duration == pytest.approx(9.0**0.25, rel=2e-3)


def test_a_plan_and_its_verdict_survive_a_file(tmp_path):
    reduced = systems.sleigh()
    plan = rnc.optimal.plan(reduced, reduced.robot.configuration(), goal_of("sleigh", 0.5), 2.0)
    plan.save(tmp_path / "plan.npz")
    again = rnc.optimal.MotionPlan.load(tmp_path / "plan.npz")
    assert again.info == plan.info
    np.testing.assert_array_equal(again.K, plan.K)
    hasty = rnc.optimal.SolverSettings(nodes=5, refinements=0, accuracy=1e-6)
    with pytest.raises(rnc.InfeasibleError) as refusal:
        rnc.optimal.plan(reduced, plan.q[0], goal_of("sleigh", 1.0, 0.5, 0.5), 2.0, seeds=0, settings=hasty)
    refusal.value.plan.save(tmp_path / "refused.npz")
    again = rnc.optimal.MotionPlan.load(tmp_path / "refused.npz")
    assert again.info == refusal.value.plan.info
    assert again.verdict.findings == refusal.value.plan.verdict.findings
    assert not again.verdict.succeeded
    assert {each.kind for each in again.verdict.failures} == {"goal"}
    assert {each.unit for each in again.verdict.failures} <= {"m", "rad", "m/s", "rad/s"}
    with pytest.raises(rnc.ConfigurationError, match="no file"):
        rnc.optimal.MotionPlan.load(tmp_path / "other.npz")
    np.savez(tmp_path / "wrong.npz", u=np.zeros(3))
    with pytest.raises(rnc.ConfigurationError, match="not a plan"):
        rnc.optimal.MotionPlan.load(tmp_path / "wrong.npz")


def test_refinement_reduces_the_violation_after_verification():
    """Half the step: a quarter of the error of the integrator."""
    reduced, goal = systems.sleigh(), goal_of("sleigh", 1.0, 0.5, 0.5)
    start, coarse = reduced.robot.configuration(), rnc.optimal.SolverSettings(nodes=10, refinements=0, accuracy=1.0)
    first = rnc.optimal.plan(reduced, start, goal, 2.0, settings=coarse).info.verification.inputs
    finer = rnc.optimal.SolverSettings(nodes=10, refinements=1, accuracy=1e-9)
    with pytest.raises(rnc.InfeasibleError, match=r"goal sleigh_y is missed by .* the accuracy is 1e-09") as refusal:
        rnc.optimal.plan(reduced, start, goal, 2.0, settings=finer, seeds=0)
    plan = refusal.value.plan
    assert len(plan.u) == 20
    assert first.violation / plan.info.verification.inputs.violation == pytest.approx(4.0, rel=0.25)


def test_user_defined_rows_bring_a_notice_that_their_derivatives_are_differences():
    robot = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")

    def blade(q):  # the knife edge moves along the sleigh with its place
        return np.array([[0.0, 1.0, 0.1 * np.sin(3 * q[0])]])

    def blade_rate(q, v):
        return np.array([[0.0, 0.0, 0.3 * np.cos(3 * q[0]) * (q[2] * v[0] - q[3] * v[1])]])

    rows = rnc.Pfaffian(blade, blade_rate)
    reduced = rnc.NonholonomicSystem(robot, [rows]).reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")])
    start = robot.configuration({"root_joint": [0.3, 0.0, 0.0]})
    with pytest.warns(rnc.ModelWarning, match="user-defined rows or outputs are finite differences"):
        rnc.optimal.plan(reduced, start, goal_of("sleigh", 1.3), 2.0, settings=rnc.optimal.SolverSettings(nodes=4))


def test_a_reference_of_the_reducing_outputs_is_driven():
    """An arc of half a turn: speed pi / 2 and turning rate pi over a second end two radii beside the start."""
    reduced = systems.sleigh()
    halfway = rnc.planning.MinimumJerk([0.0, 0.0], [np.pi / 2, np.pi], 1.0)
    q = rnc.optimal.driven_configurations(reduced, reduced.robot.configuration(), halfway)
    np.testing.assert_allclose(q[-1], [0.0, 1.0, -1.0, 0.0], atol=1e-3)


def test_a_plan_is_a_guess_over_other_intervals_with_the_same_motion():
    reduced, goal = systems.sleigh(), goal_of("sleigh", 1.0, 0.5, 0.5)
    coarse = rnc.optimal.SolverSettings(nodes=10)
    plan = rnc.optimal.plan(reduced, reduced.robot.configuration(), goal, 2.0, settings=coarse)
    at = Iterate(plan.q, plan.w, plan.u, plan.duration)
    model = rnc.optimal.action_model(reduced, "acceleration")
    twice, more = resampled(model, at, 20), resampled(model, at, 25)
    np.testing.assert_allclose(twice.u, np.repeat(plan.u, 2, axis=0), atol=1e-12)
    np.testing.assert_allclose(twice.q[::2], plan.q, atol=1e-12)
    np.testing.assert_allclose(np.diff(more.w, axis=0), more.u * 2.0 / 25, atol=1e-7)  # inputs are means
