# ruff: noqa: E501
"""MJCF that MuJoCo writes out: the same machine as MuJoCo's own, and nothing read that is not the description's."""

import os
import sys

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.model.kinematics import Kinematics
from rnc_pin.robots.sources.description import unlogged
from urdf_parts import TETRAHEDRON, write

mujoco = pytest.importorskip("mujoco", reason="mujoco is an optional extra and not installed")

SHORT = """<mujoco><include file="parts/defaults.xml"/><compiler settotalmass="6" meshdir="parts" angle="degree"/>
<asset><mesh name="wedge" file="wedge.obj" scale="1 2 0.5"/><material name="red" rgba="1 0 0 1"/></asset><worldbody>
<frame pos="0 0 1" euler="0 0 30"><body name="a"><joint name="root" axis="1 2 3"/><geom type="box" size="1 1 0.1"/>
<replicate count="3" offset="0.5 0.1 0" euler="0 0 20"><body name="b" pos="1 0 0"><joint name="j" axis="0 1 0" pos="0 0 0.1"
range="-60 60"/><geom type="capsule" fromto="0 0 0 1 0 0" size="0.1" density="700"/><frame euler="90 0 20">
<geom type="mesh" mesh="wedge" pos="0 1 0" euler="10 20 30" material="red"/><body name="c"><joint name="k" type="slide"
axis="1 0 1"/><geom type="sphere" size="0.1" pos="0 1 0"/><site name="tip" pos="0 0 1"/></body></frame></body></replicate>
</body></frame></worldbody></mujoco>"""
DEFAULTS = '<mujoco><default><joint damping="0.1" armature="0.02"/></default></mujoco>'
BODY = '<mujoco>{}<worldbody><body name="b"><joint name="j"/><geom size="1"/>{}</body></worldbody></mujoco>'


@pytest.fixture
def folder(tmp_path):
    for parts in ("robot/parts/defaults.xml", "elsewhere.xml"):
        write(tmp_path / parts, DEFAULTS)
    for mesh in ("robot/parts/wedge.obj", "elsewhere.obj"):
        write(tmp_path / mesh, TETRAHEDRON)
    (tmp_path / "robot" / "link.xml").symlink_to(tmp_path / "elsewhere.xml")
    os.mkfifo(tmp_path / "robot" / "pipe.xml")
    return tmp_path / "robot"


def written(folder, text):
    return write(folder / "robot.xml", text)


def same_machine(path):
    """Check joints, limits, losses, moments, gravity and sites against MuJoCo's; the robot."""
    from mujoco_readings import difference

    robot = rnc.Robot.from_mjcf(path, snap=False)
    with unlogged(mujoco):
        assert difference(robot, mujoco.MjModel.from_xml_path(str(path))) == ""
    return robot


def assert_meshes_are_drawn_where_mujoco_draws_them(robot, path):
    """MuJoCo turns meshes to their principal axes."""
    theirs = mujoco.MjModel.from_xml_path(str(path))
    data, here, shapes = mujoco.MjData(theirs), robot.model.createData(), robot.visual_model
    q = np.random.default_rng(0).uniform(-1, 1, robot.nq)
    data.qpos[[int(theirs.joint(name).dofadr[0]) for name in robot.joint_names]] = q
    mujoco.mj_forward(theirs, data)
    drawn = pin.GeometryData(shapes)
    pin.updateGeometryPlacements(robot.model, here, shapes, drawn, q)
    meshes = [k for k in range(theirs.ngeom) if theirs.geom_type[k] == mujoco.mjtGeom.mjGEOM_MESH]
    ours = [k for k, shape in enumerate(shapes.geometryObjects) if shape.meshPath.endswith(".obj") or len(meshes) == 1]
    assert len(meshes) == len(ours) > 0
    for mine, other in zip(ours, meshes, strict=True):
        points = np.array(shapes.geometryObjects[mine].geometry.vertices())
        points = points @ drawn.oMg[mine].rotation.T + drawn.oMg[mine].translation
        turned = theirs.mesh_vert @ data.geom_xmat[other].reshape(3, 3).T + data.geom_xpos[other]
        np.testing.assert_allclose(np.sort(points, axis=0), np.sort(turned, axis=0), atol=1e-6)


