"""The folder a run writes: marked as ours, and nobody else's overwritten."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path

import yaml

from rnc_pin.errors import ConfigurationError
from rnc_pin.plain import json_text

_MARK = ".rnc_pin"


class OutputFolder:
    """A folder for results.

    A folder that this package made before is emptied of what it wrote then; any other is refused
    unless ``force``, and then only files of the same names are replaced.

    Args:
        path: of the folder.
        force: write into a folder that is not ours.

    Raises:
        ConfigurationError: the path is a file, cannot be made, or is somebody else's folder.
    """

    def __init__(self, path: str | Path, force: bool = False) -> None:
        self.path = Path(path)
        self._mark = self.path / _MARK
        try:
            if self.path.exists() and not self.path.is_dir():
                raise ConfigurationError(f"--out {self.path}: is a file, expected a folder")
            if self.path.is_dir() and any(self.path.iterdir()) and not self._mark.exists() and not force:
                raise ConfigurationError(
                    f"--out {self.path}: exists and was not made by rnc-pin; choose another folder or add --force"
                )
            self._remove_previous()
            self.path.mkdir(parents=True, exist_ok=True)
            self._names: list[str] = []
            self._write_mark()
        except OSError as error:
            raise ConfigurationError(f"--out {self.path}: cannot be written: {error.strerror}") from None

    def file(self, name: str) -> Path:
        """Where to write a file of this name; it will be cleaned up by the next run."""
        self._names.append(name)
        self._write_mark()
        return self.path / name

    def folder(self, name: str) -> Path:
        """Where a run inside this one may write."""
        return self.file(name)

    def write_json(self, name: str, content: Mapping[str, object]) -> Path:
        """Write JSON."""
        path = self.file(name)
        path.write_text(json_text(content) + "\n", encoding="utf-8")
        return path

    def write_yaml(self, name: str, content: Mapping[str, object]) -> Path:
        """Write YAML."""
        path = self.file(name)
        path.write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding="utf-8")
        return path

    def _write_mark(self) -> None:
        self._mark.write_text(json.dumps({"files": self._names}) + "\n", encoding="utf-8")

    def _remove_previous(self) -> None:
        if not self._mark.is_file():
            return
        try:
            names = json.loads(self._mark.read_text(encoding="utf-8"))["files"]
        except (ValueError, KeyError, TypeError):
            return
        for name in names if isinstance(names, list) else []:
            # A mark that points elsewhere is not ours to follow.
            if not isinstance(name, str) or name in ("", "..") or Path(name).name != name or "\0" in name:
                continue
            path = self.path / name
            if path.is_symlink():
                continue
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
