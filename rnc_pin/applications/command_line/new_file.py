"""Check of the output files of a command."""

from __future__ import annotations

import os
import os.path
from pathlib import Path

from rnc_pin.errors import ConfigurationError


def check_new_file(option: str, path: Path, force: bool) -> None:
    """Check that a file can be written, before its content is computed.

    Raises:
        ConfigurationError: the path is a folder, its folder does not exist, or the file exists without ``force``.
            Devices and pipes are never replaced.
    """
    if os.path.isdir(path) or not path.name:
        raise ConfigurationError(f"{option} {path}: is a folder, expected a file")
    if os.path.lexists(path) and not force:  # broken links count too
        raise ConfigurationError(f"{option} {path}: exists; choose another name or add --force")
    if os.path.exists(path) and not os.path.isfile(path):
        raise ConfigurationError(f"{option} {path}: is not a regular file; choose another name")
    if not os.path.isdir(path.absolute().parent):
        raise ConfigurationError(f"{option} {path}: folder {path.absolute().parent} does not exist")