@pytest.mark.filterwarnings("ignore:compiler attribute")
def test_what_is_written_out_is_the_same_machine(folder, monkeypatch):
    monkeypatch.chdir(folder)  # MuJoCo writes a log of what this test asks it for
    path = written(folder, SHORT)
    robot = same_machine(path)
    assert sorted(robot.joint_names) == sorted(["root", "j0", "j1", "j2", "k0", "k1", "k2"])
    assert sum(inertia.mass for inertia in robot.model.inertias) == pytest.approx(6.0, rel=1e-12)
    assert_meshes_are_drawn_where_mujoco_draws_them(robot, path)


@pytest.mark.parametrize("asset", [
    '<texture name="t" type="2d" width="9" height="9"/><material name="m" texture="t"/>',
    '<texture type="skybox" builtin="gradient" width="9" height="9"/><material name="m" rgba="1 0 0 1"/>',
], ids=["named", "sky"])  # fmt: skip
def test_pictures_that_are_made_are_nobodys_business(asset, tmp_path, capfd):
    """Pinocchio's parser warns of them on standard output, where results are."""
    text = BODY.format(f"<asset>{asset}</asset>", '<geom size="1" material="m"/>')
    assert len(rnc.Robot.from_mjcf(written(tmp_path, text)).visual_model.geometryObjects) == 2
    assert capfd.readouterr() == ("", "")


def test_files_of_folders_that_are_named_are_read(folder):
    asset = '<compiler meshdir=".."/><asset><mesh name="m" file="elsewhere.obj"/></asset>'
    path = written(folder, BODY.format(asset + '<include file="../elsewhere.xml"/>', '<geom type="mesh" mesh="m"/>'))
    with pytest.raises(rnc.ModelError, match=r"give its folder in package_dirs \(--package-dir\) if you trust"):
        rnc.Robot.from_mjcf(path)
    with pytest.raises(rnc.ModelError, match="if you trust"):
        rnc.Robot.from_mjcf(path, package_dirs=[folder / "parts"])
    robot = rnc.Robot.from_mjcf(path, package_dirs=[folder.parent])
    assert robot.model.armature == pytest.approx([0.02])  # of what was included
    assert [shape.meshPath for shape in robot.visual_model.geometryObjects if shape.meshPath.endswith(".obj")]


