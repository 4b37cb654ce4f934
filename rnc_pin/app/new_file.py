"""Files that a command is told to write."""

from __future__ import annotations

import os
import os.path
from pathlib import Path

from rnc_pin.errors import ConfigurationError


def check_new_file(option: str, path: Path, force: bool) -> None:
    """See to it that a file can be written, before anything is computed for it.

    Raises:
        ConfigurationError: it is a folder, in no folder, or there already without ``force``; a device or a pipe is
            never replaced.
    """
    if os.path.isdir(path) or not path.name:
        raise ConfigurationError(f"{option} {path}: is a folder, expected a file")
    if os.path.lexists(path) and not force:  # a link that leads nowhere too
        raise ConfigurationError(f"{option} {path}: exists; choose another name or add --force")
    if os.path.exists(path) and not os.path.isfile(path):
        raise ConfigurationError(f"{option} {path}: is not a regular file; choose another name")
    if not os.path.isdir(path.absolute().parent):
        raise ConfigurationError(f"{option} {path}: there is no folder {path.absolute().parent}")
