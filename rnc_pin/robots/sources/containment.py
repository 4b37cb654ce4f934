"""Check that a robot description names only files in its own folders, after symbolic links are resolved.

Every reader calls this check before it opens a file that a description names. Otherwise a description from an untrusted
source could name any file of the computer. The content of that file would appear in a draft, a picture or an error.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import islice
from pathlib import Path

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import read_bytes
from rnc_pin.io.safe_xml import parse_tree

REMEDY = "give its folder in package_dirs (--package-dir) if you trust the description with it"
_LEVELS = 8  # number of folders above a description in which packages are searched
_LARGEST_MANIFEST = 2**20  # [bytes]
_DATA = (
    *("assets", "collision", "collisions", "common", "dae", "materials", "media", "mesh", "meshes", "mjcf", "obj"),
    *("robots", "stl", "stls", "textures", "urdf", "urdfs", "visual", "visuals", "xacro"),
)
"""Customary names of folders beside the folder of a description without a package."""


class AllowedFolders:
    """Folders whose files a description may name.

    These are its own folder, its ROS package, and the added folders. A description without a package may also use
    folders beside its own with customary names, such as ``../meshes``.

    Args:
        beside: folder of the description.
        given: folders that the user allows.
    """

    def __init__(self, beside: Path, given: Iterable[Path] = ()) -> None:
        own, *above = folders_above(beside.resolve())
        self._folders = [own, *(folder.resolve() for folder in given)]
        package = next((folder for folder in (own, *above) if package_name(folder) is not None), None)
        if package is not None:
            self._folders.append(package)
        elif above:
            self._folders += [above[0] / name for name in _DATA]

    @property
    def folders(self) -> tuple[Path, ...]:
        """Absolute paths without symbolic links."""
        return tuple(dict.fromkeys(self._folders))

    def add(self, path: Path) -> None:
        """Allow an additional folder, or a single file."""
        self._folders.append(path.resolve())

    def has(self, file: Path) -> bool:
        """True if a description may name this file."""
        return is_below(file, self._folders)

    def admit(self, file: Path, what: str) -> Path:
        """Return the absolute path of a file, without symbolic links.

        Args:
            file: path as in the description.
            what: name of the file in messages.

        Raises:
            ModelError: the file is in none of the folders.
        """
        if not self.has(file):
            raise ModelError(f"{what} is outside the folders of the description: {REMEDY}")
        return file.resolve()


def is_below(file: Path, folders: Iterable[Path]) -> bool:
    """True if a file is in one of these folders or below, after symbolic links are resolved.

    Args:
        file: any path.
        folders: absolute paths without symbolic links; one may be the file itself.
    """
    try:
        found = file.resolve()
    except (OSError, RuntimeError, ValueError):  # circular links, or an invalid file name
        return False
    return any(found.is_relative_to(folder) for folder in folders)


def folders_above(folder: Path) -> Iterator[Path]:
    """Yield a folder and the folders above it that can belong to the same project, the nearest first.

    The search stops before the root of the file system, the home directory or a folder above it, another file system,
    and a folder where all users may write.
    """
    yield folder
    home = Path(os.path.expanduser("~")).resolve()
    try:
        device = folder.stat().st_dev
        for above in islice(folder.parents, _LEVELS):
            status = above.stat()
            shared = status.st_mode & stat.S_ISVTX and status.st_mode & stat.S_IWOTH
            if above == Path(above.anchor) or home.is_relative_to(above) or shared or status.st_dev != device:
                return
            yield above
    except OSError:
        return


@lru_cache(maxsize=1024)
def package_name(folder: Path) -> str | None:
    """Name in the ``package.xml`` of a folder, or None if the folder is no ROS package."""
    try:
        root = parse_tree(read_bytes(folder / "package.xml", _LARGEST_MANIFEST))
    except (OSError, ModelError, SyntaxError, ValueError, LookupError):  # XML errors are SyntaxErrors
        return None
    return (root.findtext("name") or "").strip() if root.tag == "package" else None
