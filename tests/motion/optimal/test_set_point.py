"""Set points: goals, the homogeneous cost, and predictive control at them: arrival, escapes, warnings and verdicts."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from node_rows import check_rows
from rnc_pin.motion import optimal
from rnc_pin.motion.optimal import SetPointCost, action_model
from rnc_pin.motion.optimal.costs import NodeData
from rnc_pin.motion.optimal.guesses import along
from rnc_pin.motion.optimal.set_point import first_motion, quadratic_set_point
from rnc_pin.motion.planning.action_models import Nodes
from systems import goal_of
from textbook_systems import unicycle_with_trailers


def nodes_at(model, q, w=None, u=None):
    q = np.atleast_2d(q)
    w = np.zeros((len(q), model.nw)) if w is None else w
    return NodeData(model, Nodes(q, w), np.zeros((len(q), model.nu)) if u is None else u, np.zeros(len(q)))


def test_wheels_that_roll_may_stay_undetermined():
    point = optimal.SetPoint(systems.differential_drive(), goal_of("base", 0.5, -0.2, 0.7))
    assert (point.ignored, point.coordinates.weights) == (("left_wheel_joint", "right_wheel_joint"), (1, 1, 2))
    np.testing.assert_allclose(point.q[:4], [0.5, -0.2, np.cos(0.7), np.sin(0.7)], atol=1e-6)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_scaled_displacements_have_scaled_residuals(count):
    """Dilation: coordinates times a^w, residuals times a."""
    reduced = unicycle_with_trailers(count) if count else systems.sleigh()
    model = action_model(reduced, "kinematic")
    q = reduced.robot.configuration({f"hitch_{k + 1}": 0.2 for k in range(count)})
    cost = SetPointCost(q, precision=1e-4).bind(model)
    coordinates, generator = cost.point.coordinates, np.random.default_rng(0)
    weights = np.array(coordinates.weights)
    z = generator.uniform(0.3, 1.0, len(weights)) * np.where(generator.random(len(weights)) < 0.5, -1, 1)

    def configuration(target):
        now = q
        for _ in range(30):  # Newton's method, in the tangent space
            step = np.linalg.solve(coordinates.jacobian(now), target - coordinates.values(now))
            now = model.manifold.integrate(now[None], step[None])[0]
        return now

    sizes = []
    for a in (0.1, 0.05):
        there = configuration(a**weights * z)
        np.testing.assert_allclose(coordinates.values(there), a**weights * z, atol=1e-13)
        sizes.append(cost.rows(nodes_at(model, there), False).value[0])
    np.testing.assert_allclose(sizes[0], 2 * sizes[1], rtol=1e-6)


def test_the_unicycle_has_the_published_cost():
    """``(x^4 + yaw^4 + y^2)^(1/2)``: the square root of the cost of Rosenfelder, Ebel and Eberhard."""
    reduced = systems.sleigh()
    model = action_model(reduced, "kinematic")
    cost = SetPointCost(goal_of("sleigh", 1.0, 2.0, 0.5), precision=1e-6).bind(model)
    for x, y, yaw in ((0.3, -0.2, 0.4), (0.0, 0.04, 0.0), (0.0, 0.0, -0.3), (-2.0, 1.0, 1.5)):
        turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
        q = reduced.robot.configuration({"root_joint": [*(np.array([1.0, 2.0]) + turn @ [x, y]), 0.5 + yaw]})
        found = (cost.rows(nodes_at(model, q), False).value ** 2).sum()
        assert found == pytest.approx(np.sqrt(x**4 + yaw**4 + y**2), rel=1e-6)


def test_a_holonomic_robot_has_the_squared_distance():
    reduced = systems.mecanum()
    base = next(f.name for f in reduced.robot.model.frames if f.parentJoint == 1)
    model = action_model(reduced, "kinematic")
    cost = SetPointCost(goal_of(base, 0.2, 0.1, 0.3)).bind(model)
    q = reduced.robot.configuration({"root_joint": [0.9, -0.4, 1.0]})
    residual = cost.rows(nodes_at(model, q), False).value
    assert (residual**2).sum() == pytest.approx(0.7**2 + 0.5**2 + 0.7**2, rel=1e-9)


@pytest.mark.parametrize("form", ["kinematic", "acceleration"])
@pytest.mark.parametrize("spread", [0.02, 0.5, 2.0])
def test_derivatives(form, spread):
    """Near the goal, where the cost is smooth, and far from it, where the polynomials fade."""
    reduced = unicycle_with_trailers(2)
    model = action_model(reduced, form)
    center = reduced.robot.configuration({"hitch_1": 0.5, "hitch_2": -0.3})
    cost, generator = SetPointCost(center, precision=0.1).bind(model), np.random.default_rng(1)
    q = np.repeat(center[None], 4, axis=0)
    q = model.manifold.integrate(q, generator.uniform(-spread, spread, (4, model.nv)))
    at, u = Nodes(q, generator.normal(size=(4, model.nw))), np.zeros((4, model.nu))
    check_rows(model, cost, at, u, step=1e-6, rtol=1e-5)


def test_no_cost_and_no_slope_at_the_goal():
    reduced = unicycle_with_trailers(1)
    model = action_model(reduced, "acceleration")
    q = reduced.robot.configuration({"hitch_1": 0.4})
    found = SetPointCost(q).bind(model).rows(nodes_at(model, q), True)
    np.testing.assert_allclose(found.value, 0.0, atol=1e-15)
    assert np.isfinite(found.J).all()


def test_a_plan_without_a_hard_goal_arrives_by_the_cost_alone():
    """The quadratic cost prefers to stay aside; here the plan ends within the precision squared, a few mm."""
    reduced = systems.sleigh()
    start = reduced.robot.configuration({"root_joint": [0.0, 0.3, 0.0]})
    costs = [SetPointCost(goal_of("sleigh"), weight=100.0, phase="terminal"), optimal.EffortCost(0.01)]
    bound, settings = [optimal.VelocityBound(-1.0, 1.0)], optimal.SolverSettings(nodes=20)
    options = {"form": "kinematic", "costs": costs, "bounds": bound, "settings": settings}
    plan = rnc.optimal.plan(reduced, start, None, 4.0, **options, solutions=3)
    assert np.abs(plan.q[-1, :2]).max() < 5e-3


PLACE, YAW = rnc.FramePosition("sleigh", "xy"), rnc.FrameYaw("sleigh")
GOAL = {PLACE: [0.0, 0.0], YAW: 0.0}
COSTS = [SetPointCost(GOAL, weight=10.0, velocity_weight=0.1), optimal.EffortCost(0.01)]
AT_GOAL = optimal.OutputCost([PLACE, YAW], [0.0, 0.0, 0.0], weight=10.0, phase="both")
QUADRATIC = [AT_GOAL, optimal.EffortCost(0.01), optimal.VelocityCost(0.1, phase="both")]


def controller_of(reduced, costs=COSTS, **options):
    return optimal.PredictiveController(reduced, costs, 3.0, **{"bounds": [optimal.InputBound(-5.0, 5.0)], **options})


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
    assert (distance, run.verdict.word) == (pytest.approx(0.3), "failed")
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
        (sleigh, [optimal.OutputCost(PLACE, [0.0, 0.0], phase="both")]),
        (sleigh, [optimal.OutputCost([PLACE, YAW], np.zeros(3), phase="running")]),
        (sleigh, [optimal.OutputCost([PLACE, YAW], moving, phase="both")]),
        (mecanum, [optimal.OutputCost(at_base, np.zeros(3), phase="both")]),
    ):
        assert quadratic_set_point(action_model(reduced, "acceleration"), costs) is None
    posture = [optimal.PostureCost(sleigh.robot.configuration(), phase="terminal")]
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
    controller = controller_of(reduced, bounds=[optimal.InputBound([0.0, -1.0], [0.0, 1.0])], nodes=6)
    run, distance, _ = driven(reduced, controller, 0.3, 0.0, 1.0)
    assert (distance, run.verdict.word) == (pytest.approx(0.3, abs=1e-6), "failed")
    assert "no motion led to it" in run.verdict.first.message


def test_a_plan_is_followed_to_its_end_if_waiting_costs_less_over_one_horizon():
    """With this weight of effort, an update would turn the robot back, and it would stand 0.38 m away."""
    reduced = systems.sleigh()
    costs = [SetPointCost(goal_of("sleigh")), optimal.EffortCost()]
    controller = optimal.PredictiveController(reduced, costs, 3.0, form="acceleration", nodes=15)
    run, distance, _ = driven(reduced, controller, 0.3, 0.0, 7.0)
    assert distance < 0.005
    assert run.verdict.succeeded, run.verdict.first
    q = reduced.robot.configuration({"root_joint": [0.0, 0.3, 0.0]})
    measured = reduced.at(q, np.zeros(2)).measure(np.zeros(2))
    _, state = controller.step(0.0, measured, controller.initial_state(measured))
    assert state.next_update == pytest.approx(3.0 * len(state.u) / 15)


def test_a_long_way_is_begun_by_a_longer_plan():
    """4 m within 1 m/s do not fit into 3 s: the first intervals of a plan over twice the horizon serve."""
    reduced = systems.sleigh()
    model, point = action_model(reduced, "acceleration"), controller_of(reduced).set_point
    q = reduced.robot.configuration({"root_joint": [-4.0, 0.0, 0.0]})
    standing = along(model, np.repeat(q[None], 16, axis=0), 3.0)
    found = first_motion(model, point, standing, [rnc.optimal.VelocityBound(-1.0, 1.0)], seed=0)
    assert (found.q.shape, found.duration) == ((31, 4), 6.0)
    np.testing.assert_allclose(found.q[0], q, atol=1e-12)
    assert -3.5 < found.q[15, 0] < -1.0


@pytest.mark.filterwarnings("error")
def test_a_goal_at_the_end_of_the_horizon_holds():
    reduced = systems.sleigh()
    run, distance, turn = driven(reduced, controller_of(reduced, goal=GOAL), 0.3, 0.0)
    assert max(distance, turn) < 5e-3
    assert run.verdict.succeeded
