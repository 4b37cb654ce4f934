"""Copies of loops that have learnt, of robots with meshes, of states and of errors say the same, to the bit.

``test_copies.py`` copies the objects of all public classes, and sends models to another process.
"""

import copy
import pickle

import numpy as np
import pytest

import rnc_pin as rnc
import systems
from rnc_pin.applications.scenario.scenario import Scenario

BARE = {"comparisons": {}, "plots": {}, "simulation.duration": 0.5}
EACH_KIND = [  # of rows and of controllers
    "space-robot", "space-robot-uncertain", "mobile-manipulator-two-phase", "fire-truck", "snakeboard", "tiago-shelf",
]  # fmt: skip


def again(thing):
    return pickle.loads(pickle.dumps(thing))


def states(reduced, count=4):
    generator = np.random.default_rng(0)
    for _ in range(count):
        q = reduced.random_configuration(generator)
        yield q, generator.normal(size=reduced.r), generator.normal(size=reduced.p)


@pytest.mark.parametrize("name", EACH_KIND)
def test_a_model_and_a_loop_go_on_elsewhere_to_the_bit(name):
    """A loop with its controller, its state, and what the controller has learnt."""
    made = Scenario.load(name, BARE).experiment
    reduced = made.reduced
    others = [again(reduced), copy.deepcopy(reduced)]
    compared = 0
    for q, v2, T in states(reduced, 3):
        try:
            expected = reduced.forward_dynamics(q, v2, T)
        except rnc.SingularityError:
            continue
        compared += 1
        block = np.stack([q, q])
        for other in others:
            assert np.array_equal(other.forward_dynamics(q, v2, T), expected)
            assert np.array_equal(other.at(q, v2).contact_forces(T), reduced.at(q, v2).contact_forces(T))
            assert np.array_equal(other.at(block, v2).R_dot, reduced.at(block, v2).R_dot)
            assert np.array_equal(other.terms(q, v2).V, reduced.terms(q, v2).V)
    assert compared
    assert str(others[0]) == str(reduced)
    loop = rnc.ControlLoop(made.reduced, made.controller, 0.005, fallback="raise", max_speed=np.inf)
    v = np.zeros(made.reduced.n)
    for sample in range(2):
        loop.step(0.005 * sample, made.q0, v)
    other = again(loop)
    for sample in range(2, 4):
        assert np.array_equal(other.step(0.005 * sample, made.q0, v), loop.step(0.005 * sample, made.q0, v))


MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


def shapes(robot):
    return [(each.name, type(each.geometry).__name__) for each in robot.visual_model.geometryObjects]


def test_robots_of_every_source_draw_themselves_elsewhere(tmp_path):
    """Meshes are read again where they are asked for: a pickle of theirs would take hundreds of megabytes."""
    (tmp_path / "m.obj").write_text(MESH)
    urdf = tmp_path / "r.urdf"
    urdf.write_text(
        '<robot name="r"><link name="a"/><link name="b"><visual><geometry><mesh filename="m.obj"/></geometry></visual>'
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    mjcf = tmp_path / "r.xml"
    mjcf.write_text(
        '<mujoco><worldbody><body name="b"><joint name="j"/><geom name="g" size="1" mass="1"/></body></worldbody>'
        "</mujoco>"
    )
    arm = rnc.Robot.from_urdf("mobile_manipulator.urdf")
    tool = rnc.Robot.from_urdf("space_robot.urdf")
    robots = {
        "urdf": rnc.Robot.from_urdf(urdf),
        "mjcf": rnc.Robot.from_mjcf(mjcf),
        "locked": rnc.Robot.from_urdf("mobile_manipulator.urdf", lock={"joint_1": 0.3}),
        "bare": rnc.Robot(arm.model, arm.visual_model),
        "no picture": rnc.Robot(arm.model),
        "mounted": rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar").attach(tool, "sleigh"),
    }
    for what, robot in robots.items():
        early = again(robot)  # before any mesh was read
        assert early.model == robot.model, what
        if what == "no picture":
            assert early.visual_model is None
            continue
        assert shapes(early) == shapes(robot), what
        assert shapes(again(robot)) == shapes(robot), what
        assert (early.mimics, early.locked, early.folders) == (robot.mimics, robot.locked, robot.folders)


def test_a_pickle_holds_no_meshes():
    robot = rnc.Robot.from_example("panda")
    before = len(pickle.dumps(robot))
    assert len(robot.visual_model.geometryObjects) > 5
    assert len(pickle.dumps(robot)) == before < 200_000


def test_functions_that_no_pickle_can_hold_are_named():
    robot = rnc.Robot.from_urdf("space_robot.urdf")
    row = np.array([[0.0, 1.0, 1.0, 1.0]])
    level = rnc.Pfaffian(lambda q: row, lambda q, v: 0 * row, names=["level"])
    system = rnc.NonholonomicSystem(robot, [level], ["joint_1", "joint_2", "joint_3"])
    with pytest.raises((pickle.PicklingError, AttributeError), match=r"test_functions.*<lambda>"):
        pickle.dumps(system.reduce())
    system = rnc.NonholonomicSystem(robot, [rnc.Pfaffian(held, held_rate)], ["joint_1", "joint_2", "joint_3"])
    reduced = system.reduce()
    for q, v2, T in states(reduced):
        assert np.array_equal(again(reduced).forward_dynamics(q, v2, T), reduced.forward_dynamics(q, v2, T))


def held(q):
    return np.array([[0.0, 1.0, 1.0, 1.0]])


def held_rate(q, v):
    return np.zeros((1, 4))


def test_a_state_that_was_looked_at_can_be_looked_at_elsewhere():
    reduced = systems.space_robot()
    (q, v2, T), *_ = states(reduced)
    for some in (reduced.at(q, v2), reduced.at(np.stack([q, q]), v2)):
        expected = some.v2_dot(T)
        other = again(some)
        assert np.array_equal(other.v2_dot(T), expected)
        assert np.array_equal(other.R_dot, some.R_dot)


def test_runs_and_errors_go_over():
    """A pool hands errors back as pickles: what they carry comes along."""
    robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, -9.81, 0))
    reduced = rnc.NonholonomicSystem(robot).reduce()
    fast = rnc.SimulationOptions(rnc.Stop(speed=2.0))
    with pytest.raises(rnc.DivergenceError) as caught:
        rnc.free_motion(reduced, robot.configuration(), np.zeros(4), duration=1.0, options=fast)
    other = again(caught.value)
    assert str(other) == str(caught.value)
    assert np.array_equal(other.trajectory.q, caught.value.trajectory.q)
    space = systems.space_robot()
    with pytest.raises(rnc.SingularityError) as caught:
        _ = space.at(space.robot.configuration()).R
    other = again(caught.value)
    assert (str(other), other.rows) == (str(caught.value), caught.value.rows)
