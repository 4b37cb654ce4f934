"""Safe YAML loader with bounded cost: it counts the values behind aliases and merges before it constructs any."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import yaml

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
