"""Residuals and bounded rows: derivatives against central differences, for every kind and form."""

import coal
import numpy as np
import pytest

import rnc_pin as rnc
import systems
from node_rows import check_rows
from rnc_pin.motion.optimal.bounds import GoalRows
from rnc_pin.motion.optimal.costs import NodeData
from rnc_pin.motion.planning.action_models import Nodes, action_model


def nodes_of(model, seed=0, count=3):
    generator = np.random.default_rng(seed)
    q = np.array([model.reduced.random_configuration(generator, 0.4) for _ in range(count)])
    return Nodes(q, 0.3 * generator.normal(size=(count, model.nw))), 0.3 * generator.normal(size=(count, model.nu))


@pytest.mark.parametrize("form", ["kinematic", "acceleration", "dynamic"])
def test_every_cost_and_bound_of_a_mobile_robot(form):
    reduced = systems.sleigh()
    model, o = action_model(reduced, form), rnc.optimal
    position, yaw = rnc.FramePosition("sleigh", "xy"), rnc.FrameYaw("sleigh")
    reference = rnc.planning.MinimumJerk([0.0, 0.0], [1.0, 2.0], 1.0)
    q = reduced.robot.configuration()
    kinds = [o.OutputCost([position, yaw], [0.3, 0.2, 0.1]), o.OutputCost(position, reference), o.PostureCost(q)]
    kinds += [o.EffortCost(2.0), o.VelocityCost(), *([] if form == "kinematic" else [o.AccelerationCost()])]
    kinds += [o.InputBound(-1.0, 1.0), o.VelocityBound(-1.0, {"sleigh_yaw": 1.0})]
    kinds += [o.OutputBound([position, "sleigh_yaw"], -1.0, 1.0)]
    goals = [GoalRows(model, goal, at_rest=True) for goal in ({position: [1.0, 0.0], yaw: 0.2}, q)]
    for block in (*(kind.bind(model) for kind in kinds), *goals):
        check_rows(model, block, *nodes_of(model))


def test_orientation_of_a_hand_and_distances_of_an_arm():
    reduced = systems.driven_panda()
    model = action_model(reduced, "kinematic")
    shelf = rnc.collision.Obstacle(coal.Sphere(0.2), position=(0.8, 0.0, 0.4), name="shelf")
    rules = rnc.collision.PairSelection(links=False)
    distances = rnc.collision.CollisionDistances(reduced.robot, [shelf], rules)
    goal = {rnc.FrameOrientation("panda_hand"): [2.6, 0.4, 0.3], rnc.FramePosition("panda_hand"): [0.4, 0.1, 0.5]}
    nodes = nodes_of(model)
    check_rows(model, GoalRows(model, goal, at_rest=True), *nodes)
    check_rows(model, rnc.optimal.OutputCost(rnc.FrameOrientation("panda_hand"), [2.6, 0.4, 0.3]).bind(model), *nodes)
    # coal's distances are correct to 1e-7 m, so that differences need longer steps.
    check_rows(model, rnc.optimal.DistanceBound(distances, 0.05, pairs=1).bind(model), *nodes, atol=2e-3, step=1e-3)


def test_weights_by_name_and_over_time():
    model = action_model(systems.sleigh(), "acceleration")
    cost = rnc.optimal.VelocityCost({"sleigh_yaw": 4.0}).bind(model)
    np.testing.assert_array_equal(cost.root_weights(np.zeros(2)), [[0.0, 2.0]] * 2)
    grown = rnc.optimal.VelocityCost(lambda t: [t, 4 * t]).bind(model)
    np.testing.assert_allclose(grown.root_weights(np.array([0.0, 4.0])), [[0, 0], [2, 4]])


def test_distances_to_an_obstacle_that_moves_are_those_at_the_times_of_the_nodes():
    robot = rnc.Robot.from_urdf("car.urdf", base="planar")
    rows = [rnc.NoSideSlip("front_axle"), rnc.NoSideSlip("rear_axle")]
    model = action_model(rnc.NonholonomicSystem(robot, rows).reduce(), "kinematic")
    away = rnc.planning.MinimumJerk([2.0, 0.0, 0.1, 0.0], [3.0, 0.0, 0.1, 0.0], 1.0)
    ball = rnc.collision.Obstacle(coal.Sphere(0.2), position=(2.0, 0.0, 0.1), name="ball", motion=away)
    distances = rnc.collision.CollisionDistances(robot, [ball], rnc.collision.PairSelection(links=False))
    bound = rnc.optimal.DistanceBound(distances, 2.0, pairs=1)
    at = Nodes(np.repeat(robot.configuration()[None], 3, axis=0), np.empty((3, 0)))
    nodes = NodeData(model, at, np.zeros((3, model.nu)), np.linspace(0.0, 1.0, 3))
    found = bound.bind(model).rows(nodes, False).value[:, 0]
    # The nearest shape of the car ends 1.34 m in front of its rear axle.
    np.testing.assert_allclose(found, 2.0 + np.array([0.0, 0.5, 1.0]) - 0.2 - 1.34, atol=1e-6)
