"""Results print themselves: in a few lines with units, in one line as a part of others."""

import importlib
import inspect
import re
from dataclasses import is_dataclass

import coal
import numpy as np
import pytest

import rnc_pin as rnc
from rnc_pin.analysis import LiftOff, boundedness, classify, integrability
from rnc_pin.collision import CollisionDistances, Obstacle, continuous_distances
from rnc_pin.control import PositionGains, ReducingOutputController, VelocityGains
from rnc_pin.control.controller import LimitedAcceleration
from rnc_pin.planning import Hold, InTurn, MinimumJerk, Slowed, TaskReference, ViaPoints
from rnc_pin.printing import WIDTH, SummaryMixin
from rnc_pin.simulation import Finding, FindingKind, Severity, grip_along, judge, obstacles_passed, replay_limits
from rnc_pin.simulation.run_figure import compared_paths, ground_paths
from rnc_pin.visualization import Recording, recorded_states
from systems import space_robot

PACKAGES = ["", *(f".{name}" for name in ("analysis", "collision", "control", "control.loop", "model", "optimal",
            "planning", "plants", "robots", "simulation", "visualization", "applications.sweep",
            "identification"))]  # fmt: skip
MOST_LINES = 30


def is_record(kind):
    return is_dataclass(kind) or issubclass(kind, (SummaryMixin, tuple, dict))


