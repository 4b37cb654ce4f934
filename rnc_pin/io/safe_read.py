"""Safe reading of untrusted files: only regular files of limited size."""

from __future__ import annotations

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path

LARGEST = 64 * 2**20
"""Size limit of text and XML files [bytes]."""


def open_regular(path: Path, follow_links: bool = True) -> BufferedReader:
    """Open a regular file for reading.

    Args:
        path: the file.
        follow_links: open what a symbolic link points to; else a link is an error.

    Raises:
        OSError: the file cannot be read or is not regular. A pipe would block, and a device may never end.
    """
    links = 0 if follow_links else os.O_NOFOLLOW
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | links)  # opening a pipe would block
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise OSError(errno.EISDIR, "Is a directory", str(path))
        if not stat.S_ISREG(mode):
            raise OSError(errno.EINVAL, "Not a regular file", str(path))
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_bytes(path: Path, largest: int = LARGEST) -> bytes:
    """Read the content of a file.

    Raises:
        OSError: the file cannot be read, is not regular, or is too large.
    """
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > largest:
            raise OSError(errno.EFBIG, f"Larger than {largest:,} bytes", str(path))
        return file.read(largest)
