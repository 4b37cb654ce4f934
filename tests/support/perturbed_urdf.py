"""URDFs that are changed and still mean the same robot: functions of a text, None where they change nothing."""

import re
from collections.abc import Callable, Iterator
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.applications.init.evidence import named_as_driven
from rnc_pin.io.safe_read import parse_tree
from rnc_pin.robots.sources.description import read_numbers

LENGTH, ANGLE = 1e-3, np.deg2rad(0.1)  # standard deviation of the noise along and about each axis [m, rad]

# Syllables of few letters: no word that a reader of names may look for is inside.
_CONSONANTS, _VOWELS, _SYLLABLES = "bdkmnvz", "aiu", 4
_NAMES = {"name", "link", "joint", "reference"}  # attributes that contain the name of a link or of a joint
_DRIVES = ("transmission", "ros2_control")
_TYPES_WITH_ANGLES = ("revolute", "continuous")

_MIRROR = np.array([1.0, -1.0, 1.0])


def with_noise(urdf: str, seed: int) -> str:
    """Return a URDF whose joints, shapes and centers of mass are displaced and turned a little, by normal noise."""
    robot, generator = parse_tree(urdf), np.random.default_rng(seed)
    for owner in _placed(robot):
        origin = _child(owner, "origin")
        place, angles = (_numbers(origin, key, "0 0 0") for key in ("xyz", "rpy"))
        turned = pin.rpy.rpyToMatrix(angles) @ pin.exp3(generator.normal(scale=ANGLE, size=3))
        _write(origin, "xyz", place + generator.normal(scale=LENGTH, size=3))
        _write(origin, "rpy", pin.rpy.matrixToRpy(turned))
    return _text(robot)


def renamed(urdf: str, seed: int) -> str:
    """Return a URDF with random words as names; file names of plugins, which are programs, and endings stay."""
    robot, generator = parse_tree(urdf), np.random.default_rng(seed)
    named = [robot, *(each for each in robot.iter() if each.tag in ("link", "joint", *_DRIVES, "plugin", "actuator"))]
    meshes = [each.get("filename", "") for each in robot.iter("mesh")]
    names = dict.fromkeys([*(each.get("name", "") for each in named), *meshes])
    words = dict(zip(names, _words(len(names), generator), strict=True))
    for element in robot.iter():
        for key in _NAMES & set(element.attrib):
            element.set(key, words.get(element.get(key), element.get(key)))
        if element.tag == "mesh":
            file = element.get("filename", "")
            ending = re.search(r"(\.\w+)?$", file)
            element.set("filename", words[file] + (ending[0] if ending else ""))
    for described in (each for each in robot if each.tag in (*_DRIVES, "gazebo")):
        for element in described.iter():
            if element.text:
                element.text = re.sub(r"[^\s,]+", lambda found: words.get(found[0], found[0]), element.text)
    return _text(robot)


def shuffled(urdf: str, seed: int) -> str:
    """Return a URDF with the elements of the robot in another order."""
    robot, generator = parse_tree(urdf), np.random.default_rng(seed)
    robot[:] = [robot[k] for k in generator.permutation(len(robot))]
    return _text(robot)


def without_drives(urdf: str, seed: int = 0) -> str | None:
    """Return a URDF that names no driven joint: without transmissions, ros2_control, and plugins that name joints."""
    robot = parse_tree(urdf)
    return _text(robot) if _remove_drives(robot) else None


def mirrored(urdf: str, seed: int = 0) -> str:
    """Return a URDF of the mirror image, y for -y; joint values keep their meaning, so axes of rotation change sign."""
    robot = parse_tree(urdf)
    for owner in _placed(robot):
        origin = owner.find("origin")
        if origin is not None:
            _write(origin, "xyz", _MIRROR * _numbers(origin, "xyz", "0 0 0"))
            _write(origin, "rpy", -_MIRROR * _numbers(origin, "rpy", "0 0 0"))
    for joint in robot.findall("joint"):
        if joint.get("type") not in ("fixed", "floating"):
            axis = _child(joint, "axis")
            sign = -1.0 if joint.get("type") in _TYPES_WITH_ANGLES else 1.0
            _write(axis, "xyz", sign * _MIRROR * _numbers(axis, "xyz", "1 0 0"))
    for link in robot.findall("link"):
        for inertia in link.iterfind("inertial/inertia"):
            _multiply(inertia, ixy=-1.0, iyz=-1.0)
        for mesh in link.iter("mesh"):
            _write(mesh, "scale", _MIRROR * _numbers(mesh, "scale", "1 1 1"))
    return _text(robot)


