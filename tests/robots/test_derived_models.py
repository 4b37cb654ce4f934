"""``Robot.with_masses``: the robot that its file would give if it said those masses."""

import warnings
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

import rnc_pin as rnc
from refusals import refused
from rnc_pin.robots.robot_files import find_example, find_urdf

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
        (tmp_path / "r.xml").write_text(text.replace("MASS", mass).replace("INERTIA", inertia))
        return rnc.Robot.from_mjcf(tmp_path / "r.xml")

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
    motion = frame.placement.actInv(data.v[frame.parentJoint])
    own = 0.5 * inertia.vtiv(motion)
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
