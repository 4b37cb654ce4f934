"""Store of the scene: the latest drawing command for every node and property."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

Key = tuple[str, str]
"""Path of a node, and the kind of command: object, transform, one property, ..."""

_RANK = {"set_object": 0, "copy": 0, "set_property": 1, "set_transform": 2}


def key_of(command: Mapping[str, object]) -> Key:
    """Key of a command; a later command with the same key replaces it."""
    path = "/".join(part for part in str(command.get("path", "")).split("/") if part)
    kind = str(command["type"])
    return path, f"{kind} {command['property']}" if kind == "set_property" else kind


class SceneStore:
    """Latest command for each key, so that memory depends only on the size of the scene."""

    def __init__(self) -> None:
        self._parts: dict[str, dict[str, bytes]] = {}

    def put(self, key: Key, data: bytes) -> None:
        """Store a command. "delete" removes the commands at this path and below."""
        path, kind = key
        if kind == "delete":
            for each in [each for each in self._parts if is_below_path(each, path)]:
                del self._parts[each]
        else:
            self._parts.setdefault(path, {})[kind] = data

    def items(self) -> Iterator[tuple[Key, bytes]]:
        """Commands that draw the scene, in a valid order; the animation is last."""
        for last in (False, True):
            for path, commands in self._parts.items():
                for kind in sorted(commands, key=lambda kind: _RANK.get(kind.split(" ")[0], 3)):
                    if (kind == "set_animation") == last:
                        yield (path, kind), commands[kind]


def is_below_path(path: str, other: str) -> bool:
    """True if a path is equal to or below another path."""
    return path == other or other == "" or path.startswith(other + "/")
