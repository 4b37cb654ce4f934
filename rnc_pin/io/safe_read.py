"""Safe readers of untrusted files: regular files of limited size, XML of limited depth, YAML of bounded cost."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn
from xml.etree.ElementTree import Element, ParseError, TreeBuilder
from xml.parsers import expat

import yaml

from rnc_pin.errors import ModelError

if TYPE_CHECKING:
    from rnc_pin.io.json import Json

LARGEST = 64 * 2**20
"""Size limit of text and XML files [bytes]."""


_recorders: list[set[Path]] = []


@contextmanager
def recorded_reads() -> Iterator[set[Path]]:
    """Yield a set to which each file is added that ``open_regular`` opens inside."""
    _recorders.append(set())
    try:
        yield _recorders[-1]
    finally:
        _recorders.pop()


def open_regular(path: Path, follow_links: bool = True) -> BufferedReader:
    """Open a regular file for reading.

    Args:
        path: the file.
        follow_links: open what a symbolic link points to; else a link is an error.

    Raises:
        OSError: the file cannot be read or is not regular. A pipe would block, and a device may never end.
    """
    links = 0 if follow_links else os.O_NOFOLLOW
    # Without O_NONBLOCK, opening a pipe would block. The caller closes the file.
    file = open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK | links))  # noqa: SIM115
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    for each in _recorders:
        each.add(Path(path).resolve())
    return file


def read_bytes(path: Path, largest: int = LARGEST) -> bytes:
    """Read the content of a file.

    Args:
        path: the file.
        largest: size limit [bytes].

    Raises:
        OSError: the file cannot be read, is not regular, or is too large.
    """
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > largest:
            raise OSError(errno.EFBIG, f"Larger than {largest:,} bytes", str(path))
        # A file that grows after the check is read up to the limit only.
        return file.read(largest)


_MAX_DEPTH = 400  # bodies of MJCF are nested
_MAX_ELEMENTS = 1_000_000  # elements: each takes more memory than its text


def parse_tree(
    content: str | bytes, deepest: int = _MAX_DEPTH, make: Callable[[str, dict[str, str], int], Element] | None = None
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
    # Expat calls one for entities without a declaration, the other for files outside: none is read.
    parser.SkippedEntityHandler = parser.ExternalEntityRefHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise ParseError(str(error)) from None
    return builder.close()


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
    merge = "tag:yaml.org,2002:merge"  # key "<<": it may repeat, and its mapping is no key
    for key_node, _ in node.value:
        if key_node.tag == merge:
            continue
        key = loader.construct_object(key_node, deep=True)
        if isinstance(key, Hashable):
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"duplicate key '{key}'", key_node.start_mark)
            seen.add(key)
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


UniqueKeyLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_yaml(text: str, loader: type[BoundedLoader] = UniqueKeyLoader) -> Json:
    """Parse YAML text.

    Args:
        text: the document.
        loader: loader of its values; by default duplicate keys are errors.

    Raises:
        yaml.YAMLError: the text is not YAML, a value does not match its tag, or the size exceeds a limit.
    """
    most_characters = 2_000_000  # bounds the work of the scanner, which comes before nodes are counted
    if len(text) > most_characters:
        raise yaml.YAMLError(f"longer than {most_characters:,} characters")
    try:
        return yaml.load(text, Loader=loader)
    except RecursionError:
        raise yaml.YAMLError("lists or mappings are nested too deeply") from None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # PyYAML's constructors raise these for values such as `!!bool "text"`.
        raise yaml.YAMLError(f"a value does not match its tag: {error or type(error).__name__}") from None


def _count(node: yaml.Node, known: dict[int, int], open_nodes: set[int]) -> int:
    """Return the number of values of a node after alias expansion."""
    # Nodes of one alias are one object: counting each once keeps this linear in the text.
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
    most_values = 100_000  # after expansion of aliases: nine levels of nine aliases would be 400 million
    if total > most_values:
        problem = f"expands to more than {most_values:,} values"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
    open_nodes.discard(id(node))
    known[id(node)] = total
    return total
