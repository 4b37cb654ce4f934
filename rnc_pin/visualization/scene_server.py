"""Meshcat's scene inside this process, served on loopback only or not at all.

Meshcat 0.3.2 starts a server process that listens on every interface. Here its scene logic runs in a
thread of our own: the web server binds to 127.0.0.1, and where only a recording is wanted nothing
listens anywhere.
"""

from __future__ import annotations

import asyncio
import threading
import webbrowser
from typing import Any

import tornado.httpserver
import tornado.ioloop
import tornado.netutil
import tornado.web
import tornado.websocket
import umsgpack
from meshcat.servers.tree import SceneTree, walk
from meshcat.servers.zmqserver import (
    VIEWER_HTML,
    VIEWER_ROOT,
    StaticFileHandlerNoCache,
    WebSocketHandler,
    ZMQWebSocketBridge,
)

from rnc_pin.errors import ConfigurationError

LOOPBACK = "127.0.0.1"


class _QuietSocket(WebSocketHandler):
    """A browser that looks on. What it sends is ignored."""

    def open(self) -> None:
        self.bridge.websocket_pool.add(self)
        self.bridge.send_scene(self)

    def on_message(self, message: str | bytes) -> None:
        pass

    def on_close(self) -> None:
        self.bridge.websocket_pool.discard(self)


class _NoIcon(tornado.web.RequestHandler):
    """Browsers ask for an icon; there is none, and that is no error."""

    def get(self) -> None:
        self.set_status(204)


class _Reply:
    """Stands where Meshcat has its ZeroMQ socket: keeps the last answer."""

    def __init__(self) -> None:
        self.last = b""

    def send(self, message: bytes) -> None:
        self.last = message


class _Bridge(ZMQWebSocketBridge):
    """Meshcat's scene tree and its web socket, without ZeroMQ."""

    def __init__(self) -> None:
        # Deliberately not the parent's constructor, which opens the sockets that are not wanted here.
        self.websocket_pool: set[_QuietSocket] = set()
        self.tree = SceneTree()
        self.zmq_socket = _Reply()

    def make_app(self) -> tornado.web.Application:
        return tornado.web.Application(
            [
                (r"/static/(.*)", StaticFileHandlerNoCache, {"path": VIEWER_ROOT, "default_filename": VIEWER_HTML}),
                (r"/favicon.ico", _NoIcon),
                (r"/", _QuietSocket, {"bridge": self}),
            ]
        )

    def forward_to_websockets(self, frames: list[bytes]) -> None:
        command, _, data = frames
        for socket in list(self.websocket_pool):
            connection = socket.ws_connection
            if connection is None:
                continue
            # A browser that cannot keep up misses movements, so that nothing piles up here.
            if command == b"set_transform" and connection.stream.writing():
                continue
            try:
                socket.write_message(data, binary=True).add_done_callback(_ignore_departure)
            except tornado.websocket.WebSocketClosedError:
                self.websocket_pool.discard(socket)

    def send_scene(self, websocket: _QuietSocket) -> None:
        for node in walk(self.tree):
            for data in (node.object, *node.properties, node.transform, node.animation):
                if data is not None:
                    websocket.write_message(data, binary=True).add_done_callback(_ignore_departure)


def _ignore_departure(sent: asyncio.Future[None]) -> None:
    """A browser that goes away takes what was under way to it along; nobody needs to hear of it."""
    if not sent.cancelled():
        sent.exception()


class SceneWindow:
    """What Meshcat's ``Visualizer`` writes to. Pass it as ``meshcat.Visualizer(window=...)``."""

    def __init__(self) -> None:
        self._bridge = _Bridge()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self.web_url = ""

    def send(self, command: Any) -> None:
        """Take a drawing command; returns at once."""
        data = command.lower()
        frames = [data["type"].encode(), data["path"].encode(), umsgpack.packb(data)]
        if self._loop is None:
            self._bridge.handle_zmq(frames)
        else:
            self._loop.call_soon_threadsafe(self._bridge.handle_zmq, frames)

    def get_scene(self) -> str:
        """The scene as one self-contained HTML page."""
        if self._loop is None:
            return self._scene()
        return asyncio.run_coroutine_threadsafe(self._scene_later(), self._loop).result(timeout=30)

    def _scene(self) -> str:
        self._bridge.handle_zmq([b"get_scene"])
        return self._bridge.zmq_socket.last.decode()

    async def _scene_later(self) -> str:
        return self._scene()

    def serve(self, port: int = 0) -> str:
        """Serve the scene on loopback and return its address.

        Args:
            port: 0 finds a free one.

        Raises:
            ConfigurationError: the port is taken.
        """
        try:
            sockets = tornado.netutil.bind_sockets(port, LOOPBACK)
        except OSError as error:
            raise ConfigurationError(f"port {port} on {LOOPBACK} cannot be used: {error.strerror}") from None
        ready = threading.Event()

        def run() -> None:
            self._loop = asyncio.new_event_loop()
            asyncio.set_event_loop(self._loop)
            server = tornado.httpserver.HTTPServer(self._bridge.make_app())
            server.add_sockets(sockets)
            self._loop.call_soon(ready.set)
            self._loop.run_forever()
            server.stop()
            self._loop.run_until_complete(server.close_all_connections())
            self._loop.close()

        self._thread = threading.Thread(target=run, name="meshcat", daemon=True)
        self._thread.start()
        ready.wait()
        self.web_url = f"http://{LOOPBACK}:{sockets[0].getsockname()[1]}/static/"
        return self.web_url

    @property
    def browsers(self) -> int:
        """How many browsers look on."""
        return len(self._bridge.websocket_pool)

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
