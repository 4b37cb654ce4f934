"""Drawing commands: everything that a page receives, from the server or in a recording.

A later command for the same node and property replaces the earlier one. So the memory depends only on the size of the
scene, not on the duration of a run.
"""

from __future__ import annotations

import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

import numpy as np
import umsgpack

from rnc_pin.visualization.browser.access import LOOPBACK
from rnc_pin.visualization.browser.page import recorded_page

if TYPE_CHECKING:
    from rnc_pin.visualization.browser.scene_server import Receiver, SceneServer

Key = tuple[str, str]
"""Path of a node, and the kind of command: object, transform, one property, ..."""
Commands = dict[Key, bytes]
"""Latest drawing command for each key, in MessagePack."""

_RANK = {"delete": -1, "set_object": 0, "copy": 0, "set_property": 1, "set_transform": 2, "set_animation": 4}
_OTHER_RANK = 3
_PACKED_FLOAT = np.dtype([("mark", "u1"), ("value", ">f8")])  # float64 in MessagePack


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


class Drawing(Protocol):
    """Drawing command of Meshcat."""

    def lower(self) -> Mapping[str, object]: ...


class SceneWindow:
    """Window for Meshcat's ``Visualizer``. Pass it as ``meshcat.Visualizer(window=...)``.

    Args:
        title: title of the page.

    Attributes:
        latest: latest command for each node and property. The server's thread owns it while the scene is served.
        web_url: address of the page; empty if the scene is not served.
    """

    def __init__(self, title: str = "rnc_pin") -> None:
        self.title = title
        self.web_url = ""
        self.latest: Commands = {}
        self._heads: dict[str, bytes] = {}
        self._gathered: list[tuple[Key, bytes]] | None = None
        self._server: SceneServer | None = None

    # ------------------------------------------------------------------ drawing

    def send(self, command: Drawing) -> None:
        """Send a drawing command of Meshcat, without waiting."""
        self.post(command.lower())

    def post(self, command: Mapping[str, object], single: bool = False) -> None:
        """Send a drawing command in the format of the viewer (Meshcat or ``page.js``), without waiting.

        Args:
            command: command with its "type" and "path".
            single: pack floats in single precision.
        """
        path = "/".join(part for part in str(command.get("path", "")).split("/") if part)
        kind = str(command["type"])
        key = path, f"{kind} {command['property']}" if kind == "set_property" else kind
        self.put(key, umsgpack.packb(command, force_float_precision="single" if single else "double"))

    def place(self, path: str, matrix: np.ndarray) -> None:
        """Set the transform (4, 4) of a node, at a tenth of the cost of ``post``; every frame sets all transforms."""
        head = self._heads.get(path)
        if head is None:
            words = [umsgpack.packb(word) for word in ("type", "set_transform", "path", path, "matrix")]
            head = self._heads[path] = b"\x83" + b"".join(words) + b"\xdc\x00\x10"
        numbers = np.empty(16, _PACKED_FLOAT)
        numbers["mark"], numbers["value"] = 0xCB, matrix.T.ravel()
        self.put((path.strip("/"), "set_transform"), head + numbers.tobytes())

    @contextmanager
    def batched(self) -> Iterator[None]:
        """Send all commands of the ``with`` block to browsers as one message."""
        self._gathered = []
        try:
            yield
        finally:
            gathered, self._gathered = self._gathered, None
            self._pass_on(gathered)

    def put(self, key: Key, data: bytes) -> None:
        """Send a drawing command that is already packed in MessagePack."""
        if self._gathered is None:
            self._pass_on([(key, data)])
        else:
            self._gathered.append((key, data))

    def _pass_on(self, commands: list[tuple[Key, bytes]]) -> None:
        if self._server is None:
            apply_commands(self.latest, commands)
        else:
            self._server.send(commands)

    def page(self, begin: float | None = None) -> str:
        """Return the scene as one self-contained HTML page; see ``recorded_page``."""
        return recorded_page(self.title, in_order(self.latest), begin)

    # ------------------------------------------------------------------ serving

    def serve(self, port: int = 0, host: str = LOOPBACK, receive: Receiver | None = None) -> str:
        """Serve the scene and return its address; see ``SceneServer``."""
        from rnc_pin.visualization.browser.scene_server import SceneServer

        self._server = SceneServer(self.title, self.latest, port, host, receive)
        self.web_url = self._server.url
        return self.web_url

    @property
    def browsers(self) -> int:
        """Number of connected browsers."""
        return 0 if self._server is None else self._server.browsers

    def open(self) -> SceneWindow:
        """Show the page in the user's browser."""
        webbrowser.open(self.web_url, new=2)
        return self

    def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            self._server.close()
            self._server = None
