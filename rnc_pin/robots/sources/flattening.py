"""Expansion of MJCF shorthand by MuJoCo: included files, frames, replicated bodies.

MuJoCo is the optional extra ``mujoco``. The compiled model is written as MJCF with explicit bodies, inertias, joints
and shapes, all numbers in full precision. The MJCF reader then reads it like any other file.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError
from rnc_pin.robots.sources.containment import AllowedFolders
from rnc_pin.robots.sources.description import brief, captured_stderr, parse_xml
from rnc_pin.robots.sources.mjcf_assets import own_file
from rnc_pin.robots.sources.mjcf_meshes import mesh_name, write_out
from rnc_pin.robots.sources.mujoco_log import unlogged
from rnc_pin.robots.sources.plain_mjcf import SIZES

_MOST_ELEMENTS = 20_000  # bodies and their parts after expansion
_KEPT = ("compiler", "option", "default", "asset", "worldbody")
_MOVED = ("body", "joint", "freejoint", "geom", "inertial")
_PARTS = ("body", "frame", "replicate", "inertial", "joint", "freejoint", "geom", "site")
_CHILDREN = {
    "mujoco": _KEPT,
    "option": ("flag",),
    "default": ("default", "joint", "geom", "mesh", "material", "site"),
    "asset": ("mesh", "material"),
    **dict.fromkeys(("worldbody", "body", "frame", "replicate"), _PARTS),
}
_INERTIAS = {  # compiler settings for inertias that Pinocchio's parser treats differently, with neutral values
    "boundmass": "0", "boundinertia": "0", "balanceinertia": "false", "inertiagrouprange": "0 5",
    "inertiafromgeom": "auto",
}  # fmt: skip
_LEFT = ("equality", "tendon", "actuator")  # read from the file as it is
_JOINTS = ("free", "ball", "slide", "hinge")
_SHAPES = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}
_NEEDED = "is not read without MuJoCo: pip install 'rnc_pin[mujoco]'"


def shorthand(root: ElementTree.Element) -> str | None:
    """Return the first shorthand that places or repeats parts of bodies, or changes inertias; None if there is none."""
    for element in root.findall("worldbody//frame") + root.findall("worldbody//replicate"):
        if any(each.tag in _MOVED for each in element.iter()):
            return f"<{element.tag}>"
    for compiler in root.findall("compiler"):
        for key, usual in _INERTIAS.items():
            if compiler.get(key, usual) != usual:
                return f'<compiler {key}="{compiler.get(key)}">'
    return None


def weighed(root: ElementTree.Element) -> str | None:
    """Return a shape whose volume determines the mass of its body, which Pinocchio's parser ignores, or None.

    Args:
        root: root element of a file with its defaults written out.
    """
    for body in root.findall("worldbody//body"):
        if body.find("inertial") is None:
            for geom in body.findall("geom"):
                if geom.get("mesh") or geom.get("shellinertia", "false") == "true":
                    return f"the mass of <geom mesh=\"{geom.get('mesh', '')}\"> in body '{body.get('name')}'"
    return None


def included(root: ElementTree.Element, path: Path, allowed: AllowedFolders) -> bool:
    """Insert the included files, each once and only from allowed folders. Return True if there was any.

    Raises:
        ModelError: an included file is not allowed, included twice, not MJCF, or recursive. MuJoCo, which merges
            duplicate elements, is not installed.
    """
    seen: set[Path] = set()
    found = root.find(".//include")
    if found is not None:
        _mujoco(f'{path}: <include file="{found.get("file", "")}">')
        _include(root, path, allowed, seen)
    return bool(seen)


def _include(parent: ElementTree.Element, path: Path, allowed: AllowedFolders, seen: set[Path]) -> None:
    for index, element in reversed(list(enumerate(parent))):
        if element.tag != "include":
            _include(element, path, allowed, seen)
            continue
        name = element.get("file", "")
        file = own_file(path.parent / name, path, allowed, f'<include file="{name}">')
        if file in seen or file == path.resolve():
            raise ModelError(f'{path}: duplicate <include file="{name}">')
        seen.add(file)
        inner = parse_xml(file)
        _include(inner, path, allowed, seen)
        parent[index : index + 1] = list(inner)


def flattened(root: ElementTree.Element, path: Path, what: str) -> ElementTree.Element:
    """Return an MJCF with every body written out.

    Args:
        root: root element of the file, whose assets name allowed files (``resolve_assets``).
        path: path of the file, for messages.
        what: shorthand that requires the expansion, for messages.

    Raises:
        ModelError: MuJoCo is not installed or refuses the file, or the expansion is too large.
    """
    mujoco = _mujoco(f"{path}: {what}")
    if sum(_size(element, path) for element in root) > _MOST_ELEMENTS:
        raise ModelError(f"{path}: stands for more than {_MOST_ELEMENTS:,} elements")
    meshes = _files_of_meshes(root)
    text = ElementTree.Element("mujoco")
    text.extend(element for element in root if element.tag in _KEPT)
    _strip(text)
    inline = {mesh_name(each) for each in text.findall("asset/mesh") if not each.get("file")}
    write_out(text, path)
    try:
        with captured_stderr(), unlogged(mujoco), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = mujoco.MjModel.from_xml_string(ElementTree.tostring(text, encoding="unicode"))
    except Exception as error:  # raised by its C code
        raise ModelError(f"{path}: {brief(error)}") from None
    own = {mesh_name(each): each for each in text.findall("asset/mesh") if mesh_name(each) in inline}
    return _written(model, root, meshes, own)


def _files_of_meshes(root: ElementTree.Element) -> dict[str, str]:
    """Mesh name to absolute path."""
    meshes = {}
    for mesh in root.findall("asset/mesh"):
        file = mesh.get("file")
        if file:
            meshes[mesh.get("name") or Path(file).stem] = file
    return meshes


def _strip(element: ElementTree.Element) -> None:
    """Remove elements without motion or shape: textures and height fields of any size, sensors, plugins."""
    kept = _CHILDREN.get(element.tag, ())
    for child in list(element):
        made = element.tag == "asset" and ("builtin" in child.attrib or "plugin" in child.attrib)
        if child.tag not in kept or child.get("type") in ("hfield", "sdf") or made:
            element.remove(child)
        else:
            child.attrib.pop("texture", None)
            _strip(child)


def _mujoco(what: str) -> Any:
    try:
        import mujoco
    except ImportError:
        raise ModelError(f"{what} {_NEEDED}") from None
    return mujoco


def _size(element: ElementTree.Element, path: Path) -> int:
    """Number of elements after expansion of an element."""
    inside = 1 + sum(_size(each, path) for each in element)
    if element.tag != "replicate":
        return inside
    count = element.get("count", "1")
    if not (count.isascii() and count.isdigit() and len(count) < 20):
        raise ModelError(f"{path}: <replicate> takes a whole number as its count, found '{count}'")
    return inside * max(1, int(count))


# ---------------------------------------------------------------------- compiled model as MJCF


def _written(
    model: Any, root: ElementTree.Element, files: Mapping[str, str], own: Mapping[str, ElementTree.Element]
) -> ElementTree.Element:
    """Write a compiled model as MJCF. Meshes are given by file name or by their inline elements."""
    flat = ElementTree.Element("mujoco", {"model": root.get("model", "robot")})
    ElementTree.SubElement(flat, "compiler", {"angle": "radian"})
    option = ElementTree.SubElement(flat, "option", {"gravity": _words(model.opt.gravity)})
    option.extend(root.findall("option/flag"))
    assets = ElementTree.SubElement(flat, "asset")
    for k in range(model.nmesh):
        name = model.mesh(k).name
        if name in files:
            found = {"name": name, "file": files[name], "scale": _words(model.mesh_scale[k])}
            ElementTree.SubElement(assets, "mesh", found)
        elif name in own:
            inside = {key: own[name].get(key, "") for key in ("vertex", "face")}
            found = {"name": name, "scale": _words(model.mesh_scale[k]), **inside}
            ElementTree.SubElement(assets, "mesh", found)
    bodies = [ElementTree.SubElement(flat, "worldbody")]
    for k in range(1, model.nbody):
        bodies.append(ElementTree.SubElement(bodies[model.body_parentid[k]], "body", _body(model, k)))
        if model.body_mass[k] > 0:
            ElementTree.SubElement(bodies[k], "inertial", _inertial(model, k))
    for k in range(model.njnt):
        kind = _JOINTS[model.jnt_type[k]]
        ElementTree.SubElement(bodies[model.jnt_bodyid[k]], "joint", _joint(model, k, kind))
    for k in range(model.ngeom):
        shape = _SHAPES.get(int(model.geom_type[k]))
        if shape is not None and (shape != "mesh" or model.mesh(model.geom_dataid[k]).name in {*files, *own}):
            ElementTree.SubElement(bodies[model.geom_bodyid[k]], "geom", _geom(model, k, shape))
    for k in range(model.nsite):
        place = {"pos": _words(model.site_pos[k]), "quat": _words(model.site_quat[k])}
        ElementTree.SubElement(bodies[model.site_bodyid[k]], "site", {**_named(model.site(k).name), **place})
    flat.extend(element for element in root if element.tag in _LEFT)
    return flat


def _named(name: str) -> dict[str, str]:
    return {"name": name} if name else {}


def _words(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _body(model: Any, k: int) -> dict[str, str]:
    mocap = {"mocap": "true"} if model.body_mocapid[k] >= 0 else {}
    return {**_named(model.body(k).name), **mocap, "pos": _words(model.body_pos[k]), "quat": _words(model.body_quat[k])}


def _inertial(model: Any, k: int) -> dict[str, str]:
    return {
        "mass": _words([model.body_mass[k]]),
        "pos": _words(model.body_ipos[k]),
        "quat": _words(model.body_iquat[k]),
        "diaginertia": _words(model.body_inertia[k]),
    }


def _joint(model: Any, k: int, kind: str) -> dict[str, str]:
    entry = model.jnt_dofadr[k]
    found = {
        **_named(model.joint(k).name),
        "type": kind,
        "pos": _words(model.jnt_pos[k]),
        "damping": _words([model.dof_damping[entry]]),
        "armature": _words([model.dof_armature[entry]]),
        "frictionloss": _words([model.dof_frictionloss[entry]]),
        "stiffness": _words(np.ravel(model.jnt_stiffness[k])[:1]),
    }
    if kind in ("hinge", "slide"):
        found["axis"] = _words(model.jnt_axis[k])
        found["ref"] = _words([model.qpos0[model.jnt_qposadr[k]]])
    if kind in ("hinge", "slide") and model.jnt_limited[k]:
        found["range"] = _words(model.jnt_range[k])
    return found


def _geom(model: Any, k: int, shape: str) -> dict[str, str]:
    place = _place(model.geom_pos[k], model.geom_quat[k])
    color = model.geom_rgba[k] if model.geom_matid[k] < 0 else model.mat_rgba[model.geom_matid[k]]
    found = {
        **_named(model.geom(k).name),
        "type": shape,
        "mass": "0",  # the bodies have the masses
        "rgba": _words(color),
        "contype": str(model.geom_contype[k]),
        "conaffinity": str(model.geom_conaffinity[k]),
        "group": str(model.geom_group[k]),
    }
    if shape == "mesh":  # MuJoCo rotates meshes to their principal axes
        mesh = model.geom_dataid[k]
        found["mesh"] = model.mesh(mesh).name
        place = place * _place(model.mesh_pos[mesh], model.mesh_quat[mesh]).inverse()
    else:
        found["size"] = _words(model.geom_size[k][: SIZES[shape]])
    x, y, z, w = pin.SE3ToXYZQUAT(place)[3:]
    return {**found, "pos": _words(place.translation), "quat": _words([w, x, y, z])}


def _place(position: np.ndarray, quaternion: np.ndarray) -> pin.SE3:
    w, x, y, z = quaternion
    return pin.XYZQUATToSE3(np.array([*position, x, y, z, w]))