def exported(urdf: str, seed: int = 0) -> str | None:
    """Return a URDF with gaps that exporters leave; None if it has fewer than two wheels on the base.

    Pivots of wheels, and joints beside the motors that the file lists, have effort and velocity 0. Wheels on pivots
    without a motor of their own are fixed to them. A virtual wheel of 0.06 g is on the axle of a wheel on the base.
    """
    robot = parse_tree(urdf)
    joints = {_child(each, "child").get("link"): each for each in robot.findall("joint")}
    driven, is_list = named_as_driven(robot)
    wheels = [each for each in joints.values() if _turns_a_disk(robot, each)]
    above = {each: joints.get(_child(each, "parent").get("link")) for each in wheels}
    pivots = [
        each for each in above.values() if each is not None and each.get("type") != "fixed" and each not in wheels
    ]
    fixed = [each for each in wheels if above[each] not in pivots]
    if len(fixed) < 2:
        return None
    left_out = [each for each in joints.values() if is_list and each.get("name") not in driven and each not in wheels]
    for each in (*pivots, *left_out):
        if each.get("type") != "fixed" and each.find("mimic") is None:
            _child(each, "limit").attrib.update(effort="0", velocity="0")
    for wheel in wheels:
        alone = [*above.values()].count(above[wheel]) == 1
        if wheel not in fixed and alone and wheel.get("name") not in driven and wheel.find("mimic") is None:
            wheel.set("type", "fixed")
    virtual = ElementTree.fromstring(ElementTree.tostring(fixed[0]))
    virtual.set("name", "virtual_joint")
    _child(virtual, "child").set("link", "virtual")
    link = '<link name="virtual"><inertial><mass value="6e-5"/><inertia ixx="1e-8" iyy="1e-8" izz="1e-8" '
    robot.extend([virtual, ElementTree.fromstring(f'{link}ixy="0" ixz="0" iyz="0"/></inertial></link>')])
    return _text(robot)


def _turns_a_disk(robot: ElementTree.Element, joint: ElementTree.Element) -> bool:
    """True for a continuous joint whose link has a cylinder, and no joints behind."""
    name = _child(joint, "child").get("link")
    leaf = all(_child(each, "parent").get("link") != name for each in robot.findall("joint"))
    link = next(each for each in robot.findall("link") if each.get("name") == name)
    return joint.get("type") == "continuous" and leaf and link.find(".//cylinder") is not None


PERTURBATIONS: dict[str, Callable[[str, int], str | None]] = {
    "noise": with_noise, "names": renamed, "order": shuffled, "no drives": without_drives, "mirrored": mirrored,
    "exported": exported,
}  # fmt: skip
"""Perturbations by name: functions of a URDF and a seed."""

DRAWN = ("noise", "names", "order")
"""Perturbations that depend on the seed."""


def _placed(robot: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Elements that have a placement."""
    yield from robot.findall("joint")
    for link in robot.findall("link"):
        yield from (each for each in link if each.tag in ("visual", "collision", "inertial"))


def _remove_drives(robot: ElementTree.Element) -> bool:
    """Remove what names driven joints; return True if there was any."""
    drives = [(robot, each) for each in robot if each.tag in _DRIVES]
    for gazebo in robot.findall("gazebo"):
        for plugin in gazebo.findall("plugin"):
            if any("joint" in each.tag.lower() for each in plugin.iter()):
                drives.append((gazebo, plugin))
    for parent, element in drives:
        parent.remove(element)
    return bool(drives)


def _words(count: int, generator: np.random.Generator) -> list[str]:
    """Return random words, all different."""
    words: dict[str, None] = {}
    while len(words) < count:
        letters = (generator.choice([*kind]) for _ in range(_SYLLABLES) for kind in (_CONSONANTS, _VOWELS))
        words["".join(letters)] = None
    return [*words]


def _child(owner: ElementTree.Element, tag: str) -> ElementTree.Element:
    """Child of an element, which is added where it is missing."""
    found = owner.find(tag)
    return ElementTree.SubElement(owner, tag) if found is None else found


def _numbers(element: ElementTree.Element, key: str, usual: str) -> np.ndarray:
    text = element.get(key, usual)
    numbers = read_numbers(text, len(usual.split()))
    if numbers is None:
        raise ValueError(f'<{element.tag} {key}="{text}">: expected {len(usual.split())} finite numbers')
    return numbers


def _write(element: ElementTree.Element, key: str, numbers: np.ndarray) -> None:
    element.set(key, " ".join(repr(float(each) + 0.0) for each in numbers))


def _multiply(element: ElementTree.Element | None, **factors: float) -> None:
    """Multiply the numbers of attributes that an element has; what is no number stays."""
    for key, factor in factors.items() if element is not None else ():
        numbers = read_numbers(element.get(key))
        if numbers is not None:
            _write(element, key, factor * numbers)


def _text(robot: ElementTree.Element) -> str:
    return ElementTree.tostring(robot, encoding="unicode")
