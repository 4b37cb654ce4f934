"""Drawing commands: everything that a page receives, from the server or in a recording.

A later command for the same node and property replaces the earlier one. So the memory depends only on the size of the
scene, not on the duration of a run.
"""

from __future__ import annotations

Key = tuple[str, str]
"""Path of a node, and the kind of command: object, transform, one property, ..."""
Commands = dict[Key, bytes]
"""Latest drawing command for each key, in MessagePack."""

_RANK = {"delete": -1, "set_object": 0, "copy": 0, "set_property": 1, "set_transform": 2, "set_animation": 4}
_OTHER_RANK = 3


def put_latest(commands: Commands, key: Key, data: bytes) -> None:
    """Store a command in place of the earlier one. A "delete" replaces all commands at its path and below."""
    path, kind = key
    if kind == "delete":
        for each in [each for each in commands if path in ("", each[0]) or each[0].startswith(path + "/")]:
            del commands[each]
    commands[key] = data


def apply_commands(commands: Commands, new: list[tuple[Key, bytes]]) -> None:
    """Add new commands to the scene; a deleted node leaves nothing behind."""
    for key, data in new:
        put_latest(commands, key, data)
        if key[1] == "delete":
            del commands[key]


def in_order(commands: Commands) -> list[bytes]:
    """Commands in an order that draws the scene: objects, properties, transforms, others, animation."""
    return [commands[key] for key in sorted(commands, key=lambda key: _RANK.get(key[1].split(" ")[0], _OTHER_RANK))]
