"""Files as strangers write them: what is read as it is meant, what is said of it, and remedies that work when followed.

The files are in ``data/dirt``, each named after what is wrong with it.
"""

import ast
import math
import re
import warnings

import numpy as np
import pinocchio as pin
import pytest

import refusals
import rnc_pin as rnc
from places import DIRT, ROOT
from rnc_pin.applications.scenario.schema.world import RobotSource
from rnc_pin.robots.sources.urdf_repairs import snapped_angle, snapped_direction
from tolerances import ROUNDING
from urdf_parts import TETRAHEDRON, XACRO, write


def loaded(name, **options):
    """A robot, and the lines of the model warnings that reading it gave."""
    load = rnc.Robot.from_mjcf if str(name).endswith(".xml") else rnc.Robot.from_urdf
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        robot = load(DIRT / name, **options)
    return robot, [str(each.message) for each in said if issubclass(each.category, rnc.ModelWarning)]


def refusal(name, **options):
    words = refusals.refusal(lambda: loaded(name, **options), rnc.ModelError)
    assert str(DIRT / name) in words
    return words


def axis_of(robot, joint):
    """Direction of a joint's axis in the world at the neutral configuration, (3,)."""
    jacobian = pin.computeJointJacobians(robot.model, robot.model.createData(), pin.neutral(robot.model))
    return jacobian.reshape(6, robot.nv)[3:, robot.velocity_indices(joint).start]


@pytest.mark.parametrize(("text", "twelfths"), [
    *[("1.57", 6), ("1.5708", 6), ("1.5707", 6), ("-1.570796", -6), ("1.570", 6), ("1.570000", 6), ("4.71", 18)],
    *[("3.14", 12), ("3.1416", 12), ("3.1415", 12), ("-3.14159265", -12), ("6.2832", 24), ("6.28", 24)],
    *[("-0.785", -3), (".785", 3), ("0.79", 3), ("2.356", 9), ("2.0944", 8), ("1.047", 4), ("0.5236", 2)],
    *[("3.67e-06", 0), ("-1e-16", 0), ("1.5707e0", 6), ("15.708e-1", 6), ("1.57088", 6)],
])  # fmt: skip
def test_rounded_angles_are_multiples_of_pi(text, twelfths):
    assert snapped_angle(text) == pytest.approx(twelfths * math.pi / 12, rel=1e-15, abs=0)


@pytest.mark.parametrize(
    "text", ["1.5", "1.6", "3.1", "0.5", "0.8", "1.58", "1.573", "0.3", "0.2618", "2e-4", "1", "-0"]
)
def test_other_angles_are_kept(text):
    assert snapped_angle(text) == float(text)


@pytest.mark.parametrize(("text", "exact"), [
    ("0.7071 0.7071 0", (0.5**0.5, 0.5**0.5, 0)),
    ("0.707107 0 -0.707107", (0.5**0.5, 0, -(0.5**0.5))),
    ("0.5 0.866 0", (0.5, 0.75**0.5, 0)),
    ("-0.577 0.577 0.577", (-((1 / 3) ** 0.5), (1 / 3) ** 0.5, (1 / 3) ** 0.5)),
    ("3.7e-6 0 1", (0, 0, 1)),
    ("1 0 -3.6732e-06", (1, 0, 0)),
    ("0 -0.99999 0.00009", (0, -1, 0)),
    ("0.7071 -0.7071 0 0", (0.5**0.5, -(0.5**0.5), 0, 0)),
    ("0.6 0 0.8", (0.6, 0, 0.8)),
    ("0.71 0.7 0", (0.71, 0.7, 0)),
    ("1 1 0", (1, 1, 0)),
    ("0 0 2", (0, 0, 2)),
    ("0.99 0.1 0", (0.99, 0.1, 0)),
    ("1 0.001 0", (1, 0.001, 0)),
    ("0 0 0", (0, 0, 0)),
])  # fmt: skip
def test_rounded_directions_are_exact_and_others_kept(text, exact):
    assert snapped_direction(text.split()) == pytest.approx(exact, rel=1e-15, abs=0)


