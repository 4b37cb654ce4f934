"""Joints that a robot's file couples: ``<mimic>`` in a URDF, ``<equality>`` in MJCF."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import rnc_pin as rnc
from rnc_pin.applications.scenario.builder import build_experiment
from rnc_pin.applications.scenario.schema.scenario import validate
from rnc_pin.robots.sources.description import Mimic
from urdf_parts import joint, link, read


def arm(tmp_path, a="", b="", c="", kind="revolute", **settings):
    """Three hinges in a row, a to c, each with what is given inside its element."""
    parts = ['<link name="base"/>', *(link(name, at="0.2 0 0", moment=0.1) for name in ("one", "two", "three"))]
    for *named, inside in (("a", "base", "one", a), ("b", "one", "two", b), ("c", "two", "three", c)):
        hinge = joint(*named, (0.4, 0, 0), "0 0 1", kind, limits=(-3, 3))
        parts.append(hinge.replace("</joint>", f"{inside}</joint>"))
    return read(tmp_path / "arm.urdf", *parts, **settings)


def mimic(of, multiplier=1, offset=0):
    return f'<mimic joint="{of}" multiplier="{multiplier}" offset="{offset}"/>'


def positions(system, **joints):
    return system.robot.joint_values(system.assembled(system.robot.configuration(joints), hold=list(joints)))


@pytest.mark.filterwarnings("error")
def test_a_mimic_joint_follows(tmp_path):
    robot = arm(tmp_path, b=mimic("a", -2, 0.1))
    system = rnc.NonholonomicSystem(robot, [], ["a", "b", "c"])  # an actuator on it is no mistake
    assert system.constraints.names == ("coupling(b, a)",)
    np.testing.assert_allclose(system.constraints.places[0].block.matrix, [[2, 1, 0]])
    assert positions(system, a=0.3)["b"] == pytest.approx(-0.5, abs=1e-9)
    coupling = rnc.NonholonomicSystem(robot, [rnc.JointCoupling("b", "a", -2, 0.1)], mimic=False)
    q, v2, T = robot.configuration({"a": 0.2, "c": 0.4}), [0.3, -0.2], [0.5, -0.1, 0.2]
    other = rnc.NonholonomicSystem(robot, [rnc.JointCoupling("b", "a", -2, 0.1)], ["a", "b", "c"], mimic=False)
    assert coupling.constraints.names == system.constraints.names
    outputs = [rnc.JointPosition("a"), rnc.JointPosition("c")]
    one, two = (each.reduce(outputs).forward_dynamics(q, v2, T) for each in (system, other))
    np.testing.assert_array_equal(one, two)


def test_one_that_is_given_takes_the_place_of_its_own_and_of_no_other(tmp_path):
    robot = arm(tmp_path, a=mimic("c", 2), b=mimic("c", -0.5))
    for given, names in (("a", ("coupling(a, c)", "coupling(b, c)")), ("b", ("coupling(b, c)", "coupling(a, c)"))):
        system = rnc.NonholonomicSystem(robot, [rnc.JointCoupling(given, "c", 3.0)])
        assert system.constraints.names == names
        assert positions(system, c=0.1)[given] == pytest.approx(0.3, abs=1e-9)
    turned = rnc.NonholonomicSystem(robot, [rnc.JointCoupling("c", "a", 0.25)])  # said the other way round
    assert turned.constraints.names == ("coupling(c, a)", "coupling(b, c)")


def test_chains_couple_all(tmp_path):
    system = rnc.NonholonomicSystem(arm(tmp_path, a=mimic("b", 2), b=mimic("c", -0.5, 0.1)))
    assert system.r == 1
    found = positions(system, c=0.4)
    assert (found["a"], found["b"]) == pytest.approx((-0.2, -0.1), abs=1e-9)


@pytest.mark.parametrize(("lock", "multiplier", "held"), [
    ({"a": 0.3}, -2, {"b": -0.5}),  # the driver
    ({"b": 0.5}, -2, {"a": -0.2}),  # the joint itself
    ({}, 0, {"b": 0.1}),
    ({"a": 0.3}, 0, {"b": 0.1}),
    ({"b": 0.5}, 0, {}),
    ({"a": 0.3, "b": -0.5}, -2, {}),
])  # fmt: skip
@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_what_is_locked_holds_the_other(tmp_path, lock, multiplier, held, kind):
    robot = arm(tmp_path, b=mimic("a", multiplier, 0.1), kind=kind, lock=lock)
    system = rnc.NonholonomicSystem(robot)
    assert system.m == len(held)
    for name, value in held.items():
        assert system.constraints.names == ("coupling(b, a)",)
        assert positions(system)[name] == pytest.approx(value, abs=1e-9)
        assert not system.reduce().at(robot.configuration()).R[robot.velocity_indices(name)].any()


@pytest.mark.parametrize("given", [
    rnc.JointCoupling("b", "a", -2.0, 0.1),
    rnc.JointCoupling("b", "a", 3.0),  # the user knows better
    rnc.JointCoupling("a", "b", -0.5, 0.05),
    rnc.Pfaffian(lambda q: np.array([[4.0, 2.0, 0.0]]), lambda q, v: np.zeros((1, 3)), ["gear"]),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*move independently")  # where the ratio is another one
def test_what_is_coupled_already_is_left_alone(tmp_path, given):
    robot = arm(tmp_path, b=mimic("a", -2, 0.1))
    system = rnc.NonholonomicSystem(robot, [given])
    assert system.rows.names == given.bind(robot).names


def test_a_conserved_momentum_and_a_coupling_of_its_joint_exclude_each_other(robot):
    robot.mimics = (Mimic("joint_1", "platform", 1.0, 0.0),)
    momentum = rnc.MomentumConservation("platform")
    with pytest.raises(rnc.ConstraintError, match=r"coupling\(joint_1, platform\) acts on momentum.*mimic=False"):
        rnc.NonholonomicSystem(robot, [momentum], ["joint_1"])
    with pytest.warns(rnc.ModelWarning, match="move independently"):
        rnc.NonholonomicSystem(robot, [momentum], ["joint_1"], mimic=False)


def test_no_motion_left_names_the_way_out(tmp_path):
    robot = arm(tmp_path, a=mimic("b"), b=mimic("c"), lock={"c": 0.0})
    with pytest.raises(rnc.ConstraintError, match=r"coupling\(a, b\), coupling\(b, c\).*mimic=False"):
        rnc.NonholonomicSystem(robot)


def test_a_start_that_violates_them_names_the_remedy(tmp_path):
    robot = arm(tmp_path, b=mimic("a", -2, 0.1))
    system = rnc.NonholonomicSystem(robot, [], ["a", "c"])
    reduced = system.reduce([rnc.JointPosition("a"), rnc.JointPosition("c")])
    hold = rnc.control.ReducingOutputController(reduced, rnc.planning.Hold(np.zeros(2)))
    controller = rnc.control.ComputedTorque(reduced, hold)
    with pytest.raises(rnc.InputError, match=r"violates coupling\(b, a\) by -0.1 .*system.assembled\(q0\)"):
        rnc.simulate(reduced, controller, robot.configuration(), 0.1, 0.01)
    run = rnc.simulate(reduced, controller, system.assembled(robot.configuration(), hold=["a"]), 0.1, 0.01)
    np.testing.assert_allclose(run.q[:, 1], -2 * run.q[:, 0] + 0.1, atol=1e-11)


def test_scenarios_couple_and_assemble(tmp_path):
    arm(tmp_path, b=mimic("a", -2, 0.1))
    raw = yaml.safe_load("""
        robot: {urdf: arm.urdf}
        actuators: [a, c]
        outputs: {reducing: [{joint: a}, {joint: c}]}
        initial: {q: {a: 0.3}}
        controller: {type: reducing_outputs}
        simulation: {duration: 0.1, dt: 0.01}
    """)
    experiment = build_experiment(validate(raw, "test"), tmp_path)
    np.testing.assert_allclose(experiment.q0, [0.3, -0.5, 0.0], atol=1e-9)
    loose = replace(experiment, scenario=validate({**raw, "mimic": False}, "test")).scenario
    with pytest.warns(rnc.ModelWarning, match="move independently"), pytest.raises(rnc.ConstraintError, match="expect"):
        build_experiment(loose, tmp_path)


@pytest.mark.parametrize(("of", "words"), [("aa", "did you mean 'a'"), ("b", "expected one of: a, c")])
def test_a_mimic_of_nobody_is_named_and_left_out(of, words, tmp_path):
    with pytest.warns(rnc.ModelWarning, match=f"mimic of an invalid joint is ignored: 'b' of '{of}'; {words}"):
        assert arm(tmp_path, b=mimic(of)).mimics == ()
