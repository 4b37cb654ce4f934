"""Files of robots: where descriptions are, shipped or in example-robot-data, and the files that they may name.

Every reader checks a file that a description names before it opens it, after symbolic links are resolved. Otherwise a
description from an untrusted source could name any file of the computer. The content of that file would appear in a
draft, a picture or an error.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path

from rnc_pin.errors import ModelError, nearest
from rnc_pin.io.safe_read import parse_tree, read_bytes


def shipped_directory() -> Path:
    """Folder of the URDFs shipped with rnc_pin (in a wheel, or in a checkout)."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "urdf"
    return inside if inside.is_dir() else package.parent / "urdf"


def find_urdf(path: str | Path, beside: Path | None = None) -> Path:
    """Return the path of a URDF: absolute, relative to ``beside``, or the name of a shipped one.

    Args:
        path: absolute or relative path, or the name of a shipped file.
        beside: folder that a relative path refers to; the working directory by default.

    Raises:
        ModelError: no such file; the message names the nearest shipped one.
    """
    path = Path(path).expanduser()
    # A user's own file comes before a shipped one of the same name.
    for candidate in ((beside or Path()) / path, shipped_directory() / path):
        if os.path.isfile(candidate):
            return candidate.resolve()
    shipped = sorted(each.stem for each in shipped_directory().glob("*.urdf"))
    hint = "" if path.is_absolute() else nearest(path.stem, shipped, ".urdf")
    raise ModelError(f"no URDF file '{path}'{hint}")


def find_shipped(path: str, beside: Path) -> Path:
    """Return a path relative to ``beside``, or the path of a file shipped with rnc_pin if there is none.

    Args:
        path: relative path.
        beside: folder that it refers to first.
    """
    found = beside / path
    return found if found.is_file() or not (shipped_directory() / path).is_file() else shipped_directory() / path


def find_mjcf(path: str | Path, beside: Path | None = None) -> Path:
    """Return the path of an MJCF file, relative to ``beside``.

    Args:
        path: absolute or relative path.
        beside: folder that a relative path refers to; the working directory by default.

    Raises:
        ModelError: no such file; the message names the nearest one in the same folder.
    """
    found = (beside or Path()) / Path(path).expanduser()
    if os.path.isfile(found):
        return found.resolve()
    there = sorted(each.name for each in found.parent.glob("*.xml")) if found.parent.is_dir() else []
    raise ModelError(f"no MJCF file '{path}'{nearest(found.name, there) if there else ''}")


@cache
def _example_data() -> Path:
    import importlib.metadata  # it imports email and zipfile, which takes a twentieth of a cold start

    try:
        # The wheel installs outside of Python packages: only its list of files tells where.
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        raise ModelError("example-robot-data is not installed: pip install example-robot-data") from None
    places = (Path(str(file.locate())) for file in files if file.suffix == ".urdf")
    for folder in (parent for place in places for parent in place.parents):
        if folder.name == "robots" and folder.parent.name == "example-robot-data":
            return folder.resolve()
    raise ModelError("example-robot-data is installed without its robots")


@cache
def example_urdfs() -> dict[str, Path]:
    """All URDFs of example-robot-data by file name without suffix.

    If two robots have files of the same name, the robot's folder precedes it: ``anymal_b_simple/anymal``.
    """
    root = _example_data()
    paths = sorted(root.rglob("*.urdf"))
    stems = [path.stem for path in paths]
    folders = [path.relative_to(root).parts[0].removesuffix("_description") for path in paths]
    return {
        path.stem if stems.count(path.stem) == 1 else f"{folder}/{path.stem}": path
        for path, folder in zip(paths, folders, strict=True)
    }


def find_example(name: str) -> tuple[Path, Path]:
    """Return the URDF and the package folder of a robot in example-robot-data.

    Args:
        name: file name of the URDF without suffix, or with the folder of the robot before it.

    Raises:
        ModelError: no robot or several robots of that name; the message names the nearest.
    """
    urdfs = example_urdfs()
    if name not in urdfs:
        several = [each for each in urdfs if each.endswith(f"/{name}")]
        hint = f"; expected one of {', '.join(several)}" if several else nearest(name, urdfs)
        raise ModelError(f"no robot '{name}' in example-robot-data{hint}")
    return urdfs[name], _example_data().parent.parent


# ---------------------------------------------------------------------- files that a description may name


