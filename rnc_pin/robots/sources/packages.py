"""Search for the files of ``package://name/...`` and ``$(find name)``, with or without a ROS installation."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from rnc_pin.robots.sources.containment import AllowedFolders, folders_above, package_name

_FOUND = re.compile(r"(?:file://)?\$\(find\s+([^\s()]+)\s*\)/*")


def package_uri(name: str) -> str:
    """Return ``package://name/path`` for a file name ``$(find name)/path``, as xacro has it; others do not change."""
    return _FOUND.sub(r"package://\1/", name, count=1) if _FOUND.match(name) else name


class Packages:
    """Search for ROS packages by name.

    The search order is: the given folders (a folder of packages, or a package itself), the environment variables
    ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``, then the file's own folder and those above (``folders_above``). A
    folder there matches if it is the package, by its name or its ``package.xml``, or if it contains the package. Of
    these, only a folder with a ``package.xml`` is allowed as a whole.

    Args:
        beside: folder of the file that names packages.
        folders: folders given by the user.

    Attributes:
        allowed: folders whose files the description may name.
    """

    def __init__(self, beside: Path, folders: Sequence[str | Path] = ()) -> None:
        self._beside = beside.resolve()
        self._folders = [Path(folder).expanduser().resolve() for folder in folders]
        self._found: dict[str, Path] = {}
        self.allowed = AllowedFolders(self._beside, self._folders)

    def candidates(self, name: str) -> Iterator[Path]:
        """Yield the folders that can be this package, the most likely first."""
        if name in ("", "..") or Path(name).name != name:
            return
        for folder in self._folders:
            yield from _at(folder, name)
        prefixes = (prefix / "share" for prefix in _environment("AMENT_PREFIX_PATH"))
        for folder in (*_environment("ROS_PACKAGE_PATH"), *prefixes):
            for package in _at(folder, name):
                self.allowed.add(package)
                yield package
        yield from self._near(name)

    def folder(self, name: str) -> Path | None:
        """Return the folder of a package, or None."""
        return self._recorded(name, next(self.candidates(name), None))

    def admit(self, file: Path, what: str) -> Path:
        """Return the absolute path of a file that the description may name; see ``AllowedFolders.admit``."""
        return self.allowed.admit(file, what)

    def allow(self, path: Path) -> None:
        """Allow an additional folder, or a single file."""
        self.allowed.add(path)

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
                    self.allowed.add(package)
                yield package

    def _recorded(self, name: str, folder: Path | None) -> Path | None:
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
            candidates = list(self.candidates(name))
            having = [each for each in candidates if os.path.isfile(each / inside)]
            having.sort(key=lambda each: not self.allowed.has(each / inside))
            self._recorded(name, next(iter([*having, *candidates]), None))
            return self.allowed.admit(having[0] / inside, f"file '{uri}'") if having else None
        if separator and scheme != "file":
            return None
        path = Path(rest if separator else uri)
        places = [folder / path for folder in (self._beside, *self._folders)]
        place = next((place for place in places if os.path.isfile(place)), None)
        return None if place is None else self.allowed.admit(place, f"file '{uri}'")


def _environment(variable: str) -> list[Path]:
    return [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each]


def _at(folder: Path, name: str) -> Iterator[Path]:
    if (folder.name == name or package_name(folder) == name) and os.path.isdir(folder):
        yield folder
    if os.path.isdir(folder / name):  # unlike Path.is_dir, False for an invalid file name
        yield folder / name
