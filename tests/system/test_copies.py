"""Examples of public names make things that can be copied and sent to another process, and say there the same."""

import copy
import doctest
import importlib
import inspect
import pickle
import subprocess
import sys
import tempfile
from dataclasses import is_dataclass
from types import ModuleType

import cloudpickle
import numpy as np
import pytest

import rnc_pin as rnc
from places import docs_script
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization import LoopView
from rnc_pin.visualization.drawn_state import DrawnModel
from systems import space_robot
from urdf_parts import TETRAHEDRON, joint, link, write

MODULES = [rnc, *(importlib.import_module(f"rnc_pin.{package}") for package in docs_script("make_reference").PACKAGES)]
NAMED = {
    id(thing): (f"{module.__name__}.{name}", thing)
    for module in reversed(MODULES)  # the shortest name is the last one
    for name in module.__all__
    if callable(thing := getattr(module, name))
}
NAMED = dict(NAMED.values())
"""Public functions and classes by name."""
MOST_STATEMENTS = 10


def statements(name):
    return doctest.DocTestParser().get_examples(inspect.getdoc(NAMED[name]) or "")


def called_by_users(thing):
    """True for a class whose docstring lists arguments. Results list attributes only."""
    if not isinstance(thing, type) or inspect.isabstract(thing) or getattr(thing, "_is_protocol", False):
        return False
    return "Args:" in (inspect.getdoc(thing) or "")


def run_example(name):
    """Run the example of a public name, which has to print what it says. Return the objects that it made."""
    namespace = {"np": np, "rnc": rnc, "__name__": "rnc_pin_example"}
    said = []
    test = doctest.DocTest(statements(name), {}, name, None, None, None)
    test.globs = namespace
    with np.printoptions(precision=8, suppress=False, linewidth=75):
        doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test, out=said.append, clear_globs=False)
    assert not said, "".join(said)
    others = ModuleType | tempfile.TemporaryDirectory | LoopView  # these have one owner
    return [each for key, each in namespace.items() if not key.startswith("__") and not isinstance(each, others)]


def again(thing):
    return copy.deepcopy(pickle.loads(cloudpickle.dumps(thing)))


def figures(reduced):
    """Bytes of the accelerations of a reduced model at two random states."""
    generator, said = np.random.default_rng(0), []
    for _ in range(2):
        q = reduced.random_configuration(generator)
        v2, T = generator.normal(size=reduced.r), generator.normal(size=reduced.p)
        try:
            said.append(reduced.forward_dynamics(q, v2, T).tobytes())
        except rnc.RncError as error:  # e.g. singular, or a row that needs the time
            said.append(str(error))
    return said


@pytest.mark.parametrize(
    "name",
    [name for name, thing in NAMED.items() if name.count(".") == 1 or called_by_users(thing) or statements(name)],
)
def test_the_example_runs_and_its_objects_can_be_copied(name):
    assert 0 < len(statements(name)) <= MOST_STATEMENTS, f"{name} needs an example of at most {MOST_STATEMENTS} lines"
    for thing in run_example(name):
        other = again(thing)
        assert isinstance(thing, type) or type(other) is type(thing)
        if isinstance(thing, rnc.ReducedModel):
            shown = DrawnModel.of(thing).with_own_model()  # --show and drive do this
            assert figures(other) == figures(shown.reduced) == figures(thing)


def test_descriptions_cannot_be_changed():
    rooms = ("analysis", "constraints", "control", "model", "outputs", "motion.planning")
    rooms = tuple(f"rnc_pin.{name}" for name in rooms)
    described = [kind for kind in NAMED.values() if isinstance(kind, type) and is_dataclass(kind)]
    described = [kind for kind in described if kind.__module__.startswith(rooms)]
    assert len(described) > 40
    assert [kind.__name__ for kind in described if not kind.__dataclass_params__.frozen] == []


