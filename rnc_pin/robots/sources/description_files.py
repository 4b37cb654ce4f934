"""Files that a robot description may name: those in its own folders, and those of ROS packages, with or without ROS.

Every reader checks a file that a description names before it opens it, after symbolic links are resolved. Otherwise a
description from an untrusted source could name any file of the computer. The content of that file would appear in a
draft, a picture or an error.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from itertools import islice
from pathlib import Path

from rnc_pin.errors import ModelError
from rnc_pin.io.safe_read import parse_tree, read_bytes

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


# ---------------------------------------------------------------------- packages


_FOUND = re.compile(r"(?:file://)?\$\(find\s+([^\s()]+)\s*\)/*")


def package_uri(name: str) -> str:
    """Return ``package://name/path`` for a file name ``$(find name)/path``, as xacro has it; others do not change."""
    return _FOUND.sub(r"package://\1/", name, count=1) if _FOUND.match(name) else name


class Packages(AllowedFolders):
    """Search for ROS packages by name, and the folders whose files the description may name.

    The search order is: the given folders (a folder of packages, or a package itself), the environment variables
    ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``, then the file's own folder and those above (``folders_above``). A
    folder there matches if it is the package, by its name or its ``package.xml``, or if it contains the package. Of
    these, only a folder with a ``package.xml`` is allowed as a whole.

    Args:
        beside: folder of the file that names packages.
        given: folders given by the user.
    """

    def __init__(self, beside: Path, given: Iterable[str | Path] = ()) -> None:
        self._beside = beside.resolve()
        self._given = [Path(folder).expanduser().resolve() for folder in given]
        self._found: dict[str, Path] = {}
        self._known: dict[str, list[Path]] = {}  # candidates by name: a robot has dozens of meshes in one package
        super().__init__(self._beside, self._given)

    def candidates(self, name: str) -> Iterator[Path]:
        """Yield the folders that can be this package, the most likely first."""
        if name in ("", "..") or Path(name).name != name:
            return
        for folder in self._given:
            yield from _at(folder, name)
        prefixes = (prefix / "share" for prefix in _environment("AMENT_PREFIX_PATH"))
        for folder in (*_environment("ROS_PACKAGE_PATH"), *prefixes):
            for package in _at(folder, name):
                self.add(package)
                yield package
        yield from self._near(name)

    def folder(self, name: str) -> Path | None:
        """Return the folder of a package, or None."""
        return self._recorded(name, self.candidates(name))

    @property
    def found(self) -> Mapping[str, Path]:
        """Name to folder of each package that was requested and found."""
        return dict(self._found)

    @property
    def far(self) -> Mapping[str, Path]:
        """Those of ``found`` that a search only in the folders above the file does not find, or finds elsewhere."""
        return {name: folder for name, folder in self._found.items() if next(self._near(name), None) != folder}

    def _near(self, name: str) -> Iterator[Path]:
        for folder in folders_above(self._beside):
            for package in _at(folder, name):
                if package_name(package) is not None and package.resolve().is_relative_to(folder):
                    self.add(package)
                yield package

    def _recorded(self, name: str, candidates: Iterable[Path]) -> Path | None:
        folder = next(iter(candidates), None)
        if folder is not None:
            self._found.setdefault(name, folder)
        return folder

    def file(self, uri: str) -> Path | None:
        """Return the file of ``package://name/path``, ``file://path`` or a relative path, or None.

        Raises:
            ModelError: the file exists, but not in a folder whose files the description may name.
        """
        scheme, separator, rest = uri.partition("://")
        if separator and scheme in ("package", "model"):
            name, _, inside = rest.partition("/")
            if name not in self._known:
                self._known[name] = list(self.candidates(name))
            candidates = self._known[name]
            having = [each for each in candidates if os.path.isfile(each / inside)]
            having.sort(key=lambda each: not self.has(each / inside))
            self._recorded(name, [*having, *candidates])
            return self.admit(having[0] / inside, f"file '{uri}'") if having else None
        if separator and scheme != "file":
            return None
        path = Path(rest if separator else uri)
        places = [folder / path for folder in (self._beside, *self._given)]
        place = next((place for place in places if os.path.isfile(place)), None)
        return None if place is None else self.admit(place, f"file '{uri}'")


def _environment(variable: str) -> list[Path]:
    return [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each]


def _at(folder: Path, name: str) -> Iterator[Path]:
    if (folder.name == name or package_name(folder) == name) and os.path.isdir(folder):
        yield folder
    if os.path.isdir(folder / name):  # unlike Path.is_dir, False for an invalid file name
        yield folder / name
