"""Files that an MJCF names: checked, and replaced by absolute paths, so that they are found from any folder."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import LARGEST
from rnc_pin.robots.sources.containment import AllowedFolders


def resolve_assets(root: ElementTree.Element, path: Path, allowed: AllowedFolders) -> None:
    """Replace the file names of all assets by absolute paths, in place. The operation is idempotent.

    Args:
        root: root element of the file.
        path: path of the file.
        allowed: folders whose files it may name.

    Raises:
        ModelError: a file is not allowed, or a mesh file does not exist.
    """
    folders, stripped = {"mesh": "", "texture": ""}, False
    for compiler in root.findall("compiler"):
        both = compiler.attrib.pop("assetdir", None)
        for kind in folders:
            said = compiler.attrib.pop(f"{kind}dir", both)
            folders[kind] = folders[kind] if said is None else said
        stripped = compiler.attrib.pop("strippath", str(stripped).lower()) == "true"
    for asset in root.findall("asset/*"):
        name = asset.get("file")
        if not name:
            continue
        place = path.parent / folders.get(asset.tag, folders["mesh"]) / (Path(name).name if stripped else name)
        if asset.tag == "mesh" or os.path.isfile(place):
            asset.set("file", str(own_file(place, path, allowed, f'<{asset.tag} file="{name}">')))


def own_file(file: Path, path: Path, allowed: AllowedFolders, where: str) -> Path:
    """Return the absolute path of a file that a description may name.

    Args:
        file: path as in the description.
        path: path of the description, for messages.
        allowed: folders whose files it may name.
        where: element that names the file, for messages.

    Raises:
        ModelError: the file is not allowed, does not exist, is not a regular file, or is too large.
    """
    try:
        found = allowed.admit(file, where)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    if not os.path.isfile(found):
        raise ModelError(f"{path}: {where}: no {'mesh' if where.startswith('<mesh') else 'file'} '{found}'")
    if found.stat().st_size > LARGEST:
        raise ModelError(f"{path}: {where}: '{found}' is larger than {LARGEST:,} bytes")
    return found
