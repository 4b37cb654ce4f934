"""Files that a command is told to write."""

from __future__ import annotations

from pathlib import Path

from rnc_pin.errors import ConfigurationError


def check_new_file(option: str, path: Path, force: bool) -> None:
    """See to it that a file can be written, before anything is computed for it.

    Raises:
        ConfigurationError: it is a folder, in no folder, or there already without ``force``.
    """
    if path.is_dir() or not path.name:
        raise ConfigurationError(f"{option} {path}: is a folder, expected a file")
    if path.exists() and not force:
        raise ConfigurationError(f"{option} {path}: exists; choose another name or add --force")
    if not path.absolute().parent.is_dir():
        raise ConfigurationError(f"{option} {path}: there is no folder {path.absolute().parent}")