ROUNDED = {
    "rounded_pi.urdf": (["left_wheel_joint", "right_wheel_joint"], "3 angles or axes are rounded in the file and made "
        "exact (largest change 2e-03 rad, joint 'right_wheel_joint'); snap=False (robot: {snap: false}) keeps them"),
    "rounded_axes.urdf": (["left_wheel_joint", "right_wheel_joint"], "2 angles or axes are rounded"),
    "rounded.xml": (["left_joint", "right_joint"], "rounded in the file"),
}  # fmt: skip


@pytest.mark.parametrize("name", ROUNDED)
def test_rounded_wheels_are_parallel_and_that_is_said_in_one_line(name):
    joints, words = ROUNDED[name]
    robot, (said,) = loaded(name)
    assert said.startswith(f"{name}: ")
    assert words in said
    for joint in joints:
        np.testing.assert_allclose(abs(axis_of(robot, joint)), [0, 1, 0], atol=1e-15)
    robot, said = loaded(name, snap=False)
    assert said == []
    assert max(abs(axis_of(robot, joint))[[0, 2]].max() for joint in joints) > 1e-6


@pytest.mark.filterwarnings("error")
def test_the_robots_that_come_along_are_not_warned_of():
    for name in ("tiago", "tiago_no_hand", "panda"):
        rnc.Robot.from_example(name)


@pytest.mark.filterwarnings("error")
def test_a_scenario_keeps_roundings_and_gives_masses():
    RobotSource(urdf="rounded_pi.urdf", snap=False).build(DIRT)
    masses = {"knuckle": 0.2, "fork": 0.1}
    robot = RobotSource(urdf="massless_knuckle.urdf", masses=masses).build(DIRT)
    assert robot.model.inertias[robot.joint_id("steer")].mass == 0.2
    with pytest.raises(ValueError, match="'masses' belongs to 'urdf' and 'example'"):
        RobotSource(mjcf="rounded.xml", masses=masses)


REFUSED = {
    "massless_knuckle.urdf": "joints 'caster', 'steer' move no mass: give 2 links masses with masses={'fork': 0.1, "
    "'knuckle': 0.14}",
    "nothing_has_a_mass.urdf": "joints 'shoulder', 'elbow' move no mass: give 2 links masses with masses={'upper'",
    "inertia_not_positive.urdf": "rotational inertia behind joint 'shoulder' is not positive: give link 'tool' a mass "
    "with masses={'tool': 0.7}",
    "negative_mass.urdf": "mass of link 'tool' is negative: -0.1 kg; give it another with masses={'tool': 0.1}",
    "point_masses.urdf": "can move without moving mass: give link 'base' a mass with masses={'base': 0.1}",
}


def test_inertia_without_mass_is_idealised_and_loads():
    robot, said = loaded("inertia_without_mass.urdf", base="fixed")
    words = "rotational inertia but zero mass behind shoulder: such bodies are idealised, so check the file"
    assert said == [f"robot 'cart': {words}"]
    assert pin.crba(robot.model, robot.model.createData(), pin.neutral(robot.model)) == pytest.approx(0.1)


@pytest.mark.parametrize("name", REFUSED)
def test_a_remedy_works_when_it_is_followed(name):
    base = "free" if name == "point_masses.urdf" else "fixed"
    words = refusal(name, base=base)
    assert REFUSED[name] in words
    robot, _ = loaded(name, base=base, masses=ast.literal_eval(re.search(r"masses=({.*?})", words)[1]))
    assert robot.nv > 0


SHAPES = {
    "tilted cylinder": ('<origin rpy="1.5707963267948966 0 0"/>', '<cylinder radius="0.3" length="0.1"/>',
        (0.6, 0.1, 0.6)),
    "sphere": ("", '<sphere radius="0.2"/>', (0.4, 0.4, 0.4)),
    "mesh": ("", '<mesh filename="package://shapes/t.obj" scale="2 1 1"/>', (2, 1, 1)),
    "missing mesh": ("", '<mesh filename="package://shapes/u.obj"/>', 3 * [0.05 * (12 / 5) ** 0.5]),
}  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
def test_a_mass_is_spread_over_every_kind_of_geometry(shape, tmp_path):
    write(tmp_path / "shapes/t.obj", TETRAHEDRON)
    origin, geometry, edges = SHAPES[shape]
    text = (DIRT / "massless_knuckle.urdf").read_text()
    text = text.replace('<origin xyz="0.1 0 0"/><geometry><box size="0.2 0.04 0.06"/>', f"{origin}<geometry>{geometry}")
    robot = rnc.Robot.from_urdf(write(tmp_path / "robot.urdf", text), masses={"knuckle": 1.2, "fork": 1})
    moments = 0.1 * (np.sum(np.square(edges)) - np.square(edges))
    np.testing.assert_allclose(np.diag(robot.model.inertias[robot.joint_id("steer")].inertia), moments, rtol=1e-6)


