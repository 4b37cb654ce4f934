"""Predictive control at set points: arrival from starts where quadratic costs stall, escapes, warnings and verdicts."""

import warnings

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.optimal import EffortCost, InputBound, OutputCost, PostureCost, PredictiveController, SetPointCost, stall
from rnc_pin.optimal.action_models import action_model
from rnc_pin.optimal.stall import first_motion, quadratic_set_point

PLACE, YAW = rnc.FramePosition("sleigh", "xy"), rnc.FrameYaw("sleigh")
GOAL = {PLACE: [0.0, 0.0], YAW: 0.0}
COSTS = [SetPointCost(GOAL, weight=10.0, velocity_weight=0.1), EffortCost(0.01)]
QUADRATIC = [
    OutputCost([PLACE, YAW], [0.0, 0.0, 0.0], weight=10.0, phase="both"),
    EffortCost(0.01),
    rnc.optimal.VelocityCost(0.1, phase="both"),
]


def controller_of(reduced, costs=COSTS, **options):
    return PredictiveController(reduced, costs, 3.0, **{"bounds": [InputBound(-5.0, 5.0)], **options})


def driven(reduced, controller, aside, yaw, duration=10.0):
    start = reduced.robot.configuration({"root_joint": [0.0, aside, yaw]})
    run = rnc.simulate(reduced, controller, start, duration, dt=0.05)
    q = run.q[-1]
    return run, np.hypot(q[0], q[1]), abs(np.arctan2(q[3], q[2]))


@pytest.mark.parametrize(("aside", "yaw"), [(0.3, 0.0), (1.0, 0.5), (0.01, 0.0)])
def test_arrives_where_quadratic_costs_stall(aside, yaw):
    reduced = systems.sleigh()
    run, distance, turn = driven(reduced, controller_of(reduced), aside, yaw)
    assert distance < 2e-3
    assert turn < 2e-3
    assert np.abs(run.v2[-1]).max() < 1e-3
    assert run.verdict.succeeded
    assert np.abs(run.T).max() <= 5.0 * (1 + 1e-2)


def test_quadratic_costs_warn_and_their_stall_is_in_the_verdict():
    """The first row of the table: the sleigh does not move, and the run was once "succeeded"."""
    reduced = systems.sleigh()
    with pytest.warns(rnc.ModelWarning, match=r"weights 1, 1, 2: quadratic costs stall"):
        controller = controller_of(reduced, QUADRATIC)
    run, distance, _ = driven(reduced, controller, 0.3, 0.0, 2.0)
    assert distance == pytest.approx(0.3)
    assert run.verdict.word == "failed"
    found = run.verdict.first
    assert (found.kind, found.where) == ("goal", "sleigh_y")
    assert found.amount == pytest.approx(0.3)
    assert "SetPointCost" in found.message


def test_costs_that_determine_no_set_point_do_not_warn():
    """A place without a heading, costs on the way only, a reference, and a holonomic robot."""
    sleigh, mecanum = systems.sleigh(), systems.mecanum()
    base = next(f.name for f in mecanum.robot.model.frames if f.parentJoint == 1)
    at_base = [rnc.FramePosition(base, "xy"), rnc.FrameYaw(base)]
    moving = rnc.planning.MinimumJerk(np.zeros(3), np.ones(3), 1.0)
    for reduced, costs in (
        (sleigh, [OutputCost(PLACE, [0.0, 0.0], phase="both")]),
        (sleigh, [OutputCost([PLACE, YAW], np.zeros(3), phase="running")]),
        (sleigh, [OutputCost([PLACE, YAW], moving, phase="both")]),
        (mecanum, [OutputCost(at_base, np.zeros(3), phase="both")]),
    ):
        assert quadratic_set_point(action_model(reduced, "acceleration"), costs) is None
    posture = [PostureCost(sleigh.robot.configuration(), phase="terminal")]
    assert quadratic_set_point(action_model(sleigh, "acceleration"), posture) is not None


def test_the_first_motion_is_the_beginning_of_a_plan_and_counts_as_an_escape():
    reduced = systems.sleigh()
    controller = controller_of(reduced)
    q = reduced.robot.configuration({"root_joint": [0.0, 0.3, 0.0]})
    measured = reduced.at(q, np.zeros(2)).measure(np.zeros(2))
    _, state = controller.step(0.0, measured, controller.initial_state(measured))
    assert (state.escapes, state.searches, state.next_search) == (1, 1, 3.0)
    assert controller.set_point.distance(state.q[-1]) < 0.9 * controller.set_point.distance(q)
    _, later = controller.step(0.05, measured, state)
    assert later.searches == 1


