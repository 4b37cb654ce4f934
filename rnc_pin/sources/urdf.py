"""URDF files: parsed by Pinocchio, with package paths resolved and what Pinocchio passes over in silence checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pinocchio as pin

from rnc_pin.errors import ModelError, nearest
from rnc_pin.sources.description import (
    GEOMETRY,
    ROOT_JOINTS,
    Description,
    Mimic,
    captured_stderr,
    geometry_errors,
    parse_xml,
    read_numbers,
)
from rnc_pin.sources.packages import Packages
from rnc_pin.sources.xacro_files import expand, is_xacro


def read_urdf(
    path: Path, base: str, package_dirs: Sequence[str | Path], xacro_arguments: Mapping[str, Any] | None
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
    for element in root.iter():
        if element.tag in ("mesh", "texture") and "filename" in element.attrib:
            found = packages.file(element.attrib["filename"])
            if found is not None:  # else Pinocchio says what it misses, when somebody wants to draw
                element.set("filename", str(found))
    text = ElementTree.tostring(root, encoding="unicode")
    model = _build(text, path, base)
    folders = [str(path.parent), *map(str, package_dirs)]

    def geometry(kind: str) -> pin.GeometryModel:
        with geometry_errors(path):
            return pin.buildGeomFromUrdfString(model, text, GEOMETRY[kind], None, folders)

    return Description(model, geometry, mimics)


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
    """Negative masses vanish from sight where a link is fixed to a heavier one."""
    for link in root.findall("link"):
        mass = link.find("inertial/mass")
        numbers = read_numbers(mass.get("value", "")) if mass is not None else None
        if numbers is not None and numbers.size == 1 and numbers[0] < 0 and _is_fixed(root, link.get("name")):
            raise ModelError(f"{path}: mass of link '{link.get('name')}' is negative: {numbers[0]:g} kg")


def _is_fixed(root: ElementTree.Element, link: str | None) -> bool:
    """Whether a link has no moving joint of its own; a moving one's inertia is checked with its joint's name."""
    for joint in root.findall("joint"):
        child = joint.find("child")
        if child is not None and child.get("link") == link:
            return joint.get("type") == "fixed"
    return True


def _mimics(root: ElementTree.Element, path: Path) -> tuple[Mimic, ...]:
    joints = [str(joint.get("name")) for joint in root.findall("joint")]
    mimics: list[Mimic] = []
    for joint in root.findall("joint"):
        mimic, name = joint.find("mimic"), str(joint.get("name"))
        if mimic is None:
            continue
        source = mimic.get("joint", "")
        if source not in joints or source == name:
            raise ModelError(
                f"{path}: joint '{name}' mimics '{source}'{nearest(source, [j for j in joints if j != name])}"
            )
        factors = []
        for key, default in (("multiplier", "1"), ("offset", "0")):
            numbers = read_numbers(mimic.get(key, default))
            if numbers is None or numbers.size != 1:
                raise ModelError(f"{path}: {key} of joint '{name}' has to be a finite number, found '{mimic.get(key)}'")
            factors.append(float(numbers[0]))
        mimics.append(Mimic(name, source, *factors))
    return tuple(mimics)
