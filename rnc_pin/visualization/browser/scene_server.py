"""Window of a scene, saved as a page or served to browsers: Meshcat's drawing commands, and controls of the page."""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import socket
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple, Protocol

import numpy as np
import tornado.httpserver
import tornado.ioloop
import tornado.iostream
import tornado.netutil
import tornado.web
import tornado.websocket
import umsgpack

from rnc_pin.errors import ConfigurationError
from rnc_pin.visualization.browser import page as pages
from rnc_pin.visualization.browser.page import LOOPBACK, Commands, Key, RequestFilter, apply_commands


class ControlPanel(NamedTuple):
    """Panel of controls on a page."""

    script: str
    """Name of its script, without ``.js``."""
    receive: Callable[[object], object]
    """Function for a message of the page's user, decoded from JSON and otherwise unchecked, in the server's thread."""
    farewell: object = None
    """Message of a page that is closed, reloaded, or does not answer any more; None for none."""


_RATE, _BURST = 100.0, 200.0  # messages per second of one page, and at once
_PING = 0.5  # [s] between questions whether the page is still there, and for its answer


class FilteredHandler(tornado.web.RequestHandler):
    """Request handler that refuses requests which ``RequestFilter`` does not admit."""

    def prepare(self) -> None:
        requests: RequestFilter = self.settings["requests"]
        headers = self.request.headers
        if not requests.allows(headers.get("Host"), headers.get("Origin")):
            raise tornado.web.HTTPError(403)

    def write_error(self, status_code: int, **more: object) -> None:
        self.finish()


class CommandSocket(FilteredHandler, tornado.websocket.WebSocketHandler):
    """Connection through which the page of a user sends messages.

    The first message has the secret from the address of the page. A browser does not send that part of an address to
    any server, and other users of the computer do not know it. Any other first message ends the connection.
    """

    ping_interval = ping_timeout = _PING  # a browser answers for hidden pages too

    def initialize(self, panel: ControlPanel, secret: str) -> None:
        self._receive, self._farewell, self._secret = panel.receive, panel.farewell, secret
        self._admitted = False
        self._allowance, self._last = _BURST, time.monotonic()

    def prepare(self) -> None:
        super().prepare()
        if self.request.headers.get("Origin") is None:  # a browser always sends it
            raise tornado.web.HTTPError(403)

    def on_message(self, message: str | bytes) -> None:
        now = time.monotonic()
        # A token bucket: a broken page cannot keep the loop busy with messages.
        self._allowance = min(_BURST, self._allowance + _RATE * (now - self._last)) - 1.0
        self._last = now
        if self._allowance < 0.0:
            return
        try:
            content = json.loads(message)
        except (ValueError, RecursionError):
            content = None
        if self._admitted:
            self._receive(content)
            return
        told = content.get("secret") if isinstance(content, dict) else None
        # Compared in constant time: the delay of an answer must not tell how much of a guess is right.
        self._admitted = isinstance(told, str) and hmac.compare_digest(told.encode(), self._secret.encode())
        if not self._admitted:
            self.close(4003, "wrong secret")

    def on_close(self) -> None:
        if self._admitted and self._farewell is not None:
            # A page that is gone sends nothing: its last command, such as a velocity, must not go on.
            self._receive(self._farewell)


_CLOSING_TIME = 0.5  # [s]
_MAX_MESSAGE = 1024  # [bytes]; of messages from browsers
_LIMITS = {
    "max_header_size": 16_384,
    "max_body_size": 1024,
    "max_buffer_size": 262_144,
    "idle_connection_timeout": 30.0,
    "body_timeout": 10.0,
}
"""Resource limits of one connection [bytes, s]."""


