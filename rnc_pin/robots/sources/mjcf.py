"""Reader of MJCF files. MuJoCo's compiler, the extra ``mujoco``, decides what a file means."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from rnc_pin.errors import ModelError, ModelWarning
from rnc_pin.robots.sources.description import Closure, Description, Mimic, brief, check_base
from rnc_pin.robots.sources.description_files import AllowedFolders
from rnc_pin.robots.sources.mjcf_document import compile_document, read_with_includes, reduce_document
from rnc_pin.robots.sources.mjcf_geometry import MeshAssets, MjcfGeometry
from rnc_pin.robots.sources.mjcf_model import ModelBuilder, pose
from rnc_pin.robots.sources.rounding import snap_mjcf

if TYPE_CHECKING:
    import mujoco


def read_mjcf(path: Path, base: str | None, package_dirs: Sequence[Path] = (), *, snap: bool = True) -> Description:
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
        check_base(base)
    allowed = AllowedFolders(path.parent, package_dirs)
    root = read_with_includes(path, allowed)
    name = root.get("model") or path.stem
    ignored = unread(root)
    reduce_document(root, path)
    notes = snap_mjcf(root) if snap else []
    assets = MeshAssets(root, path)
    compiled = compile_document(root, path, assets)
    try:
        built = ModelBuilder(compiled, name, base)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    except Exception as error:  # Boost.Python raises any type of C++ exception
        raise ModelError(f"{path}: {brief(error)}") from None
    mark_passive_joints(compiled, built)
    coupled, nonlinear = mimics(compiled, built)
    if ignored | nonlinear:
        notes.append(f"{', '.join(sorted(ignored | nonlinear))} is left out of the model: add constraints for it")
    for note in [*built.notes, *notes]:
        warnings.warn(f"{path.name}: {note}", ModelWarning, stacklevel=3)
    geometry = MjcfGeometry(compiled, built, assets)
    return Description(
        built.model,
        geometry,
        mimics=coupled,
        folders=allowed.folders,
        closures=tuple(closures(compiled, built)),
        references=built.references,
    )


# ---------------------------------------------------------------------- couplings


_CONNECT, _WELD, _JOINT = range(3)  # types of equalities
_ON_TENDON = 3  # transmission of an actuator
_READ = ("connect", "weld", "joint")


def unread(root: ElementTree.Element) -> set[str]:
    """Elements of a file that couple bodies and are not read."""
    active = [each.tag for each in root.findall("equality/*") if each.get("active", "true") != "false"]
    tendons = {"<tendon>"} if root.find("tendon/*") is not None else set()
    return {f"<equality><{tag}>" for tag in active if tag not in _READ} | tendons


def mark_passive_joints(compiled: mujoco.MjModel, built: ModelBuilder) -> None:
    """Set the effort limits of joints without an actuator to zero, as a URDF does for passive joints.

    The model does not change if no actuator drives a joint.
    """
    driven: set[int] = set()
    for kind, target in zip(compiled.actuator_trntype, compiled.actuator_trnid[:, 0], strict=True):
        first, count = (compiled.tendon_adr[target], compiled.tendon_num[target]) if kind == _ON_TENDON else (0, 0)
        driven |= set(map(int, compiled.wrap_objid[first : first + count])) if kind == _ON_TENDON else {int(target)}
    model, driven_names = built.model, {built.joint_name(k) for k in driven}
    for joint in model.joints[1:] if driven else ():
        if model.names[joint.id] not in driven_names:
            entries = slice(joint.idx_v, joint.idx_v + joint.nv)
            for limit in (model.effortLimit, model.upperEffortLimit, model.lowerEffortLimit):
                limit[entries] = 0.0


def mimics(compiled: mujoco.MjModel, built: ModelBuilder) -> tuple[tuple[Mimic, ...], set[str]]:
    """Linear equalities of two joints, and the elements that are of another form."""
    found: list[Mimic] = []
    others: set[str] = set()
    for k in _equalities(compiled, (_JOINT,)):
        joint, of = compiled.eq_obj1id[k], compiled.eq_obj2id[k]
        offset, ratio, *higher = map(float, compiled.eq_data[k, :5])
        if of < 0 or any(higher):
            others.add("<equality><joint>")
            continue
        # The equality is between displacements from the configuration of the file.
        rest, of_rest = (float(compiled.qpos0[compiled.jnt_qposadr[each]]) for each in (joint, of))
        found.append(Mimic(built.joint_name(joint), built.joint_name(of), ratio, offset + rest - ratio * of_rest))
    return tuple(found), others


def closures(compiled: mujoco.MjModel, built: ModelBuilder) -> Iterator[Closure]:
    """Yield the kinematic loops, without those of bodies that the user moves (``mocap``)."""
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
        kind: Literal["frame", "point"] = "frame" if is_weld and data[10] > 0 else "point"
        rpy = pin.rpy.matrixToRpy(turn) if kind == "frame" else np.zeros(3)
        names = [built.carriers[body].name for body in ends]
        yield Closure(names[0], names[1], kind, _rounded(a), _rounded(b), _rounded(rpy))


def _equalities(compiled: mujoco.MjModel, kinds: tuple[int, ...]) -> list[int]:
    return [k for k in range(compiled.neq) if compiled.eq_active0[k] and compiled.eq_type[k] in kinds]


def _rounded(numbers: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(each), 12) + 0.0 for each in numbers)
    return x, y, z
