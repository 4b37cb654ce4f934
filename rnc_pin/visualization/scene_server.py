"""Meshcat scene inside this process, served on loopback by default or not at all.

Meshcat 0.3.2 starts a server process that listens on every interface. Its queue for a browser that does not read grows
without limit. Here a thread of this process serves Meshcat's viewer, and the web server binds to 127.0.0.1. Each
browser receives the latest command for every node, as fast as it reads. A recording needs no server.
"""

from __future__ import annotations

import asyncio
import ipaddress
import threading
import webbrowser
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Protocol

import numpy as np
import tornado.httpserver
import tornado.ioloop
import tornado.iostream
import tornado.netutil
import tornado.web
import tornado.websocket
import umsgpack

from rnc_pin.errors import ConfigurationError
from rnc_pin.visualization.page import VIEWER, bundle, live_page, recorded_page
from rnc_pin.visualization.scene_store import Key, SceneStore, is_below_path, key_of
from rnc_pin.visualization.visitors import RequestFilter, addresses_of

LOOPBACK = "127.0.0.1"
_GOODBYE = 0.5  # [s]
_LONGEST_MESSAGE = 1024  # [bytes]; messages from browsers are ignored
_LIMITS = {
    "max_header_size": 16_384,
    "max_body_size": 1024,
    "max_buffer_size": 262_144,
    "idle_connection_timeout": 30.0,
    "body_timeout": 10.0,
}
"""Resource limits of one connection [bytes, s]."""
_PACKED_FLOAT = np.dtype([("mark", "u1"), ("value", ">f8")])  # float64 in MessagePack


def is_loopback(host: str) -> bool:
    """True if only this computer can reach an address. A host name is resolved first."""
    found = addresses_of(host)
    return bool(found) and all(ipaddress.ip_address(address).is_loopback for address in found)


class Drawing(Protocol):
    """Drawing command of Meshcat."""

    def lower(self) -> Mapping[str, object]: ...


class SceneWindow:
    """Window for Meshcat's ``Visualizer``. Pass it as ``meshcat.Visualizer(window=...)``.

    Args:
        title: title of the page.
    """

    def __init__(self, title: str = "rnc_pin") -> None:
        self.title = title
        self.web_url = ""
        self._store = SceneStore()
        self._watching: set[_Browser] = set()
        self._heads: dict[str, bytes] = {}
        self._gathered: list[tuple[Key, bytes]] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None

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
        data = umsgpack.packb(command, force_float_precision="single" if single else "double")
        self._put(key_of(command), data)

    def place(self, path: str, matrix: np.ndarray) -> None:
        """Set the transform (4, 4) of a node, at a tenth of the cost of ``post``; every frame sets all transforms."""
        head = self._heads.get(path)
        if head is None:
            words = [umsgpack.packb(word) for word in ("type", "set_transform", "path", path, "matrix")]
            head = self._heads[path] = b"\x83" + b"".join(words) + b"\xdc\x00\x10"
        numbers = np.empty(16, _PACKED_FLOAT)
        numbers["mark"], numbers["value"] = 0xCB, matrix.T.ravel()
        self._put((path.strip("/"), "set_transform"), head + numbers.tobytes())

    @contextmanager
    def batched(self) -> Iterator[None]:
        """Send all commands of the ``with`` block to browsers as one message."""
        self._gathered = []
        try:
            yield
        finally:
            gathered, self._gathered = self._gathered, None
            self._pass_on(gathered)

    def _put(self, key: Key, data: bytes) -> None:
        if self._gathered is None:
            self._pass_on([(key, data)])
        else:
            self._gathered.append((key, data))

    def _pass_on(self, commands: list[tuple[Key, bytes]]) -> None:
        if self._loop is None:
            self._take(commands)
        else:
            self._loop.call_soon_threadsafe(self._take, commands)

    def _take(self, commands: list[tuple[Key, bytes]]) -> None:
        for key, data in commands:
            self._store.put(key, data)
        for browser in self._watching:
            browser.offer(commands)

    def page(self, begin: float | None = None) -> str:
        """Return the scene as one self-contained HTML page; see ``recorded_page``."""
        return recorded_page(self.title, (data for _, data in self._store.items()), begin)

    # ------------------------------------------------------------------ serving

    def serve(self, port: int = 0, host: str = LOOPBACK) -> str:
        """Serve the scene and return its address.

        Args:
            port: port to listen on; 0 finds a free port.
            host: address to listen on; any address except loopback lets other computers watch.

        Raises:
            ConfigurationError: the port is in use, or the address is not an address of this computer.
        """
        try:
            sockets = tornado.netutil.bind_sockets(port, host)
        except OSError as error:
            raise ConfigurationError(f"port {port} on {host} cannot be used: {error.strerror}") from None
        ready = threading.Event()

        def run() -> None:
            self._loop = asyncio.new_event_loop()
            asyncio.set_event_loop(self._loop)
            server = tornado.httpserver.HTTPServer(self._application(RequestFilter(host)), **_LIMITS)
            server.add_sockets(sockets)
            around = tornado.ioloop.IOLoop.current()
            self._loop.call_soon(ready.set)
            self._loop.run_forever()
            server.stop()
            self._loop.run_until_complete(self._send_last_and_close())
            self._loop.run_until_complete(server.close_all_connections())
            self._loop.run_until_complete(_end_tasks())
            asyncio.set_event_loop(None)
            around.close()  # closes the loop too; tornado would keep it until it creates the next one

        self._thread = threading.Thread(target=run, name="meshcat", daemon=True)
        self._thread.start()
        ready.wait()
        name = f"[{host}]" if ":" in host else host
        self.web_url = f"http://{name}:{sockets[0].getsockname()[1]}/static/"
        return self.web_url

    async def _send_last_and_close(self) -> None:
        """Send the last frame to browsers that still read, and close all connections."""
        sending = [browser.sending for browser in self._watching if browser.sending is not None]
        if sending:
            _, stuck = await asyncio.wait(sending, timeout=_GOODBYE)
            for task in stuck:
                task.cancel()
            await asyncio.gather(*stuck, return_exceptions=True)
        for browser in list(self._watching):
            browser.disconnect()
        self._watching.clear()

    def _application(self, visitors: RequestFilter) -> tornado.web.Application:
        page = live_page(self.title).encode()
        return tornado.web.Application(
            [
                (r"/static/", _StaticFile, {"kind": "text/html", "text": page}),
                (r"/static/main.min.js", _StaticFile, {"kind": "text/javascript", "text": VIEWER.read_bytes()}),
                (r"/favicon.ico", _EmptyIcon),
                (r"/", _Browser, {"store": self._store, "watching": self._watching}),
            ],
            default_handler_class=_NotFound,
            websocket_max_message_size=_LONGEST_MESSAGE,
            visitors=visitors,
            log_function=lambda handler: None,  # requests are not logged to the terminal
        )

    @property
    def browsers(self) -> int:
        """Number of connected browsers."""
        return len(self._watching)

    def open(self) -> SceneWindow:
        """Show the page in the user's browser."""
        webbrowser.open(self.web_url, new=2)
        return self

    def close(self) -> None:
        """Stop serving."""
        if self._loop is not None and self._thread is not None:
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(timeout=5)
            self._loop = None


