"""Robots from MJCF and xacro, packages without ROS, and what Pinocchio passes over in silence."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from rnc_pin.robots.sources.description import Packages, package_name
from tolerances import ROUNDING
from urdf_parts import TETRAHEDRON, XACRO, write


def urdf(mimic="", moments=(1, 1, 1), visual="", mass=2):
    xx, yy, zz = moments
    body = (
        f'<inertial><origin xyz="0.3 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    joint = (
        '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>{}<origin xyz="0.5 0 0.1"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="3" velocity="1"/><dynamics damping="0.2"/></joint>'
    )
    links = f'<link name="ground">{visual}</link><link name="one">{body}</link><link name="two">{body}</link>'
    joints = joint.format("shoulder", "ground", "one", "") + joint.format("elbow", "one", "two", mimic)
    return f'<robot name="arm">{links}{joints}</robot>'


MJCF = """<mujoco model="arm"><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>
  <geom type="plane" size="1 1 1"/>
  <body name="one" pos="0.5 0 0.1">{root}<joint name="shoulder" axis="0 1 0" range="-1 1" damping="0.2"/>
    <inertial pos="0.3 0 0" mass="2" diaginertia="1 1 1"/><geom type="sphere" size="0.05" contype="0"/>
    <body name="two" pos="0.5 0 0.1"><joint name="elbow" axis="0 1 0" range="-1 1" damping="0.2"/>
      <inertial pos="0.3 0 0" mass="2" diaginertia="1 1 1"/></body></body></worldbody>{more}</mujoco>"""


def mjcf(root="", more=""):
    return MJCF.format(root=root, more=more)


@pytest.mark.parametrize("lock", [None, {"elbow": 0.4}], ids=["whole", "locked"])
@pytest.mark.parametrize("gravity", [None, (0, 0, -1.62)], ids=["earth", "moon"])
def test_one_arm_has_the_same_dynamics_as_mjcf_and_as_urdf(lock, gravity, tmp_path):
    one = rnc.Robot.from_urdf(write(tmp_path / "arm.urdf", urdf()), lock=lock, gravity=gravity)
    other = rnc.Robot.from_mjcf(write(tmp_path / "arm.xml", mjcf()), lock=lock, gravity=gravity)
    assert one.joint_names == other.joint_names
    generator = np.random.default_rng(0)
    for _ in range(3):
        q, v, a = (generator.uniform(-1, 1, one.nv) for _ in range(3))
        torques = [pin.rnea(robot.model, robot.model.createData(), q, v, a) for robot in (one, other)]
        np.testing.assert_allclose(*torques, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(other.model.lowerPositionLimit, one.model.lowerPositionLimit)
    np.testing.assert_allclose(other.model.damping, one.model.damping)


def test_gravity_of_an_mjcf_is_the_files(tmp_path):
    """Pinocchio's parser leaves the option out."""
    path = write(tmp_path / "arm.xml", mjcf().replace("-9.81", "-1.62"))
    assert rnc.Robot.from_mjcf(path).model.gravity.linear.tolist() == [0, 0, -1.62]


@pytest.mark.parametrize(("base", "first", "nv"), [
    (None, "float", 8), ("fixed", "shoulder", 2), ("planar", "root_joint", 5), ("free", "root_joint", 8),
])  # fmt: skip
def test_a_base_takes_the_place_of_the_free_joint(base, first, nv, tmp_path):
    text = (
        '<mujoco><worldbody><body name="b"><freejoint name="float"/>'
        '<geom size="0.1" mass="3"/>'
        '<body name="one"><joint name="shoulder"/><geom pos="1 0 0" size="0.1" mass="1"/>'
        '<body name="two"><joint name="elbow" axis="0 1 0"/><geom pos="1 0 0" size="0.1" mass="1"/>'
        "</body></body></body></worldbody></mujoco>"
    )
    robot = rnc.Robot.from_mjcf(write(tmp_path / "arm.xml", text), base)
    assert robot.joint_names[0] == first
    assert robot.nv == nv


def test_the_floor_of_an_mjcf_is_not_drawn_with_the_robot(tmp_path):
    robot = rnc.Robot.from_mjcf(write(tmp_path / "arm.xml", mjcf()))
    assert [shape.name for shape in robot.visual_model.geometryObjects] == ["oneGeom_0"]


def test_equalities_of_joints_and_bodies_are_listed_and_others_are_named(tmp_path):
    joint = '<joint joint1="elbow" joint2="shoulder" polycoef="0.1 -2 0 0 0"/>'
    more = f'<equality>{joint}<connect body1="one" body2="two" anchor="0 0 0"/><tendon tendon1="t"/></equality>'
    with pytest.warns(rnc.ModelWarning, match="<equality><tendon> is left out"):
        robot = rnc.Robot.from_mjcf(write(tmp_path / "arm.xml", mjcf(more=more)))
    assert robot.mimics == (("elbow", "shoulder", -2.0, 0.1),)
    assert [closure[:3] for closure in robot.closures] == [("one", "two", "point")]


