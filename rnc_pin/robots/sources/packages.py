"""Where the files of ``package://name/...`` and ``$(find name)`` are, with or without a ROS installation."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree


class Packages:
    """Finds ROS packages by name.

    Looked through, in this order: the folders given (a folder of packages, or a package itself), those of the
    environment variables ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``, and from the file's own folder upwards: each
    folder that is the package, by its name or its ``package.xml``, and each that has the package in it.

    Args:
        beside: folder of the file that names packages.
        folders: given by the user.
    """

    def __init__(self, beside: Path, folders: Sequence[str | Path] = ()) -> None:
        self._beside = beside.resolve()
        self._folders = [Path(folder).expanduser().resolve() for folder in folders]
        self._found: dict[str, Path] = {}

    def candidates(self, name: str) -> Iterator[Path]:
        """Folders that can be this package, the likeliest first."""
        if name in ("", "..") or Path(name).name != name:
            return
        for folder in (*self._folders, *_environment("ROS_PACKAGE_PATH")):
            yield from _at(folder, name)
        for prefix in _environment("AMENT_PREFIX_PATH"):
            yield from _at(prefix / "share", name)
        yield from self._near(name)

    def folder(self, name: str) -> Path | None:
        """The folder of a package, or None."""
        return self._recorded(name, next(self.candidates(name), None))

    @property
    def found(self) -> Mapping[str, Path]:
        """Name to folder of each package that was asked for and found."""
        return dict(self._found)

    @property
    def far(self) -> Mapping[str, Path]:
        """Those of ``found`` that are not found, or elsewhere, from the file's own folder upwards alone."""
        return {name: folder for name, folder in self._found.items() if next(self._near(name), None) != folder}

    def _near(self, name: str) -> Iterator[Path]:
        for folder in (self._beside, *self._beside.parents):
            yield from _at(folder, name)

    def _recorded(self, name: str, folder: Path | None) -> Path | None:
        if folder is not None:
            self._found.setdefault(name, folder)
        return folder

    def file(self, uri: str) -> Path | None:
        """The file that ``package://name/path``, ``file://path`` or a relative path means, or None."""
        scheme, separator, rest = uri.partition("://")
        if separator and scheme in ("package", "model"):
            name, _, inside = rest.partition("/")
            candidates = list(self.candidates(name))
            folder = next((each for each in candidates if (each / inside).is_file()), None)
            self._recorded(name, folder or next(iter(candidates), None))
            return None if folder is None else folder / inside
        path = Path(rest if separator and scheme == "file" else uri)
        if separator and scheme != "file":
            return None
        places = [folder / path for folder in (self._beside, *self._folders)]
        return next((place for place in places if place.is_file()), None)


def _environment(variable: str) -> list[Path]:
    return [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each]


def _at(folder: Path, name: str) -> Iterator[Path]:
    if (folder.name == name or _declared_name(folder) == name) and folder.is_dir():
        yield folder
    if (folder / name).is_dir():
        yield folder / name


@lru_cache(maxsize=1024)
def _declared_name(folder: Path) -> str | None:
    try:
        return (ElementTree.parse(folder / "package.xml").getroot().findtext("name") or "").strip()
    except (OSError, ElementTree.ParseError, ValueError, LookupError):
        return None
