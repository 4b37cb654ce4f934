"""Safe readers of untrusted files: regular files of limited size, XML, YAML and ``.npz`` archives of bounded cost.

A zip directory and the header of an array may both be wrong. So each array is read up to the size in its header, has to
end there, and nothing is unpickled.
"""

from __future__ import annotations

import errno
import os
import stat
import zipfile
from collections.abc import Callable, Collection, Hashable
from io import BufferedReader
from math import prod
from pathlib import Path
from typing import IO, Any, NamedTuple, NoReturn
from xml.etree.ElementTree import Element, ParseError, TreeBuilder
from xml.parsers import expat

import numpy as np
import yaml

from rnc_pin.errors import ModelError

ROOM = 256 * 2**20
"""Size limit of the arrays of a small file [bytes]."""
RATIO = 20
"""Size limit of the arrays of a larger file, relative to its own size. Runs compress to 80 %, zip bombs to 0.1 %."""

_MAX_TEXT = 32 * 2**20  # bytes of one text array, 4 per character
_MAX_ARRAYS = 10_000
_MAX_AXES = 8
_CHUNK = 2**20
_MAX_HEADER = 2**16 + 10
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # other methods allocate what their headers request


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
    except Exception:  # zipfile, zlib and NumPy raise various exceptions on broken files
        raise ArchiveError("cannot be read as .npz") from None


class _Header(NamedTuple):
    shape: tuple[int, ...]
    by_columns: bool
    dtype: np.dtype

    @property
    def size(self) -> int:
        """Size that the header declares [bytes]."""
        return self.dtype.itemsize * prod(self.shape)


def _arrays(
    archive: zipfile.ZipFile, names: Collection[str] | None, text: Collection[str], largest: int
) -> dict[str, np.ndarray]:
    members = archive.infolist()
    if len(members) > _MAX_ARRAYS:
        raise ArchiveError(f"holds {len(members)} arrays, more than {_MAX_ARRAYS}")
    chosen: dict[str, zipfile.ZipInfo] = {}
    total = 0
    for member in members:
        name = member.filename.removesuffix(".npy")
        if names is not None and name not in names:
            continue
        if name in chosen:
            raise ArchiveError(f"duplicate array '{name}'")
        if member.compress_type not in _METHODS:
            raise ArchiveError(f"'{name}' has an unsupported compression method")
        with archive.open(member) as file:
            header = _header(file, name, name in text)
        total += max(header.size, prod(header.shape))
        if total > largest or (name in text and header.size > _MAX_TEXT):
            raise ArchiveError(f"arrays take more than {largest:,} bytes: '{name}' has shape {header.shape}")
        if member.file_size > header.size + _MAX_HEADER:
            raise ArchiveError(f"'{name}' is longer than its header declares")
        chosen[name] = member
    return {name: _array(archive, member, name, name in text) for name, member in chosen.items()}


def _header(file: IO[bytes], name: str, is_text: bool) -> _Header:
    if np.lib.format.read_magic(file) != (1, 0):  # later versions allow headers of any length
        raise ArchiveError(f"'{name}' is not an array of numbers")
    header = _Header(*np.lib.format.read_array_header_1_0(file))
    if header.dtype.kind not in ("U" if is_text else "fiub"):
        raise ArchiveError(f"'{name}' holds no {'text' if is_text else 'numbers'}")
    if len(header.shape) > _MAX_AXES or min(header.shape, default=0) < 0:
        raise ArchiveError(f"'{name}' has shape {header.shape}")
    return header


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str, is_text: bool) -> np.ndarray:
    with archive.open(member) as file:
        shape, by_columns, dtype = header = _header(file, name, is_text)
        # Read in chunks: the header may declare more than the file has.
        content = bytearray()
        while len(content) < header.size:
            chunk = file.read(min(_CHUNK, header.size - len(content)))
            if not chunk:
                raise ArchiveError(f"'{name}' is shorter than its header declares")
            content += chunk
        if file.read(1):
            raise ArchiveError(f"'{name}' is longer than its header declares")
    array = np.frombuffer(content, dtype) if content else np.zeros(prod(shape), dtype)
    return array.reshape(shape, order="F" if by_columns else "C").astype(dtype.newbyteorder("="), copy=False)


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


