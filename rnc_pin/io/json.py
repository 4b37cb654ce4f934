"""Values that JSON and YAML can represent, and files that appear whole.

A file or a folder is written to a temporary path and moved into place when it is complete.
"""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TypeAlias

from rnc_pin.errors import InputError

Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"


def to_json(content: object, what: str, finite: bool = False) -> Json:
    """Return a deep copy of JSON values, with mappings and dataclasses as dicts, sequences and arrays as lists.

    Args:
        content: value to copy.
        what: its name in errors.
        finite: True to return None for infinities and NaN.

    Raises:
        InputError: a value has no JSON representation.
    """
    if hasattr(content, "tolist"):  # an array or a number of NumPy
        content = content.tolist()
    # JSON has no infinity; readers in other languages reject the names that Python's json writes.
    if finite and isinstance(content, float) and not math.isfinite(content):
        return None
    if content is None or isinstance(content, bool | int | float | str):
        return content
    if is_dataclass(content) and not isinstance(content, type):
        content = {each.name: getattr(content, each.name) for each in fields(content)}
    if isinstance(content, Mapping):
        return {str(key): to_json(value, f"{what}.{key}", finite) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [to_json(value, f"{what}[{place}]", finite) for place, value in enumerate(content)]
    raise InputError(f"{what}: is of type {type(content).__name__}, expected numbers, text, lists and mappings")


def to_json_mapping(content: Mapping[str, object], what: str) -> dict[str, Json]:
    """Return a deep copy of a mapping of JSON values, like ``to_json``.

    Args:
        content: mapping to copy.
        what: its name in errors.
    """
    return {str(key): to_json(value, f"{what}.{key}") for key, value in content.items()}


def dump_json(content: object) -> str:
    """Return values as JSON text; infinities and NaN become null.

    Args:
        content: values that JSON can represent, such as ``to_json`` returns.
    """
    return json.dumps(to_json(content, "content", finite=True), indent=2, allow_nan=False)


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
    # The temporary file is in the same folder, because a rename between file systems is a copy.
    partial = path.with_name(TEMPORARY_PREFIX + secrets.token_hex(4) + path.suffix)
    try:
        # "x" refuses a name that another process made in the meantime, a link included.
        partial.open("xb").close()
        yield partial
        _put(partial, path, replace)
    except OSError as error:
        # A user knows the path of the file, not the temporary one.
        if error.filename in (None, str(partial)) and error.errno is not None:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        partial.unlink(missing_ok=True)


def _put(source: Path, target: Path, replace: bool) -> None:
    try:
        if not replace:
            os.link(source, target)  # unlike rename, link fails if the target exists
            return
    except OSError:  # the target exists, or a file system has no links
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target)) from None
    os.replace(source, target)
