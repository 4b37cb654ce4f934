"""Published descriptions as they come: meshes that are missing, broken or mirrored, and what fails in drawing."""

import os
import shlex
import shutil
import subprocess
import sys
import warnings
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from browsing import place, visit
from patience import PATIENCE, eventually
from places import DIRT
from rnc_pin.applications.command_line.cli import main
from rnc_pin.applications.scenario import execution
from rnc_pin.applications.scenario.execution import execute
from rnc_pin.applications.scenario.scenario import Scenario
from rnc_pin.visualization.drawn_state import DrawnState, View
from rnc_pin.visualization.elements import drawn_scale
from rnc_pin.visualization.loop_view import LiveView
from rnc_pin.visualization.meshcat_scene import MeshcatScene
from rnc_pin.visualization.recording import Recording
from rnc_pin.visualization.scene_bodies import drawn_triangles

SINGLE_PRECISION = 1e-6  # [m]; meshes are kept in it

INERTIAL = """<inertial><origin xyz="0 0 0.1" rpy="0 0 0.3"/><mass value="12"/>
    <inertia ixx="0.13" iyy="0.1" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial>"""
BOX = '<geometry><box size="1 1 1"/></geometry>'
BODY = f'{INERTIAL}<visual><geometry><box size="0.4 0.3 0.2"/></geometry></visual>'


def mesh(name, kind="visual"):
    return f'<{kind}><geometry><mesh filename="{name}"/></geometry></{kind}>'


def chain(**links):
    """A URDF of links, each on a hinge after the one before it."""
    names = list(links)
    parts = [f'<link name="{name}">{content}</link>' for name, content in links.items()]
    parts += [
        f'<joint name="{child}_joint" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        '<origin xyz="0.3 0 0"/><axis xyz="0 0 1"/></joint>'
        for parent, child in pairwise(names)
    ]
    return f'<robot name="gaps">{"".join(parts)}</robot>'


@pytest.fixture
def gaps(tmp_path):
    """A file whose meshes are missing and broken in every way."""
    path = tmp_path / "gaps.urdf"
    shutil.copy(DIRT / "wedge.stl", tmp_path)
    (tmp_path / "broken.stl").write_text("rubbish")
    (tmp_path / "odd.step").write_text("rubbish")
    (tmp_path / "pointer.stl").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:1\nsize 3\n")
    path.write_text(
        chain(
            base=INERTIAL + mesh("package://nowhere/base.stl") + mesh("package://nowhere/base.stl", "collision"),
            arm=INERTIAL + mesh("absent.dae") + f"<visual>{BOX}</visual><collision>{BOX}</collision>",
            broken=INERTIAL + mesh("broken.stl"),
            pointer=INERTIAL + mesh("pointer.stl"),
            odd=INERTIAL + mesh("odd.step"),
            whole=INERTIAL + mesh("wedge.stl"),
            massless=mesh("package://nowhere/small.stl"),
            far=INERTIAL,
        )
    )
    return path


