"""Set points: which goals determine one, and the homogeneous cost: dilations, derivatives, holonomic robots."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.optimal import EffortCost, SetPoint, SetPointCost, SolverSettings, VelocityBound, action_model
from rnc_pin.optimal.action_models import Nodes
from rnc_pin.optimal.node_data import NodeData
from textbook_systems import unicycle_with_trailers

STEP = 1e-6


def drive():
    robot = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    rows = [rnc.RollingWheel("left_wheel", 0.1), rnc.RollingWheel("right_wheel", 0.1)]
    return rnc.NonholonomicSystem(robot, rows, ["left_wheel_joint", "right_wheel_joint"]).reduce()


def pose(frame, x=0.0, y=0.0, yaw=0.0):
    return {rnc.FramePosition(frame, "xy"): [x, y], rnc.FrameYaw(frame): yaw}


def nodes_at(model, q, w=None, u=None):
    q = np.atleast_2d(q)
    w = np.zeros((len(q), model.nw)) if w is None else w
    return NodeData(model, Nodes(q, w), np.zeros((len(q), model.nu)) if u is None else u, np.zeros(len(q)))


# ---------------------------------------------------------------------- goals


def test_wheels_that_roll_may_stay_undetermined():
    point = SetPoint(drive(), pose("base", 0.5, -0.2, 0.7))
    assert point.ignored == ("left_wheel_joint", "right_wheel_joint")
    assert point.coordinates.weights == (1, 1, 2)
    np.testing.assert_allclose(point.q[:4], [0.5, -0.2, np.cos(0.7), np.sin(0.7)], atol=1e-6)


def test_goals_that_leave_more_open_are_refused_by_name():
    with pytest.raises(rnc.ConfigurationError, match="does not determine the position of root_joint"):
        SetPoint(systems.sleigh(), {rnc.FramePosition("sleigh", "xy"): [0.0, 0.0]})
    truck = systems.fire_truck()
    goal = pose("cab") if truck.robot.model.existFrame("cab") else pose(truck.robot.model.frames[2].name)
    with pytest.raises(rnc.ConfigurationError, match=r"does not determine .*front_steering"):
        SetPoint(truck, goal)


def test_configurations_with_neighbours_out_of_reach_are_refused():
    """The difference of the wheels' angles follows from the yaw: 4 of 5 dimensions."""
    reduced = drive()
    with pytest.raises(rnc.InfeasibleError, match="4 of 5 dimensions"):
        SetPoint(reduced, reduced.robot.configuration())


def test_goals_out_of_reach_are_refused():
    reduced = systems.mobile_manipulator()
    tip, axle = rnc.FramePosition("tip", "xy"), rnc.FramePosition("axle", "xy")
    with pytest.raises(rnc.InfeasibleError, match="no configuration reaches the goal"):
        SetPoint(reduced, {tip: [9.0, 0.0], axle: [0.0, 0.0], rnc.FrameYaw("axle"): 0.0})


# ---------------------------------------------------------------------- the cost


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
    cost = SetPointCost(pose("sleigh", 1.0, 2.0, 0.5), precision=1e-6).bind(model)
    for x, y, yaw in ((0.3, -0.2, 0.4), (0.0, 0.04, 0.0), (0.0, 0.0, -0.3), (-2.0, 1.0, 1.5)):
        turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
        q = reduced.robot.configuration({"root_joint": [*(np.array([1.0, 2.0]) + turn @ [x, y]), 0.5 + yaw]})
        found = (cost.rows(nodes_at(model, q), False).value ** 2).sum()
        assert found == pytest.approx(np.sqrt(x**4 + yaw**4 + y**2), rel=1e-6)


def test_a_holonomic_robot_has_the_squared_distance():
    reduced = systems.mecanum()
    base = next(f.name for f in reduced.robot.model.frames if f.parentJoint == 1)
    model = action_model(reduced, "kinematic")
    cost = SetPointCost(pose(base, 0.2, 0.1, 0.3)).bind(model)
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
    w = generator.normal(size=(4, model.nw))
    found = cost.rows(nodes_at(model, q, w), True)
    np.testing.assert_allclose(found.value, cost.rows(nodes_at(model, q, w), False).value, rtol=1e-12)
    for k, d in enumerate(np.eye(model.nx) * STEP):
        moved = (model.displaced(Nodes(q, w), np.tile(s * d, (4, 1))) for s in (1, -1))
        ahead, behind = (cost.rows(nodes_at(model, *each), False).value for each in moved)
        np.testing.assert_allclose(found.x[:, :, k], (ahead - behind) / (2 * STEP), rtol=1e-5, atol=1e-6)


def test_no_cost_and_no_slope_at_the_goal():
    reduced = unicycle_with_trailers(1)
    model = action_model(reduced, "acceleration")
    q = reduced.robot.configuration({"hitch_1": 0.4})
    found = SetPointCost(q).bind(model).rows(nodes_at(model, q), True)
    np.testing.assert_allclose(found.value, 0.0, atol=1e-15)
    assert np.isfinite(found.x).all()


def test_a_plan_without_a_hard_goal_arrives_by_the_cost_alone():
    """The quadratic cost prefers to stay aside; here the plan ends within the precision squared, a few mm."""
    reduced = systems.sleigh()
    start = reduced.robot.configuration({"root_joint": [0.0, 0.3, 0.0]})
    costs = [SetPointCost(pose("sleigh"), weight=100.0, phase="terminal"), EffortCost(0.01)]
    bound = [VelocityBound(-1.0, 1.0)]
    settings = SolverSettings(nodes=20)
    plan = rnc.optimal.plan(
        reduced, start, None, 4.0, form="kinematic", costs=costs, bounds=bound, settings=settings, solutions=3
    )
    assert np.abs(plan.q[-1, :2]).max() < 5e-3


def test_the_precision_is_positive():
    with pytest.raises(rnc.ConfigurationError, match="positive precision"):
        SetPointCost(np.zeros(4), precision=0.0)


def test_unknown_weights_are_refused():
    cost = SetPointCost(pose("sleigh"), weight={"sleigh_x": 1.0})
    with pytest.raises(rnc.ConfigurationError, match="no 'sleigh_x'"):
        cost.bind(action_model(systems.sleigh(), "kinematic"))
