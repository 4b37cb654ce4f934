"""Atomic writing: files and folders are written to a temporary path and moved into place when complete."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TEMPORARY_PREFIX = ".rnc_pin_"
"""Prefix of temporary names."""


@contextmanager
def atomic_file(path: Path, replace: bool = True) -> Iterator[Path]:
    """Yield a temporary path for a file, and move the file into place at the end; a failure leaves no file.

    A link at ``path`` is replaced itself; its target does not change.

    Args:
        path: the file.
        replace: replace an existing file; else that is an error.

    Raises:
        OSError: the file cannot be written or exists; the error names ``path``.
    """
    partial = path.with_name(TEMPORARY_PREFIX + secrets.token_hex(4) + path.suffix)
    try:
        partial.open("xb").close()
        yield partial
        _put(partial, path, replace)
    except OSError as error:
        if error.filename in (None, str(partial)) and error.errno is not None:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: Path, replace: bool = True) -> Iterator[Path]:
    """Yield a temporary folder, and move its files into place at the end; other files in the folder stay.

    Args:
        path: the folder, created with its parents.
        replace: replace files of the same names; else they are an error.

    Raises:
        OSError: the folder cannot be written, or a file exists.
    """
    path = Path(os.path.abspath(path))  # "." has no name to derive a temporary one from
    path.parent.mkdir(parents=True, exist_ok=True)
    staging = path.with_name(TEMPORARY_PREFIX + secrets.token_hex(4))
    staging.mkdir()
    try:
        yield staging
        path.mkdir(exist_ok=True)
        names = sorted(each.name for each in staging.iterdir())
        for name in names if not replace else ():
            if os.path.lexists(path / name):
                raise _is_there(path / name)
        for name in names:
            _put(staging / name, path / name, replace)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _put(source: Path, target: Path, replace: bool) -> None:
    if replace:
        os.replace(source, target)
        return
    try:
        os.link(source, target)  # unlike rename, link fails if the target exists
    except FileExistsError:
        raise _is_there(target) from None
    except OSError:  # a file system without links
        if os.path.lexists(target):
            raise _is_there(target) from None
        os.replace(source, target)


def _is_there(path: Path) -> FileExistsError:
    return FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
