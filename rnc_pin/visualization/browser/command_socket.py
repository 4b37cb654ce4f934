"""Web socket for the messages of a page's user, and the request check that all handlers share."""

from __future__ import annotations

import hmac
import json
import time
from collections.abc import Callable
from typing import TypeAlias

import tornado.web
import tornado.websocket

from rnc_pin.visualization.browser.access import RequestFilter

Receiver: TypeAlias = Callable[[object], object]
"""Function for one message of a user, decoded from JSON and otherwise unchecked."""

_RATE, _BURST = 100.0, 200.0  # messages per second of one page, and at once


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

    def initialize(self, receive: Receiver, secret: str) -> None:
        self._receive, self._secret = receive, secret
        self._admitted = False
        self._allowance, self._last = _BURST, time.monotonic()

    def prepare(self) -> None:
        super().prepare()
        if self.request.headers.get("Origin") is None:  # a browser always sends it
            raise tornado.web.HTTPError(403)

    def on_message(self, message: str | bytes) -> None:
        now = time.monotonic()
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
        self._admitted = isinstance(told, str) and hmac.compare_digest(told.encode(), self._secret.encode())
        if not self._admitted:
            self.close(4003, "wrong secret")
