"""Safe YAML whose cost is bounded: what aliases and merges stand for is counted before anything is made of it."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import yaml

_MOST = 100_000
_LONGEST = 2_000_000
_MERGE = "tag:yaml.org,2002:merge"


class BoundedLoader(yaml.SafeLoader):
    """Safe YAML that refuses what would not end; of a key given twice it keeps the last, as PyYAML does."""

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None:
            _count(node, {}, set())
        return node


class UniqueKeyLoader(BoundedLoader):
    """Bounded YAML that refuses a key given twice."""


def _mapping(loader: UniqueKeyLoader, node: yaml.MappingNode) -> dict[Hashable, object]:
    seen: set[Hashable] = set()
    for key_node, _ in node.value:
        if key_node.tag == _MERGE:
            continue
        key = loader.construct_object(key_node, deep=True)
        if isinstance(key, Hashable):
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is there twice", key_node.start_mark)
            seen.add(key)
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


UniqueKeyLoader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_bounded(text: str, loader: type[BoundedLoader] = UniqueKeyLoader) -> Any:
    """What a text says.

    Raises:
        yaml.YAMLError: it is not YAML, a value is not of the kind that its tag says, or it stands for too much.
    """
    if len(text) > _LONGEST:
        raise yaml.YAMLError(f"longer than {_LONGEST:,} letters")
    try:
        return yaml.load(text, Loader=loader)
    except RecursionError:
        raise yaml.YAMLError("lists or mappings inside one another without end") from None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # PyYAML's own constructors raise these for `!!bool "text"` and its like.
        raise yaml.YAMLError(f"a value is not what its tag says: {error or type(error).__name__}") from None


def _count(node: yaml.Node, known: dict[int, int], open_nodes: set[int]) -> int:
    """How many values a node stands for, each alias counted as what it stands for."""
    if id(node) in known:
        return known[id(node)]
    if id(node) in open_nodes:
        raise yaml.constructor.ConstructorError(None, None, "recursive: it is inside itself", node.start_mark)
    open_nodes.add(id(node))
    parts = [] if isinstance(node, yaml.ScalarNode) else node.value
    total = 1
    for part in parts:
        for each in part if isinstance(part, tuple) else (part,):
            total += _count(each, known, open_nodes)
    if total > _MOST:
        problem = f"stands for more than {_MOST:,} values"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
    open_nodes.discard(id(node))
    known[id(node)] = total
    return total
