"""Reader of MJCF files. MuJoCo's compiler, the extra ``mujoco``, decides what a file means."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

from rnc_pin.errors import ModelError, ModelWarning
from rnc_pin.robots.sources.containment import AllowedFolders
from rnc_pin.robots.sources.description import Description, brief, check_base
from rnc_pin.robots.sources.mjcf_compiler import compile_document
from rnc_pin.robots.sources.mjcf_couplings import closures, mark_passive_joints, mimics, unread
from rnc_pin.robots.sources.mjcf_document import read_with_includes, reduce_document
from rnc_pin.robots.sources.mjcf_geometry import MjcfGeometry
from rnc_pin.robots.sources.mjcf_meshes import MeshAssets
from rnc_pin.robots.sources.mjcf_model import ModelBuilder
from rnc_pin.robots.sources.rounding import snap_mjcf


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