def test_without_mujoco_no_mjcf_is_read(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(rnc.ModelError, match=r"robot.xml: MuJoCo compiles MJCF. MuJoCo is not installed: pip install"):
        rnc.Robot.from_mjcf(written(tmp_path, BODY.format("", "")))


def test_a_mesh_takes_the_place_of_its_own_shape_alone(folder):
    """Names may repeat: a shape without a name is called baseGeom_0, and another one may have this name."""
    mesh = '<asset><mesh name="wedge" file="parts/wedge.obj"/></asset>'
    ball = '<body name="b" pos="1 0 0"><joint/><geom name="baseGeom_0" size="0.1"/></body>'
    base = '<body name="base"><joint/><geom type="mesh" mesh="wedge"/></body>'
    path = written(folder, f"<mujoco>{mesh}<worldbody>{base}{ball}</worldbody></mujoco>")
    shapes = rnc.Robot.from_mjcf(path).visual_model.geometryObjects
    assert sorted(shape.meshPath.endswith(".obj") for shape in shapes) == [False, True]


def test_mujoco_leaves_no_log_where_the_program_was_started(folder, monkeypatch):
    path = written(folder, SHORT)
    monkeypatch.chdir(folder.parent / "robot" / "parts")
    rnc.Robot.from_mjcf(path)
    assert sorted(os.listdir()) == ["defaults.xml", "wedge.obj"]


SWINGING = '<joint axis="0 1 0"/><geom size="0.1" pos="0.3 0 0.1"/>'
FLOATING = '<freejoint/><geom type="box" size="0.1 0.2 0.3" pos="0.3 0 0.1"/>'
CLASSES = (
    '<default><joint armature="0.1"/><geom density="500" size="0.2 0.3 0.1"/><default class="outer"><geom type="box" '
    'euler="10 20 30"/><joint axis="1 1 0"/><default class="inner"><joint pos="0.1 0.2 0" type="slide"/></default></default></default>'
)
HELD = '<inertial mass="2" pos="0 0 0.1" fullinertia="0.02 0.03 0.04 0.001 0 0"/><geom size="0.1" pos="0 0.4 0"/>'


@pytest.mark.parametrize(("world", "joints"), [
    (f'<body name="left">{SWINGING}</body><body name="right" pos="1 0 0">{SWINGING}</body>', 2),
    (f'<body name="table" pos="0 0 1"><geom size="1"/></body><body name="arm">{SWINGING}</body>', 1),
    (f'<body name="left">{FLOATING}</body><body name="right" pos="1 0 0">{FLOATING}</body>', 2),
    (f"<body>{SWINGING}</body>", 1),
    (f'<body name="body_2">{SWINGING}<body>{SWINGING}</body><body pos="1 0 0">{SWINGING}</body></body>', 3),
    (f"<body>{FLOATING}<body>{SWINGING}<body>{SWINGING}</body></body></body><body/>", 3),
    (f'<body name="body_1">{SWINGING}</body></worldbody><worldbody><body>{SWINGING}</body>', 2),
], ids=["two roots", "one stands", "two float", "nameless", "nameless siblings", "nameless chain", "two sections"])  # fmt: skip
def test_every_body_is_read(world, joints, tmp_path):
    """Pinocchio's parser keeps the first root, and one of the bodies without names."""
    robot = same_machine(written(tmp_path, f"<mujoco><worldbody>{world}</worldbody></mujoco>"))
    assert len(robot.joint_names) == joints


@pytest.mark.parametrize(("head", "body"), [
    ("", f'axisangle="1 2 3 40">{SWINGING}'),
    ('<compiler angle="radian"/>', f'axisangle="1 2 3 0.7">{SWINGING}'),
    *((f'<compiler eulerseq="{axes}"/>', f'euler="20 30 50">{SWINGING}') for axes in ("XYZ", "ZXZ", "xZy", "zyx")),
    (CLASSES, '><joint class="inner" name="j"/><geom type="capsule"/>'),
    (CLASSES, f'childclass="inner"><joint/><geom size="0.5"/><body pos="1 0 0"><joint class="outer"/>{HELD}</body>'),
    (CLASSES, 'childclass="outer"><joint axis="0 0 1"/><geom quat="1 1 0 0"/><geom type="capsule" fromto="0 0 0 1 1 0"/>'),
    (CLASSES, '><joint class="outer" armature="0"/><geom density="100" type="cylinder" size="0.1" zaxis="1 2 3"/>'),
    ("", f'><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>{SWINGING}'),
    ("", f'pos="1 2 3" euler="10 20 30"><joint pos="0 0 1" axis="1 0 0" range="-30 40"/><joint type="ball"/>{HELD}<body>{SWINGING}</body>'),
    ("", f'><joint ref="20" range="10 60" damping="0.2"/>{HELD}<body><joint type="slide" ref="0.3" range="0.1 0.9"/>{HELD}</body>'),
    ("", f'><joint range="10 60" limited="false"/>{HELD}<body><joint type="slide" range="0 0"/>{HELD}</body>'),
    ('<compiler angle="radian" autolimits="false"/>',
        f'><joint range="-1 1" limited="true"/>{HELD}<body><joint range="-1 1" limited="false"/>{HELD}</body>'),
    ("", f'pos="1 2 3" euler="10 90 20"><body>{SWINGING}<site name="s"/></body>'),
    ("", f'pos="1 2 3" euler="10 90 20"><freejoint/>{HELD}<site name="s" pos="1 0 0"/>'),
    ("", f'pos="1 2 3"><joint type="free" damping="0.3" armature="0.1"/>{HELD}<site name="s" pos="1 0 0"/>'),
    ('<compiler boundmass="3"/>', f'><joint type="free" damping="0.3" armature="0.1"/>{HELD}<site name="s"/>'),
    ("", f'><joint type="ball" damping="0.3" armature="0.1"/>{HELD}'),
    ('<option><flag gravity="disable"/></option>', f">{SWINGING}"),
    ('<option gravity="1 2 3"><flag gravity="disable"/></option><compiler boundmass="9"/>', f">{SWINGING}"),
    ('<default><geom quat="1 1 1 0"/></default>', '><joint/><geom type="capsule" size="0.1" pos="0 0 0" fromto="0 0 0 1 2 3"/>'),
    ("", '><joint axis="1 2 3"/><geom type="box" size="0.1 0.2 0.3" shellinertia="true"/>'),
    ('<compiler boundmass="3"/>', f'><joint ref="20"/>{HELD}<body>{SWINGING}</body>'),
    ('<compiler boundinertia="3"/>', f">{SWINGING}"),
    ('<compiler inertiagrouprange="0 2"/>', '><joint/><geom size="0.2" pos="1 0 0" group="4"/><geom size="0.3"/>'),
    ('<compiler inertiafromgeom="true"/>', f"><joint/>{HELD}"),
    ('<compiler inertiafromgeom="false"/>', f'><joint/>{HELD}<body pos="1 0 0">{SWINGING}{HELD}</body>'),
    ('<compiler inertiafromgeom="false"/>', f'><joint/><joint type="slide"/>{HELD}'),
    ('<compiler balanceinertia="true"/>', '><joint/><inertial mass="1" pos="0 0 1" diaginertia="1 1 3"/>'),
])  # fmt: skip
def test_what_is_left_to_be_understood_is_understood_as_mujoco_does(head, body, tmp_path):
    same_machine(written(tmp_path, f"<mujoco>{head}<worldbody><body {body}</body></worldbody></mujoco>"))


@pytest.mark.parametrize("angle", ["degree", "radian"])
@pytest.mark.parametrize("turn", [
    "", 'euler="20 30 50"', 'axisangle="1 2 3 40"', 'quat="1 2 3 4"', 'xyaxes="1 2 3 0 1 1"', 'zaxis="1 2 3"', 'zaxis="0 0 -1"',
    'type="capsule" size="0.1" fromto="0 0 0 1 2 3"',
])  # fmt: skip
def test_sites_are_where_mujoco_has_them(turn, angle, tmp_path):
    """Pinocchio's parser takes a body out of a chain of those that are fixed to each other."""
    place = "" if "fromto" in turn else 'pos="0.1 0.2 0.3"'
    site = f'<site name="{{}}" {place} {turn}/>'
    text = (
        f'<mujoco><compiler angle="{angle}" eulerseq="xZy"/><worldbody><site/><body name="a">{SWINGING}{site.format("near")}'
        f'<body pos="0 0 1"><body pos="0 1 0" euler="1 2 3"><body pos="1 0 0">{site.format("far")}</body></body></body>'
        "</body></worldbody></mujoco>"
    )
    model = same_machine(written(tmp_path, text)).model
    assert [each.name for each in model.frames if each.type == pin.FrameType.OP_FRAME] == ["near", "far"]


@pytest.mark.parametrize(("head", "body"), [
    ("", '<geom type="mesh" mesh="wedge" pos="1 0 0" euler="10 20 30"/>'),
    ("", '<geom type="mesh" mesh="wedge" mass="2"/><geom size="0.1" pos="0 0 1"/>'),
    ("", '<geom type="mesh" mesh="wedge" mass="0"/><geom size="0.1" pos="0 0 1"/>'),
    ('<default><geom type="mesh" density="100"/><mesh scale="1 2 1"/></default>', '<geom mesh="wedge"/>'),
    ("", '<geom type="box" mesh="wedge"/>'),
])  # fmt: skip
def test_what_meshes_weigh(head, body, folder):
    """To Pinocchio's parser each weighs a kilogram."""
    asset = f'<compiler meshdir="parts"/><asset><mesh name="wedge" file="wedge.obj"/></asset>{head}'
    world = f'<worldbody><body name="b"><joint axis="1 2 3"/>{body}</body></worldbody>'
    path = written(folder, f"<mujoco>{asset}{world}</mujoco>")
    same_machine(path)
    path.write_text(path.read_text().replace("</body>", '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'))
    assert rnc.Robot.from_mjcf(path).model.inertias[1].mass == 1


@pytest.mark.parametrize("compiler", ["", '<compiler angle="radian"/>', '<compiler balanceinertia="true"/>'])
def test_a_coupling_is_of_what_joints_have_moved(compiler, tmp_path):
    """MuJoCo's equality counts from where the file has the joints, their ``ref``."""
    unit = 1.0 if "radian" in compiler else np.rad2deg(1.0)
    text = (
        f'<mujoco>{compiler}<worldbody><body><joint name="x" ref="{0.3 * unit}"/><geom size="0.1"/><body><joint name="s" '
        'type="slide" ref="0.2"/><geom size="0.1"/></body></body></worldbody><equality><joint joint1="s" joint2="x" '
        'polycoef="0.1 2 0 0 0"/></equality></mujoco>'
    )
    (mimic,) = same_machine(written(tmp_path, text)).mimics
    assert (mimic.multiplier, mimic.offset) == (2.0, pytest.approx(0.2 + 0.1 - 2 * 0.3))


@pytest.mark.parametrize("text", [
    f'<default><geom material="{"x" * 100_000}"/></default><worldbody><body><joint/><geom/></body></worldbody>',
    f'<default><geom material="{"x" * 1_000_000}"/>{100 * "<default/>"}</default><worldbody><body/></worldbody>',
    f'<worldbody><replicate count="9999"><body childclass="{"x" * 1_000_000}"/></replicate></worldbody>',
], ids=["elements", "classes", "replicate"])  # fmt: skip
def test_what_is_repeated_stands_for_no_more_than_a_file_may_be(text, tmp_path):
    with pytest.raises(rnc.ModelError, match=r"<(geom|body)>: (material|childclass) is longer than 1,000 characters"):
        rnc.Robot.from_mjcf(written(tmp_path, f"<mujoco>{text}</mujoco>"))


@pytest.mark.parametrize(("world", "base", "words"), [
    (f'<body name="a">{SWINGING}</body><body name="b">{SWINGING}</body>', "free",
        "base='free' moves one body, and in <worldbody> there are 2: a, b; take the file's own base"),
    (f'<body name="a">{SWINGING}</body>', "planar",
        "base='planar' would move body 'a', which has 1 joint of its own: take the file's own base"),
])  # fmt: skip
def test_what_is_no_one_machine_is_refused(world, base, words, tmp_path):
    path = written(tmp_path, f"<mujoco><worldbody>{world}</worldbody></mujoco>")
    with pytest.raises(rnc.ModelError, match=words):
        rnc.Robot.from_mjcf(path, base)


def test_a_mesh_without_mass_is_read_when_it_is_drawn(folder):
    asset = '<compiler meshdir="parts"/><asset><mesh name="wedge" file="wedge.obj"/></asset>'
    body = '<body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom type="mesh" mesh="wedge"/></body>'
    robot = rnc.Robot.from_mjcf(written(folder, f"<mujoco>{asset}<worldbody>{body}</worldbody></mujoco>"))
    (folder / "parts" / "wedge.obj").write_text("v 0 0 0\n")
    with pytest.raises(rnc.ModelError, match=r"robot.xml: mesh 'wedge': "):
        _ = robot.visual_model


@pytest.mark.parametrize("weighed", [False, True], ids=["drawn", "weighed"])
def test_a_mesh_with_a_pose_of_its_own_is_drawn_where_mujoco_has_it(weighed, folder, monkeypatch):
    monkeypatch.chdir(folder)
    inertial = "" if weighed else '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    path = written(
        folder,
        '<mujoco><compiler meshdir="parts"/><asset><mesh name="m" file="wedge.obj" refpos="1 2 3" refquat="1 2 0 1" '
        f'scale="1 2 3"/></asset><worldbody><body><joint name="j" axis="1 2 3"/>{inertial}<geom type="mesh" mesh="m" pos="1 0 0" '
        'euler="10 20 30"/></body></worldbody></mujoco>',
    )
    assert_meshes_are_drawn_where_mujoco_draws_them(same_machine(path), path)


