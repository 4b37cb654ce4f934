"""URDFs that are changed and still mean the same robot.

Each function takes the text of a URDF, without macros, and returns another text, or None where it changes nothing.
"""

import re
from collections.abc import Callable, Iterator
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

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
    """Return a URDF with random words as names of the robot, its links, joints, transmissions, plugins and meshes.

    The file name of a plugin stays: it is a program, and no name that an author chose. Meshes keep their endings.
    """
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
    """Return a URDF of the mirror image, left for right: y of the base and of every link is -y.

    Joint values keep their meaning, and so do limits and mimics: an axis of rotation changes its sign beside.
    """
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


PERTURBATIONS: dict[str, Callable[[str, int], str | None]] = {
    "noise": with_noise,
    "names": renamed,
    "order": shuffled,
    "no drives": without_drives,
    "mirrored": mirrored,
}
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
