"""Files that a robot description may name: those in its own folders, after links are resolved.

Every reader asks here before it opens a file that a description names. A description from a stranger could otherwise
name any file of the computer, and what it says would show up in a draft, a picture or an error.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import islice
from pathlib import Path

from rnc_pin.errors import ModelError
from rnc_pin.regular_files import read_bytes
from rnc_pin.robots.sources.description import parse_tree

REMEDY = "give its folder in package_dirs (--package-dir) if you trust the description with it"
_LEVELS = 8  # folders above a description in which packages are searched
_LARGEST_MANIFEST = 2**20  # [bytes]
_DATA = (
    *("assets", "collision", "collisions", "common", "dae", "materials", "media", "mesh", "meshes", "mjcf", "obj"),
    *("robots", "stl", "stls", "textures", "urdf", "urdfs", "visual", "visuals", "xacro"),
)
"""Folders that descriptions without a package have beside their own."""


class AllowedFolders:
    """Folders whose files a description may name.

    These are its own folder, the ROS package that it is in, and what is added. A description in no package may also use
    the folders beside its own whose names are customary for robots, such as ``../meshes``.

    Args:
        beside: folder of the description.
        given: folders that the user names.
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
        """Absolute paths without links."""
        return tuple(dict.fromkeys(self._folders))

    def add(self, path: Path) -> None:
        """Allow one more folder, or a single file."""
        self._folders.append(path.resolve())

    def has(self, file: Path) -> bool:
        """Whether a description may name this file."""
        return is_below(file, self._folders)

    def admit(self, file: Path, what: str) -> Path:
        """Return the absolute path of a file, without links.

        Args:
            file: as the description names it.
            what: names it, for messages.

        Raises:
            ModelError: it is in none of the folders.
        """
        if not self.has(file):
            raise ModelError(f"{what} is outside the folders of the description: {REMEDY}")
        return file.resolve()


def is_below(file: Path, folders: Iterable[Path]) -> bool:
    """Whether a file is in one of these folders or below, after its links are resolved.

    Args:
        file: any path.
        folders: absolute paths without links; one may be the file itself.
    """
    try:
        found = file.resolve()
    except (OSError, RuntimeError, ValueError):  # a ring of links, or a name that no file can have
        return False
    return any(found.is_relative_to(folder) for folder in folders)


def folders_above(folder: Path) -> Iterator[Path]:
    """A folder and those above it that can belong to one project, the nearest first.

    They end before the root of the file system, the home directory or a folder above it, another file system, and a
    folder where all users may write.
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
    """Name in the ``package.xml`` of a folder, or None if it is no ROS package."""
    try:
        root = parse_tree(read_bytes(folder / "package.xml", _LARGEST_MANIFEST))
    except (OSError, ModelError, SyntaxError, ValueError, LookupError):  # XML errors are SyntaxErrors
        return None
    return (root.findtext("name") or "").strip() if root.tag == "package" else None
