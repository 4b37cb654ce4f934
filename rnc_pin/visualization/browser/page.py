"""HTML page: Meshcat's viewer with an overlay, a legend and a player; its drawing commands, and the check of access.

A later command for the same node and property replaces the earlier one. So the memory depends only on the size of the
scene, not on the duration of a run.
"""

from __future__ import annotations

import base64
import gzip
import ipaddress
import re
import socket
import sys
from collections.abc import Iterable
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from types import ModuleType

LOOPBACK = "127.0.0.1"


def addresses_of(host: str) -> set[str]:
    """Addresses to which this computer resolves a name; empty if there are none.

    Args:
        host: name or address.
    """
    try:
        return {str(info[4][0]).partition("%")[0] for info in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError):
        return set()


def is_loopback(host: str) -> bool:
    """True if only this computer can reach an address. A host name is resolved first.

    Args:
        host: name or address.
    """
    found = addresses_of(host)
    return bool(found) and all(ipaddress.ip_address(address).is_loopback for address in found)


class RequestFilter:
    """Check of the request headers Host and Origin: a request must name this computer by one of its own names.

    A web site can resolve its own name to 127.0.0.1 (DNS rebinding). Its pages can then read everything that is served
    there. The names reveal the attack: a browser sends the requested name as Host and the name of the page as Origin.

    Args:
        host: name or address that the server listens on.
    """

    def __init__(self, host: str) -> None:
        # A name of this computer may stand for several addresses, with IPv4 and IPv6.
        addresses = addresses_of(host)
        names = {"localhost", host.lower(), *addresses}
        patterns = [r"127(\.\d{1,3}){3}", r"\[::1\]"]
        if any(ipaddress.ip_address(address).is_unspecified for address in addresses):
            # A server on all addresses accepts any numeric address: no list is complete, and DNS cannot redirect them.
            names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
            patterns = [r"\d{1,3}(\.\d{1,3}){3}", r"\[[\da-f:.]+\]"]
        patterns += [re.escape(f"[{name}]" if ":" in name else name) for name in names if name]
        self._own = re.compile(f"({'|'.join(patterns)})(:\\d+)?")

    def allows(self, host: str | None, origin: str | None) -> bool:
        """Return True if the server may answer a request.

        Args:
            host: header Host, with or without a port.
            origin: header Origin. Browsers always send it with a web socket; other programs may omit it.
        """
        if not host or not self._own.fullmatch(host.lower()):
            return False
        # Pages of other sites may send requests here, but with their own origin: these are refused.
        return origin is None or origin.lower() in (f"http://{host.lower()}", f"https://{host.lower()}")


# Meshcat takes one name of IPython, for notebooks. There it is imported already; elsewhere it would take 0.2 s.
_display = ModuleType("IPython.display")
vars(_display)["HTML"] = str
_unused = sys.modules.setdefault(_display.__name__, _display) is _display
import meshcat  # noqa: E402
import meshcat.geometry as mg  # noqa: E402

if _unused:
    del sys.modules[_display.__name__]

__all__ = ["meshcat", "mg"]


VIEWER = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
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


def content_policy(own: str = "") -> str:
    """Content-Security-Policy of a page: it loads nothing but its own text.

    Args:
        own: addresses of its server, such as ``'self'``; none for a page that needs no server.
    """
    return (
        f"default-src 'none'; script-src {own} 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
        f"font-src data:; img-src {own} data: blob:; connect-src {own} data: blob:; base-uri 'none'; form-action 'none'"
    )


Key = tuple[str, str]
"""Path of a node, and the kind of command: object, transform, one property, ..."""
Commands = dict[Key, bytes]
"""Latest drawing command for each key, in MessagePack."""

_RANK = {"delete": -1, "set_object": 0, "copy": 0, "set_property": 1, "set_transform": 2, "set_animation": 4}
_OTHER_RANK = 3


def apply_commands(commands: Commands, new: list[tuple[Key, bytes]], keep_deletes: bool = False) -> None:
    """Store commands in place of earlier ones. A "delete" removes all commands at its path and below.

    Args:
        commands: commands so far by path and kind, which change.
        new: further commands: path, kind and packed command.
        keep_deletes: True to store a "delete" too, for a page that has drawn the node.
    """
    for (path, kind), data in new:
        if kind == "delete":
            for each in [each for each in commands if path in ("", each[0]) or each[0].startswith(path + "/")]:
                del commands[each]
        if kind != "delete" or keep_deletes:
            commands[path, kind] = data


def in_order(commands: Commands) -> list[bytes]:
    """Commands in an order that draws the scene: objects, properties, transforms, others, animation.

    Args:
        commands: commands by path and kind.
    """
    # Sorting is stable: a parent that was drawn first stays before its children.
    return [commands[key] for key in sorted(commands, key=lambda key: _RANK.get(key[1].split(" ")[0], _OTHER_RANK))]


def live_page(title: str, panel: str | None = None) -> str:
    """Page that draws the commands from its web socket. It loads ``main.min.js`` from its server.

    Args:
        title: title of the page.
        panel: name of the script, without ``.js``, that adds a panel of controls and sends messages of the user.
    """
    scripts_of_panel = [] if panel is None else [_part("panel.js"), _part(f"{panel}.js")]
    # In this order: a panel uses the viewer, and the connection comes when both are there.
    parts = [_part("page.js"), *scripts_of_panel, "viewer.connect();"]
    scripts = "\n".join(['<script src="main.min.js"></script>', *(f"<script>{part}</script>" for part in parts)])
    style = _part("page.css") + ("" if panel is None else _part("panel.css"))
    return _PAGE.format(title=escape(title), policy=content_policy("'self' ws:"), style=style, scripts=scripts)


def recorded_page(title: str, commands: Iterable[bytes], begin: float | None = None) -> str:
    """Self-contained page that needs only a browser.

    Args:
        title: title of the page.
        commands: drawing commands in order; the animation is last.
        begin: pause at this time [s]; by default the animation plays immediately.
    """
    # Without a time stamp: equal runs have equal pages.
    text = base64.b64encode(gzip.compress(bundle(commands), 6, mtime=0)).decode("ascii")
    start = f'play_recording("{text}"' + (")" if begin is None else f", {begin!r})")
    parts = (VIEWER.read_text(encoding="utf-8"), _part("page.js"), start)
    scripts = "\n".join(f"<script>{part}</script>" for part in parts)
    return _PAGE.format(title=escape(title), policy=content_policy(), style=_part("page.css"), scripts=scripts)


def bundle(commands: Iterable[bytes]) -> bytes:
    """Join commands into one message; the size of each precedes it as a 4-byte little-endian integer.

    Args:
        commands: packed commands.
    """
    return b"".join(len(data).to_bytes(4, "little") + data for data in commands)


@cache
def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