@pytest.mark.parametrize(("masses", "words"), [
    ({"knuckel": 0.1}, "no link 'knuckel'; did you mean 'knuckle'"),
    ({"knuckle": 0}, "mass of link 'knuckle' has to be positive [kg], found 0"),
    ({"knuckle": "heavy"}, "has to be positive"),
    ({"base": 3.0}, "link 'base' has an inertia of its own ("),
])  # fmt: skip
def test_masses_that_are_none_are_refused(masses, words):
    assert words in refusal("massless_knuckle.urdf", masses=masses)


def test_a_link_and_a_joint_of_one_name():
    whole, said = loaded("link_and_joint_of_one_name.urdf")
    assert said == []
    robot, _ = loaded("link_and_joint_of_one_name.urdf", lock={"right": 0.5})
    assert (robot.joint_names, [frame.name for frame in robot.model.frames].count("right")) == (("left",), 2)
    assert robot.model.frames[robot.frame_id("right")].type == pin.FrameType.BODY
    assert len(robot.collision_model.geometryObjects) == len(whole.collision_model.geometryObjects) == 3
    for each in (whole, robot):
        carried = {shape.name[:-2]: shape.parentJoint for shape in each.collision_model.geometryObjects}
        assert carried["left"] == carried["hand"] == each.joint_id("left")
    arm = rnc.Robot.from_example("panda")
    names = [frame.name for frame in whole.attach(arm, "left").model.frames]
    assert sorted(names[1:]) == sorted(each.name for of in (whole, arm) for each in list(of.model.frames)[1:])
    rolling, _ = loaded("link_and_joint_of_one_name.urdf", base="planar")
    assert rnc.NonholonomicSystem(rolling, [rnc.NoSideSlip("left")]).m == 1


def test_a_joint_with_the_name_of_the_bases(tmp_path):
    text = (DIRT / "negative_and_skew_axes.urdf").read_text().replace("left_wheel_joint", "root_joint")
    (tmp_path / "robot.urdf").write_text(text)
    assert "root_joint" in rnc.Robot.from_urdf(tmp_path / "robot.urdf").joint_names
    with pytest.raises(rnc.ModelError, match="'root_joint' has the name of a planar base's own: rename it"):
        rnc.Robot.from_urdf(tmp_path / "robot.urdf", base="planar")
    (tmp_path / "robot.urdf").write_text((DIRT / "no_world.urdf").read_text().replace('"weld"', '"root_joint"'))
    with pytest.warns(rnc.ModelWarning, match="'world'"):
        robot = rnc.Robot.from_urdf(tmp_path / "robot.urdf", base="planar", lock={"left_wheel_joint": 0.1})
    assert robot.joint_names == ("root_joint",)


def test_macros_and_expressions_inside_a_urdf_are_expanded():
    wide, _ = loaded("macros_inside.urdf", xacro_arguments={"track": 1.0})
    assert [pose.translation[1] for pose in list(wide.model.jointPlacements)[1:]] == [0.5, -0.5]
    robot, _ = loaded("expression_inside.urdf")
    np.testing.assert_allclose(robot.model.jointPlacements[1].rotation, pin.rpy.rpyToMatrix(0, 0, 1.5), atol=ROUNDING)
    robot, _ = loaded("argument_without_default.urdf.xacro", xacro_arguments={"track": 0.3})
    assert robot.model.jointPlacements[1].translation[1] == 0.3
    assert "xacro arguments are for a file" in refusal("namespace_only.urdf", xacro_arguments={"track": 1})


def test_a_call_of_a_macro_that_the_file_does_not_include_is_not_known(tmp_path):
    (tmp_path / "r.xacro").write_text(f'<robot name="r" {XACRO}><cart/></robot>')
    with pytest.raises(rnc.ModelError, match="<cart> is not known: a macro is called with its prefix, <xacro:cart>"):
        rnc.Robot.from_urdf(tmp_path / "r.xacro")


