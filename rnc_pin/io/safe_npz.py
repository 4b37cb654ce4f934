"""Safe reader of untrusted ``.npz`` archives: it checks sizes before it allocates memory, and unpickles nothing.

A zip directory and the header of an array may both be wrong. So each array is read up to the size in its header, and
has to end there.
"""

from __future__ import annotations

import errno
import zipfile
from collections.abc import Collection
from math import prod
from pathlib import Path
from typing import IO

import numpy as np

from rnc_pin.io.safe_read import open_regular

ROOM = 256 * 2**20
"""Size limit of the arrays of a small file [bytes]."""
RATIO = 20
"""Size limit of the arrays of a larger file, relative to its own size. Runs compress to 80 %, zip bombs to 0.1 %."""


class ArchiveError(Exception):
    """The archive is broken or too large; the message says why."""


def read_npz(
    path: Path, names: Collection[str] | None = None, text: Collection[str] = (), largest: int | None = None
) -> dict[str, np.ndarray]:
    """Read numeric arrays and text arrays.

    Args:
        path: the file.
        names: arrays to read; names that are not in the file are skipped. All arrays by default.
        text: names of the text arrays.
        largest: size limit of all arrays together [bytes]. By default the larger of ``ROOM`` and ``RATIO`` times the
            file size.

    Raises:
        FileNotFoundError: the file does not exist.
        ArchiveError: the file is not an archive, is broken, or is too large.
    """
    try:
        with open_regular(path) as file:
            size = file.seek(0, 2)
            largest = max(ROOM, RATIO * size) if largest is None else largest
            with zipfile.ZipFile(file) as archive:
                return _arrays(archive, names, text, largest)
    except FileNotFoundError:
        raise
    except OSError as error:
        if error.errno in (errno.EINVAL, errno.EISDIR):
            raise ArchiveError("not a regular file") from None
        raise ArchiveError(f"cannot be read: {error.strerror}" if error.strerror else "cannot be read") from None
    except MemoryError:
        raise ArchiveError("larger than memory") from None
    except ArchiveError:
        raise
    # MemoryError is no fault of the file's form and is told apart above.
    except Exception:  # zipfile, zlib and NumPy raise various exceptions on broken files
        raise ArchiveError("cannot be read as .npz") from None


def _arrays(
    archive: zipfile.ZipFile, names: Collection[str] | None, text: Collection[str], largest: int
) -> dict[str, np.ndarray]:
    members = archive.infolist()
    most_arrays = 10_000  # each costs a directory entry and a header, whatever the size limit says
    if len(members) > most_arrays:
        raise ArchiveError(f"holds {len(members)} arrays, more than {most_arrays}")
    chosen: dict[str, zipfile.ZipInfo] = {}
    total = 0
    text_limit = 32 * 2**20  # bytes of one text array, 4 per character
    header_limit = 2**16 + 10  # bytes: magic, and the two-byte length of a header of version 1.0 with its content
    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # other methods allocate what their headers request
    for member in members:
        name = member.filename.removesuffix(".npy")
        if names is not None and name not in names:
            continue
        if name in chosen:
            raise ArchiveError(f"duplicate array '{name}'")
        if member.compress_type not in methods:
            raise ArchiveError(f"'{name}' has an unsupported compression method")
        with archive.open(member) as file:
            shape, _, _, array_size = _header(file, name, name in text)
        # Items of size zero take no bytes but a shape of any size: their number counts too.
        total += max(array_size, prod(shape))
        if total > largest or (name in text and array_size > text_limit):
            raise ArchiveError(f"arrays take more than {largest:,} bytes: '{name}' has shape {shape}")
        if member.file_size > array_size + header_limit:
            raise ArchiveError(f"'{name}' is longer than its header declares")
        chosen[name] = member
    return {name: _array(archive, member, name, name in text) for name, member in chosen.items()}


def _header(file: IO[bytes], name: str, is_text: bool) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    """Shape, order by columns, type and size [bytes] of an array."""
    if np.lib.format.read_magic(file) != (1, 0):  # later versions allow headers of any length
        raise ArchiveError(f"'{name}' is not an array of numbers")
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(file)
    if dtype.kind not in ("U" if is_text else "fiub"):
        raise ArchiveError(f"'{name}' holds no {'text' if is_text else 'numbers'}")
    most_axes = 8  # NumPy would take 64, and a run needs few
    if len(shape) > most_axes or min(shape, default=0) < 0:
        raise ArchiveError(f"'{name}' has shape {shape}")
    return shape, by_columns, dtype, dtype.itemsize * prod(shape)


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str, is_text: bool) -> np.ndarray:
    with archive.open(member) as file:
        shape, by_columns, dtype, size = _header(file, name, is_text)
        # zipfile takes memory for what it finds, and not for what the header declares; one byte more shows the end.
        content = file.read(size + 1)
    if len(content) != size:
        raise ArchiveError(f"'{name}' is {'shorter' if len(content) < size else 'longer'} than its header declares")
    array = np.frombuffer(content, dtype) if content else np.zeros(prod(shape), dtype)
    return array.reshape(shape, order="F" if by_columns else "C").astype(dtype.newbyteorder("="), copy=False)