def warned(call):
    """Result of a call, and the messages of its ModelWarnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        value = call()
    return value, [str(each.message) for each in caught if issubclass(each.category, rnc.ModelWarning)]


def test_meshes_that_cannot_be_had_cost_one_warning_that_names_the_remedy(gaps):
    robot, told = warned(lambda: rnc.Robot.from_urdf(gaps))
    assert told == []  # who does not draw is told nothing
    (visual, told) = warned(lambda: robot.visual_model)
    (line,) = told
    where = f"package 'nowhere' (2), absent.dae in folder '{gaps.parent}'"
    assert line.startswith(f"{gaps}: 3 meshes were not found: {where}")
    assert "package_dirs (--package-dir, ROS_PACKAGE_PATH)" in line
    assert "3 meshes were not readable: broken.stl (STL of 7 bytes: room for 0 triangles, declared 0)" in line
    assert "pointer.stl (a git-lfs pointer: git lfs pull)" in line
    assert "odd.step (format '.step', expected one of .dae, .glb, .gltf, .obj, .ply, .stl)" in line
    assert line.endswith("boxes of the inertia's size stand in")
    names = {shape.name for shape in visual.geometryObjects}
    stand_ins = {f"{link}_stand_in" for link in ("base", "broken", "pointer", "odd")}
    assert names == {"arm_1", "whole_0", *stand_ins}  # nothing for what has no mass
    assert robot.stand_ins == stand_ins
    collision, told = warned(lambda: robot.collision_model)
    assert (told, [shape.name for shape in collision.geometryObjects]) == ([], ["arm_0"])


def test_a_stand_in_has_the_inertia_of_its_link(gaps):
    robot = rnc.Robot.from_urdf(gaps)
    warned(lambda: robot.visual_model)
    shape = robot.visual_model.geometryObjects[robot.visual_model.getGeometryId("broken_stand_in")]
    sides = 2 * np.asarray(shape.geometry.halfSide)
    moments = 12.0 / 12 * ((sides**2).sum() - sides**2)
    turned = shape.placement.rotation @ np.diag(moments) @ shape.placement.rotation.T
    expected = pin.rpy.rpyToMatrix(0, 0, 0.3) @ np.diag([0.13, 0.1, 0.05]) @ pin.rpy.rpyToMatrix(0, 0, 0.3).T
    np.testing.assert_allclose(turned, expected, atol=1e-12)
    np.testing.assert_allclose(shape.placement.translation, [0, 0, 0.1], atol=1e-12)
    assert robot.model.names[shape.parentJoint] == "broken_joint"


def volume(triangles):
    """Of the body within a closed surface whose triangles are counterclockwise from outside [m^3]."""
    first, second, third = np.moveaxis(triangles, 1, 0)
    return float(np.einsum("ij,ij->", first, np.cross(second, third)) / 6)


@pytest.fixture(scope="module")
def mirrored():
    return rnc.Robot.from_urdf(DIRT / "mirrored.urdf", gravity=(0, 0, 0))


PAIRS = [("left_0", "right_0", 1.0), ("upper_left_0", "upper_right_0", 1.0), ("top_left_0", "top_right_0", 2.0)]


@pytest.mark.parametrize(("name", "other", "factor"), PAIRS)
def test_a_mirrored_mesh_is_drawn_mirrored_with_its_faces_outward(name, other, factor, mirrored):
    visual = mirrored.visual_model
    left, right = (visual.geometryObjects[visual.getGeometryId(each)] for each in (name, other))
    assert (drawn_scale(right) > 0).all()
    straight, turned = (drawn_triangles(each) * drawn_scale(each) for each in (left, right))
    assert volume(straight) > 0
    assert volume(turned) == pytest.approx(factor**3 * volume(straight), rel=1e-5)
    mirror = factor * np.array([1.0, -1.0, 1.0])
    corners, expected = turned.reshape(-1, 3), straight.reshape(-1, 3) * mirror
    np.testing.assert_allclose(corners.min(axis=0), expected.min(axis=0), atol=SINGLE_PRECISION)
    np.testing.assert_allclose(corners.max(axis=0), expected.max(axis=0), atol=SINGLE_PRECISION)


SHORT = ["--set", "simulation.duration=0.2"]
RUN = ["run", "space-robot", *SHORT, "--set", "comparisons={}", "--out"]


def called(monkeypatch, capfd, *arguments):
    """Exit status, output and errors of the command in this process."""
    monkeypatch.setattr(sys, "argv", ["rnc-pin", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, *capfd.readouterr()


def test_what_fails_in_drawing_costs_the_drawing_alone(tmp_path, monkeypatch, capfd):
    printed = []

    def fail(*arguments):
        printed.append((sorted(path.name for path in (tmp_path / "out").iterdir()), capfd.readouterr().out))
        raise ValueError("found a\nleft-handed frame")

    monkeypatch.setattr(rnc.simulation, "plot_run", fail)
    monkeypatch.setattr(rnc.visualization, "Recording", fail)
    status, out, err = called(monkeypatch, capfd, *RUN, tmp_path / "out")
    assert status == 0
    saved, table = printed[0]
    assert {"trajectory.npz", "summary.json", "scenario.yaml"} <= set(saved)
    assert "final error" in table  # the table was there before anything was drawn
    (line,) = [line for line in err.splitlines() if line.startswith("rnc-pin: ")]
    cause = "ValueError: found a left-handed frame"
    assert line == f"rnc-pin: warning: overview.png, overview_2.png, animation.html could not be drawn: {cause}"
    (files,) = [line for line in out.splitlines() if line.startswith("in ")]
    written = files.split(": ")[-1].split()
    assert not {"overview.png", "animation.html"} & {path.name for path in (tmp_path / "out").iterdir()}
    names = {path.name for path in (tmp_path / "out").iterdir()} - {".rnc_pin"}
    assert {name.rstrip(",") for name in written} == names
    assert any(name.endswith(".png") for name in names)  # the other pictures are there


def test_a_run_without_drawing_reads_no_meshes_for_pictures(tmp_path, monkeypatch):
    def fail(robot):
        raise AssertionError("geometry was asked for")

    monkeypatch.setattr(rnc.Robot, "visual_model", property(fail))  # the verdict needs collision shapes
    execute(Scenario.load("space-robot", {"simulation.duration": 0.02, "comparisons": {}}))


def test_a_robot_without_its_meshes_runs(tmp_path, monkeypatch, capfd):
    path = tmp_path / "arm.urdf"
    far = mesh("package://nowhere/meshes/arm.stl")
    shutil.copy(DIRT / "wedge.stl", tmp_path)
    path.write_text(chain(base=INERTIAL + far, arm=INERTIAL + far, hand=INERTIAL + mesh("wedge.stl")))
    scenario = tmp_path / "arm.yaml"
    called(monkeypatch, capfd, "init", path, "--out", scenario)
    monkeypatch.setattr(execution, "_figure", lambda *_: None)
    status, _, err = called(monkeypatch, capfd, "run", scenario, *SHORT, "--out", tmp_path / "out")
    assert status == 0
    (line,) = [line for line in err.splitlines() if "warning" in line]
    assert "1 mesh was not found: package 'nowhere' (1)" in line
    assert (tmp_path / "out" / "animation.html").is_file()


HOOK = """
import importlib.abc, os, signal, sys, time
class Interrupting(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            {interrupt}
sys.meta_path.insert(0, Interrupting())
"""
AS_EXCEPTION = "raise KeyboardInterrupt"
AS_SIGNAL = "os.kill(os.getpid(), signal.SIGINT); time.sleep(5)"


@pytest.mark.parametrize(("module", "interrupt"), [
    ("click", AS_EXCEPTION), ("pinocchio", AS_EXCEPTION), ("rnc_pin.applications.command_line.run", AS_SIGNAL),
], ids=["click", "pinocchio", "signal"])  # fmt: skip
def test_an_interrupted_import_is_one_line(module, interrupt, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(HOOK.format(module=module, interrupt=interrupt))
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    process = subprocess.run(
        [sys.executable, "-m", "rnc_pin", *RUN, tmp_path / "out"],
        env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, timeout=PATIENCE,
    )  # fmt: skip
    assert process.stderr == "rnc-pin: error: interrupted\n"
    # Something is said before anything that takes long is imported.
    said = "" if module == "click" else "space-robot: reading the scenario ...\n"
    assert (process.returncode, process.stdout) == (1, said)


@pytest.mark.parametrize(("command", "name"), [
    ("run", "my robot.urdf"), ("inspect", "robot.urdf.xacro"), ("sweep", "robot.xml"), ("run", "talos_reduced"),
])  # fmt: skip
def test_a_robot_is_no_scenario_but_can_become_one(command, name, call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "." in name:
        (tmp_path / name).write_text(chain(base=INERTIAL, arm=INERTIAL))
    status, _, error = call(command, name, *(["--runs", "2", "--out", "x"] if command == "sweep" else []))
    assert status == 2
    assert "that is a robot, not a scenario: draft one with: rnc-pin init " in error
    assert (shlex.split(error)[-1], len(error.splitlines())) == (name, 1)


def test_what_a_draft_says_to_do_next_can_be_pasted(call, tmp_path):
    robot = tmp_path / "my robot.urdf"
    robot.write_text(chain(base=INERTIAL, arm=INERTIAL))
    status, out, _ = call("init", robot, "--out", tmp_path / "my first.yaml")
    assert status == 0
    tried = out.split("then try: ")[1].split(";")
    assert [shlex.split(each)[-1] for each in tried] == [str(tmp_path / "my first.yaml")] * 2


@pytest.mark.parametrize(("name", "valid", "meant"), [
    ("talos", ["tiago", "talos_reduced", "talos_full_v2_box"], "talos_reduced"),
    ("wheel_l", ["wheel", "wheels", "front_wheel_left", "wheel_left_joint"], "wheel_left_joint"),
    ("left", ["lift", "wheel_left_joint"], "wheel_left_joint"),
    ("plotz", ["matplotlib", "plots"], "plots"),
    ("pandaa", ["tiago", "panda", "panda_hand"], "panda"),
    ("tpi", ["base", "tip"], "tip"),
])  # fmt: skip
def test_the_nearest_name_begins_like_the_one_given(name, valid, meant):
    assert rnc.errors.nearest(name, valid) == f"; did you mean '{meant}'?"


FAR = 20.0  # [m]


@pytest.fixture(scope="module")
def cart(tmp_path_factory):
    path = tmp_path_factory.mktemp("cart") / "cart.urdf"
    path.write_text(chain(base=BODY, mast=BODY))
    return rnc.Robot.from_urdf(path, base="planar")


def at(robot, time, x):
    none = np.empty(0)
    q = robot.configuration({"root_joint": [x, 0.0, 0.0]})
    return DrawnState(time, q, none, none, none, none, none, none, float("nan"))


EYES = "[viewer.camera.position.toArray(), viewer.controls.target.toArray()]"


def eyes(page):
    """Places of the camera and of its target, in the world's axes; the viewer's have y up."""
    return [np.array([x, -z, y]) for x, y, z in page.evaluate(EYES)]


@pytest.mark.parametrize(
    "view", [View(), View(camera=(0.0, -2.5, 1.5), target=(0.1, 0.0, 0.1))], ids=["fitted", "given"]
)
def test_a_recorded_page_keeps_a_robot_in_sight_that_drives_away(view, cart, browser, tmp_path):
    start = np.r_[FAR / 10.0, np.zeros(cart.nv - 1)]
    run = rnc.free_motion(rnc.NonholonomicSystem(cart).reduce(), cart.configuration(), start, duration=10.0)
    assert run.q[-1, 0] == pytest.approx(FAR, rel=1e-6)
    page, problems = visit(browser, Recording(cart, run, view).save(tmp_path / "page.html").as_uri(), offline=True)
    page.wait_for_function("window.ready === true", timeout=1000 * PATIENCE)
    page.evaluate("viewer.animator.pause()")
    for time in (0.0, 5.0, 10.0, 2.0):
        seen(page, time)
        camera, target = eyes(page)
        size = np.linalg.norm(camera - target)
        assert size < 5.0  # near enough to see it
        assert np.linalg.norm(np.array(place(page, "robot", "visuals", "base_0")) - target) < 0.5 * size
    # A user who comes nearer and looks from elsewhere keeps that.
    page.evaluate("viewer.camera.position.y += 0.7")
    before = np.subtract(*eyes(page))
    seen(page, 9.0)
    np.testing.assert_allclose(np.subtract(*eyes(page)), before, atol=1e-5)
    assert not problems
    page.context.close()


def seen(page, time):
    page.evaluate(f"viewer.animator.seek({time})")
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def in_sight(camera, target):
    return np.linalg.norm(np.array([FAR, 0.0, 0.0]) - target) < 0.5 * np.linalg.norm(camera - target)


def test_the_live_page_keeps_a_robot_in_sight_that_drives_away(cart, browser):
    live = LiveView(cart, speed=0, open_browser=False)
    try:
        live(at(cart, 0.0, 0.0))
        page, problems = visit(browser, live.url)
        for k in range(1, 41):
            live(at(cart, 0.2 * k, FAR * k / 40))
        assert eventually(lambda: place(page, "robot", "visuals", "base_0")[0] > FAR - 0.1)
        assert eventually(lambda: in_sight(*eyes(page)))
        late, _ = visit(browser, live.url)  # who comes late sees the same
        assert eventually(lambda: in_sight(*eyes(late)) and np.allclose(eyes(late), eyes(page), atol=1e-5))
        assert eventually(lambda: abs(place(page, "ground")[0] - eyes(page)[1][0]) <= 1.0)
        assert not problems
        late.context.close()
        page.context.close()
    finally:
        live.close()


@pytest.mark.parametrize(("base", "gravity", "view", "floor"), [
    ("free", (0, 0, 0), View(), False),
    ("free", (0, 0, 0), View(ground=0.0), True),
    ("free", (0, 0, -9.81), View(), True),
    ("planar", (0, 0, 0), View(), True),
    ("fixed", (0, 0, 0), View(), True),
    ("fixed", (0, 0, 0), View(ground=None), False),
])  # fmt: skip
def test_there_is_no_floor_under_what_floats(base, gravity, view, floor, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(MeshcatScene, "grid", lambda scene, height, center, half: drawn.append(height))
    path = tmp_path / "satellite.urdf"
    path.write_text(chain(hub=BODY, arm=BODY))
    robot = rnc.Robot.from_urdf(path, base=base, gravity=gravity)
    constraints = [rnc.MomentumConservation("root_joint")] if base == "free" and not any(gravity) else []
    reduced = rnc.NonholonomicSystem(robot, constraints).reduce()
    Recording(reduced, rnc.free_motion(reduced, robot.configuration(), np.full(reduced.r, 0.1), duration=0.1), view)
    assert bool(drawn) is floor
