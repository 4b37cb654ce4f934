"""What is on the stage: the last word on every part, as the commands that draw it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

Key = tuple[str, str]
"""Path of a part, and what of it: an object, a transform, one property, ..."""

_RANK = {"set_object": 0, "copy": 0, "set_property": 1, "set_transform": 2}


def key_of(command: Mapping[str, object]) -> Key:
    """What a command has the last word on."""
    path = "/".join(part for part in str(command.get("path", "")).split("/") if part)
    kind = str(command["type"])
    return path, f"{kind} {command['property']}" if kind == "set_property" else kind


class SceneStore:
    """Commands by what they have the last word on, so that it stays as small as the scene is."""

    def __init__(self) -> None:
        self._parts: dict[str, dict[str, bytes]] = {}

    def put(self, key: Key, data: bytes) -> None:
        """Take a command."""
        path, kind = key
        if kind == "delete":
            for each in [each for each in self._parts if below(each, path)]:
                del self._parts[each]
        else:
            self._parts.setdefault(path, {})[kind] = data

    def items(self) -> Iterator[tuple[Key, bytes]]:
        """All that it takes to draw the scene, in an order that works: the animation comes last."""
        for last in (False, True):
            for path, commands in self._parts.items():
                for kind in sorted(commands, key=lambda kind: _RANK.get(kind.split(" ")[0], 3)):
                    if (kind == "set_animation") == last:
                        yield (path, kind), commands[kind]


def below(path: str, other: str) -> bool:
    """Whether a path is another, or a part of it."""
    return path == other or other == "" or path.startswith(other + "/")