def test_another_process_says_the_same():
    """A fresh process, which inherits nothing: a hand with mimic joints, which once held a joint model of Pinocchio."""
    robot = rnc.Robot.from_example("panda")
    hand = rnc.NonholonomicSystem(robot, [], list(robot.joint_names)).reduce()
    q, v2 = robot.configuration(), np.full(hand.r, 0.1)
    code = "import pickle, sys; m, q, v2 = pickle.load(sys.stdin.buffer); print(m.terms(q, v2).V.tobytes().hex())"
    sent = pickle.dumps((hand, q, v2))
    assert len(robot.visual_model.geometryObjects) > 5
    assert len(pickle.dumps((hand, q, v2))) == len(sent) < 400_000  # without meshes
    done = subprocess.run([sys.executable, "-c", code], input=sent, capture_output=True, check=True)
    assert done.stdout.decode().strip() == hand.terms(q, v2).V.tobytes().hex()


@pytest.mark.parametrize("name", ["space-robot-uncertain", "fire-truck"])
def test_a_loop_goes_on_elsewhere_to_the_bit(name):
    made = Scenario.load(name, {"comparisons": {}, "plots": {}}).experiment
    loop = rnc.ControlLoop(made.reduced, made.controller, 0.005, fallback="raise", max_speed=np.inf)
    v = np.zeros(made.reduced.n)
    for sample in range(2):
        loop.step(0.005 * sample, made.q0, v)
    other = pickle.loads(pickle.dumps(loop))
    for sample in range(2, 4):
        assert np.array_equal(other.step(0.005 * sample, made.q0, v), loop.step(0.005 * sample, made.q0, v))


def shapes(robot):
    objects = robot.visual_model and robot.visual_model.geometryObjects
    return objects and [(one.name, type(one.geometry).__name__) for one in objects]


def test_robots_of_every_source_draw_themselves_elsewhere(tmp_path):
    write(tmp_path / "m.obj", TETRAHEDRON)
    mesh, hinge = '<mesh filename="m.obj"/>', joint("j", "a", "b", (0, 0, 0))
    drawn = link("b", shape=mesh, geometry="visual")
    write(tmp_path / "r.urdf", f'<robot name="r"><link name="a"/>{drawn}{hinge}</robot>')
    body = '<body name="b"><joint name="j"/><geom name="g" size="1" mass="1"/></body>'
    write(tmp_path / "r.xml", f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    arm, tool = rnc.Robot.from_urdf("mobile_manipulator.urdf"), rnc.Robot.from_urdf("space_robot.urdf")
    for robot in (
        rnc.Robot.from_urdf(tmp_path / "r.urdf"),
        rnc.Robot.from_mjcf(tmp_path / "r.xml"),
        rnc.Robot.from_urdf("mobile_manipulator.urdf", lock={"joint_1": 0.3}),
        rnc.Robot(arm.model, arm.visual_model),
        rnc.Robot(arm.model),
        rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar").attach(tool, "sleigh"),
    ):
        early = again(robot)  # before any mesh was read
        assert early.model == robot.model
        assert shapes(early) == shapes(robot) == shapes(again(robot))
        assert (early.mimics, early.locked, early.folders) == (robot.mimics, robot.locked, robot.folders)


def test_runs_and_errors_go_over():
    robot = rnc.Robot.from_urdf("space_robot.urdf", gravity=(0, -9.81, 0))
    reduced = rnc.NonholonomicSystem(robot).reduce()
    fast = rnc.SimulationOptions(rnc.Stop(speed=2.0))
    with pytest.raises(rnc.DivergenceError) as caught:
        rnc.free_motion(reduced, robot.configuration(), np.zeros(4), duration=1.0, options=fast)
    other = again(caught.value)
    assert str(other) == str(caught.value)
    assert np.array_equal(other.trajectory.q, caught.value.trajectory.q)
    with pytest.raises(rnc.SingularityError) as caught:
        _ = space_robot().at(robot.configuration()).R
    other = again(caught.value)
    assert (str(other), other.rows) == (str(caught.value), caught.value.rows)