async def _end_tasks() -> None:
    """Cancel all other tasks of the loop, which may still wait for a browser."""
    waiting = asyncio.all_tasks() - {asyncio.current_task()}
    for task in waiting:
        task.cancel()
    await asyncio.gather(*waiting, return_exceptions=True)


class _FilteredHandler(tornado.web.RequestHandler):
    """Request handler that refuses requests which ``RequestFilter`` does not admit."""

    def prepare(self) -> None:
        visitors: RequestFilter = self.settings["visitors"]
        headers = self.request.headers
        if not visitors.allows(headers.get("Host"), headers.get("Origin")):
            raise tornado.web.HTTPError(403)

    def write_error(self, status_code: int, **more: object) -> None:
        self.finish()


class _Browser(_FilteredHandler, tornado.websocket.WebSocketHandler):
    """Connection to a browser. Messages from the browser are ignored.

    One batch is sent at a time. Meanwhile only the latest command for every node waits. So a browser that is slow, or
    stops reading, needs no more memory than the scene.
    """

    def initialize(self, store: SceneStore, watching: set[_Browser]) -> None:
        self._store, self._watching = store, watching
        self._waiting: dict[Key, bytes] = {}
        self.sending: asyncio.Task[None] | None = None

    def open(self) -> None:
        self._watching.add(self)
        self._stream = self.ws_connection.stream if self.ws_connection is not None else None
        self.offer(self._store.items())

    def offer(self, commands: Iterable[tuple[Key, bytes]]) -> None:
        for key, data in commands:
            if key[1] == "delete":
                for each in [each for each in self._waiting if is_below_path(each[0], key[0])]:
                    del self._waiting[each]
            self._waiting[key] = data
        if self.sending is None:
            self.sending = asyncio.get_running_loop().create_task(self._send())

    async def _send(self) -> None:
        try:
            while self._waiting:
                batch, self._waiting = self._waiting, {}
                await self.write_message(bundle(batch.values()), binary=True)
        except (tornado.websocket.WebSocketClosedError, tornado.iostream.StreamClosedError):
            self._watching.discard(self)  # the browser has disconnected; the batch is lost
        finally:
            self.sending = None

    def disconnect(self) -> None:
        """Close the connection, even if the browser does not respond."""
        self.close()
        if self._stream is not None:
            self._stream.close()

    def on_message(self, message: str | bytes) -> None:
        pass

    def on_close(self) -> None:
        self._watching.discard(self)


class _StaticFile(_FilteredHandler):
    """Static file of the page."""

    def initialize(self, kind: str, text: bytes) -> None:
        self._kind, self._text = kind, text

    def get(self) -> None:
        self.set_header("Content-Type", f"{self._kind}; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.write(self._text)


class _EmptyIcon(_FilteredHandler):
    """Empty answer to a browser's request for an icon."""

    def get(self) -> None:
        self.set_status(204)


class _NotFound(_FilteredHandler):
    """Answer 404 for any other path."""

    def prepare(self) -> None:
        super().prepare()
        raise tornado.web.HTTPError(404)