@pytest.mark.parametrize(
    ("of", "words"), [("sholder", "did you mean 'shoulder'"), ("elbow", "expected one of: shoulder")]
)
def test_a_mimic_of_nobody_is_named_and_left_out(of, words, tmp_path):
    path = write(tmp_path / "arm.urdf", urdf(f'<mimic joint="{of}"/>'))
    with pytest.warns(rnc.ModelWarning, match=f"mimic of an invalid joint is ignored: 'elbow' of '{of}'; {words}"):
        assert rnc.Robot.from_urdf(path).mimics == ()


@pytest.mark.parametrize(("moments", "possible"), [((1, 1, 2), True), ((0, 0, 0), True), ((1, 1, 2.1), False)])
def test_an_inertia_that_no_body_has_is_named(moments, possible, tmp_path):
    path = write(tmp_path / "arm.urdf", urdf(moments=moments))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        rnc.Robot.from_urdf(path)
    assert [str(each.message).split(": ")[1] for each in said if each.category is rnc.ModelWarning] == (
        [] if possible else ["impossible rotational inertia behind shoulder, elbow"]
    )


MESH = '<visual><geometry><mesh filename="package://shapes/meshes/t.obj"/></geometry></visual>'


def names(robot):
    return len(robot.visual_model.geometryObjects) - len(robot.stand_ins)


@pytest.mark.parametrize(("package", "file", "options", "variable"), [
    ("ws/shapes", "ws/shapes/urdf/arm.urdf", {}, None),  # the file is in the package
    ("ws/shapes", "ws/arm_description/urdf/arm.urdf", {}, None),  # the package is beside the file's
    ("else/shapes", "arm.urdf", {"package_dirs": ["else"]}, None),
    ("else/shapes", "arm.urdf", {"package_dirs": ["else/shapes"]}, None),  # the package itself
    ("else/shapes", "arm.urdf", {}, ("ROS_PACKAGE_PATH", "nowhere:else")),
    ("else/share/shapes", "arm.urdf", {}, ("AMENT_PREFIX_PATH", "else")),
    ("git-checkout", "git-checkout/urdf/arm.urdf", {}, None),  # by the name in its manifest
], ids=["inside", "beside", "folder", "itself", "ROS 1", "ROS 2", "another name"])  # fmt: skip
def test_a_package_is_found(package, file, options, variable, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / package / "meshes/t.obj", TETRAHEDRON)
    if "arm_description" in file or package == "git-checkout":  # else the folder could be anybody's
        write(tmp_path / package / "package.xml", "<package><name>shapes</name></package>")
    path = write(tmp_path / file, urdf(visual=MESH))
    if variable:
        monkeypatch.setenv(*variable)
    assert names(rnc.Robot.from_urdf(path, **options)) == 1


@pytest.mark.parametrize("name", ["$(find shapes)/meshes/t.obj", "file://$(find  shapes )/meshes/t.obj"])
def test_a_package_is_found_as_xacro_names_it_although_the_file_is_none(name, tmp_path):
    text = urdf(visual=MESH.replace("package://shapes/meshes/t.obj", name))
    write(tmp_path / "checkout/meshes/t.obj", TETRAHEDRON)
    path = write(tmp_path / "checkout/urdf/arm.urdf", text)
    robot = rnc.Robot.from_urdf(path)
    with pytest.warns(rnc.ModelWarning, match=r"1 mesh was not found: package 'shapes' \(1\); give the folder"):
        assert names(robot) == 0
    write(tmp_path / "checkout/package.xml", "<package><name>shapes</name></package>")
    package_name.cache_clear()
    assert names(rnc.Robot.from_urdf(path)) == 1


@pytest.mark.parametrize("name", ["", "..", "a/b", "nowhere_at_all"])
def test_a_package_of_no_name_is_not_found(name, tmp_path):
    assert Packages(tmp_path).folder(name) is None


def test_each_file_finds_its_own_packages(tmp_path):
    for number in (1, 2):
        write(tmp_path / f"{number}/parts/package.xml", "<package><name>parts</name></package>")
        write(tmp_path / f"{number}/parts/arm.xacro", urdf(mass=number).replace("<robot ", f"<robot {XACRO} "))
        text = f'<robot name="r" {XACRO}><xacro:include filename="$(find parts)/arm.xacro"/></robot>'
        robot = rnc.Robot.from_urdf(write(tmp_path / f"{number}/mine/robot.xacro", text))
        assert robot.model.inertias[1].mass == number
