"""Where the files of ``package://name/...`` and ``$(find name)`` are, with or without a ROS installation."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
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

    def candidates(self, name: str) -> Iterator[Path]:
        """Folders that can be this package, the likeliest first."""
        if name in ("", "..") or Path(name).name != name:
            return
        for folder in (*self._folders, *_environment("ROS_PACKAGE_PATH")):
            yield from _at(folder, name)
        for prefix in _environment("AMENT_PREFIX_PATH"):
            yield from _at(prefix / "share", name)
        for folder in (self._beside, *self._beside.parents):
            yield from _at(folder, name)

    def folder(self, name: str) -> Path | None:
        """The folder of a package, or None."""
        return next(self.candidates(name), None)

    def file(self, uri: str) -> Path | None:
        """The file that ``package://name/path``, ``file://path`` or a relative path means, or None."""
        scheme, separator, rest = uri.partition("://")
        if separator and scheme in ("package", "model"):
            name, _, inside = rest.partition("/")
            return next((each / inside for each in self.candidates(name) if (each / inside).is_file()), None)
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
