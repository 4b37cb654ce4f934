"""Files and folders are written beside their place and put there when they are whole."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

BEGINNING = ".rnc_pin_"
"""Of the name of what is not whole yet."""


@contextmanager
def written_whole(path: Path, replace: bool = True) -> Iterator[Path]:
    """Where to write a file, which is put into place at the end; nothing is left of one that fails.

    A link in its place is replaced itself, and what it points to is not touched.

    Args:
        path: of the file.
        replace: what is there by then; else that is an error.

    Raises:
        OSError: it cannot be written, or something is there; says the file's own name.
    """
    partial = path.with_name(BEGINNING + secrets.token_hex(4) + path.suffix)
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
def written_folder(path: Path, replace: bool = True) -> Iterator[Path]:
    """Where to write the files of a folder, which are put into place at the end; what else is there stays.

    Args:
        path: of the folder, which is made with those above it.
        replace: files of the same names; else they are an error.

    Raises:
        OSError: it cannot be written, or a file is there.
    """
    path = Path(os.path.abspath(path))  # "." has no name to put another in the place of
    path.parent.mkdir(parents=True, exist_ok=True)
    staging = path.with_name(BEGINNING + secrets.token_hex(4))
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
        os.link(source, target)  # unlike a renaming, it fails where something is
    except FileExistsError:
        raise _is_there(target) from None
    except OSError:  # a file system without links
        if os.path.lexists(target):
            raise _is_there(target) from None
        os.replace(source, target)


def _is_there(path: Path) -> FileExistsError:
    return FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
