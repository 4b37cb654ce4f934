"""Manifest of an output folder: the files that runs wrote there, and may therefore replace and delete.

A manifest can come from an untrusted archive or repository. An entry therefore counts only if its file has a name that
runs use, is a regular file on the folder's device, and has the recorded content. No link is followed.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path

from rnc_pin.io.safe_read import open_regular

MANIFEST = ".rnc_pin"
_RESULT = re.compile(
    r"trajectory(_\w+)?\.npz|plan\.npz|summary\.json|commands\.json|scenario\.yaml|animation\.html|[^/\0]+\.(png|pdf|svg)"
    r"|calibration\.json|comparison\.json|mapping\.yaml|robot\.urdf"
)
_MAX_SIZE = 64_000_000  # [bytes]


class Manifest:
    """Files of an output folder that runs wrote, with the SHA-256 of their content.

    Args:
        folder: the output folder.
        digests: SHA-256 by name; several of a file that a run is just replacing.
    """

    def __init__(self, folder: Path, digests: Mapping[str, list[str]] | None = None) -> None:
        self.folder, self.digests = folder, dict(digests or {})

    @classmethod
    def read(cls, folder: Path) -> Manifest | None:
        """Read the manifest of a folder; None if there is none, empty if it is invalid."""
        try:
            with open_regular(folder / MANIFEST, follow_links=False) as file:
                files = json.loads(file.read(_MAX_SIZE))["files"]
            digests = {name: [each for each in files[name] if isinstance(each, str)] for name in files}
            return cls(folder, {name: found for name, found in digests.items() if is_result(name)})
        except OSError:
            return None
        except (ValueError, KeyError, TypeError, RecursionError):
            return cls(folder)

    def write(self, temporary: Path) -> None:
        """Replace the manifest in the folder atomically.

        Args:
            temporary: folder on the same device in which the file is prepared.
        """
        partial = temporary / MANIFEST
        partial.write_text(json.dumps({"files": self.digests}) + "\n", encoding="utf-8")
        os.replace(partial, self.folder / MANIFEST)

    def owns(self, name: str) -> bool:
        """True if a run wrote the file and it is unchanged."""
        path = self.folder / name
        try:
            return (
                name in self.digests
                and not self.folder.is_symlink()
                and path.lstat().st_dev == self.folder.stat().st_dev
                and digest(path) in self.digests[name]
            )
        except OSError:
            return False

    def remove(self, name: str) -> None:
        """Delete a file that the manifest owns."""
        if self.owns(name):
            (self.folder / name).unlink()

    def __or__(self, digests: Mapping[str, list[str]]) -> Manifest:
        """Manifest with further files, and with further contents of the same files."""
        both = {name: [*self.digests.get(name, ()), *found] for name, found in digests.items()}
        return Manifest(self.folder, {**self.digests, **both})


def is_result(name: str) -> bool:
    """True if runs write files of this name."""
    return _RESULT.fullmatch(name) is not None


def digest(path: Path) -> str:
    """Return the SHA-256 of a regular file.

    Raises:
        OSError: the file cannot be read, or is a link.
    """
    with open_regular(path, follow_links=False) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
