"""MJCF with explicit defaults, because Pinocchio reads some implicit content differently from MuJoCo.

Pinocchio ignores the position of a joint in a default class, and the names of several joints in one body. It misreads
axes that are not of unit length, and rotations about fixed axes. It reads only one of several unnamed bodies, only the
first of several root bodies, and no pose of a fixed root body.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from rnc_pin.errors import ModelError, few, nearest
from rnc_pin.io.safe_read import LARGEST
from rnc_pin.robots.sources.description import ROOT_JOINTS, read_numbers

_WITH_DEFAULTS = ("joint", "geom", "site", "mesh")
_TURNS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
SIZES = {"plane": 3, "sphere": 1, "capsule": 2, "ellipsoid": 3, "cylinder": 2, "box": 3, "mesh": 0}
"""Number of entries in the size of each shape."""
WORLD = "world"
"""Name of the added body that fixes all others to the world; no body of the file has this name."""
Attributes = dict[str, dict[str, str]]


def make_plain(root: ElementTree.Element, path: Path, base: str | None) -> None:
    """Make implicit content explicit, in place.

    Args:
        root: root element of the file.
        path: path of the file, for messages.
        base: as for ``read_mjcf``.

    Raises:
        ModelError: an unknown class, duplicate body names, a base for several bodies, or too long a result.
    """
    _write_defaults(root, path)
    _drop_made_textures(root)
    root.set("model", root.get("model") or path.stem)
    free = _free_names(root, path)
    _make_one_root(root, path, base, free)
    for element in root.iter():
        _make_unit(element)
    _order_turns(root)
    for body in list(root.iter("body")):
        _separate(body, free)


class _Defaults:
    """Default classes of a file and their application to elements."""

    def __init__(self, root: ElementTree.Element, path: Path) -> None:
        self._path, self._length = path, 0
        self._classes: dict[str, Attributes] = {"main": {}}
        self._top: Attributes = {}
        for default in root.findall("default"):
            self._top = self._collect(default, self._top)

    def _collect(self, default: ElementTree.Element, inherited: Attributes) -> Attributes:
        """Return the attributes of a class with those inherited from outer classes; store it and its inner classes."""
        own = {tag: dict(attributes) for tag, attributes in inherited.items()}
        for element in default:
            if element.tag in _WITH_DEFAULTS:
                own.setdefault(element.tag, {}).update(element.attrib)
        for attributes in own.values():
            self._count(attributes)
        self._classes[default.get("class", "main")] = own
        for inner in default.findall("default"):
            self._collect(inner, own)
        return own

    def _count(self, attributes: dict[str, str]) -> None:
        self._length += sum(len(key) + len(value) for key, value in attributes.items())
        if self._length > LARGEST:
            raise ModelError(f"{self._path}: with its defaults longer than {LARGEST:,} characters")

    def write(self, parent: ElementTree.Element, inherited: str | None = None) -> None:
        """Apply the default classes to all elements below, and remove the class attributes."""
        inherited = parent.attrib.pop("childclass", inherited)
        for element in parent:
            if element.tag == "body":
                self.write(element, inherited)
            elif element.tag in _WITH_DEFAULTS:
                name = element.attrib.pop("class", inherited)
                if name is not None and name not in self._classes:
                    other = nearest(name, self._classes)
                    raise ModelError(f'{self._path}: <{element.tag} class="{name}">: no such <default>{other}')
                defaults = (self._top if name is None else self._classes[name]).get(element.tag, {})
                self._count(defaults)
                _complete(element, defaults)


def _write_defaults(root: ElementTree.Element, path: Path) -> None:
    """Apply the default classes to all elements, and remove the classes."""
    defaults = _Defaults(root, path)
    for parent in (*root.findall("worldbody"), *root.findall("asset")):
        defaults.write(parent)
    for default in root.iter("default"):
        for element in [each for each in default if each.tag in _WITH_DEFAULTS]:
            default.remove(element)


def _complete(element: ElementTree.Element, defaults: dict[str, str]) -> None:
    """Add missing attributes. Equivalent attributes count as present; a size is completed entry by entry."""
    said = set(element.attrib)
    if said & set(_TURNS):
        said |= set(_TURNS)
    for key, value in defaults.items():
        if key not in said and key != "class":
            element.set(key, value)
    if "fromto" in element.attrib:
        for key in _TURNS:
            element.attrib.pop(key, None)
        if not np.any(read_numbers(element.get("pos", "0"))):  # a nonzero position beside fromto is refused
            element.attrib.pop("pos", None)
    if element.tag == "geom" and "size" in said and "size" in defaults:
        needed = SIZES.get(element.get("type", "sphere"), 0) - (element.get("fromto") is not None)
        own = element.get("size", "").split()
        element.set("size", " ".join(own + defaults["size"].split()[len(own) : needed]))


def _drop_made_textures(root: ElementTree.Element) -> None:
    """Remove textures that MuJoCo would generate; Pinocchio does not draw them and prints a message."""
    made = set()
    for asset in root.findall("asset"):
        for texture in asset.findall("texture"):
            if not texture.get("file"):
                made.add(texture.get("name"))
                asset.remove(texture)
    for material in root.iter("material"):
        if "texture" in material.attrib and material.attrib["texture"] in made:
            del material.attrib["texture"]


def _make_one_root(root: ElementTree.Element, path: Path, base: str | None, free: Iterator[str]) -> None:
    """Name every body, and join all bodies under one root body, at the origin unless it moves."""
    world, *others = root.findall("worldbody")
    for other in others:  # sections may be repeated
        world.extend(other)
        root.remove(other)
    for body in world.iter("body"):
        if not body.get("name"):
            body.set("name", next(free))
    roots = world.findall("body")
    moved = ROOT_JOINTS[base or "fixed"] is not None
    if len(roots) < 2 and (moved or any(part.tag in ("joint", "freejoint") for part in roots[0])):
        return
    if moved:
        raise ModelError(
            f"{path}: base='{base}' moves one body, and in <worldbody> there are {len(roots)}: "
            f"{few([str(each.get('name')) for each in roots])}; take the file's own base (None), or a file of one"
        )
    # Not one of the generated names: another base has no such body, and the names of the others must not change.
    taken = any(body.get("name") == WORLD for body in world.iter("body"))
    whole = ElementTree.SubElement(world, "body", name=next(free) if taken else WORLD)
    whole.append(_no_mass())
    for each in roots:
        world.remove(each)
        whole.append(each)


def _free_names(root: ElementTree.Element, path: Path) -> Iterator[str]:
    names = Counter(body.get("name") for body in root.iter("body") if body.get("name"))
    for name, count in names.items():
        if count > 1:
            raise ModelError(f"{path}: duplicate body '{name}'")
    return (name for name in (f"body_{k}" for k in itertools.count(1)) if name not in names)


def _make_unit(element: ElementTree.Element) -> None:
    """Normalize the axis of ``axisangle``."""
    turn = read_numbers(element.get("axisangle", ""))
    if turn is not None and turn.size == 4 and np.linalg.norm(turn[:3]) > 0:
        turn[:3] /= np.linalg.norm(turn[:3])
        element.set("axisangle", " ".join(map(repr, map(float, turn))))


def _order_turns(root: ElementTree.Element) -> None:
    """Convert rotations about fixed axes (upper case) to rotations about moving axes, which are in reverse order."""
    compiler = root.find("compiler")
    sequence = "" if compiler is None else compiler.get("eulerseq", "")
    if compiler is None or sequence == sequence.lower():
        return
    order: list[int] = []
    for k, axis in enumerate(sequence):
        order = [k, *order] if axis.isupper() else [*order, k]
    compiler.set("eulerseq", "".join(sequence[k] for k in order).lower())
    for element in root.iter():
        angles = element.get("euler", "").split()
        if len(angles) == len(order):
            element.set("euler", " ".join(angles[k] for k in order))


def _separate(body: ElementTree.Element, free: Iterator[str]) -> None:
    """Give each of several joints its own body; Pinocchio would merge them into one joint without their names."""
    joints, name = body.findall("joint"), str(body.get("name"))
    for k, joint in enumerate(joints):
        joint.set("name", joint.get("name") or f"{name}Joint_{k}")
    parts = [part for part in body if part not in joints]
    for part in list(body):
        body.remove(part)
    for joint in joints[:-1]:
        body.set("name", next(free))
        body.extend([joint, _no_mass()])
        body = ElementTree.SubElement(body, "body")
    body.set("name", name)
    body.extend([*joints[-1:], *parts])


def _no_mass() -> ElementTree.Element:
    return ElementTree.Element("inertial", mass="0", pos="0 0 0", diaginertia="0 0 0")