def test_bodies_and_shapes_stay_where_mujoco_would_discard_them(tmp_path):
    seen = '<geom name="seen" size="1" contype="0" conaffinity="0" mass="1"/>'
    body = f'<body>{SWINGING}<body name="tool" pos="0 0 1">{seen}</body></body>'
    compiler = '<compiler fusestatic="true" discardvisual="true"/>'
    robot = same_machine(written(tmp_path, f"<mujoco>{compiler}<worldbody>{body}</worldbody></mujoco>"))
    assert robot.model.existFrame("tool")
    assert "seen" in [shape.name for shape in robot.visual_model.geometryObjects]


def test_a_joint_that_moves_no_mass_can_be_locked(tmp_path):
    """MuJoCo alone would refuse the file."""
    plain = rnc.Robot.from_mjcf(written(tmp_path, BODY.format("", '<body name="c"/>')))
    path = written(tmp_path, BODY.format("", '<body name="c"><joint name="idle"/></body>'))
    with pytest.raises(rnc.ModelError, match="joint 'idle' moves no mass"):
        rnc.Robot.from_mjcf(path)
    assert rnc.Robot.from_mjcf(path, lock={"idle": 0.0}).model.inertias[1] == plain.model.inertias[1]


def test_mujoco_is_given_no_plugins_sensors_or_pictures(tmp_path, monkeypatch):
    given, read = [], mujoco.MjSpec.from_string
    monkeypatch.setattr(mujoco.MjSpec, "from_string", lambda text, *more: given.append(text) or read(text, *more))
    head = (
        '<extension><plugin plugin="any.plugin"/></extension><asset><texture name="t" type="2d" file="t.png"/>'
        '<material name="m" texture="t"/><model name="other" file="other.xml"/></asset><sensor><plugin name="s" '
        'plugin="any.plugin"/></sensor><actuator><plugin joint="j" plugin="any.plugin"/></actuator>'
    )
    (tmp_path / "other.xml").write_text("<mujoco/>")
    path = written(tmp_path, BODY.format(head, '<geom size="1" material="m"/><plugin plugin="x"/>'))
    assert rnc.Robot.from_mjcf(path).model.upperEffortLimit[0] > 0
    assert len(given) == 1
    assert not any(word in given[0] for word in ("plugin", "texture", "sensor", "other"))


