"""Manifest of result folders: identifies files of rnc_pin by name and content.

A folder's mark (``.rnc_pin``) lists the files that runs wrote. A mark can come from an untrusted archive or repository.
An entry therefore counts only if its file has a name that runs use, is a regular file on the folder's device, and has
the recorded content. Functions of this module do not follow links and open only regular files.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import stat
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from rnc_pin.io.atomic_write import TEMPORARY_PREFIX

MARK = ".rnc_pin"
STAGING = TEMPORARY_PREFIX
"""Prefix of the name of the temporary folder in which a run writes its results."""
_FILES = re.compile(
    r"trajectory(_\w+)?\.npz|summary\.json|scenario\.yaml|animation\.html|sweep\.(csv|json)|[^/\0]+\.png"
)
_FOLDERS = re.compile(r"run_\d{4,}")
_STAGINGS = re.compile(re.escape(STAGING) + r"\w+")
_PARTIAL = re.compile(re.escape(STAGING) + r"\w+(\.\w+)?")
_LONGEST_MARK = 64_000_000  # [bytes]


@dataclass
class Mark:
    """Record of files and folders that runs wrote. Each file has its SHA-256, or several while a run replaces it."""

    files: dict[str, list[str]] = field(default_factory=dict)
    folders: list[str] = field(default_factory=list)

    @classmethod
    def read(cls, folder: Path) -> Mark | None:
        """Read the mark of a folder; None if there is none, empty if it is invalid."""
        content = _content(folder / MARK, _device(folder), _LONGEST_MARK)
        if content is None:
            return None
        try:
            said = json.loads(content)
            files, folders = said["files"], said.get("folders", [])
            return cls(
                {
                    name: [each for each in hashes if isinstance(each, str)]
                    for name, hashes in (files.items() if isinstance(files, dict) else ())
                    if isinstance(hashes, list) and _FILES.fullmatch(name)
                },
                [name for name in folders if isinstance(name, str) and _FOLDERS.fullmatch(name)],
            )
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return cls()

    def write(self, folder: Path) -> None:
        """Replace the mark of a folder atomically."""
        partial = folder / (STAGING + "mark")
        with suppress(FileNotFoundError):
            partial.unlink()
        try:
            with partial.open("x", encoding="utf-8") as file:
                file.write(json.dumps({"files": self.files, "folders": self.folders}) + "\n")
            partial.replace(folder / MARK)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise

    def __or__(self, other: Mark) -> Mark:
        files = {name: list(hashes) for name, hashes in self.files.items()}
        for name, hashes in other.files.items():
            files[name] = list(dict.fromkeys([*files.get(name, ()), *hashes]))
        return Mark(files, list(dict.fromkeys([*self.folders, *other.folders])))


def is_file_name(name: str) -> bool:
    """True if runs write files with this name."""
    return _FILES.fullmatch(name) is not None


def is_folder_name(name: str) -> bool:
    """True if sweeps make folders with this name."""
    return _FOLDERS.fullmatch(name) is not None


def fingerprint(path: Path) -> str:
    """SHA-256 of a file that rnc_pin wrote."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def is_kept(folder: Path, name: str, mark: Mark) -> bool:
    """True if the mark records an entry of a folder and the entry is unchanged.

    A run's folder is unchanged if all its recorded files are unchanged; it may contain other files.
    """
    path, device = folder / name, _device(folder)
    if is_folder_name(name):
        return _is_folder(path, device) and not changed(path)
    return name in mark.files and _digest(path, device) in mark.files[name]


def changed(folder: Path, names: Iterable[str] | None = None) -> list[str]:
    """Return existing entries that differ from the record, so that rnc_pin must not replace them.

    Args:
        folder: folder of results.
        names: names of the entries that a run will write; by default all recorded entries.
    """
    mark = Mark.read(folder) or Mark()
    expected = [*mark.files, *mark.folders] if names is None else names
    return [name for name in expected if os.path.lexists(folder / name) and not is_kept(folder, name, mark)]


def remove_kept(folder: Path, mark: Mark, names: Iterable[str]) -> None:
    """Delete the entries that are unchanged since the mark recorded them. Other files in a run's folder remain."""
    device = _device(folder)
    for name in names:
        path = folder / name
        if name in mark.folders and _is_folder(path, device):
            inner = Mark.read(path)
            if inner is not None:
                remove_kept(path, inner, [*inner.files, *inner.folders])
                remove_leftovers(path)
                (path / MARK).unlink(missing_ok=True)
                with suppress(OSError):  # not empty
                    path.rmdir()
        elif name in mark.files and _digest(path, device) in mark.files[name]:
            path.unlink()


def remove_staging(staging: Path) -> None:
    """Delete a temporary folder of a run. Only files with names that runs use are deleted."""
    device = _device(staging)
    for path in list(staging.iterdir()):
        if _is_folder(path, device):
            if _FOLDERS.fullmatch(path.name) or _STAGINGS.fullmatch(path.name):
                remove_staging(path)
        elif _FILES.fullmatch(path.name) or _PARTIAL.fullmatch(path.name) or path.name == MARK:
            path.unlink()
    with suppress(OSError):
        staging.rmdir()


def remove_leftovers(folder: Path) -> None:
    """Delete the temporary folders of killed runs. The caller must hold the folder's lock."""
    for path in list(folder.iterdir()):
        if _STAGINGS.fullmatch(path.name) and _is_folder(path, _device(folder)):
            remove_staging(path)


def _device(folder: Path) -> int:
    return folder.stat().st_dev


def _is_folder(path: Path, device: int) -> bool:
    try:
        found = path.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_dev == device


def _open(path: Path, device: int) -> int | None:
    """Open a regular file for reading; None for other entries. It follows no links and does not wait for pipes."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return None
    found = os.fstat(file)
    if stat.S_ISREG(found.st_mode) and found.st_dev == device:
        return file
    os.close(file)
    return None


def _content(path: Path, device: int, longest: int) -> bytes | None:
    descriptor = _open(path, device)
    if descriptor is None:
        return None
    with open(descriptor, "rb") as file:
        content = file.read(longest + 1)
        return content if len(content) <= longest else b""


def _digest(path: Path, device: int) -> str | None:
    descriptor = _open(path, device)
    if descriptor is None:
        return None
    with open(descriptor, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