_MAX_DEPTH = 400  # bodies of MJCF are nested
_MAX_ELEMENTS = 1_000_000  # elements: each takes more memory than its text


def parse_tree(
    content: str | bytes,
    deepest: int = _MAX_DEPTH,
    make: Callable[[str, dict[str, str], int], Element] | None = None,
) -> Element:
    """Return the root element of a text, without external entities.

    Names keep their prefixes, and declarations of namespaces are dropped: urdfdom, MuJoCo and xacro read no namespaces.

    Args:
        content: the text.
        deepest: largest depth of an element.
        make: function from tag, attributes and line to an element; ``Element`` by default.

    Raises:
        ModelError: elements are too deep, or too many.
        xml.etree.ElementTree.ParseError: the text is not well formed.
    """
    parser = expat.ParserCreate()
    builder = TreeBuilder(
        None if make is None else lambda tag, attributes: make(tag, attributes, parser.CurrentLineNumber)
    )
    depth = count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth += 1
        count += 1
        if depth > deepest or count > _MAX_ELEMENTS:
            raise ModelError(f"elements are more than {deepest} deep, or more than {_MAX_ELEMENTS:,}")
        kept = {key: value for key, value in attributes.items() if key != "xmlns" and not key.startswith("xmlns:")}
        builder.start(tag, kept)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(name: str, *_place: object) -> NoReturn:
        raise ParseError(f"undefined entity &{name};: line {parser.CurrentLineNumber}")

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.SkippedEntityHandler = parser.ExternalEntityRefHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise ParseError(str(error)) from None
    return builder.close()


_MAX_VALUES = 100_000
_MAX_CHARACTERS = 2_000_000
_MERGE = "tag:yaml.org,2002:merge"


class BoundedLoader(yaml.SafeLoader):
    """Safe YAML loader that rejects unbounded documents. It keeps the last of duplicate keys, as PyYAML does."""

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None:
            _count(node, {}, set())
        return node


class UniqueKeyLoader(BoundedLoader):
    """Bounded YAML loader that rejects duplicate keys."""


def _mapping(loader: UniqueKeyLoader, node: yaml.MappingNode) -> dict[Hashable, object]:
    seen: set[Hashable] = set()
    for key_node, _ in node.value:
        if key_node.tag == _MERGE:
            continue
        key = loader.construct_object(key_node, deep=True)
        if isinstance(key, Hashable):
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"duplicate key '{key}'", key_node.start_mark)
            seen.add(key)
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


UniqueKeyLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_yaml(text: str, loader: type[BoundedLoader] = UniqueKeyLoader) -> Any:
    """Parse YAML text.

    Raises:
        yaml.YAMLError: the text is not YAML, a value does not match its tag, or the size exceeds a limit.
    """
    if len(text) > _MAX_CHARACTERS:
        raise yaml.YAMLError(f"longer than {_MAX_CHARACTERS:,} characters")
    try:
        return yaml.load(text, Loader=loader)
    except RecursionError:
        raise yaml.YAMLError("lists or mappings are nested too deeply") from None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # PyYAML's constructors raise these for values such as `!!bool "text"`.
        raise yaml.YAMLError(f"a value does not match its tag: {error or type(error).__name__}") from None


def _count(node: yaml.Node, known: dict[int, int], open_nodes: set[int]) -> int:
    """Return the number of values of a node after alias expansion."""
    if id(node) in known:
        return known[id(node)]
    if id(node) in open_nodes:
        raise yaml.constructor.ConstructorError(None, None, "recursive: the node contains itself", node.start_mark)
    open_nodes.add(id(node))
    parts = [] if isinstance(node, yaml.ScalarNode) else node.value
    total = 1
    for part in parts:
        for each in part if isinstance(part, tuple) else (part,):
            total += _count(each, known, open_nodes)
    if total > _MAX_VALUES:
        problem = f"expands to more than {_MAX_VALUES:,} values"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
    open_nodes.discard(id(node))
    known[id(node)] = total
    return total
