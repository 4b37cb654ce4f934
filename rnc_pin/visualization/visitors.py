"""Access check of a local server: a request must name this computer by one of its own names.

A web site can resolve its own name to 127.0.0.1 (DNS rebinding). Its pages can then read everything that is served
there. The names reveal the attack: a browser sends the requested name as Host and the name of the page as Origin.
"""

from __future__ import annotations

import ipaddress
import socket
from urllib.parse import urlsplit


def addresses_of(host: str) -> set[str]:
    """Addresses to which this computer resolves a name; empty if there are none."""
    try:
        return {str(info[4][0]) for info in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError):
        return set()


class RequestFilter:
    """Check of the request headers Host and Origin.

    Args:
        host: name or address that the server listens on.
    """

    def __init__(self, host: str) -> None:
        addresses = addresses_of(host)
        # A server on all addresses accepts any numeric address: no list is complete, and DNS cannot redirect a number.
        self._any_address = any(_is_unspecified(address) for address in addresses)
        self._names = {"localhost", host.lower(), *addresses}
        if self._any_address:
            self._names |= {socket.gethostname().lower(), socket.getfqdn().lower()}

    def allows(self, host: str | None, origin: str | None) -> bool:
        """Return True if the server may answer a request.

        Args:
            host: header Host, with or without a port.
            origin: header Origin. Browsers always send it with a web socket; other programs may omit it.
        """
        if not host or not self._is_ours(_name_in(f"//{host}")):
            return False
        return origin is None or (_scheme_is_web(origin) and urlsplit(origin).netloc.lower() == host.lower())

    def _is_ours(self, name: str | None) -> bool:
        if name is None:
            return False
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return name in self._names
        return self._any_address or address.is_loopback or name in self._names


def _name_in(url: str) -> str | None:
    try:
        parts = urlsplit(url)
        _ = parts.port  # raises ValueError if the port is not a number
    except ValueError:
        return None
    return None if parts.path or parts.query or parts.username is not None else parts.hostname


def _scheme_is_web(origin: str) -> bool:
    return _name_in(origin) is not None and urlsplit(origin).scheme in ("http", "https")


def _is_unspecified(address: str) -> bool:
    return ipaddress.ip_address(address.partition("%")[0]).is_unspecified
