"""Meshcat's scene inside this process, served on loopback only or not at all.

Meshcat 0.3.2 starts a server process that listens on every interface, and queues without bound for a browser that
does not read. Here a thread of our own serves its viewer: the web server binds to 127.0.0.1, each browser is sent the
last word on every part as fast as it takes it, and where only a recording is wanted nothing listens anywhere.
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
from rnc_pin.visualization.scene_store import Key, SceneStore, below, key_of
from rnc_pin.visualization.visitors import Visitors, addresses_of

LOOPBACK = "127.0.0.1"
_GOODBYE = 0.5  # [s]
_LONGEST_MESSAGE = 1024  # [bytes]; what browsers send is ignored
_LIMITS = {
    "max_header_size": 16_384,
    "max_body_size": 1024,
    "max_buffer_size": 262_144,
    "idle_connection_timeout": 30.0,
    "body_timeout": 10.0,
}
"""Of what one connection may cost [bytes, s]."""
_PACKED_FLOAT = np.dtype([("mark", "u1"), ("value", ">f8")])  # of MessagePack


def is_loopback(host: str) -> bool:
    """Whether nobody but this computer reaches an address; a name counts as what it stands for here."""
    found = addresses_of(host)
    return bool(found) and all(ipaddress.ip_address(address).is_loopback for address in found)


class Drawing(Protocol):
    """One of Meshcat's commands."""

    def lower(self) -> Mapping[str, object]: ...


class SceneWindow:
    """What Meshcat's ``Visualizer`` writes to. Pass it as ``meshcat.Visualizer(window=...)``.

    Args:
        title: of the page.
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
        """Take one of Meshcat's drawing commands; returns at once."""
        self.post(command.lower())

    def post(self, command: Mapping[str, object], single: bool = False) -> None:
        """Take a drawing command as the viewer gets it, Meshcat's or one of ``page.js``; returns at once.

        Args:
            command: with its "type" and "path".
            single: pack floats in single precision.
        """
        data = umsgpack.packb(command, force_float_precision="single" if single else "double")
        self._put(key_of(command), data)

    def place(self, path: str, matrix: np.ndarray) -> None:
        """Take a transform (4, 4): what ``post`` does at a tenth of the cost, for every part of every picture."""
        head = self._heads.get(path)
        if head is None:
            words = [umsgpack.packb(word) for word in ("type", "set_transform", "path", path, "matrix")]
            head = self._heads[path] = b"\x83" + b"".join(words) + b"\xdc\x00\x10"
        numbers = np.empty(16, _PACKED_FLOAT)
        numbers["mark"], numbers["value"] = 0xCB, matrix.T.ravel()
        self._put((path.strip("/"), "set_transform"), head + numbers.tobytes())

    @contextmanager
    def together(self) -> Iterator[None]:
        """Let browsers have what is drawn inside as one message."""
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
        """The scene as one self-contained HTML page; see ``recorded_page``."""
        return recorded_page(self.title, (data for _, data in self._store.items()), begin)

    # ------------------------------------------------------------------ serving

    def serve(self, port: int = 0, host: str = LOOPBACK) -> str:
        """Serve the scene and return its address.

        Args:
            port: 0 finds a free one.
            host: address to listen on; anything but loopback lets others watch.

        Raises:
            ConfigurationError: the port is taken, or the address is not this machine's.
        """
        try:
            sockets = tornado.netutil.bind_sockets(port, host)
        except OSError as error:
            raise ConfigurationError(f"port {port} on {host} cannot be used: {error.strerror}") from None
        ready = threading.Event()

        def run() -> None:
            self._loop = asyncio.new_event_loop()
            asyncio.set_event_loop(self._loop)
            server = tornado.httpserver.HTTPServer(self._application(Visitors(host)), **_LIMITS)
            server.add_sockets(sockets)
            around = tornado.ioloop.IOLoop.current()
            self._loop.call_soon(ready.set)
            self._loop.run_forever()
            server.stop()
            self._loop.run_until_complete(self._say_goodbye())
            self._loop.run_until_complete(server.close_all_connections())
            self._loop.run_until_complete(_end_tasks())
            asyncio.set_event_loop(None)
            around.close()  # and the loop; tornado would keep it until the next one is made

        self._thread = threading.Thread(target=run, name="meshcat", daemon=True)
        self._thread.start()
        ready.wait()
        name = f"[{host}]" if ":" in host else host
        self.web_url = f"http://{name}:{sockets[0].getsockname()[1]}/static/"
        return self.web_url

    async def _say_goodbye(self) -> None:
        """Let browsers have the last picture, those that still read."""
        sending = [browser.sending for browser in self._watching if browser.sending is not None]
        if sending:
            _, stuck = await asyncio.wait(sending, timeout=_GOODBYE)
            for task in stuck:
                task.cancel()
            await asyncio.gather(*stuck, return_exceptions=True)
        for browser in list(self._watching):
            browser.hang_up()
        self._watching.clear()

    def _application(self, visitors: Visitors) -> tornado.web.Application:
        page = live_page(self.title).encode()
        return tornado.web.Application(
            [
                (r"/static/", _Text, {"kind": "text/html", "text": page}),
                (r"/static/main.min.js", _Text, {"kind": "text/javascript", "text": VIEWER.read_bytes()}),
                (r"/favicon.ico", _NoIcon),
                (r"/", _Browser, {"store": self._store, "watching": self._watching}),
            ],
            default_handler_class=_Nothing,
            websocket_max_message_size=_LONGEST_MESSAGE,
            visitors=visitors,
            log_function=lambda handler: None,  # what strangers ask for is not for the user's terminal
        )

    @property
    def browsers(self) -> int:
        """How many browsers look on."""
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
    """Let nothing that waits for a browser hold on to it."""
    waiting = asyncio.all_tasks() - {asyncio.current_task()}
    for task in waiting:
        task.cancel()
    await asyncio.gather(*waiting, return_exceptions=True)


class _Checked(tornado.web.RequestHandler):
    """Answers those who ask for this computer by a name of its own."""

    def prepare(self) -> None:
        visitors: Visitors = self.settings["visitors"]
        headers = self.request.headers
        if not visitors.admit(headers.get("Host"), headers.get("Origin")):
            raise tornado.web.HTTPError(403)

    def write_error(self, status_code: int, **more: object) -> None:
        self.finish()


class _Browser(_Checked, tornado.websocket.WebSocketHandler):
    """A browser that looks on. What it sends is ignored.

    One batch is under way to it at a time. Of what comes meanwhile only the last word on every part waits, so a
    browser that is slow, or reads no more, costs no more memory than the scene has.
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
                for each in [each for each in self._waiting if below(each[0], key[0])]:
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
            self._watching.discard(self)  # gone, and what was under way to it too
        finally:
            self.sending = None

    def hang_up(self) -> None:
        """Close the connection, whatever the other end does."""
        self.close()
        if self._stream is not None:
            self._stream.close()

    def on_message(self, message: str | bytes) -> None:
        pass

    def on_close(self) -> None:
        self._watching.discard(self)


class _Text(_Checked):
    """A file of the page."""

    def initialize(self, kind: str, text: bytes) -> None:
        self._kind, self._text = kind, text

    def get(self) -> None:
        self.set_header("Content-Type", f"{self._kind}; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.write(self._text)


class _NoIcon(_Checked):
    """Browsers ask for an icon; there is none, and that is no error."""

    def get(self) -> None:
        self.set_status(204)


class _Nothing(_Checked):
    """What is not there."""

    def prepare(self) -> None:
        super().prepare()
        raise tornado.web.HTTPError(404)