def returned_classes():
    """Records that exported functions return, by the annotations of the functions."""
    modules = [importlib.import_module(f"rnc_pin{name}") for name in PACKAGES]
    exported = {name: getattr(module, name) for module in modules for name in module.__all__}
    found = set()
    for thing in filter(inspect.isfunction, exported.values()):
        function = inspect.unwrap(thing)
        for word in re.findall(r"\w+", str(function.__annotations__.get("return", ""))):
            kind = function.__globals__.get(word, exported.get(word))
            if isinstance(kind, type) and kind.__module__.startswith("rnc_pin") and is_record(kind):
                found.add(kind)
    return found


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """One object of each class, most of them results of a computation."""
    reduced = space_robot()
    robot, rng = reduced.robot, np.random.default_rng(0)
    q0, still = robot.configuration({"joint_1": -0.4, "joint_2": 1.8, "joint_3": -1.1}), np.zeros(reduced.r)
    task = rnc.Task.of(reduced, ["tip_x", "tip_y"], ["joint_1"])
    x1, x2 = reduced.at(q0).outputs()
    samples = np.stack([reduced.random_configuration(rng) for _ in range(8)])
    outwards = MinimumJerk(x2[:2], 1.1 * x2[:2], duration=2.0)
    reference = TaskReference(outwards, Hold(x1))
    run = rnc.free_motion(reduced, q0, [0.1, 0.0, 0.1], 1.0, 0.05)
    target = ReducingOutputController(reduced, Hold(x2))
    loop = rnc.ControlLoop(reduced, rnc.control.VelocityTracker(target), 0.01)
    loop.step(0.0, q0, np.zeros(reduced.robot.nv))

    sled = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    drives = [rnc.FrameForce("sleigh", "x"), rnc.FrameTorque("sleigh", "z")]
    system = rnc.NonholonomicSystem(sled, [rnc.NoSideSlip("sleigh")], drives)
    sleigh = system.reduce([rnc.FrameSpeed("sleigh"), rnc.FrameYaw("sleigh")], [rnc.FramePosition("sleigh", "xy")])
    curve = rnc.free_motion(sleigh, sled.configuration(), [1.0, 0.5], 1.0, 0.05)
    grip = rnc.Grip(sleigh, 0.5)
    goal = {rnc.FramePosition("sleigh", "xy"): [1.0, 0.5]}
    plan = rnc.optimal.plan(sleigh, sled.configuration(), goal, 2.0, form="kinematic")
    ball = Obstacle(coal.Sphere(0.1), position=(2.0, 1.0, 0.0), name="ball")
    near = continuous_distances(CollisionDistances(robot, [ball], q0=q0), run.time, run.q, within=10.0)
    wheels = [rnc.RollingWheel(f"{side}_wheel", 0.1) for side in ("left", "right")]
    turns = rnc.planning.Harmonic([0.0, 0.0], amplitude=[20.0, 25.0], frequency=[0.05, 0.08])
    rolling = rnc.NonholonomicSystem(rnc.Robot.from_urdf("differential_drive.urdf", base="planar"), wheels)
    turned = rolling.reduce([rnc.JointPosition(f"{side}_wheel_joint") for side in ("left", "right")])
    target_turns, start = ReducingOutputController(turned, turns), rolling.robot.configuration()
    times, path = rnc.kinematic_rollout(turned, target_turns, start, 9.0)
    log = rnc.Log.of_motion(rolling.robot, times, path, frames=["base"])
    larger = rolling.with_robot(rolling.robot, [rnc.RollingWheel(f"{side}_wheel", 0.12) for side in ("left", "right")])
    radius = [rnc.identification.WheelRadius(["left_wheel", "right_wheel"])]
    with rnc.show(robot, gains={"k": (0.0, 2.0, 1.0)}, open_browser=False) as view:
        view.update(q0)
    cart = rnc.Robot.from_urdf("differential_drive.urdf", base="planar")
    cart_model = rnc.NonholonomicSystem(cart, wheels, ["left_wheel_joint", "right_wheel_joint"]).reduce()
    follower, stands = rnc.control.TwistController(cart_model, "base", 0.02), cart.configuration()
    folder = tmp_path_factory.mktemp("sweep")
    sweep = rnc.sweep("unicycle", [{"simulation.duration": 0.1}, {"simulation.duration": 0.2}], out=folder / "runs")
    return [
        *(rnc.analyze(reduced, ["tip_x", "tip_y"], ["joint_1"], samples=8), rnc.linearize(reduced, q0)),
        rnc.equilibrium(reduced, q0),
        *(rnc.preflight(reduced, task, reference, q0), rnc.state_derivatives(reduced, q0, still, np.zeros(reduced.p))),
        *(boundedness(reduced, samples), classify(reduced, task, samples), integrability(reduced, samples)),
        *(run, curve, rnc.summarize(run), rnc.summarize(curve, 0.2), run.info, run.info.outputs, run.verdict),
        run.info.provenance,
        *(judge(curve), replay_limits(robot, run), rnc.kinematic_rollout(reduced, target, q0, 1.0, 0.1), near),
        *(rnc.solve_ik(reduced, q0, {rnc.FramePosition("tip", "xy"): 1.1 * x2[:2]}), *obstacles_passed(
            robot, run.time, run.q, [ball])),
        *(rnc.impact(reduced, q0, rnc.free_motion(reduced, q0, [0.1, 0.0, 0.1], 0.1, 0.1).v[0]), sweep),
        *(plan, plan.info, plan.info.verification, plan.reference()),
        *(grip, grip_along(sleigh, grip, curve.time, curve.q)),
        *(reference, outwards, Hold(x1), ViaPoints([0.0, 1.0], [x1, x1 + 1.0]), Slowed(outwards, 2.0)),
        InTurn([outwards]),
        *(ground_paths(curve)[0], compared_paths(curve, {})),
        *(next(recorded_states(robot, run)), Recording(reduced, run, title="arm")),
        *(PositionGains(), VelocityGains(), LimitedAcceleration("joint_1", "v", 1, -2.0, 2.0)),
        *(loop.last, loop.state, loop.last.command, loop.last.measurement, reduced.terms(q0, still)),
        reduced.lagrangian_terms(q0, still),
        *(reduced.at(q0), reduced.at(q0, still), reduced.at(samples, np.zeros((8, reduced.r)))),
        follower.feasible(stands, [0.5, 0.1, 0.2]),
        follower.step(stands, [0.5, 0.1, 0.2], follower.initial_state())[0],
        *(view, log, rnc.calibrate(rolling, log, radius, "base"), rnc.compare(larger, log, "base")),
        *(rnc.base_parameters(turned), turned.regressor(start, np.ones(2), np.ones(2))),
        rnc.planning.find_way(sleigh, sled.configuration(), sled.configuration({"root_joint": [1.0, 0.5, 0.3]}), []),
        rnc.collision.OccupancyMap(np.eye(3, dtype=bool), np.zeros((3, 3), dtype=bool), 0.05, np.zeros(3)),
        rnc.collision.cells_around(rng.uniform(size=(20, 3)), 0.2),
        rnc.control.MissedGoal("sleigh_x", 0.03, 0.005, "it stalls"),
        LiftOff("left_wheel", 1.0, -2.0, -3.0),
        Finding(FindingKind.GOAL, "tip", 0.03, "m", 2.0, Severity.FAILS, "the goal of tip is missed by 0.03 m at 2 s"),
    ]  # fmt: skip


def test_there_is_an_object_of_every_class_that_a_function_returns(results):
    shown = {type(each) for each in results} | {rnc.simulation.Summary}  # a mapping, which PrintedSummary prints
    assert {kind.__name__ for kind in returned_classes() - shown} == set()


def test_a_result_prints_in_a_few_lines(results):
    for each in results:
        lines = str(each).splitlines()
        assert len(lines) <= MOST_LINES, each
        assert max(map(len, lines)) <= WIDTH, each
        assert not re.search(r"array\(|<.* object at 0x|\w+=\w+\([^.]", str(each)), each


def test_its_repr_is_one_line_that_names_its_class(results):
    for each in results:
        assert "\n" not in repr(each)
        assert len(repr(each)) <= WIDTH
        if not isinstance(each, (rnc.IkResult, rnc.simulation.Verdict)):  # their titles are sentences of their own
            assert type(each).__name__.removeprefix("Printed") in repr(each)
