"""Reader of MJCF files. MuJoCo's compiler, the extra ``mujoco``, decides what a file means.

MuJoCo sees only files of the description, checked numbers and a bounded size, and no plugins.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, check_known, missing_extra, nearest, warn
from rnc_pin.io.safe_read import LARGEST
from rnc_pin.robots import robot_files
from rnc_pin.robots.sources import description, urdf_repairs
from rnc_pin.robots.sources.mjcf_model import SMALLEST, MeshAssets, MjcfGeometry, ModelBuilder, pose

if TYPE_CHECKING:
    import mujoco


def read_mjcf(
    path: Path, base: str | None, package_dirs: Sequence[Path] = (), *, snap: bool = True
) -> description.Description:
    """Read an MJCF file.

    Args:
        path: path of the file.
        base: None keeps the root joints of the file. "fixed", "planar" or "free" replaces its free joint.
        package_dirs: additional folders whose files the file may name.
        snap: replace rounded axes of joints and angles of bodies by exact ones.

    Raises:
        ModelError: the file cannot be read, is not MJCF, or needs an unsupported element; or there is no MuJoCo.
    """
    if base is not None:
        check_known(base, description.ROOT_JOINTS, "base", ModelError)
    allowed = robot_files.Packages(path.parent, package_dirs)
    root = read_with_includes(path, allowed)
    name = root.get("model") or path.stem
    # Before the document is reduced, because that drops what is not read.
    ignored, driven = unread(root), joints_of_actuators(root)
    with ModelError.at(path):
        reduce_document(root)
        # MuJoCo reads degrees by default, for which 90 is exact.
        units = [each.attrib["angle"] for each in root.findall("compiler") if "angle" in each.attrib]
        angles = [("body", ".", "euler")] if units[-1:] == ["radian"] else []
        notes = urdf_repairs.snap(root, [("joint", ".", "axis"), ("body", ".", "quat"), *angles]) if snap else []
        assets = MeshAssets(root)
        # By MuJoCo itself: defaults, frames, replicas and inertias from shapes then mean what they mean there.
        compiled = compile_document(root, assets)
        try:
            built = ModelBuilder(compiled, name, base)
        except ModelError:
            raise
        except Exception as error:  # Boost.Python raises any type of C++ exception
            raise ModelError(description.brief(error)) from None
        mark_passive_joints(compiled, built, driven)
    coupled, nonlinear = mimics(compiled, built)
    if ignored | nonlinear:
        notes.append(f"{', '.join(sorted(ignored | nonlinear))} is left out of the model: add constraints for it")
    for note in [*built.notes, *notes]:
        warn(f"{path.name}: {note}")
    return description.Description(
        built.model,
        MjcfGeometry(compiled, built, assets, path),
        mimics=coupled,
        folders=allowed.folders,
        closures=tuple(closures(compiled, built)),
        references=built.references,
    )


# ---------------------------------------------------------------------- couplings


_CONNECT, _WELD, _JOINT = range(3)  # types of equalities


def unread(root: ElementTree.Element) -> set[str]:
    """Elements of a file that couple bodies and are not read.

    Args:
        root: root element of the file.
    """
    active = [each.tag for each in root.findall("equality/*") if each.get("active", "true") != "false"]
    tendons = {"<tendon>"} if root.find("tendon/*") is not None else set()
    read = ("connect", "weld", "joint")
    return {f"<equality><{tag}>" for tag in active if tag not in read} | tendons


def joints_of_actuators(root: ElementTree.Element) -> set[str]:
    """Names of the joints that actuators of a file drive; none if one acts along a spatial tendon.

    Args:
        root: root element of the file.
    """
    tendons = {each.get("name", ""): each for each in root.findall("tendon/*")}
    found: set[str] = set()
    for actuator in root.findall("actuator/*"):
        found |= {actuator.attrib[key] for key in ("joint", "jointinparent") if key in actuator.attrib}
        name = actuator.get("tendon")
        if name in tendons and tendons[name].tag == "spatial":  # its joints are not known
            return set()
        if name in tendons:  # a fixed tendon drives all joints that it wraps
            found |= {each.get("joint", "") for each in tendons[name]}
        elif name is not None:  # refused with unknown joints
            found.add(name)
    return found


def mark_passive_joints(compiled: mujoco.MjModel, built: ModelBuilder, driven: set[str]) -> None:
    """Set the effort limits of joints without an actuator to zero, as a URDF does for passive joints.

    The model does not change if no actuator drives a joint.

    Args:
        compiled: the ``mujoco.MjModel``.
        built: the model, changed in place.
        driven: names of the joints that actuators drive.

    Raises:
        ModelError: an actuator drives an unknown joint.
    """
    names = [compiled.joint(k).name for k in range(compiled.njnt)]
    for name in sorted(driven.difference(names)):
        raise ModelError(f"unknown transmission target '{name}' of an actuator{nearest(name, names)}")
    model = built.model
    for joint in model.joints[1:] if driven else ():
        if model.names[joint.id] not in driven:
            entries = slice(joint.idx_v, joint.idx_v + joint.nv)
            for limit in (model.effortLimit, model.upperEffortLimit, model.lowerEffortLimit):
                limit[entries] = 0.0


def mimics(compiled: mujoco.MjModel, built: ModelBuilder) -> tuple[tuple[description.Mimic, ...], set[str]]:
    """Linear equalities of two joints, and the elements that are of another form.

    Args:
        compiled: the ``mujoco.MjModel``.
        built: the model.
    """
    found: list[description.Mimic] = []
    others: set[str] = set()
    for k in _equalities(compiled, (_JOINT,)):
        joint, of = compiled.eq_obj1id[k], compiled.eq_obj2id[k]
        offset, ratio, *higher = map(float, compiled.eq_data[k, :5])
        # One joint alone is held at a value, and a polynomial is not linear: neither is a coupling with a ratio.
        if of < 0 or any(higher):
            others.add("<equality><joint>")
            continue
        # The equality is between displacements from the configuration of the file.
        rest, of_rest = (float(compiled.qpos0[compiled.jnt_qposadr[each]]) for each in (joint, of))
        names = built.joint_name(joint), built.joint_name(of)
        found.append(description.Mimic(*names, ratio, offset + rest - ratio * of_rest))
    return tuple(found), others


def closures(compiled: mujoco.MjModel, built: ModelBuilder) -> Iterator[description.Closure]:
    """Yield the kinematic loops, without loops of bodies that the user moves (``mocap``).

    Args:
        compiled: the ``mujoco.MjModel``.
        built: the model.
    """
    import mujoco

    for k in _equalities(compiled, (_CONNECT, _WELD)):
        ends = [int(compiled.eq_obj1id[k]), int(compiled.eq_obj2id[k])]
        is_weld, data = compiled.eq_type[k] == _WELD, compiled.eq_data[k]
        # A weld places the anchor of body 2 in body 1, a connection has an anchor in each.
        a = data[3:6] if is_weld else data[:3]
        b = data[:3] if is_weld else data[3:6]
        turn = pose(np.zeros(3), data[6:10]).rotation if is_weld else np.eye(3)
        if compiled.eq_objtype[k] == mujoco.mjtObj.mjOBJ_SITE:
            one, other = (pose(compiled.site_pos[site], compiled.site_quat[site]) for site in ends)
            a, b, turn = one.translation, other.translation, one.rotation @ other.rotation.T
            ends = [int(compiled.site_bodyid[site]) for site in ends]
        if (compiled.body_mocapid[ends] >= 0).any():
            continue
        # data[10] is the weight of the weld's rotation (torquescale): without it only the points coincide.
        kind: Literal["frame", "point"] = "frame" if is_weld and data[10] > 0 else "point"
        rpy = pin.rpy.matrixToRpy(turn) if kind == "frame" else np.zeros(3)
        names = [built.frame(body).name for body in ends]
        yield description.Closure(names[0], names[1], kind, _rounded(a), _rounded(b), _rounded(rpy))


def _equalities(compiled: mujoco.MjModel, kinds: tuple[int, ...]) -> list[int]:
    return [k for k in range(compiled.neq) if compiled.eq_active0[k] and compiled.eq_type[k] in kinds]


def _rounded(numbers: np.ndarray) -> tuple[float, float, float]:
    # Twelve digits and no -0.0: they are the numbers of a scenario, and rotations have rounding errors.
    x, y, z = (round(float(each), 12) + 0.0 for each in numbers)
    return x, y, z


_BODY_CHILDREN = ("body", "frame", "replicate", "inertial", "joint", "freejoint", "geom", "site")
_CHILDREN = {
    "mujoco": ("compiler", "option", "default", "asset", "worldbody", "equality"),
    "option": ("flag",),
    "default": ("default", "joint", "geom", "mesh", "material", "site", "equality"),
    "asset": ("mesh", "material"),
    **dict.fromkeys(("worldbody", "body", "frame", "replicate"), _BODY_CHILDREN),
    "equality": ("connect", "weld", "joint"),
}
"""Children that MuJoCo is given. No textures, height fields, actuators, sensors, models of other files or plugins."""
_DROPPED = {"compiler": ("fusestatic", "discardvisual"), "material": ("texture",)}
"""Attributes that would remove named bodies and drawn shapes, or that name dropped elements."""
_COUNTS = {  # numbers per attribute
    "pos": (3,), "quat": (4,), "axis": (3,), "euler": (3,), "axisangle": (4,), "xyaxes": (6,), "zaxis": (3,),
    "fromto": (6,), "mass": (1,), "density": (1,), "diaginertia": (3,), "fullinertia": (6,), "range": (2,),
    "gravity": (3,), "armature": (1,), "frictionloss": (1,), "damping": (1, 2, 3), "size": (1, 2, 3, 4), "ref": (1,),
    "anchor": (3,), "relpose": (7,), "polycoef": (1, 2, 3, 4, 5), "settotalmass": (1,),
}  # fmt: skip


def read_with_includes(path: Path, allowed: robot_files.Packages) -> ElementTree.Element:
    """Return a file with its included files, in which each asset names an allowed file by its absolute path.

    Args:
        path: path of the file.
        allowed: folders whose files it may name.

    Raises:
        ModelError: the file is not MJCF, or a file that it names is not allowed, included twice, or missing.
    """
    root = description.parse_xml(path)
    if root.tag != "mujoco":
        raise ModelError(f"{path}: not MJCF: the outermost element is <{root.tag}>, expected <mujoco>")
    _include(root, path, allowed, set())
    _resolve_assets(root, path, allowed)
    return root


def _include(parent: ElementTree.Element, path: Path, allowed: robot_files.Packages, seen: set[Path]) -> None:
    # From the end: replacing an element moves only those behind it.
    for index, element in reversed(list(enumerate(parent))):
        if element.tag != "include":
            _include(element, path, allowed, seen)
            continue
        name = element.get("file", "")
        file = _own_file(path.parent / name, path, allowed, f'<include file="{name}">')
        # MuJoCo refuses a file that is included twice, and a file that includes itself would never end.
        if file in seen or file == path.resolve():
            raise ModelError(f'{path}: duplicate <include file="{name}">')
        seen.add(file)
        inner = description.parse_xml(file)
        _include(inner, path, allowed, seen)
        parent[index : index + 1] = list(inner)


def _resolve_assets(root: ElementTree.Element, path: Path, allowed: robot_files.Packages) -> None:
    folders, stripped = {"mesh": "", "texture": ""}, False
    for compiler in root.findall("compiler"):
        # Later <compiler> elements overrule earlier ones, and meshdir overrules assetdir, as in MuJoCo.
        both = compiler.attrib.pop("assetdir", None)
        for kind in folders:
            folder = compiler.attrib.pop(f"{kind}dir", both)
            folders[kind] = folders[kind] if folder is None else folder
        stripped = compiler.attrib.pop("strippath", str(stripped).lower()) == "true"
    for asset in root.findall("asset/*"):
        name = asset.get("file")
        if not name:
            continue
        place = path.parent / folders.get(asset.tag, folders["mesh"]) / (Path(name).name if stripped else name)
        # Textures are dropped later: a missing one does no harm, but a file elsewhere is refused all the same.
        if asset.tag == "mesh" or os.path.isfile(place):
            asset.set("file", str(_own_file(place, path, allowed, f'<{asset.tag} file="{name}">')))


def _own_file(file: Path, path: Path, allowed: robot_files.Packages, where: str) -> Path:
    with ModelError.at(path):
        found = allowed.admit(file, where)
    if not os.path.isfile(found):
        raise ModelError(f"{path}: {where}: no {'mesh' if where.startswith('<mesh') else 'file'} '{found}'")
    # MuJoCo would read a file of any size.
    if found.stat().st_size > LARGEST:
        raise ModelError(f"{path}: {where}: '{found}' is larger than {LARGEST:,} bytes")
    return found


def reduce_document(root: ElementTree.Element) -> None:
    """Remove all that has no effect on motion or shape, in place, and check the rest.

    Args:
        root: root element of the file.

    Raises:
        ModelError: an element is not supported, a number is not valid, the file is too large, or has no body.
    """
    generators = ("composite", "flexcomp", "attach")  # elements that make bodies, of which the names are not known here
    for element in root.findall("worldbody//*"):
        if element.tag in generators:
            raise ModelError(f"<{element.tag}> is not supported: write out the bodies that it generates")
    if root.find("worldbody//body") is None:
        raise ModelError("<worldbody> has no <body>")
    _strip(root)
    most_characters = 1_000  # of an attribute that defaults and <replicate> can repeat
    for parent in (*root.findall("worldbody"), *root.findall("default")):
        for element in parent.iter():
            for key, text in element.attrib.items():
                if len(text) > most_characters:
                    raise ModelError(f"<{element.tag}>: {key} is longer than {most_characters:,} characters")
    most_elements = 20_000  # after expansion of <replicate>
    if _size(root) > most_elements:
        raise ModelError(f"stands for more than {most_elements:,} elements")
    _check_numbers(root)


def _strip(element: ElementTree.Element) -> None:
    for key in _DROPPED.get(element.tag, ()):
        element.attrib.pop(key, None)
    kept = _CHILDREN.get(element.tag, ())
    for child in list(element):
        # Assets that MuJoCo makes have no shape for the model.
        made = element.tag == "asset" and ("builtin" in child.attrib or "plugin" in child.attrib)
        if child.tag not in kept or child.get("type") in ("hfield", "sdf") or made:
            element.remove(child)
        else:
            _strip(child)


def _size(element: ElementTree.Element) -> int:
    """Number of elements after expansion of an element."""
    inside = 1 + sum(_size(each) for each in element)
    if element.tag != "replicate":
        return inside
    count = element.get("count", "1")
    if not (count.isascii() and count.isdigit() and len(count) < 20):
        raise ModelError(f"<replicate> takes a whole number as its count, found '{count}'")
    return inside * max(1, int(count))


def _check_numbers(root: ElementTree.Element) -> None:
    for element in (each for each in root.iter() if each.tag != "flag"):
        for key, text in element.attrib.items():
            if key in _COUNTS:
                where = f'<{element.tag} name="{element.get("name")}">' if element.get("name") else f"<{element.tag}>"
                description.check_numbers(text, _COUNTS[key], f"{where}: {key}")


# ---------------------------------------------------------------------- compilation


def compile_document(root: ElementTree.Element, assets: MeshAssets) -> mujoco.MjModel:
    """Return the ``mujoco.MjModel`` of a file.

    A moving body without mass is compiled with the smallest one, because its joint may be locked.

    Args:
        root: root element of the file, reduced to what MuJoCo may see, without meshes.
        assets: meshes of the file.

    Raises:
        ModelError: MuJoCo is not installed, or refuses the file.
    """
    try:
        import mujoco
    except ImportError:
        raise ModelError(f"MuJoCo compiles MJCF. {missing_extra('mujoco')}") from None
    try:
        with description.captured_stderr(), description.unlogged(mujoco), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return _compile(root, assets)
            except ValueError as error:
                # Only bounds on masses make such a file compile; the body is checked again with the robot's joints.
                if "mjMINVAL" not in str(error):
                    raise
                bounds = {"boundmass": str(SMALLEST), "boundinertia": str(SMALLEST)}
                root.insert(0, ElementTree.Element("compiler", bounds))
                return _compile(root, assets)
    except ModelError:
        raise
    except Exception as error:  # raised by its C code
        raise ModelError(_explained(description.brief(error), root)) from None


def _compile(root: ElementTree.Element, assets: MeshAssets) -> mujoco.MjModel:
    import mujoco

    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    assets.put_in(spec)
    return spec.compile()


def _explained(message: str, root: ElementTree.Element) -> str:
    """Text of an error of MuJoCo, with the name of the file that is nearest to an unknown one."""
    text, _, place = message.replace("XML Error:", "").replace("Error:", "").partition("Element")
    text, named = " ".join(text.split()), re.search("'([^']+)'", place)
    text += "" if named is None else f" (element '{named[1]}')"
    unknown = re.search("'([^']+)'", text)
    if unknown is not None and ("unknown" in text or "not found" in text):
        names = {each.get("name", "") for each in root.iter()} - {""}
        names |= {"main", *(each.get("class", "main") for each in root.iter("default"))}
        text += nearest(unknown[1], sorted(names))
    return text
