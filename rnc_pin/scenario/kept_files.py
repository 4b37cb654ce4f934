"""What stands in a folder of results and is ours: by its name and by its content, never by a list alone.

A folder's mark lists what a run wrote. A mark can come from anywhere, with an archive or a repository, so it is
believed only where the file it speaks of has a name that runs give, is a plain file on the folder's own device, and
holds what was recorded. Nothing here follows a link or opens what is no plain file.
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

from rnc_pin.whole_files import BEGINNING

MARK = ".rnc_pin"
STAGING = BEGINNING
"""How the folder begins in which a run writes before its results are complete."""
_FILES = re.compile(
    r"trajectory(_\w+)?\.npz|summary\.json|scenario\.yaml|animation\.html|sweep\.(csv|json)|[^/\0]+\.png"
)
_FOLDERS = re.compile(r"run_\d{4,}")
_STAGINGS = re.compile(re.escape(STAGING) + r"\w+")
_PARTIAL = re.compile(re.escape(STAGING) + r"\w+(\.\w+)?")
_LONGEST_MARK = 64_000_000  # [bytes]


@dataclass
class Mark:
    """What runs wrote into a folder: SHA-256 of every file, more than one while files are replaced, and folders."""

    files: dict[str, list[str]] = field(default_factory=dict)
    folders: list[str] = field(default_factory=list)

    @classmethod
    def read(cls, folder: Path) -> Mark | None:
        """The mark of a folder; empty where nothing in it can be believed, None where there is none."""
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
        """Replace the mark of a folder, at once or not at all."""
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
    """Whether runs write files of this name."""
    return _FILES.fullmatch(name) is not None


def is_folder_name(name: str) -> bool:
    """Whether sweeps make folders of this name."""
    return _FOLDERS.fullmatch(name) is not None


def fingerprint(path: Path) -> str:
    """SHA-256 of a file that we wrote."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def is_kept(folder: Path, name: str, mark: Mark) -> bool:
    """Whether an entry of a folder is a file that the mark records and that is as it was then.

    Of a run's folder it is enough that nothing which a run recorded in it has changed: runs write beside what is there.
    """
    path, device = folder / name, _device(folder)
    if is_folder_name(name):
        return _is_folder(path, device) and not changed(path)
    return name in mark.files and _digest(path, device) in mark.files[name]


def changed(folder: Path, names: Iterable[str] | None = None) -> list[str]:
    """Entries that stand where results were recorded, or will be, and are not as recorded: somebody else's by now.

    Args:
        folder: of results.
        names: of what will be written; by default all that is recorded counts.
    """
    mark = Mark.read(folder) or Mark()
    expected = [*mark.files, *mark.folders] if names is None else names
    return [name for name in expected if os.path.lexists(folder / name) and not is_kept(folder, name, mark)]


def remove_kept(folder: Path, mark: Mark, names: Iterable[str]) -> None:
    """Delete those entries that are as the mark records them. What else is in a folder of a run stays."""
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
    """Delete a folder that a run wrote in: files of our names, and nothing else."""
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
    """Delete what runs left that were killed while they wrote. Only whoever has the folder's lock may."""
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
    """A plain file for reading, or None: links are not followed, pipes not waited for."""
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
