"""Robots from files: what is in them, how names and joints are treated, and one line for whatever is wrong."""

import warnings
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

import refusals
import rnc_pin as rnc
from bodies import add_body
from refusals import refused
from rnc_pin.robots.robot_files import find_example, find_urdf
from tolerances import ROUNDING
from urdf_parts import INERTIAL, inertial, write

GRAVITY = (0.0, 0.0, -9.81)


@pytest.mark.parametrize(("file", "base", "body", "links"), [
    ("space_robot.urdf", "fixed", "platform", ["joint_1", "joint_2", "joint_3"]),
    ("mobile_manipulator.urdf", "planar", "root_joint", ["joint_1", "joint_2"]),
])  # fmt: skip
def test_case_studies_have_the_inertia_of_the_paper(file, base, body, links):
    """M = J = 10, about the pin or the middle of the axle, and a point mass at the far end of each link of 1 m."""
    robot = rnc.Robot.from_urdf(file, base=base)
    own, *others = (robot.model.inertias[robot.joint_id(joint)] for joint in (body, *links))
    assert (own.mass, own.lever.tolist(), own.inertia[2, 2]) == (10.0, [0.0, 0.0, 0.0], 10.0)
    for each in others:
        assert (each.mass, each.lever.tolist()) == (10.0, [1.0, 0.0, 0.0])
        assert not each.inertia.any()


def test_any_pinocchio_model_will_do_and_has_no_geometry_unless_given():
    model = rnc.Robot.from_urdf("space_robot.urdf").model
    assert rnc.Robot(model).visual_model is None
    assert rnc.Robot(model).joint_names == ("platform", "joint_1", "joint_2", "joint_3")


def test_a_file_is_found_relative_to_where_one_stands_before_a_shipped_one(tmp_path, monkeypatch):
    (tmp_path / "space_robot.urdf").write_text(urdf())
    monkeypatch.chdir(tmp_path)
    assert rnc.Robot.from_urdf("space_robot.urdf").name == "tiny"
    assert rnc.Robot.from_urdf("fire_truck.urdf").name == "fire_truck"


def test_gravity_is_the_one_given_and_the_earths_otherwise():
    def torque(gravity):
        robot = rnc.Robot.from_example("double_pendulum_continuous", gravity=gravity)
        q = robot.configuration({"joint1": 0.4, "joint2": 0.9})
        return pin.computeGeneralizedGravity(robot.model, robot.model.createData(), q)

    assert np.abs(torque(None)).min() > 0.01
    np.testing.assert_array_equal(torque((0, 0, 0)), 0.0)
    np.testing.assert_allclose(torque((0, 0, -1.62)), torque(GRAVITY) * 1.62 / 9.81, rtol=ROUNDING)
    # Pinocchio's default must not have been changed for robots loaded later.
    np.testing.assert_array_equal(torque(None), torque(GRAVITY))


@pytest.mark.parametrize(("load", "lock"), [
    (lambda **options: rnc.Robot.from_urdf("space_robot.urdf", **options), {"joint_2": 0.7}),
    (lambda **options: rnc.Robot.from_urdf("fire_truck.urdf", base="planar", **options), {"hitch": -0.4}),
    (lambda **options: rnc.Robot.from_example("panda", base="free", **options),
        {"panda_joint4": -1.2, "panda_finger_joint1": 0.02}),
    (lambda **options: rnc.Robot.from_example("double_pendulum_continuous", **options), {"joint2": 0.9}),
], ids=["space_robot", "fire_truck", "panda", "continuous"])  # fmt: skip
def test_a_locked_joint_is_gone_and_the_rest_moves_as_with_the_joint_held(load, lock, generator):
    whole, locked = load(), load(lock=lock)
    assert len(locked.visual_model.geometryObjects) == len(whole.visual_model.geometryObjects)
    assert set(locked.joint_names) == set(whole.joint_names) - set(lock)
    q, v = locked.random_configuration(generator), generator.uniform(-1, 1, locked.nv)
    whole_q, whole_v = whole.configuration(lock), np.zeros(whole.nv)
    moving = []
    for name in locked.joint_names:
        here, there = locked.model.joints[locked.joint_id(name)], whole.model.joints[whole.joint_id(name)]
        whole_q[there.idx_q : there.idx_q + there.nq] = q[here.idx_q : here.idx_q + here.nq]
        whole_v[there.idx_v : there.idx_v + there.nv] = v[here.idx_v : here.idx_v + here.nv]
        moving += range(there.idx_v, there.idx_v + there.nv)
    data, whole_data = locked.model.createData(), whole.model.createData()
    inertia, whole_inertia = pin.crba(locked.model, data, q), pin.crba(whole.model, whole_data, whole_q)
    np.testing.assert_allclose(inertia, whole_inertia[np.ix_(moving, moving)], atol=ROUNDING)
    bias, whole_bias = pin.nle(locked.model, data, q, v), pin.nle(whole.model, whole_data, whole_q, whole_v)
    np.testing.assert_allclose(bias, whole_bias[moving], atol=ROUNDING)