CAPSULE = '<geom type="capsule" fromto="0 0 0 0 0 .4" size=".03" mass="1"/>'
ARM = f"""<mujoco><worldbody><body><joint name="a" axis="0 1 0"/>{CAPSULE}
  <site name="p"/><body pos="0 0 .4"><joint name="b" axis="0 1 0"/>{CAPSULE}<site name="q"/>
    <body pos="0 0 .4"><joint name="c" axis="0 1 0"/>{CAPSULE}</body></body></body></worldbody>
  <tendon><fixed name="t"><joint joint="b" coef="1"/><joint joint="c" coef="-1"/></fixed>
  <spatial name="s"><site site="p"/><site site="q"/></spatial></tendon>
  <actuator>{{}}</actuator></mujoco>"""


@pytest.mark.filterwarnings("ignore:.*<tendon> is left out")
@pytest.mark.parametrize(("actuators", "passive"), [
    ("", ""),
    ('<motor joint="a"/>', "bc"),
    ('<position joint="a"/><velocity jointinparent="c"/>', "b"),
    ('<general tendon="t"/>', "a"),
    ('<general tendon="s"/><motor joint="a"/>', ""),  # the joints of a path are not told
    ('<motor site="thruster"/>', ""),
])  # fmt: skip
def test_joints_without_an_actuator_have_no_effort(actuators, passive, tmp_path):
    robot = rnc.Robot.from_mjcf(write(tmp_path / "r.xml", ARM.format(actuators)))
    limits = dict(zip(robot.joint_names, robot.model.upperEffortLimit, strict=True))
    assert "".join(name for name, limit in limits.items() if limit == 0) == passive