def test_searches_in_vain_are_rare_and_the_stall_stays_in_the_verdict():
    """Bounds that allow no push forward: nothing leads to the goal."""
    reduced = systems.sleigh()
    controller = controller_of(reduced, bounds=[InputBound([0.0, -1.0], [0.0, 1.0])], nodes=6)
    run, distance, _ = driven(reduced, controller, 0.3, 0.0, 1.0)
    assert distance == pytest.approx(0.3, abs=1e-6)
    assert run.verdict.word == "failed"
    assert "no motion led to it" in run.verdict.first.message


def test_a_long_way_is_begun_by_a_part_of_a_longer_plan():
    """4 m within 1 m/s do not fit into 3 s: the first intervals of a plan over twice the horizon serve."""
    reduced = systems.sleigh()
    model = action_model(reduced, "acceleration")
    point = controller_of(reduced).set_point
    q = reduced.robot.configuration({"root_joint": [-4.0, 0.0, 0.0]})
    found = first_motion(model, point, q, 3.0, 15, [rnc.optimal.VelocityBound(-1.0, 1.0)], seed=0)
    assert found.q.shape == (16, 4)
    assert found.duration == 3.0
    np.testing.assert_allclose(found.q[0], q, atol=1e-12)
    assert -3.5 < found.q[-1, 0] < -1.0


@pytest.fixture
def searches(monkeypatch):
    """Numbers of intervals and of guesses of the searches for a first motion."""
    found, search = [], stall.plan_motion

    def recorded(*given, **options):
        found.append((options["settings"].nodes, 1 + options["seeds"]))
        return search(*given, **options)

    monkeypatch.setattr(stall, "plan_motion", recorded)
    return found


def test_a_motion_whose_coarse_steps_miss_the_goal_is_a_first_motion_without_longer_searches(searches):
    """In a replay with its gains, it misses the goal by 9 cm, beside 1 m: more than the accuracy."""
    reduced = systems.sleigh()
    point = controller_of(reduced).set_point
    q = reduced.robot.configuration({"root_joint": [0.0, 1.0, 0.5]})
    found = first_motion(action_model(reduced, "acceleration"), point, q, 3.0, 5, [], seed=0)
    assert [nodes for nodes, _ in searches] == [5]
    assert found is not None
    assert point.distance(found.q[-1]) < 1e-3


def test_searches_over_longer_horizons_take_about_as_long_as_the_first(searches):
    reduced = systems.sleigh()
    q = reduced.robot.configuration({"root_joint": [-40.0, 0.0, 0.0]})
    slow = [rnc.optimal.VelocityBound(-1.0, 1.0)]
    model = action_model(reduced, "acceleration")
    assert first_motion(model, controller_of(reduced).set_point, q, 3.0, 5, slow, seed=0) is None
    assert [nodes for nodes, _ in searches] == [5, 10, 20]
    effort = [nodes * guesses for nodes, guesses in searches]
    assert max(effort) <= 2 * effort[0]


def test_a_goal_at_the_end_of_the_horizon_holds():
    reduced = systems.sleigh()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        controller = controller_of(reduced, goal=GOAL)
    run, distance, turn = driven(reduced, controller, 0.3, 0.0)
    assert max(distance, turn) < 5e-3
    assert run.verdict.succeeded


def test_a_first_motion_of_a_car_without_bounds_keeps_the_steering_limit_of_its_file():
    """Guesses that steer by 90 degrees are singular, and led to no motion."""
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    rows = [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")]
    drives = [rnc.FrameForce("rear_axle", "x"), "front_steering"]
    reduced = rnc.NonholonomicSystem(robot, rows, drives).reduce(
        [rnc.FrameSpeed("rear_axle"), rnc.JointPosition("front_steering")]
    )
    model = action_model(reduced, "acceleration")
    point = rnc.optimal.SetPoint(reduced, robot.configuration())
    q = robot.configuration({"root_joint": [0.0, 0.3, 0.0]})
    found = first_motion(model, point, q, 4.0, 12, [InputBound(-2.0, 2.0)], seed=0)
    assert found is not None
    assert np.abs(found.w).max() > 0.1
    assert np.abs(found.q[:, 4]).max() <= 1.0 + 1e-3