REMEDY = "give its folder in package_dirs (--package-dir) if you trust the description with it"
_DATA = (
    *("assets", "collision", "collisions", "common", "dae", "materials", "media", "mesh", "meshes", "mjcf", "obj"),
    *("robots", "stl", "stls", "textures", "urdf", "urdfs", "visual", "visuals", "xacro"),
)
"""Customary names of folders beside the folder of a description without a package."""


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

    Args:
        folder: absolute path without symbolic links.
    """
    yield folder
    home = Path(os.path.expanduser("~")).resolve()
    levels = 8  # folders above: in ROS a package is a few folders above its description
    try:
        device = folder.stat().st_dev
        for above in islice(folder.parents, levels):
            status = above.stat()
            # Anybody could put a package.xml in /tmp, and so open files beside it to a description.
            shared = status.st_mode & stat.S_ISVTX and status.st_mode & stat.S_IWOTH
            if above == Path(above.anchor) or home.is_relative_to(above) or shared or status.st_dev != device:
                return
            yield above
    except OSError:
        return


@lru_cache(maxsize=1024)
def package_name(folder: Path) -> str | None:
    """Name in the ``package.xml`` of a folder, or None if the folder is no ROS package.

    Args:
        folder: any folder.
    """
    largest = 2**20  # [bytes]: a manifest is a page of text
    try:
        root = parse_tree(read_bytes(folder / "package.xml", largest))
    except (OSError, ModelError, SyntaxError, ValueError, LookupError):  # XML errors are SyntaxErrors
        return None
    return (root.findtext("name") or "").strip() if root.tag == "package" else None


def package_uri(name: str) -> str:
    """Return ``package://name/path`` for a file name ``$(find name)/path``, as xacro has it; others do not change.

    Args:
        name: name of a file in a description.
    """
    return re.sub(r"^(?:file://)?\$\(find\s+([^\s()]+)\s*\)/*", r"package://\1/", name)


class Packages:
    """Folders whose files a description may name, and search for ROS packages by name.

    A description may name files in its own folder, its ROS package, and the given folders. Without a package it may
    also use folders beside its own with customary names, such as ``../meshes``.

    The search order is: the given folders (a folder of packages, or a package itself), the environment variables
    ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``, then the file's own folder and those above (``folders_above``). A
    folder there matches if it is the package, by its name or its ``package.xml``, or if it contains the package. Of
    these, only a folder with a ``package.xml`` is allowed as a whole.

    Args:
        beside: folder of the description.
        given: folders given by the user.

    Attributes:
        found: name to folder of each package that was requested and found.
    """

    def __init__(self, beside: Path, given: Iterable[str | Path] = ()) -> None:
        self._beside = beside.resolve()
        self._given = [Path(folder).expanduser().resolve() for folder in given]
        self.found: dict[str, Path] = {}
        self._known: dict[str, list[Path]] = {}  # candidates by name: a robot has dozens of meshes in one package
        own, *above = folders_above(self._beside)
        self._allowed = [own, *self._given]
        package = next((folder for folder in (own, *above) if package_name(folder) is not None), None)
        if package is not None:
            self._allowed.append(package)
        # Nothing tells where a project without a package ends: beside it, only folders of customary names count.
        elif above:
            self._allowed += [above[0] / name for name in _DATA]

    @property
    def folders(self) -> tuple[Path, ...]:
        """Folders whose files the description may name: absolute paths without symbolic links."""
        return tuple(dict.fromkeys(self._allowed))

    def allow(self, path: Path) -> None:
        """Allow an additional folder, or a single file.

        Args:
            path: folder or file.
        """
        self._allowed.append(path.resolve())

    def admit(self, file: Path, what: str) -> Path:
        """Return the absolute path of a file, without symbolic links.

        Args:
            file: path as in the description.
            what: name of the file in messages.

        Raises:
            ModelError: the file is in none of the folders.
        """
        if not is_below(file, self._allowed):
            raise ModelError(f"{what} is outside the folders of the description: {REMEDY}")
        return file.resolve()

    def folder(self, name: str) -> Path | None:
        """Return the folder of a package, or None.

        Args:
            name: name of the package.
        """
        return self._recorded(name, self._candidates(name))

    def is_near(self, name: str, folder: Path) -> bool:
        """True if a search for a package only in the folders above the file finds this folder.

        Args:
            name: name of the package.
            folder: folder of the package.
        """
        return next(self._near(name), None) == folder

    def _candidates(self, name: str) -> list[Path]:
        """Folders that can be this package, the most likely first."""
        # A package with a path as its name would lead out of the allowed folders.
        if name in ("", "..") or Path(name).name != name:
            return []
        if name not in self._known:
            prefixes = [prefix / "share" for prefix in _environment("AMENT_PREFIX_PATH")]
            places = [*_environment("ROS_PACKAGE_PATH"), *prefixes]
            own, others = ([each for folder in some for each in _at(folder, name)] for some in (self._given, places))
            self._allowed += [each.resolve() for each in others]
            self._known[name] = [*own, *others, *self._near(name)]
        return self._known[name]

    def _near(self, name: str) -> Iterator[Path]:
        for folder in folders_above(self._beside):
            for package in _at(folder, name):
                # A link to a folder elsewhere would otherwise open that folder by its own package.xml.
                if package_name(package) is not None and package.resolve().is_relative_to(folder):
                    self.allow(package)
                yield package

    def _recorded(self, name: str, candidates: Sequence[Path]) -> Path | None:
        if candidates:
            self.found.setdefault(name, candidates[0])
        return next(iter(candidates), None)

    def file(self, uri: str) -> Path | None:
        """Return the file of ``package://name/path``, ``file://path`` or a relative path, or None.

        Args:
            uri: name of a file in a description.

        Raises:
            ModelError: the file exists, but not in a folder whose files the description may name.
        """
        scheme, separator, rest = uri.partition("://")
        if separator and scheme in ("package", "model"):
            name, _, inside = rest.partition("/")
            candidates = self._candidates(name)
            having = [each for each in candidates if os.path.isfile(each / inside)]
            # A stable sort: allowed folders first, each group in the order of the search.
            having.sort(key=lambda each: not is_below(each / inside, self._allowed))
            self._recorded(name, [*having, *candidates])
            return self.admit(having[0] / inside, f"file '{uri}'") if having else None
        # http and other schemes are never fetched.
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
