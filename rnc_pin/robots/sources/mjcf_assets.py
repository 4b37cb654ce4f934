"""Files that an MJCF names: admitted, and by their absolute paths, so that they are found from anywhere."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from rnc_pin.errors import ModelError
from rnc_pin.regular_files import LARGEST, is_file
from rnc_pin.robots.sources.containment import AllowedFolders


def resolve_assets(root: ElementTree.Element, path: Path, allowed: AllowedFolders) -> None:
    """Let all assets name their files by absolute paths, in place; doing it again changes nothing.

    Args:
        root: of the file.
        path: of the file.
        allowed: which files it may name.

    Raises:
        ModelError: a file is not allowed, or that of a mesh is not there.
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
        if asset.tag == "mesh" or is_file(place):
            asset.set("file", str(own_file(place, path, allowed, f'<{asset.tag} file="{name}">')))


def own_file(file: Path, path: Path, allowed: AllowedFolders, where: str) -> Path:
    """Return the absolute path of a file that a description may name.

    Args:
        file: as it is named.
        path: of the description, for messages.
        allowed: which files it may name.
        where: the element that names it, for messages.

    Raises:
        ModelError: it is not allowed, not there, no regular file, or too large.
    """
    try:
        found = allowed.admit(file, where)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    if not is_file(found):
        raise ModelError(f"{path}: {where}: no {'mesh' if where.startswith('<mesh') else 'file'} '{found}'")
    if found.stat().st_size > LARGEST:
        raise ModelError(f"{path}: {where}: '{found}' is larger than {LARGEST:,} bytes")
    return found
