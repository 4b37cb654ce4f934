"""Reader of MJCF files: Pinocchio parses; content that its parser ignores is checked or added here."""

from __future__ import annotations

import copy
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, ModelWarning, few, nearest
from rnc_pin.printing import counted
from rnc_pin.robots.sources.containment import AllowedFolders
from rnc_pin.robots.sources.description import (
    GEOMETRY,
    ROOT_JOINTS,
    Description,
    brief,
    captured_stderr,
    check_base,
    geometry_errors,
    parse_xml,
    read_numbers,
)
from rnc_pin.robots.sources.flattening import flattened, included, shorthand, weighed
from rnc_pin.robots.sources.mjcf_actuators import mark_passive_joints
from rnc_pin.robots.sources.mjcf_assets import resolve_assets
from rnc_pin.robots.sources.mjcf_closures import closures
from rnc_pin.robots.sources.mjcf_joints import complete, couplings, in_radians
from rnc_pin.robots.sources.mjcf_meshes import MjcfMeshes
from rnc_pin.robots.sources.mjcf_sites import place_sites
from rnc_pin.robots.sources.plain_mjcf import make_plain
from rnc_pin.robots.sources.rounding import Roundings

_JOINTS = ("hinge", "slide", "ball", "free")
_SOFT = ("composite", "flexcomp", "attach")
_SIZES = {  # numbers per attribute: Pinocchio replaces those that it cannot read by zero
    "pos": (3,), "quat": (4,), "axis": (3,), "euler": (3,), "axisangle": (4,), "xyaxes": (6,), "zaxis": (3,),
    "fromto": (6,), "mass": (1,), "density": (1,), "diaginertia": (3,), "fullinertia": (6,), "range": (2,),
    "gravity": (3,), "armature": (1,), "frictionloss": (1,), "damping": (1, 2, 3), "size": (1, 2, 3, 4), "ref": (1,),
}  # fmt: skip


def read_mjcf(path: Path, base: str | None, package_dirs: Sequence[Path] = (), *, snap: bool = True) -> Description:
    """Read an MJCF file.

    Args:
        path: path of the file.
        base: None keeps the root joints of the file. "fixed", "planar" or "free" replaces its free joint.
        package_dirs: additional folders whose files the file may name.
        snap: replace rounded axes of joints and angles of bodies by exact ones.

    Raises:
        ModelError: the file cannot be read, is not MJCF, or needs an unsupported element.
    """
    if base is not None:
        check_base(base)
    root = parse_xml(path)
    if root.tag != "mujoco":
        raise ModelError(f"{path}: not MJCF: the outermost element is <{root.tag}>, expected <mujoco>")
    allowed = AllowedFolders(path.parent, package_dirs)
    root = _understood(root, path, base, allowed)
    _check(root, path, base)
    _check_unknown(root, path)
    _clear_base(root, path, base)
    if snap:
        _snap(root, path)
    meshes = MjcfMeshes(root, path)
    make_root = ROOT_JOINTS[base or "fixed"]
    with _written(root) as file:
        try:
            with captured_stderr(), warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)
                if make_root is None:
                    model = pin.buildModelFromMJCF(file)
                else:
                    model = pin.buildModelFromMJCF(file, make_root(), "root_joint")
        except Exception as error:  # Boost.Python raises any type of C++ exception
            raise ModelError(f"{path}: {brief(error)}") from None
    if isinstance(model, tuple):
        model = model[0]
    _scale(model, root, path)
    complete(model, root)
    mark_passive_joints(model, root)
    radians = 1.0 if in_radians(root) else np.pi / 180
    place_sites(model, root, radians)
    for option in root.findall("option"):
        if "gravity" in option.attrib:
            model.gravity.linear = read_numbers(option.attrib["gravity"])
        if any(flag.get("gravity") == "disable" for flag in option.findall("flag")):
            model.gravity.linear = np.zeros(3)
    return Description(
        model,
        partial(_geometry, model, root, path, meshes),
        couplings(root, path),
        folders=allowed.folders,
        closures=closures(root, path, radians),
    )


def _geometry(
    model: pin.Model, root: ElementTree.Element, path: Path, meshes: MjcfMeshes, kind: str
) -> pin.GeometryModel:
    with geometry_errors(path), _written(root) as file:
        full = pin.buildGeomFromMJCF(model, file, GEOMETRY[kind])
    for shape in list(full.geometryObjects):
        if type(shape.geometry).__name__ in ("Halfspace", "Plane"):  # an infinite floor is not part of the robot
            full.removeGeometryObject(shape.name)
    meshes.put_in(full)
    return full


def _understood(
    root: ElementTree.Element, path: Path, base: str | None, allowed: AllowedFolders
) -> ElementTree.Element:
    """Return a file with explicit defaults. MuJoCo expands the shorthand that only MuJoCo supports.

    Raises:
        ModelError: an element is not supported, a named file is not allowed, or there is no body.
    """
    _check_makers(root, path)
    what = "<include>" if included(root, path, allowed) else shorthand(root)
    resolve_assets(root, path, allowed)
    if what is not None:
        _check_makers(root, path)
        root = flattened(root, path, what)
    if not root.findall("worldbody/body"):
        raise ModelError(f"{path}: <worldbody> has no <body>")
    plain = copy.deepcopy(root)
    make_plain(plain, path, base)
    resolve_assets(plain, path, allowed)  # a default class may name files too
    what = weighed(plain)
    if what is not None:
        plain = flattened(root, path, what)
        make_plain(plain, path, base)
    return plain


