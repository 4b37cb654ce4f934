"""Bounds of contact forces: derivatives beside differences, and plans beside closed forms."""

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.optimal.node_data import NodeData
from rnc_pin.optimal.planner import build_problem, initial_node
from rnc_pin.optimal.transcription import Iterate
from rnc_pin.optimal.verification import plan_findings, verify_inputs
from rnc_pin.planning.action_models import Nodes, action_model
from systems import WHEEL, random_states, rolling_base
from textbook_systems import G

FRICTION, CASTER = 0.7, rnc.Caster("nose", WHEEL)


def three_supports(base="planar", aside=0.0, third=CASTER, further=()):
    """Two driven wheels and a caster."""
    robot = rnc.Robot(rolling_base({"l": (0.0, 0.2), "r": (0.0, -0.2), "nose": (0.4, aside)}, WHEEL, base))
    rows = [rnc.RollingWheel("l", WHEEL), rnc.RollingWheel("r", WHEEL), third]
    system = rnc.NonholonomicSystem(robot, rows, ["l_spin", "r_spin", "nose_spin", *further])
    return system.reduce([rnc.FrameSpeed("base"), rnc.FrameYaw("base"), rnc.JointPosition("nose_spin")])


class OfAUser:
    """A caster whose point has no derivative in closed form."""

    def bind(self, robot):
        rows = CASTER.bind(robot)
        rows.point_gradient = lambda at: None
        return rows


SYSTEMS = {
    "rows of a user": lambda: three_supports(aside=0.1, third=OfAUser()),
    "three supports": three_supports,
    "three supports of a free base": lambda: three_supports("free"),
    "thrusters and reaction wheels": lambda: three_supports(
        further=[kind("base", axis) for kind in (rnc.FrameForce, rnc.FrameTorque) for axis in "xz"]
    ),
    "four wheels": systems.on_four_wheels,
    "mecanum": systems.mecanum,
    "sleigh": systems.sleigh,
    "bicycle": systems.bicycle,
    "car": systems.ackermann_car,
}


def moved(model, at, u, by):
    """Nodes displaced by tangent vectors."""
    states = model.displaced(at, by[:, : model.nx])
    return NodeData(model, states, u + by[:, model.nx :], np.zeros(len(u)), None)


@pytest.mark.parametrize("bound", [rnc.optimal.NormalForceBound(0.0), rnc.optimal.GripBound(FRICTION)])
@pytest.mark.parametrize("form", ["dynamic", "acceleration"])
@pytest.mark.parametrize("name", SYSTEMS)
def test_derivatives_of_contact_forces_are_those_of_differences(name, form, bound):
    reduced = SYSTEMS[name]()
    model = action_model(reduced, form)
    if form == "acceleration" and reduced.p != reduced.r:
        with pytest.raises(rnc.ConfigurationError, match="use form 'dynamic'"):
            bound.bind(model)
        return
    rows = bound.bind(model)
    states = list(random_states(reduced, 4))
    generator = np.random.default_rng(3)
    at = Nodes(np.array([q for q, _ in states]), np.array([v2 for _, v2 in states]))
    u = generator.normal(size=(4, model.nu))
    found = rows.rows(moved(model, at, u, np.zeros((4, model.nx + model.nu))), True)
    whole = np.concatenate([found.x, found.u], axis=2)
    step, width = 1e-5, model.nx + model.nu
    by = step * np.concatenate([np.eye(width), -np.eye(width)])  # all nodes, displaced along each direction, at once
    many = Nodes(*(np.repeat(each, 2 * width, axis=0) for each in (at.q, at.w)))
    values = rows.rows(moved(model, many, np.repeat(u, 2 * width, axis=0), np.tile(by, (4, 1))), False).value
    values = values.reshape(4, 2, width, -1)
    differences = np.moveaxis(values[:, 0] - values[:, 1], 1, 2) / (2 * step)
    scale = np.abs(whole).max() + np.abs(found.value).max()
    np.testing.assert_allclose(whole, differences, atol=2e-6 * scale)


def shortest(reduced, goal, bound, v2_0=None):
    """Plan of the shortest duration, towards which the weight of the effort falls."""
    plan = None
    for weight in (1e-3, 1e-5):
        plan = rnc.optimal.plan(
            reduced, reduced.robot.configuration(), goal, (0.05, 5.0), form="dynamic",
            costs=[rnc.optimal.EffortCost(weight)], bounds=[bound], time_weight=1.0, guess=plan, v2_0=v2_0,
            settings=rnc.optimal.SolverSettings(nodes=10),
        )  # fmt: skip
    assert plan.verdict.succeeded
    return plan