def limited(limit, tmp_path):
    """A robot with two joints of this limit, a lift and a wrist, what was said of it, and the limits."""
    (tmp_path / "r.urdf").write_text(re.sub("<limit .*?/>", limit, (DIRT / "no_limits.urdf").read_text()))
    robot, said = loaded(tmp_path / "r.urdf")
    at = [robot.velocity_indices(name).start for name in ("lift", "wrist")]
    model = robot.model
    limits = model.lowerPositionLimit, model.upperPositionLimit, model.effortLimit, model.velocityLimit
    return said[1:], [tuple(each[k] for each in limits) for k in at]


NEGATIVE = "has a negative limit of effort or velocity, which is taken as infinite"
UNSTATED = "has a <limit> without lower and upper and is taken as unlimited"
OPEN = np.inf


@pytest.mark.parametrize(("limit", "words", "expected"), [
    ('<limit lower="-1" upper="1" effort="-1.0" velocity="-1"/>', NEGATIVE, (-1, 1, OPEN, OPEN)),  # as in SDF
    ('<limit lower="-1" upper="1" effort="3" velocity="-1"/>', NEGATIVE, (-1, 1, 3, OPEN)),
    ('<limit effort="1" velocity="1"/>', UNSTATED, (-OPEN, OPEN, 1, 1)),
    ('<limit lower="0" effort="1" velocity="1"/>', UNSTATED, (-OPEN, OPEN, 1, 1)),
    ('<limit upper="0" effort="1" velocity="1"/>', UNSTATED, (-OPEN, OPEN, 1, 1)),
    ('<limit lower="0" upper="0" effort="1" velocity="1"/>', "", (0, 0, 1, 1)),
])  # fmt: skip
def test_a_limit_that_is_none_is_infinite(limit, words, expected, tmp_path):
    said, limits = limited(limit, tmp_path)
    assert (said, limits) == ([f"r.urdf: {words}: joint lift, wrist"] if words else [], [expected, expected])


def test_joints_without_limits_move_without_end():
    robot, said = loaded("no_limits.urdf")
    assert said == [
        "no_limits.urdf: has no <limit> and is taken as unlimited: joint shoulder",
        "no_limits.urdf: has no limit of effort or velocity, which is taken as infinite: joint lift",
    ]
    assert robot.model.lowerPositionLimit[robot.velocity_indices("shoulder").start] == -np.inf
    assert robot.model.effortLimit[robot.velocity_indices("lift").start] == np.inf
    assert axis_of(robot, "wrist").tolist() == [1, 0, 0]
    assert np.isfinite(robot.random_configuration(np.random.default_rng(0))).all()


@pytest.mark.parametrize("namespace", [
    'xmlns="http://drake.mit.edu"',
    'xmlns="http://www.ros.org" xmlns:sim="http://simulators.org"',
    'xmlns="http://simulators.org" xmlns:sim="http://simulators.org"',
    "",  # urdfdom does not ask for a declaration
])  # fmt: skip
def test_namespaces_are_read_as_by_urdfdom(namespace, tmp_path):
    """It knows none: a default namespace changes no name, and an element with a prefix has another name."""
    text = (DIRT / "no_limits.urdf").read_text()
    foreign = '<sim:joint name="foreign" type="fixed"/><sim:link name="foreign"><sim:mass value="1"/></sim:link>'
    text = text.replace("<robot ", f"<robot {namespace} ").replace("</robot>", f"{foreign}</robot>")
    robot, said = loaded(write(tmp_path / "r.urdf", text))
    plain, usual = loaded("no_limits.urdf")
    assert robot.joint_names == plain.joint_names
    assert [each.name for each in robot.model.frames] == [each.name for each in plain.model.frames]
    assert [each.partition(":")[2] for each in said] == [each.partition(":")[2] for each in usual]
    theirs = pin.buildModelFromXML((DIRT / "continuous_with_limits.urdf").read_text())
    named = (DIRT / "continuous_with_limits.urdf").read_text().replace("<robot ", f"<robot {namespace} ")
    assert pin.buildModelFromXML(named) == theirs  # what urdfdom itself does