def _clear_base(root: ElementTree.Element, path: Path, base: str | None) -> None:
    """Remove the free joints of the file if another base is requested.

    Raises:
        ModelError: the base of the file has joints that are not free.
    """
    if base is None:
        return
    for body in root.findall("worldbody/body"):
        for element in [each for each in body if _is_free(each)]:
            body.remove(element)
        own = body.findall("joint")
        if own and ROOT_JOINTS[base] is not None:
            raise ModelError(
                f"{path}: base='{base}' would move body '{body.get('name')}', which has "
                f"{counted(len(own), 'joint')} of its own: take the file's own base (None)"
            )


def _check_makers(root: ElementTree.Element, path: Path) -> None:
    """Refuse elements that generate bodies and are not supported.

    Raises:
        ModelError: there is such an element.
    """
    for element in root.findall("worldbody//*"):
        if element.tag in _SOFT:
            raise ModelError(f"{path}: <{element.tag}> is not supported: write out the bodies that it generates")


def _check_unknown(root: ElementTree.Element, path: Path) -> None:
    """Refuse impossible values; warn about springs, which are omitted.

    Raises:
        ModelError: negative damping, a range with its lower limit above the upper one, or a body with two inertias.
    """
    for element in root.findall("worldbody//*"):
        if element.tag == "body" and len(element.findall("inertial")) > 1:
            raise ModelError(f"{path}: body '{element.get('name')}' has more than one <inertial>")
    springs = []
    for joint in root.iter("joint"):
        name = joint.get("name") or "without a name"
        damping, stiffness, bounds = (read_numbers(joint.get(key, "")) for key in ("damping", "stiffness", "range"))
        if damping is not None and (damping < 0).any():
            raise ModelError(f"{path}: damping of joint '{name}' is negative: {joint.get('damping')}")
        if bounds is not None and bounds.size == 2 and bounds[0] > bounds[1]:
            raise ModelError(f"{path}: range of joint '{name}' has a lower limit above the upper: {joint.get('range')}")
        if (stiffness is not None and stiffness.any()) or joint.get("springdamper"):
            springs.append(name)
    if springs:
        text = f"{path.name}: springs (stiffness, springdamper) are left out of the model: joint {few(springs)}"
        warnings.warn(text, ModelWarning, stacklevel=5)


def _scale(model: pin.Model, root: ElementTree.Element, path: Path) -> None:
    """Scale all masses to the total of ``settotalmass``, as MuJoCo does after compilation."""
    compiler = root.find("compiler")
    numbers = None if compiler is None else read_numbers(compiler.get("settotalmass", ""))
    if compiler is None or "settotalmass" not in compiler.attrib:
        return
    if numbers is None or numbers.size != 1:
        raise ModelError(f"{path}: settotalmass takes a number, found '{compiler.get('settotalmass')}'")
    total = sum(inertia.mass for inertia in model.inertias)
    if numbers[0] > 0 and total > 0:
        factor = float(numbers[0]) / total
        for index, inertia in enumerate(model.inertias):
            model.inertias[index] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)


def _snap(root: ElementTree.Element, path: Path) -> None:
    """Replace rounded axes of joints and quaternions of bodies by exact ones, and angles of bodies given in radians."""
    roundings = Roundings()
    angles = in_radians(root)
    for element in root.iter():
        exact = {}
        where = f"{element.tag} '{element.get('name', '')}'"
        if element.tag == "joint":
            exact["axis"] = roundings.direction
        if element.tag == "body":
            exact["quat"] = roundings.direction
            if angles:
                exact["euler"] = roundings.angles_of
        for key, make in exact.items():
            if key in element.attrib:
                element.set(key, make(element.attrib[key], where))
    words = roundings.words()
    if words:
        warnings.warn(f"{path.name}: {words}", ModelWarning, stacklevel=4)


@contextmanager
def _written(root: ElementTree.Element) -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.xml"
        file.write_bytes(ElementTree.tostring(root))
        yield str(file)


def _is_free(element: ElementTree.Element) -> bool:
    return element.tag == "freejoint" or (element.tag == "joint" and element.get("type") == "free")


def _check(root: ElementTree.Element, path: Path, base: str | None) -> None:
    seen: set[str] = set()
    # Equalities name joints too.
    parts = {element for body in root.findall("worldbody/body") for element in body.iter()}
    for element in root.iter():
        if element.tag in ("joint", "freejoint") and element.get("name") and element in parts:
            name = str(element.get("name"))
            if name in seen:
                raise ModelError(f"{path}: duplicate joint '{name}'")
            taken = name == "universe" or (
                name == "root_joint" and ROOT_JOINTS[base or "fixed"] and not _is_free(element)
            )
            if taken:  # Pinocchio would end the process, or add joints endlessly
                raise ModelError(f"{path}: a joint cannot be called '{name}': it is the base's name")
            seen.add(name)
        if element.tag == "joint" and element.get("type", "hinge") not in _JOINTS and element in parts:
            kind = str(element.get("type"))
            raise ModelError(f"{path}: joint '{element.get('name')}' of type '{kind}'{nearest(kind, _JOINTS)}")
        for key, text in element.attrib.items():
            if key in _SIZES and element.tag in ("body", "joint", "freejoint", "geom", "inertial", "site", "option"):
                numbers = read_numbers(text)
                if numbers is None or numbers.size not in _SIZES[key]:
                    count = " or ".join(map(str, _SIZES[key])) if len(_SIZES[key]) < 3 else "some"
                    where = (
                        f'<{element.tag} name="{element.get("name")}">' if element.get("name") else f"<{element.tag}>"
                    )
                    raise ModelError(f"{path}: {where}: {key} takes {count} finite numbers, found '{text}'")
