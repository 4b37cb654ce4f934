"""Reader of URDF files: Pinocchio parses; package paths and errors that Pinocchio ignores are handled here."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, argument, check_known, few, nearest, warn
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.robots import robot_files
from rnc_pin.robots.sources import description, urdf_repairs
from rnc_pin.robots.sources.urdf_links import Meshes, bodies_of, give_masses

CHILDREN: Mapping[str, tuple[str, ...]] = {
    "robot": ("link", "joint", "material", "gazebo", "transmission", "ros2_control", "sensor"),
    "link": ("inertial", "visual", "collision", "contact", "sensor"),
    "joint": (
        *("parent", "child", "origin", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"),
        *("hardwareInterface", "physics"),
    ),
    "inertial": ("origin", "mass", "inertia"),
    "visual": ("origin", "geometry", "material", "name"),
    "collision": ("origin", "geometry", "material", "name", "contact_coefficients", "verbose"),
    "geometry": ("box", "cylinder", "sphere", "mesh", "capsule"),
}
"""Known elements in an element of a URDF, with customary ones of simulators; elements that are no key can have any."""


def read_urdf(
    path: Path,
    base: str,
    package_dirs: Sequence[str | Path] = (),
    xacro_arguments: Mapping[str, object] | None = None,
    *,
    snap: bool = True,
    masses: Mapping[str, float] | None = None,
) -> description.Description:
    """Read a URDF, or a xacro file that expands to one.

    Args:
        path: path of the file. A file whose name ends in ``.xacro``, or that uses xacro, is expanded.
        base: joint between the root link and the world.
        package_dirs: folders of packages, or packages themselves.
        xacro_arguments: values for the arguments of a xacro file.
        snap: replace rounded angles and axes of joints by exact ones.
        masses: link to mass [kg], for links whose inertia is missing or not usable.

    Raises:
        ModelError: the file cannot be read, is not a URDF, or describes an impossible robot.
    """
    check_known(base, description.ROOT_JOINTS, "base", ModelError)
    packages = robot_files.Packages(path.parent, package_dirs)
    root = parse_urdf(path, xacro_arguments, packages)
    with ModelError.at(path):
        # Repairs first: checks after them tell only what no repair can decide.
        notes = urdf_repairs.repair(root, path.name)
        _check_unique(root)
        meshes = Meshes(root, path, packages)
        # Meshes are known now, whose boxes give the moments; the checks come after, because masses repair what they
        # refuse.
        give_masses(root, masses or {})
        _check_links(root)
        moving = [joint.get("name") for joint in root.findall("joint") if joint.get("type") != "fixed"]
        # Pinocchio names the joint of the base so.
        if base != "fixed" and "root_joint" in moving:
            raise ModelError(f"joint 'root_joint' has the name of a {base} base's own: rename it in the file")
        mimics = _mimics(root, path)
        if snap:
            # A wheel then has an inertia symmetric about its axle. No axis has to be parallel to the geometry.
            places = ("link", "inertial/origin", "rpy"), ("joint", "origin", "rpy"), ("joint", "axis", "xyz")
            notes += urdf_repairs.snap(root, places)
        for note in notes:
            warn(f"{path.name}: {note}")
        model = _build(ElementTree.tostring(root, encoding="unicode"), base)
    geometry = partial(meshes.geometry, model)
    return description.Description(
        model, geometry, meshes.lost, mimics, bodies_of(root), packages.found, packages.folders
    )


def parse_urdf(
    path: Path, xacro_arguments: Mapping[str, object] | None, packages: robot_files.Packages
) -> ElementTree.Element:
    """Return the XML of a URDF without changes; a xacro file is expanded.

    Args:
        path: path of the file.
        xacro_arguments: values for the arguments of a xacro file.
        packages: packages for the files that it names.

    Raises:
        ModelError: the file cannot be read, or is not a URDF.
    """
    # A plain URDF is read once; only a file with macros is read again, by their expander.
    root = None if path.name.endswith(".xacro") else description.parse_xml(path)
    if root is None or _has_macros(root, path):
        from rnc_pin.robots.sources.xacro import expand  # most files have no macros, and do not wait for it

        root = expand(path, xacro_arguments, packages, CHILDREN)
    elif xacro_arguments:
        raise ModelError(f"{path}: xacro arguments are for a file whose name ends in .xacro or that uses xacro")
    if root.tag != "robot":
        raise ModelError(f"{path}: not a URDF: the outermost element is <{root.tag}>, expected <robot>")
    if root.find("link") is None:
        raise ModelError(f"{path}: {_why_no_links(root, path)}")
    return root


def _has_macros(root: ElementTree.Element, path: Path) -> bool:
    """True if a file has a xacro element, or declares the prefix and has an expression of xacro, whatever its name."""
    if any(element.tag.startswith("xacro:") for element in root.iter()):
        return True
    expression = re.compile(r"\$\{|\$\((arg|find|env|optenv|eval|dirname|anon)\b")
    used = any(expression.search(text) for element in root.iter() for text in element.attrib.values())
    # The parser drops declarations of prefixes.
    return used and b"xmlns:xacro" in read_bytes(path)


def _why_no_links(root: ElementTree.Element, path: Path) -> str:
    macros = [str(each.get("name")) for each in description.parse_xml(path).findall("xacro:macro")]
    if macros:
        return f"has no links, it only defines macros ({few(macros)}): give the file that calls them"
    calls = [each.tag for each in root if each.tag not in CHILDREN["robot"]]
    if calls:
        return f"has no links, and <{calls[0]}> is not known: a macro is called with its prefix, <xacro:{calls[0]}>"
    return "has no links"


def _build(text: str, base: str) -> pin.Model:
    make_root = description.ROOT_JOINTS[base]
    failure: Exception | None = None
    with description.captured_stderr() as complaints:
        try:
            model = pin.buildModelFromXML(text, *([] if make_root is None else [make_root()]))
        except Exception as error:  # Boost.Python raises any type of C++ exception
            failure = error
    # urdfdom also prints errors for elements that it then omits from the model.
    # The text of urdfdom names the element; the exception that follows only says that parsing failed.
    complaint = _first_complaint(complaints) or failure
    if complaint:
        raise ModelError(str(complaint))
    for limit in (
        *(model.lowerPositionLimit, model.upperPositionLimit, model.effortLimit, model.lowerEffortLimit),
        *(model.velocityLimit, model.upperVelocityLimit, model.lowerVelocityLimit),
    ):
        # The stand-in for an infinite limit becomes infinite again, with its sign.
        limit[np.abs(limit) == urdf_repairs.ENDLESS] *= np.inf
    return model


def _first_complaint(lines: list[str]) -> str | None:
    """First error of urdfdom with its location, which urdfdom prints as a separate error after the cause."""
    # Behind two blanks follows a place in the sources of urdfdom.
    errors = [line.removeprefix("Error:").strip().split("  ")[0] for line in lines if line.startswith("Error:")]
    if not errors:
        return None
    place = next((error for error in errors[1:] if "[" in error), None)
    return errors[0] if place is None else f"{errors[0]} ({place[0].lower()}{place[1:]})"


def _check_unique(root: ElementTree.Element) -> None:
    """Check that links and joints have names of their own, and name the files where one has not."""
    for tag in ("link", "joint"):
        seen: dict[str | None, ElementTree.Element] = {}
        for each in root.findall(tag):
            first = seen.setdefault(each.get("name"), each)
            if first is not each:
                # Elements of a xacro file have places.
                both = [(getattr(one, "file", None), getattr(one, "line", 0)) for one in (first, each)]
                places = [f"{file.name} line {line}" for file, line in both if file is not None]
                where = f": in {' and in '.join(dict.fromkeys(places))}" if places else ""
                raise ModelError(f"{tag} '{each.get('name')}' is not unique{where}")


def _check_links(root: ElementTree.Element) -> None:
    """Check faults that urdfdom accepts without a message, such as unreachable links and negative damping."""
    links = dict.fromkeys(str(link.get("name")) for link in root.findall("link"))
    parents: dict[str, str] = {}
    kinds: dict[str, str | None] = {}
    types = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
    for joint in root.findall("joint"):
        name, kind = joint.get("name"), joint.get("type")
        dynamics = joint.find("dynamics")
        if dynamics is not None and kind != "fixed":
            values = {key: description.read_number(dynamics.get(key)) for key in ("damping", "friction")}
            description.check_not_negative(values, f"joint '{name}'")
        ends = {each.tag: each.get("link", "") for each in reversed(joint)}
        parent, child = ends.get("parent", ""), ends.get("child", "")
        if parent not in links or child not in links:
            return  # urdfdom reports the missing link
        # A second parent would close a loop, which a tree of joints cannot have.
        if child in parents:
            raise ModelError(f"link '{child}' is the child of two joints, '{name}' the second")
        parents[child], kinds[child] = parent, kind
        if kind is not None and kind not in types:
            raise ModelError(f"joint '{name}' of type '{kind}'{nearest(kind, types)}")
        axis = joint.find("axis")
        numbers = None if axis is None else description.read_numbers(axis.get("xyz", "1 0 0"))
        if numbers is not None and not numbers.any() and kind not in ("fixed", "floating"):
            raise ModelError(f"the axis of joint '{name}' is zero")
    # Cycles first: all their links have parents, so they have no root to be reported.
    _check_chains(parents)
    roots = [f"[{link}]" for link in links if link not in parents]
    if len(roots) > 1:
        raise ModelError(f"several root links: {few(roots, 6)}: attach all but one with fixed joints")
    for link in root.findall("link"):
        name, mass = str(link.get("name")), link.find("inertial/mass")
        number = None if mass is None else description.read_number(mass.get("value"))
        # A movable link is checked with its joint.
        if number is not None and number < 0 and kinds.get(name, "fixed") == "fixed":
            remedy = f"give it another with {argument('masses', {name: 0.1})}"
            raise ModelError(f"mass of link '{name}' is negative: {number:g} kg; {remedy}")


def _check_chains(parents: Mapping[str, str]) -> None:
    """Refuse loops, and chains too long for Pinocchio's recursion."""
    try:
        order = list(TopologicalSorter({child: (parent,) for child, parent in parents.items()}).static_order())
    except CycleError as error:
        ring = error.args[1][0]
        raise ModelError(f"no root link: link '{ring}' is in a loop of links, each the parent of the next") from None
    depths: dict[str, int] = {}
    for link in order:
        depths[link] = depths[parents[link]] + 1 if link in parents else 0
    longest = 1000  # links: Pinocchio visits them by recursion, which would overflow the stack
    if max(depths.values(), default=0) > longest:
        raise ModelError(f"a chain of more than {longest} links, each the parent of the next")


def _mimics(root: ElementTree.Element, path: Path) -> tuple[description.Mimic, ...]:
    joints = dict.fromkeys(str(joint.get("name")) for joint in root.findall("joint"))
    mimics: list[description.Mimic] = []
    strangers: list[str] = []
    for joint in root.findall("joint"):
        mimic, name = joint.find("mimic"), str(joint.get("name"))
        if mimic is None:
            continue
        source = mimic.get("joint", "")
        if source not in joints or source == name:
            # Pinocchio accepts such files, and some common files have this fault.
            hint = "" if strangers else nearest(source, [each for each in joints if each != name])
            strangers.append(f"'{name}' of '{source}'{hint}")
            continue
        factors = [
            float(description.check_numbers(mimic.get(key, usual), (1,), f"{key} of joint '{name}'")[0])
            for key, usual in (("multiplier", "1"), ("offset", "0"))
        ]
        mimics.append(description.Mimic(name, source, *factors))
    if strangers:
        more = f" (and {len(strangers) - 1} more)" if len(strangers) > 1 else ""
        warn(f"{path}: mimic of an invalid joint is ignored: {strangers[0]}{more}")
    return tuple(mimics)
