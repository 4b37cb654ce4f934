"""Access check of a local server: a request must name this computer by one of its own names.

A web site can resolve its own name to 127.0.0.1 (DNS rebinding). Its pages can then read everything that is served
there. The names reveal the attack: a browser sends the requested name as Host and the name of the page as Origin.
"""

from __future__ import annotations

import ipaddress
import logging
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any

from rnc_pin.errors import ConfigurationError

LOOPBACK = "127.0.0.1"
_VISER_MESSAGE = 1_000_000  # [bytes]; messages from viser's page contain camera poses and clicks


def addresses_of(host: str) -> set[str]:
    """Addresses to which this computer resolves a name; empty if there are none."""
    try:
        return {str(info[4][0]).partition("%")[0] for info in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError):
        return set()


def is_loopback(host: str) -> bool:
    """True if only this computer can reach an address. A host name is resolved first."""
    found = addresses_of(host)
    return bool(found) and all(ipaddress.ip_address(address).is_loopback for address in found)


class RequestFilter:
    """Check of the request headers Host and Origin.

    Args:
        host: name or address that the server listens on.
    """

    def __init__(self, host: str) -> None:
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
        return origin is None or origin.lower() in (f"http://{host.lower()}", f"https://{host.lower()}")


@contextmanager
def viser_request_filter(requests: RequestFilter) -> Iterator[None]:
    """Add the access check to a viser server that is started inside the ``with`` block.

    Viser has no setting for it, but it serves through ``websockets``, which can refuse a request before the handshake.
    So this function replaces ``websockets``' ``serve`` while the viser server starts.

    Raises:
        ConfigurationError: the server did not start through ``websockets``.
    """
    from websockets.asyncio import server

    usual, started = server.serve, []
    log = logging.getLogger("rnc_pin.viser")  # of refused requests; silent unless the application adds a handler
    log.addHandler(logging.NullHandler())

    def serve(*arguments: Any, process_request: Any = None, **settings: Any) -> Any:
        def check(connection: Any, request: Any) -> Any:
            hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
            if len(hosts) != 1 or len(origins) > 1 or not requests.allows(hosts[0], origins[0] if origins else None):
                return connection.respond(HTTPStatus.FORBIDDEN, "")
            return None if process_request is None else process_request(connection, request)

        started.append(True)
        return usual(*arguments, **{**settings, "max_size": _VISER_MESSAGE, "logger": log}, process_request=check)

    server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = usual  # type: ignore[misc]
    if not started:
        raise ConfigurationError(
            "PINOCCHIO_VIEWER=viser: this version of viser would answer any web site; install another version, or use "
            "PINOCCHIO_VIEWER=meshcat"
        )