class SceneServer:
    """Server of one page, the viewer's script and the drawing commands, and of nothing else.

    Args:
        title: title of the page.
        latest: commands so far. The thread of the server owns them until ``close`` and adds those that are sent.
        port: port to listen on; 0 finds a free port.
        host: address to listen on; any address except loopback lets other computers watch.
        panel: panel of controls; None for a page that only shows. The address of a page with a panel ends in ``#`` and
            a secret, which its messages need.

    Attributes:
        url: address of the page.
        watching: connected browsers.

    Raises:
        ConfigurationError: the port is in use, or the address is not an address of this computer.
    """

    def __init__(self, title: str, latest: Commands, port: int, host: str, panel: ControlPanel | None = None) -> None:
        try:
            # In the caller's thread, so that a port that is taken is an error there.
            sockets = tornado.netutil.bind_sockets(port, host)
        except OSError as error:
            raise ConfigurationError(f"port {port} on {host} cannot be used: {error.strerror}") from None
        name = f"[{host}]" if ":" in host else host
        self.url = f"http://{name}:{sockets[0].getsockname()[1]}/static/"
        self._panel, self._secret = panel, secrets.token_urlsafe(18)
        if panel is not None:
            self.url += f"#{self._secret}"
        self._latest, self.watching = latest, set[_Browser]()
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(title, host, sockets), name="meshcat", daemon=True)
        self._thread.start()
        self._started.wait()

    def send(self, commands: list[tuple[Key, bytes]]) -> None:
        """Send commands to all browsers, without waiting.

        Args:
            commands: packed commands.
        """
        # The loop of the server owns all state: other threads only hand over.
        self._loop.call_soon_threadsafe(self._send, commands)

    def close(self) -> None:
        """Send the last frame to browsers that still read, and stop serving."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(timeout=5)

    # ------------------------------------------------------------------ in the thread of the server

    def _run(self, title: str, host: str, sockets: list[socket.socket]) -> None:
        asyncio.run(self._serve(title, host, sockets))
        self._wrapper.close()  # tornado would keep it until it creates the next one

    async def _serve(self, title: str, host: str, sockets: list[socket.socket]) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        self._wrapper = tornado.ioloop.IOLoop.current()
        page, commands = pages.live_page(title, None if self._panel is None else self._panel.script), []
        if self._panel is not None:
            commands = [(r"/commands", CommandSocket, {"panel": self._panel, "secret": self._secret})]
        application = tornado.web.Application(
            [
                (r"/static/", _StaticFile, {"kind": "text/html", "text": page.encode()}),
                (r"/static/main.min.js", _StaticFile, {"kind": "text/javascript", "text": pages.VIEWER.read_bytes()}),
                (r"/favicon.ico", _StaticFile, {"kind": "image/x-icon", "text": b""}),
                (r"/", _Browser, {"latest": self._latest, "watching": self.watching}),
                *commands,
            ],
            default_handler_class=_NotFound,
            websocket_max_message_size=_MAX_MESSAGE,
            requests=RequestFilter(host),
            log_function=lambda handler: None,  # requests are not logged to the terminal
        )
        server = tornado.httpserver.HTTPServer(application, **_LIMITS)
        server.add_sockets(sockets)
        self._started.set()
        await self._stop.wait()
        # No new browsers while the last frame is on its way.
        server.stop()
        sending = [browser.sending for browser in self.watching if browser.sending is not None]
        if sending:
            await asyncio.wait(sending, timeout=_CLOSING_TIME)
        # A copy: each disconnection takes its browser out of the set.
        for browser in list(self.watching):
            browser.disconnect()
        self.watching.clear()
        await server.close_all_connections()

    def _send(self, commands: list[tuple[Key, bytes]]) -> None:
        apply_commands(self._latest, commands)
        for browser in self.watching:
            browser.offer(commands)


class _Browser(FilteredHandler, tornado.websocket.WebSocketHandler):
    """Connection to a browser. Messages from the browser are ignored.

    One batch is sent at a time. Meanwhile only the latest command for every node waits. So a browser that is slow, or
    stops reading, needs no more memory than the scene.
    """

    def initialize(self, latest: Commands, watching: set[_Browser]) -> None:
        self._latest, self._watching = latest, watching
        self._waiting: Commands = {}
        self.sending: asyncio.Task[None] | None = None

    def open(self) -> None:
        self._watching.add(self)
        self._stream = self.ws_connection.stream if self.ws_connection is not None else None
        self.offer(list(self._latest.items()))

    def offer(self, commands: list[tuple[Key, bytes]]) -> None:
        apply_commands(self._waiting, commands, keep_deletes=True)
        if self.sending is None:
            self.sending = asyncio.get_running_loop().create_task(self._send())

    async def _send(self) -> None:
        try:
            while self._waiting:
                # While a batch is sent, newer commands replace those that wait: a slow browser skips frames.
                batch, self._waiting = self._waiting, {}
                await self.write_message(pages.bundle(pages.in_order(batch)), binary=True)
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


class _StaticFile(FilteredHandler):
    """Static file of the page."""

    def initialize(self, kind: str, text: bytes) -> None:
        self._kind, self._text = kind, text

    def get(self) -> None:
        self.set_header("Content-Type", f"{self._kind}; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.set_header("Content-Security-Policy", pages.content_policy(f"'self' ws://{self.request.host}"))
        self.write(self._text)


class _NotFound(FilteredHandler):
    """Answer 404 for any other path."""

    def prepare(self) -> None:
        super().prepare()
        raise tornado.web.HTTPError(404)


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
        """Send a drawing command of Meshcat, without waiting.

        Args:
            command: the command.
        """
        self.post(command.lower())

    def post(self, command: Mapping[str, object], single: bool = False) -> None:
        """Send a drawing command in the format of the viewer (Meshcat or ``page.js``), without waiting.

        Args:
            command: command with its "type" and "path".
            single: pack floats in single precision.
        """
        # Meshcat and this package write paths with and without a slash: one node has one key.
        path = "/".join(part for part in str(command.get("path", "")).split("/") if part)
        kind = str(command["type"])
        key = path, f"{kind} {command['property']}" if kind == "set_property" else kind
        self.put(key, umsgpack.packb(command, force_float_precision="single" if single else "double"))

    def place(self, path: str, matrix: np.ndarray) -> None:
        """Set the transform (4, 4) of a node, at a tenth of the cost of ``post``; every frame sets all transforms.

        Args:
            path: path of the node.
            matrix: the transform, which may include a scale.
        """
        head = self._heads.get(path)
        if head is None:
            words = [umsgpack.packb(word) for word in ("type", "set_transform", "path", path, "matrix")]
            head = self._heads[path] = b"\x83" + b"".join(words) + b"\xdc\x00\x10"
        # A record array packs sixteen numbers in one copy; umsgpack would take one call for each.
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
        """Send a drawing command that is already packed in MessagePack.

        Args:
            key: path and kind of the command.
            data: the packed command.
        """
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
        """Return the scene as one self-contained HTML page; see ``recorded_page``.

        Args:
            begin: pause at this time [s]; None plays immediately.
        """
        return pages.recorded_page(self.title, pages.in_order(self.latest), begin)

    # ------------------------------------------------------------------ serving

    def serve(self, port: int = 0, host: str = LOOPBACK, panel: ControlPanel | None = None) -> str:
        """Serve the scene and return its address; see ``SceneServer``.

        Args:
            port: port; 0 for a free one.
            host: address to serve on.
            panel: panel of controls.
        """
        self._server = SceneServer(self.title, self.latest, port, host, panel)
        self.web_url = self._server.url
        return self.web_url

    @property
    def browsers(self) -> int:
        """Number of connected browsers."""
        return 0 if self._server is None else len(self._server.watching)

    def open(self) -> SceneWindow:
        """Show the page in the user's browser."""
        webbrowser.open(self.web_url, new=2)
        return self

    def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            self._server.close()
            self._server = None
