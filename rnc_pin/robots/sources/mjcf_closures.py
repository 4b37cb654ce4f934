"""Kinematic loops of an MJCF: ``<connect>`` and ``<weld>``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, nearest
from rnc_pin.robots.sources.description import Closure, read_numbers
from rnc_pin.robots.sources.mjcf_sites import placement

KINDS = ("connect", "weld")


class _End(NamedTuple):
    """Frame of a body, and the pose of the body in the file."""

    body: str
    place: pin.SE3
    inside: pin.SE3


class _Bodies:
    """Poses of the bodies and sites in the configuration of the file."""

    def __init__(self, root: ElementTree.Element, path: Path, radians: float) -> None:
        self._path = path
        compiler = root.find("compiler")
        self._sequence = "xyz" if compiler is None else compiler.get("eulerseq", "xyz")
        self._radians = radians
        self.moved_by_user: set[str] = set()
        self._places = {"world": ("universe", pin.SE3.Identity())}
        self._sites: dict[str, _End] = {}
        for world in root.findall("worldbody"):
            self._read(world, "universe", pin.SE3.Identity())

    def _read(self, element: ElementTree.Element, name: str, place: pin.SE3) -> None:
        for site in element.findall("site"):
            if site.get("name"):
                self._sites[str(site.get("name"))] = _End(name, place, self._placement(site))
        for body in element.findall("body"):
            inner, there = str(body.get("name")), place * self._placement(body)
            self._places.setdefault(inner, (inner, there))
            if body.get("mocap") == "true":
                self.moved_by_user.add(inner)
            self._read(body, inner, there)

    def _placement(self, element: ElementTree.Element) -> pin.SE3:
        return placement(element, self._sequence, self._radians)

    def body(self, name: str | None) -> _End:
        name = name or "world"
        if name not in self._places:
            raise ModelError(f"{self._path}: <equality>: no body '{name}'{nearest(name, self._places)}")
        frame, place = self._places[name]
        return _End(frame, place, pin.SE3.Identity())

    def site(self, name: str) -> _End:
        if name not in self._sites:
            raise ModelError(f"{self._path}: <equality>: no site '{name}'{nearest(name, self._sites)}")
        return self._sites[name]


def closures(root: ElementTree.Element, path: Path, radians: float) -> tuple[Closure, ...]:
    """Return the kinematic loops of a file, without those of bodies that the user moves (``mocap``).

    Args:
        root: root element of the file, with explicit defaults (``make_plain``).
        path: path of the file, for messages.
        radians: radians per unit of the file's angles.

    Raises:
        ModelError: unknown body or site, or invalid numbers.
    """
    elements = [each for kind in KINDS for each in root.findall(f"equality/{kind}")]
    active = [each for each in elements if each.get("active", "true") != "false"]
    return tuple(_closures(active, _Bodies(root, path, radians), path)) if active else ()


def _closures(elements: list[ElementTree.Element], bodies: _Bodies, path: Path) -> Iterator[Closure]:
    for element in elements:
        by_sites = "site1" in element.attrib
        ends = [
            bodies.site(element.get(f"site{k}", "")) if by_sites else bodies.body(element.get(f"body{k}"))
            for k in (1, 2)
        ]
        if bodies.moved_by_user & {end.body for end in ends}:
            continue
        a, b = ends
        if element.tag == "connect":
            anchor = a.inside.translation if by_sites else _numbers(element, "anchor", 3, path)
            other = b.inside.translation if by_sites else b.place.actInv(a.place.act(anchor))
            yield _closure(a, b, "point", anchor, other)
            continue
        turns = _numbers(element, "torquescale", 1, path, 1.0)[0] > 0
        kind: Literal["frame", "point"] = "frame" if turns else "point"
        if by_sites:
            rotation = a.inside.rotation @ b.inside.rotation.T
            yield _closure(a, b, kind, a.inside.translation, b.inside.translation, rotation)
            continue
        point, said, relative = _numbers(element, "anchor", 3, path), _pose(element, path), a.place.actInv(b.place)
        # An explicit pose places the anchor of body 2, not its origin.
        at = relative.act(point) if said is None else said.translation
        yield _closure(a, b, kind, at, point, (said or relative).rotation)


def _closure(
    a: _End,
    b: _End,
    kind: Literal["frame", "point"],
    offset_a: np.ndarray,
    offset_b: np.ndarray,
    rotation: np.ndarray | None = None,
) -> Closure:
    turned = kind == "frame" and rotation is not None
    rpy = pin.rpy.matrixToRpy(rotation) if turned else np.zeros(3)
    return Closure(a.body, b.body, kind, *(_rounded(each) for each in (offset_a, offset_b, rpy)))


def _rounded(numbers: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(each), 12) + 0.0 for each in numbers)
    return x, y, z


def _pose(element: ElementTree.Element, path: Path) -> pin.SE3 | None:
    """Explicit pose of body 2 in body 1; None if it is the pose in the file."""
    x, y, z, scalar, *rest = _numbers(element, "relpose", 7, path, *(0, 1, 0, 0, 0, 0, 0))
    size = float(np.linalg.norm([scalar, *rest]))
    if size == 0:
        return None
    return pin.SE3(pin.Quaternion(scalar / size, *(each / size for each in rest)), np.array([x, y, z]))


def _numbers(element: ElementTree.Element, key: str, count: int, path: Path, *usual: float) -> np.ndarray:
    numbers = np.array(usual or np.zeros(count), dtype=float)
    if key in element.attrib:
        found = read_numbers(element.attrib[key])
        if found is None or found.size != count:
            raise ModelError(f"{path}: <{element.tag}>: {key} takes {count} finite numbers")
        numbers = found
    return numbers
