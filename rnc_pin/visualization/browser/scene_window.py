"""Window of a scene: what Meshcat draws becomes drawing commands, for a page that is saved or served."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

import numpy as np
import umsgpack

from rnc_pin.visualization.browser.access import LOOPBACK
from rnc_pin.visualization.browser.page import Commands, Key, apply_commands, in_order, recorded_page

if TYPE_CHECKING:
    from rnc_pin.visualization.browser.scene_server import ControlPanel, SceneServer

_PACKED_FLOAT = np.dtype([("mark", "u1"), ("value", ">f8")])  # float64 in MessagePack


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
        self._sending = threading.Lock()  # a page with controls sends from several threads
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
            with self._sending:
                gathered, self._gathered = self._gathered, None
            self._pass_on(gathered)

    def put(self, key: Key, data: bytes) -> None:
        """Send a drawing command that is already packed in MessagePack."""
        with self._sending:
            if self._gathered is not None:
                self._gathered.append((key, data))
                return
        self._pass_on([(key, data)])

    def _pass_on(self, commands: list[tuple[Key, bytes]]) -> None:
        if self._server is None:
            apply_commands(self.latest, commands)
        else:
            self._server.send(commands)

    def page(self, begin: float | None = None) -> str:
        """Return the scene as one self-contained HTML page; see ``recorded_page``."""
        return recorded_page(self.title, in_order(self.latest), begin)

    # ------------------------------------------------------------------ serving

    def serve(self, port: int = 0, host: str = LOOPBACK, panel: ControlPanel | None = None) -> str:
        """Serve the scene and return its address; see ``SceneServer``."""
        from rnc_pin.visualization.browser.scene_server import SceneServer

        self._server = SceneServer(self.title, self.latest, port, host, panel)
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