TREE = """<mujoco><compiler angle="radian"/>{head}<worldbody><site name="w" pos="0.2 0.1 0" euler="0.1 0.2 0.3"/>
  <body name="a" pos="0.1 0 0.2" euler="0.3 -0.2 0.1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <joint name="a1" axis="0 1 0"/><joint name="a2" axis="0 0 1" ref="0.2"/>
    <body name="b" pos="0.4 0 0.1" euler="0 0.5 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint name="b1" axis="0 1 0"/><site name="s" pos="0.1 0.2 0.3" euler="0.4 0 0.2"/></body></body>
  <body name="c" pos="1 0 0" quat="0.8 0.6 0 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <joint name="c1" axis="0 1 0"/><joint name="c2" type="slide" axis="1 0 0"/>
    <site name="t" pos="0 0.1 0" euler="0 0.3 0"/></body>
  <body name="hook" mocap="true"/></worldbody><equality>{equality}</equality></mujoco>"""

LOOPS = {
    "connect": '<connect body1="b" body2="c" anchor="0.1 0.2 0.3"/>',
    "connect to the world": '<connect body1="b" anchor="0.1 0.2 0.3"/>',
    "connect sites": '<connect site1="s" site2="t"/>',
    "connect a site to the world": '<connect site1="w" site2="t"/>',
    "weld": '<weld body1="b" body2="c"/>',
    "weld to the world": '<weld body1="c"/>',
    "weld with a pose": '<weld body1="b" body2="c" anchor="0.1 0 0.2" relpose="0.1 0.2 0.3 0.9 0.1 -0.2 0.3"/>',
    "weld sites": '<weld site1="s" site2="t"/>',
    "weld that turns": '<weld body1="b" body2="c" anchor="0.1 0 0.2" torquescale="0"/>',
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_is_as_far_from_closed_as_in_mujoco(name, tmp_path, generator):
    """The gap of three coordinates, at random configurations; and all angles at which MuJoCo has it closed."""
    text = TREE.format(head="", equality=LOOPS[name])
    model = mujoco.MjModel.from_xml_string(text)
    data, robot = mujoco.MjData(model), rnc.Robot.from_mjcf(write(tmp_path / "r.xml", text))
    (closure,) = robot.closures
    rows = rnc.LoopClosure(*closure).bind(robot)
    for scale in (0.0, 0.3, 1.0):
        values = {joint: generator.uniform(-scale, scale) for joint in robot.joint_names}
        values["a2"] += 0.2  # where the file has it
        for joint, value in values.items():
            data.qpos[model.joint(joint).qposadr[0]] = value
        mujoco.mj_forward(model, data)
        position = Kinematics(robot).position(robot.configuration(values))
        gap = np.linalg.norm(data.efc_pos[:3])
        # A weld's residual is a screw, whose length differs unless it is small; its points are checked by a connection.
        frame_a, frame_b, kind, offset_a, offset_b, _ = closure
        point = rnc.LoopClosure(frame_a, frame_b, "point", offset_a, offset_b).bind(robot)
        assert np.linalg.norm(point.residual(position)) == pytest.approx(gap, abs=1e-9)
        if kind == "frame":
            angles = 2 * np.arcsin(min(1.0, np.linalg.norm(data.efc_pos[3:6])))
            assert np.linalg.norm(rows.residual(position)[3:]) == pytest.approx(angles, abs=1e-6)


def test_loops_that_are_not_active_or_moved_by_a_user_are_none(tmp_path):
    equality = '<connect body1="b" body2="c" anchor="0 0 0" active="false"/><weld body1="hook" body2="b"/>'
    assert rnc.Robot.from_mjcf(write(tmp_path / "r.xml", TREE.format(head="", equality=equality))).closures == ()


@pytest.mark.filterwarnings("error")
def test_a_loop_that_stays_open_is_warned_of(tmp_path):
    robot = rnc.Robot.from_mjcf(write(tmp_path / "r.xml", TREE.format(head="", equality=LOOPS["connect"])))
    with pytest.warns(rnc.ModelWarning, match="loops that the file closes are open: b and c"):
        rnc.NonholonomicSystem(robot)
    system = rnc.NonholonomicSystem(robot, [rnc.LoopClosure(*closure) for closure in robot.closures])
    assert system.m == 3


@pytest.mark.parametrize(("base", "first", "nv"), [
    (None, "float", 8), ("fixed", "shoulder", 2), ("planar", "root_joint", 5), ("free", "root_joint", 8),
])  # fmt: skip
def test_a_base_takes_the_place_of_the_free_joint(base, first, nv, tmp_path):
    text = (
        '<mujoco><worldbody><body name="b"><freejoint name="float"/><geom size="0.1" mass="3"/>'
        '<body name="one"><joint name="shoulder"/><geom pos="1 0 0" size="0.1" mass="1"/>'
        '<body name="two"><joint name="elbow" axis="0 1 0"/><geom pos="1 0 0" size="0.1" mass="1"/>'
        "</body></body></body></worldbody></mujoco>"
    )
    robot = rnc.Robot.from_mjcf(written(tmp_path, text), base)
    assert (robot.joint_names[0], robot.nv) == (first, nv)


def test_the_floor_of_an_mjcf_is_not_drawn_with_the_robot(tmp_path):
    text = BODY.format("", "").replace("<worldbody>", '<worldbody><geom type="plane" size="1 1 1"/>')
    robot = rnc.Robot.from_mjcf(written(tmp_path, text))
    assert [shape.name for shape in robot.visual_model.geometryObjects] == ["bGeom_0"]


def test_equalities_of_joints_and_bodies_are_listed_and_others_are_named(tmp_path):
    equality = (
        '<joint joint1="b1" joint2="a1" polycoef="0.1 -2 0 0 0"/><tendon tendon1="t"/>'
        '<connect body1="a" body2="b" anchor="0 0 0"/>'
    )
    with pytest.warns(rnc.ModelWarning, match="<equality><tendon> is left out"):
        robot = rnc.Robot.from_mjcf(written(tmp_path, TREE.format(head="", equality=equality)))
    assert robot.mimics == (("b1", "a1", -2.0, 0.1),)
    assert [closure[:3] for closure in robot.closures] == [("a", "b", "point")]


NO_HULL = "<frame><geom size='1'/></frame>"
WORLD = "<mujoco><worldbody>{}</worldbody></mujoco>"


@pytest.mark.parametrize(("text", "words"), [
    (BODY.format('<include file="../elsewhere.xml"/>', ""), "outside the folders of the description"),
    (BODY.format('<include file="/etc/passwd"/>', ""), "outside the folders of the description"),
    (BODY.format('<include file="link.xml"/>', ""), "outside the folders of the description"),
    (BODY.format('<include file="pipe.xml"/>', ""), "no file '/"),
    (BODY.format('<include file="robot.xml"/>', ""), "duplicate <include"),
    (BODY.format(2 * '<include file="parts/defaults.xml"/>', ""), "duplicate <include"),
    (BODY.format('<asset><mesh file="../elsewhere.obj"/></asset>', NO_HULL), "outside the folders of the description"),
    (BODY.format('<compiler meshdir="/etc" strippath="true"/><asset><mesh file="parts/hosts"/></asset>', NO_HULL),
        "outside the folders of the description"),
    (BODY.format("", "<replicate count='1000000000'><geom size='1'/></replicate>"), "more than 20,000 elements"),
    (BODY.format("", 5 * "<replicate count='100'>" + "<body/>" + 5 * "</replicate>"), "more than 20,000 elements"),
    (BODY.format("", "<replicate count='-1'><geom size='1'/></replicate>"), "takes a whole number"),
    (BODY.format("", "<frame><geom size='0'/></frame>"), "robot.xml: "),
    (BODY.format("", "<frame><attach model='x'/></frame>"), "<attach> is not supported"),
    (WORLD.format(f'<body name="a">{SWINGING}<body name="a">{SWINGING}</body></body>'), "repeated name 'a' in body"),
    (WORLD.format('<body><joint/><geom type="capsule" size="0.1" pos="0 0 1" fromto="0 0 0 1 2 3"/></body>'), "both pos and fromto"),
    (WORLD.format('<body><joint class="main"/><geom class="mian" size="1"/></body>'),
        r"unknown default class name 'mian' \(element 'geom'\); did you mean 'main'"),
    (ARM.format('<motor joint="aa"/>'), r"unknown transmission target 'aa' .*; did you mean 'a'"),
    (TREE.format(head="", equality='<connect body1="b" body2="d" anchor="0 0 0"/>'),
        "unknown element 'd' in equality .*expected one of: a, "),
    (TREE.format(head="", equality='<weld site1="s" site2="r"/>'), "unknown element 'r' in equality"),
    (TREE.format(head="", equality='<connect body1="b" anchor="0 0"/>'), "<connect>: anchor takes 3 finite numbers"),
    (TREE.format(head="", equality='<weld body1="b" relpose="0 0 nan 1 0 0 0"/>'), "relpose takes 7 finite numbers"),
])  # fmt: skip
def test_what_is_not_the_descriptions_own_or_makes_no_sense_is_refused_by_name(text, words, folder):
    with pytest.raises(rnc.ModelError, match=words) as raised:
        rnc.Robot.from_mjcf(written(folder, text))
    assert str(raised.value).isprintable()