@pytest.mark.parametrize(("speed", "lever"), [(1.5, 0.3), (-1.5, 0.2)], ids=["forwards", "backwards"])
def test_a_tall_cart_stops_over_the_shortest_way_when_a_load_is_zero(speed, lever):
    """Its deceleration is g times the lever over the height: the caster or the wheels then carry everything."""
    reduced = systems.on_two_wheels(height=0.6, ahead=0.5, center=0.2)
    deceleration = G * lever / 0.6
    plan = shortest(reduced, {rnc.FrameYaw("base"): 0.0}, rnc.optimal.NormalForceBound(), [speed, 0.0])
    assert plan.time[-1] == pytest.approx(abs(speed) / deceleration, rel=0.01)
    assert abs(plan.q[-1][0]) == pytest.approx(speed**2 / (2 * deceleration), rel=0.01)
    state = reduced.at(plan.q[:-1], plan.w[:-1])
    loads = rnc.analysis.NormalForces(reduced).at(state, plan.u)
    assert loads.min() == pytest.approx(0.0, abs=0.1)


def test_a_cart_with_known_friction_starts_and_stops_at_mu_g():
    """Four driven wheels: each torque follows the load of its wheel, wherever the centre of mass is."""
    plan = shortest(systems.on_four_wheels(), {rnc.FramePosition("base", "x"): 1.0}, rnc.optimal.GripBound(0.4))
    assert plan.time[-1] == pytest.approx(2 * np.sqrt(1.0 / (0.4 * G)), rel=0.01)
    used = rnc.Grip(systems.on_four_wheels(), 0.4).used(plan.q[:-1], plan.w[:-1], plan.u)
    assert used.max() == pytest.approx(1.0, rel=0.01)


def test_a_cart_on_two_wheels_starts_as_traction_and_its_caster_allow():
    """The wheels carry m (g (l - c) + a h) / l: a start lifts the caster before it slips, a stop slips first."""
    height, ahead, center, friction, way = 0.6, 0.5, 0.2, 0.4, 1.0
    start = G * center / height
    stop = friction * G * (ahead - center) / (ahead + friction * height)
    assert start < friction * G * (ahead - center) / (ahead - friction * height)
    reduced = systems.on_two_wheels(height=height, ahead=ahead, center=center)
    plan = shortest(reduced, {rnc.FramePosition("base", "x"): way}, rnc.optimal.GripBound(friction))
    assert plan.time[-1] == pytest.approx(np.sqrt(2 * way * (start + stop) / (start * stop)), rel=0.01)


def test_the_verification_finds_a_lift_off_between_nodes():
    """A stop of 0.2 s lifts the wheels: they carry m (g (l - c) - a h) / l."""
    reduced = systems.on_two_wheels(height=0.6, ahead=0.5, center=0.2)
    goal, start = {rnc.FrameYaw("base"): 0.0}, (reduced.robot.configuration(), [1.5, 0.0])
    plan = rnc.optimal.plan(reduced, start[0], goal, 0.2, form="dynamic", v2_0=start[1])
    model, bounds = action_model(reduced, "dynamic"), [rnc.optimal.NormalForceBound()]
    problem = build_problem(model, initial_node(model, *start), None, 0.2, None, bounds, len(plan.u))
    verified, excesses = verify_inputs(problem, Iterate(plan.q, plan.w, plan.u, 0.2), 20, None, 5e-3)
    lowest = min((G * 0.3 + a * 0.6) / 0.5 / G / 2 for a in plan.u.sum(axis=1) / 0.1 / 10.0)
    assert lowest < 0
    assert {each.title for each in excesses} == {"normal force of l", "normal force of r"}
    for each in excesses:
        assert (each.amount, each.limit, each.unit) == (pytest.approx(-lowest, rel=1e-3), 0.0, "times the weight")
    findings = plan_findings(problem, Iterate(plan.q, plan.w, plan.u, 0.2), excesses, verified, 5e-3)
    assert {each.kind for each in findings} == {"lift_off"}


def test_a_predictive_controller_keeps_its_wheels_on_the_ground():
    reduced = systems.on_two_wheels(height=0.6, ahead=0.5, center=0.2)
    goal = {rnc.FramePosition("base", "xy"): [0.5, 0.0], rnc.FrameYaw("base"): 0.0}
    costs, bounds = [rnc.optimal.EffortCost(0.01)], [rnc.optimal.NormalForceBound(5.0)]
    controller = rnc.optimal.PredictiveController(reduced, costs, 0.8, goal=goal, bounds=bounds)
    run = rnc.simulate(reduced, controller, reduced.robot.configuration(), duration=0.4, dt=0.04)
    loads = rnc.analysis.NormalForces(reduced).at(reduced.at(run.q, run.v2), run.T)
    assert loads.min() > 4.9
    assert run.q[-1, 0] > 0.1