READ = {
    "byte_order_mark.urdf": (("left_wheel_joint",), []),
    "blank_before_declaration.urdf": (("left_wheel_joint",), []),
    "latin_1.urdf": (("left_wheel_joint",), []),
    "simulator_tags.urdf": (("shoulder",), []),
    "macros_inside.urdf": (("left_wheel_joint", "right_wheel_joint"), []),
    "namespace_only.urdf": (None, []),
    "no_name.urdf": (None, ["<robot> has no name and is called 'no_name' after its file"]),
    "no_world.urdf": (None, ["names 'world' as a parent, which is added as a link"]),
    "floating_and_planar.urdf": (None, ["planar joint without an axis, which moves in its x-y plane: shift"]),
    "commas.urdf": (None, ["has too many numbers, the last are ignored: xyz of joint 'arm_joint'"]),
    "incomplete_inertials.urdf": (None, ["<inertial> without a mass is left out: link base",
        "<inertial> without an <inertia> is taken as a point: link arm"]),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_what_is_written_another_way_is_read_and_said(name):
    joints, words = READ[name]
    robot, said = loaded(name)
    assert said == [f"{name}: {each}" for each in words]
    assert joints in (None, robot.joint_names)


REFUSED_FILES = {
    "two_links_of_one_name.urdf": "link 'arm' is not unique",
    "two_joints_of_one_name.urdf": "joint 'turn' is not unique",
    "decimal_commas.urdf": "<origin> of joint 'left_wheel_joint': xyz is '0 0,2 0': write a point for the decimals",
    "planar_across.urdf": "has axis '1 0 0'",
    "ball_joint.urdf": "type 'spherical'; expected one of: fixed, revolute",
    "several_roots.urdf": "several root links: [base], [island], [rock]: attach all but one with fixed joints",
    "nothing.urdf": "has no links",
    "missing_package.urdf.xacro": "no package 'gazebo_stuff': give its folder in package_dirs (--package-dir)",
    "missing_include.urdf.xacro": "gazebo/nowhere.xacro': No such file",
    "argument_without_default.urdf.xacro": "give it with xacro_arguments={'track': ...} (--arg track=...)",
    "macros_only.urdf.xacro": "it only defines macros (cart): give the file that calls them",
    "call_without_prefix.urdf.xacro": "element <cart>: a macro of this name exists; write <xacro:cart> (line 5)",
}


@pytest.mark.parametrize("name", REFUSED_FILES)
def test_what_is_no_robot_is_refused_by_name(name):
    assert REFUSED_FILES[name] in refusal(name)


def test_numbers_are_those_of_the_file():
    robot, _ = loaded("commas.urdf")
    joints = (robot.joint_id(f"{name}_joint") for name in ("left_wheel", "arm"))
    places = [robot.model.jointPlacements[joint].translation.tolist() for joint in joints]
    assert places == [[0, 0.2, 0], [0.1, 0, 0]]
    robot, _ = loaded("incomplete_inertials.urdf")
    assert robot.model.inertias[robot.joint_id("shoulder")].mass == 2
    np.testing.assert_allclose(robot.model.inertias[robot.joint_id("wrist")].inertia, 0.1 * np.eye(3), atol=ROUNDING)
    assert (loaded("floating_and_planar.urdf")[0].nv, loaded("no_name.urdf")[0].name) == (6 + 3 + 3, "no_name")


def test_limits_of_a_continuous_joint_do_not_bound_it():
    robot, said = loaded("continuous_with_limits.urdf")
    assert said == []
    assert robot.joint_values(robot.configuration({"wheel_joint": 2.0})) == pytest.approx({"wheel_joint": 2.0})
    assert robot.model.effortLimit.tolist() == [7]


def test_a_capsule_is_a_cylinder_and_shapes_of_no_urdf_are_left_out():
    robot, (said,) = loaded("capsules.urdf")
    assert "mesh): <visual> of 'arm'" in said
    (shape,) = robot.collision_model.geometryObjects
    assert (shape.geometry.radius, 2 * shape.geometry.halfLength) == pytest.approx((0.1, 0.8))


def test_every_file_of_dirt_is_told_of():
    told = "".join(path.read_text() for room in ("tests/**/test_", "benchmarks/") for path in ROOT.glob(f"{room}*.py"))
    assert [path.name for path in DIRT.iterdir() if path.name.partition(".")[0] not in told] == []
