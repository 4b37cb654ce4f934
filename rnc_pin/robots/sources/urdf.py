"""URDF files: parsed by Pinocchio, with package paths resolved and what Pinocchio passes over in silence checked."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import pinocchio as pin

from rnc_pin.errors import ModelError, ModelWarning, nearest
from rnc_pin.robots.sources.description import (
    ROOT_JOINTS,
    Description,
    Mimic,
    captured_stderr,
    parse_xml,
    read_numbers,
)
from rnc_pin.robots.sources.meshes import Meshes
from rnc_pin.robots.sources.packages import Packages
from rnc_pin.robots.sources.xacro_files import expand, is_xacro


def read_urdf(
    path: Path, base: str, package_dirs: Sequence[str | Path], xacro_arguments: Mapping[str, object] | None
) -> Description:
    """Read a URDF, or a xacro file that expands to one.

    Raises:
        ModelError: cannot be read, is not a URDF, or describes an impossible robot.
    """
    packages = Packages(path.parent, package_dirs)
    if is_xacro(path):
        root = ElementTree.fromstring(expand(path, xacro_arguments, packages))
    else:
        if xacro_arguments:
            raise ModelError(f"{path}: xacro arguments are for a file whose name ends in .xacro")
        root = parse_xml(path)
    if root.tag != "robot":
        raise ModelError(f"{path}: not a URDF: the outermost element is <{root.tag}>, expected <robot>")
    _check_links(root, path)
    mimics = _mimics(root, path)
    meshes = Meshes(root, path, packages, [str(path.parent), *map(str, package_dirs)])
    text = ElementTree.tostring(root, encoding="unicode")
    model = _build(text, path, base)
    return Description(model, lambda kind: meshes.geometry(model, kind), mimics)


def _build(text: str, path: Path, base: str) -> pin.Model:
    make_root = ROOT_JOINTS[base]
    failure: Exception | None = None
    with captured_stderr() as complaints:
        try:
            model = pin.buildModelFromXML(text, *([] if make_root is None else [make_root()]))
        except Exception as error:  # Boost.Python raises whatever the C++ side threw
            failure = error
    # urdfdom also prints errors for elements that it then leaves out of the model.
    complaint = _first_complaint(complaints) or failure
    if complaint:
        raise ModelError(f"{path}: {complaint}")
    return model


def _first_complaint(lines: list[str]) -> str | None:
    """What urdfdom refused, with where it was: that it says in an error of its own, after the cause."""
    errors = [line.removeprefix("Error:").strip().split("  ")[0] for line in lines if line.startswith("Error:")]
    if not errors:
        return None
    place = next((error for error in errors[1:] if "[" in error), None)
    return errors[0] if place is None else f"{errors[0]} ({place[0].lower()}{place[1:]})"


def _check_links(root: ElementTree.Element, path: Path) -> None:
    """What urdfdom takes without a word: links it does not reach, and negative masses fixed to heavier links."""
    links = [str(link.get("name")) for link in root.findall("link")]
    parents: dict[str, str] = {}
    kinds: dict[str, str | None] = {}
    for joint in root.findall("joint"):
        parent, child = (_end(joint, end) for end in ("parent", "child"))
        if parent not in links or child not in links:
            return  # urdfdom says what it misses
        if child in parents:
            raise ModelError(f"{path}: link '{child}' is the child of two joints, '{joint.get('name')}' the second")
        parents[child], kinds[child] = parent, joint.get("type")
        axis = joint.find("axis")
        numbers = None if axis is None else read_numbers(axis.get("xyz", "1 0 0"))
        if numbers is not None and not numbers.any() and joint.get("type") not in ("fixed", "floating"):
            raise ModelError(f"{path}: the axis of joint '{joint.get('name')}' has no length")
    for link in links:
        seen = [link]
        while seen[-1] in parents and parents[seen[-1]] not in seen:
            seen.append(parents[seen[-1]])
        if seen[-1] in parents:
            raise ModelError(
                f"{path}: no root link: link '{seen[-1]}' is in a ring of links, each the parent of the next"
            )
    for element in root.findall("link"):
        link = str(element.get("name"))
        if kinds.get(link, "fixed") == "fixed":  # a moving one is checked with its joint's name
            _check_mass(element, link, path)


def _end(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _check_mass(element: ElementTree.Element, link: str, path: Path) -> None:
    mass = element.find("inertial/mass")
    numbers = None if mass is None else read_numbers(mass.get("value", ""))
    if numbers is not None and numbers.size == 1 and numbers[0] < 0:
        raise ModelError(f"{path}: mass of link '{link}' is negative: {numbers[0]:g} kg")


def _mimics(root: ElementTree.Element, path: Path) -> tuple[Mimic, ...]:
    joints = [str(joint.get("name")) for joint in root.findall("joint")]
    mimics: list[Mimic] = []
    strangers: list[str] = []
    for joint in root.findall("joint"):
        mimic, name = joint.find("mimic"), str(joint.get("name"))
        if mimic is None:
            continue
        source = mimic.get("joint", "")
        if source not in joints or source == name:
            # Pinocchio takes such files, and some that people use are so.
            strangers.append(f"'{name}' of '{source}'{nearest(source, [each for each in joints if each != name])}")
            continue
        factors = []
        for key, default in (("multiplier", "1"), ("offset", "0")):
            numbers = read_numbers(mimic.get(key, default))
            if numbers is None or numbers.size != 1:
                raise ModelError(f"{path}: {key} of joint '{name}' has to be a finite number, found '{mimic.get(key)}'")
            factors.append(float(numbers[0]))
        mimics.append(Mimic(name, source, *factors))
    if strangers:
        more = f" (and {len(strangers) - 1} more)" if len(strangers) > 1 else ""
        text = f"{path}: mimics a joint that is not there: {strangers[0]}{more}"
        warnings.warn(text, ModelWarning, stacklevel=4)
    return tuple(mimics)