@pytest.mark.parametrize(("load", "values", "expected"), [
    (lambda: rnc.Robot.from_urdf("space_robot.urdf"), None, [0, 0, 0, 0]),
    (lambda: rnc.Robot.from_urdf("space_robot.urdf"), {"joint_2": 7.0}, [0, 0, 7, 0]),
    (lambda: rnc.Robot.from_example("double_pendulum_continuous"), {"joint2": 2.0}, [1, 0, np.cos(2.0), np.sin(2.0)]),
    (lambda: rnc.Robot.from_urdf("mobile_manipulator.urdf", base="planar"),
        {"root_joint": [1, 2, 0.5], "joint_2": 0.3}, [1, 2, np.cos(0.5), np.sin(0.5), 0, 0.3]),
    (lambda: rnc.Robot.from_urdf("mobile_manipulator.urdf", base="free"),
        {"root_joint": [1, 2, 3, 0, 0, 3, 4]}, [1, 2, 3, 0, 0, 0.6, 0.8, 0, 0]),  # a quaternion of any length
], ids=["neutral", "revolute", "continuous", "planar", "free"])  # fmt: skip
def test_configuration(load, values, expected):
    np.testing.assert_allclose(load().configuration(values), expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("load", [
    lambda: rnc.Robot.from_urdf("fire_truck.urdf", base="planar"),
    lambda: rnc.Robot.from_example("panda", base="free"),
    lambda: rnc.Robot.from_example("double_pendulum_continuous"),
], ids=["planar", "free", "continuous"])  # fmt: skip
def test_random_configurations_are_seeded_normalised_and_within_limits(load):
    robot = load()
    one, same, other = (np.random.default_rng(seed) for seed in (1, 1, 2))
    drawn = np.stack([robot.random_configuration(one) for _ in range(50)])
    np.testing.assert_array_equal(drawn, [robot.random_configuration(same) for _ in range(50)])
    assert np.abs(drawn[0] - robot.random_configuration(other)).max() > 1e-3
    assert (np.ptp(drawn, axis=0) > 1e-3).all()
    assert all(pin.isNormalized(robot.model, q, ROUNDING) for q in drawn)
    for joint in list(robot.model.joints)[1:]:
        if joint.nq == 1:
            values = drawn[:, joint.idx_q]
            assert robot.model.lowerPositionLimit[joint.idx_q] <= values.min()
            assert values.max() <= robot.model.upperPositionLimit[joint.idx_q]


def urdf(arm=INERTIAL, joint_type="revolute", origin="0 0 0", more=""):
    """A link on a hinge."""
    return (
        f'<robot name="tiny"><link name="ground"/><link name="arm">{arm}</link><joint name="hinge" type="{joint_type}">'
        f'<parent link="ground"/><child link="arm"/><origin xyz="{origin}"/><axis xyz="0 0 1"/>'
        f'<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>{more}</robot>'
    )


SECOND_HINGE = """<link name="hand"/><joint name="wrist" type="continuous">
    <parent link="arm"/><child link="hand"/><axis xyz="0 0 1"/></joint>"""

BAD_FILES = {
    "not XML": ("wheels: 4", ["not well-formed XML", "line 1"]),
    "unknown joint type": (urdf(joint_type="rotating"), ["hinge", "rotating"]),
    "unknown child": (urdf().replace('child link="arm"', 'child link="am"'), ["hinge", "am"]),
    "NaN mass": (urdf(inertial(mass="nan")), ["nan", "arm"]),
    "NaN inertia": (urdf(inertial(moment="nan")), ["arm"]),
    "NaN origin": (urdf(origin="0 nan 0"), ["nan", "hinge"]),
    "negative mass": (urdf(inertial(mass="-2")), ["mass behind joint 'hinge' is negative: -2 kg"]),
    "negative inertia": (urdf(inertial(moment="-1")), ["inertia behind joint 'hinge' is not positive"]),
    "joint that moves no mass": (urdf(arm=""), ["joint 'hinge' moves no mass"]),
    "last joint moves no mass": (urdf(more=SECOND_HINGE), ["joint 'wrist' moves no mass"]),
    "two joints move one mass": (urdf(arm="", more=SECOND_HINGE.replace("/><joint", f">{INERTIAL}</link><joint", 1)),
        ["inertia matrix is singular", "can move without moving mass"]),
    "nothing moves": ('<robot name="tiny"><link name="ground"/></robot>', ["'tiny' has no moving joint"]),
}  # fmt: skip


def refusal(call, capfd):
    """The one line that a call is refused with, nothing else being printed."""
    message = refusals.refusal(call, rnc.ModelError)
    assert capfd.readouterr() == ("", "")
    return message


@pytest.mark.parametrize(("text", "words"), BAD_FILES.values(), ids=BAD_FILES)
def test_a_file_that_describes_no_robot_is_refused_in_one_line(text, words, tmp_path, capfd):
    message = refusal(lambda: rnc.Robot.from_urdf(write(tmp_path / "bad.urdf", text)), capfd)
    assert all(word in message for word in words), message


def space_robot(**options):
    return rnc.Robot.from_urdf("space_robot.urdf", **options)


BAD_CALLS = {
    "no such file": (lambda: rnc.Robot.from_urdf("/nowhere/arm.urdf"), ["no URDF file '/nowhere/arm.urdf'"]),
    "a folder": (lambda: rnc.Robot.from_urdf("/proc"), ["no URDF file '/proc'"]),
    "unknown example": (lambda: rnc.Robot.from_example("zzzz"), ["'zzzz'", "expected one of"]),
    # The massless ground would be carried along, and its yaw is the platform's.
    "base of no mass": (lambda: space_robot(base="planar"), ["inertia matrix is singular"]),
    "NaN gravity": (lambda: space_robot(gravity=(0, 0, np.nan)), ["gravity", "three finite numbers"]),
    "gravity in words": (lambda: space_robot(gravity="down"), ["gravity", "three finite numbers"]),
    "misspelt joint": (lambda: space_robot().joint_id("platfrom"), ["joint 'platfrom'", "did you mean 'platform'?"]),
    "misspelt frame": (lambda: space_robot().frame_id("tpi"), ["frame 'tpi'", "did you mean 'tip'?"]),
    "part of a name": (lambda: space_robot().joint_id("plat"), ["did you mean 'platform'?"]),
    "joint by number": (lambda: space_robot().joint_id(2), ["no joint '2'", "expected one of: platform"]),
    "NaN lock": (lambda: space_robot(lock={"joint_2": np.nan}), ["joint 'joint_2' takes finite numbers, found nan"]),
    "all locked": (lambda: space_robot(lock=dict.fromkeys(["platform", "joint_1", "joint_2", "joint_3"], 0.0)),
        ["'space_robot' has no moving joint"]),
    "locked base": (lambda: rnc.Robot.from_urdf("fire_truck.urdf", base="planar", lock={"root_joint": [0, 0, 0]}),
        ["'root_joint' cannot be locked", "base='fixed'"]),
    "planar base without yaw": (lambda: rnc.Robot.from_urdf("fire_truck.urdf",
        base="planar").configuration({"root_joint": [1, 2]}), ["'root_joint' takes 3 (x, y, yaw) values, found 2"]),
    "quaternion of no length": (lambda: rnc.Robot.from_urdf("fire_truck.urdf",
        base="free").configuration({"root_joint": [0] * 7}), ["'root_joint'", "zero length"]),
}  # fmt: skip


@pytest.mark.parametrize(("call", "words"), BAD_CALLS.values(), ids=BAD_CALLS)
def test_a_wrong_argument_is_refused_in_one_line(call, words, capfd):
    message = refusal(call, capfd)
    assert all(word in message for word in words), message


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_model_with_an_inertia_that_is_not_finite_is_refused(bad, capfd):
    model = pin.Model()
    add_body(model, "hinge", "RZ", 1.0, com=(bad, 0.0, 0.0))
    assert "'hinge' is not finite" in refusal(lambda: rnc.Robot(model), capfd)


def test_joints_that_are_not_added_branch_by_branch_are_refused():
    """Pinocchio's composite rigid body algorithm takes the joints of a branch to be numbered one after the other."""

    def robot(order):
        model = pin.Model()
        places = {"": 0}
        for name, parent in order:
            places[name] = add_body(model, name, "RY", 1.0, places[parent], com=(1, 1, 1), at=(1, 1, 1))
        return rnc.Robot(model)

    assert robot([("left", ""), ("hand", "left"), ("right", "")]).nv == 3
    with pytest.raises(rnc.ModelError, match=r"'right' was added between 'left' and 'hand'.*branch by branch"):
        robot([("left", ""), ("right", ""), ("hand", "left")])


@pytest.mark.parametrize(("izz", "possible"), [("2", True), ("2.1", False)])
def test_an_inertia_that_no_body_has_is_named(izz, possible, tmp_path):
    (tmp_path / "arm.urdf").write_text(urdf(INERTIAL.replace('izz="1"', f'izz="{izz}"')))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        rnc.Robot.from_urdf(tmp_path / "arm.urdf")
    words = [str(each.message).split(": ")[1] for each in said if each.category is rnc.ModelWarning]
    assert words == ([] if possible else ["impossible rotational inertia behind hinge"])


EXACT = 1e-14


def dynamic(robot):
    return np.array([inertia.toDynamicParameters() for inertia in robot.model.inertias])


def rewritten(path, masses, folder):
    """The file with the masses of some links, and their tensors in proportion, written anew."""
    tree = ElementTree.parse(path)
    for link in tree.getroot().findall("link"):
        if link.get("name") in masses:
            mass, tensor = link.find("inertial/mass"), link.find("inertial/inertia")
            factor = masses[link.get("name")] / float(mass.get("value"))
            mass.set("value", repr(masses[link.get("name")]))
            for key in tensor.attrib:
                tensor.set(key, repr(float(tensor.get(key)) * factor))
    tree.write(folder / path.name)
    return folder / path.name


def masses_of(path):
    """Links with a mass [kg]."""
    links = ElementTree.parse(path).getroot().findall("link")
    found = {each.get("name"): each.find("inertial/mass") for each in links}
    masses = {name: float(mass.get("value")) for name, mass in found.items() if mass is not None}
    return {name: mass for name, mass in masses.items() if mass > 0}


@pytest.mark.parametrize(("name", "options"), [
    ("space_robot.urdf", {}),
    ("mobile_manipulator.urdf", {"base": "planar", "lock": {"joint_1": 0.4, "joint_2": -0.3}}),
    ("panda", {"base": "free", "lock": {"panda_joint3": 0.5, "panda_joint7": 0.2, "panda_finger_joint1": 0.01}}),
    ("tiago_no_hand", {"base": "planar", "lock": {"torso_lift_joint": 0.1, "arm_4_joint": 0.7}}),
])  # fmt: skip
def test_it_is_the_robot_of_a_file_with_those_masses(name, options, tmp_path):
    """Each link in turn, and all together; links that are fixed to others and those behind locked joints among them."""
    path = find_urdf(name) if name.endswith(".urdf") else find_example(name)[0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rnc.ModelWarning)
        robot = rnc.Robot.from_urdf(path, **options)
        before = dynamic(robot)
        links = list(masses_of(path))
        generator = np.random.default_rng(0)
        several = {link: float(mass) for link, mass in zip(links, generator.uniform(0.5, 3.0, len(links)), strict=True)}
        for masses in ({links[-1]: 0.4}, several):
            changed = robot.with_masses(masses)
            expected = rnc.Robot.from_urdf(rewritten(path, masses, tmp_path), **options)
            scale = max(np.abs(dynamic(expected)).max(), np.abs(before).max())
            assert np.abs(dynamic(changed) - dynamic(expected)).max() < EXACT * scale
            back = changed.with_masses({link: mass for link, mass in masses_of(path).items() if link in masses})
            assert np.abs(dynamic(back) - before).max() < EXACT * scale
    assert np.array_equal(dynamic(robot), before)
    assert changed.visual_model is not None
    assert (changed.name, changed.locked, changed.mimics) == (robot.name, robot.locked, robot.mimics)


def test_links_of_mjcf_and_of_mounted_robots(tmp_path):
    text = (
        '<mujoco><worldbody><body name="b"><joint name="j"/><inertial pos="0 .1 0" mass="1" diaginertia="1 1 1"/>'
        '<body name="c" pos="1 0 0"><inertial pos="0 0 .2" mass="MASS" diaginertia="INERTIA"/><body name="d"><joint '
        'name="k"/><inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/></body></body></body></worldbody></mujoco>'
    )

    def read(mass, inertia):
        return rnc.Robot.from_mjcf(write(tmp_path / "r.xml", text.replace("MASS", mass).replace("INERTIA", inertia)))

    changed = read("2", "2 2 1").with_masses({"c": 6.0})
    assert dynamic(changed) == pytest.approx(dynamic(read("6", "6 6 3")), abs=EXACT)
    carrier = rnc.Robot.from_urdf("chaplygin_sleigh.urdf", base="planar")
    arm = rnc.Robot.from_urdf("space_robot.urdf")
    one = carrier.attach(arm, "sleigh").with_masses({"link_2": 3.0, "sleigh": 7.0})
    other = carrier.with_masses({"sleigh": 7.0}).attach(arm.with_masses({"link_2": 3.0}), "sleigh")
    assert dynamic(one) == pytest.approx(dynamic(other), abs=EXACT * 10)


def test_an_inertia_takes_the_place_of_a_links_own():
    """In the link's frame; the flange of the Panda's hand is turned and set off from the joint that carries it."""
    robot = rnc.Robot.from_example("panda")
    inertia = pin.Inertia(2.0, np.array([0.1, -0.2, 0.05]), np.diag([0.02, 0.03, 0.04]))
    changed = robot.with_masses({"panda_hand": inertia})
    frame = robot.model.frames[robot.frame_id("panda_hand")]
    q = robot.random_configuration(np.random.default_rng(0))
    v = np.random.default_rng(1).normal(size=robot.nv)

    def energy(one):
        data = one.model.createData()
        pin.forwardKinematics(one.model, data, q, v)
        return pin.computeKineticEnergy(one.model, data, q, v)

    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q, v)
    own = 0.5 * inertia.vtiv(frame.placement.actInv(data.v[frame.parentJoint]))
    light = robot.with_masses({"panda_hand": 1e-9})
    assert energy(changed) - energy(light) == pytest.approx(own, abs=1e-8)


test_masses_that_make_no_sense_are_refused = refused([
    ({"link_4": 1.0}, "no link 'link_4' in robot 'space_robot'; did you mean 'link_"),
    ({3: 1.0}, "no link '3' in robot 'space_robot'"),
    ({"link_1": -1.0}, "mass of link 'link_1' has to be positive [kg], or a pinocchio.Inertia, found -1.0"),
    ({"link_1": np.nan}, "has to be positive [kg]"),
    ({"link_1": "heavy"}, "found 'heavy'"),
    ({"link_1": True}, "found True"),
    ({"tip": 1.0}, "link 'tip' of robot 'space_robot' has no mass of its own that could be scaled"),
    ({"link_1": pin.Inertia(0.0, np.zeros(3), np.eye(3))}, "inertia for link 'link_1' has to have a positive mass"),
    ({"link_1": 1e300}, "limit 1e+15"),
    (["link_1"], "masses have to be a mapping of links to masses [kg], found list"),
], lambda masses: rnc.Robot.from_urdf("space_robot.urdf").with_masses(masses), rnc.ModelError)  # fmt: skip
