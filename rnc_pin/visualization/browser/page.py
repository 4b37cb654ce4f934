"""HTML page: Meshcat's viewer with an overlay, a legend and a player; and the drawing commands that it receives.

A later command for the same node and property replaces the earlier one. So the memory depends only on the size of the
scene, not on the duration of a run.
"""

from __future__ import annotations

import base64
import gzip
from collections.abc import Iterable
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path

from rnc_pin.visualization.meshcat_library import meshcat

VIEWER = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title><style>
{style}</style></head>
<body>
<div id="meshcat-pane"></div>
<div id="overlay"></div>
<div id="foot">
<div id="legend"></div>
<div id="player" hidden>
<button id="play" title="play or pause">▶</button>
<input id="slider" type="range" min="0" max="1" step="0.001" value="0" aria-label="time">
<output id="clock"></output>
<select id="speed" title="speed"><option value="0.1">0.1 x</option><option value="0.25">0.25 x</option>
<option value="0.5">0.5 x</option><option value="1" selected>1 x</option><option value="2">2 x</option>
<option value="4">4 x</option></select>
</div>
</div>
{scripts}
</body>
</html>
"""
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


def live_page(title: str, panel: str | None = None) -> str:
    """Page that draws the commands from its web socket. It loads ``main.min.js`` from its server.

    Args:
        title: title of the page.
        panel: name of the script, without ``.js``, that adds a panel of controls and sends messages of the user.
    """
    scripts_of_panel = [] if panel is None else [_part("panel.js"), _part(f"{panel}.js")]
    parts = [_part("page.js"), *scripts_of_panel, "viewer.connect();"]
    scripts = "\n".join(['<script src="main.min.js"></script>', *(f"<script>{part}</script>" for part in parts)])
    style = _part("page.css") + ("" if panel is None else _part("panel.css"))
    return _PAGE.format(title=escape(title), style=style, scripts=scripts)


def recorded_page(title: str, commands: Iterable[bytes], begin: float | None = None) -> str:
    """Self-contained page that needs only a browser.

    Args:
        title: title of the page.
        commands: drawing commands in order; the animation is last.
        begin: pause at this time [s]; by default the animation plays immediately.
    """
    text = base64.b64encode(gzip.compress(bundle(commands), 6, mtime=0)).decode("ascii")
    start = f'play_recording("{text}"' + (")" if begin is None else f", {begin!r})")
    parts = (VIEWER.read_text(encoding="utf-8"), _part("page.js"), start)
    scripts = "\n".join(f"<script>{part}</script>" for part in parts)
    return _PAGE.format(title=escape(title), style=_part("page.css"), scripts=scripts)


def bundle(commands: Iterable[bytes]) -> bytes:
    """Join commands into one message; the size of each precedes it as a 4-byte little-endian integer."""
    return b"".join(len(data).to_bytes(4, "little") + data for data in commands)


@cache
def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
