"""Who is served: pages and programs that ask for this computer by a name of its own.

A page of any web site can let its own name stand for 127.0.0.1 (DNS rebinding), and then read what is served there as
if it were its own. What gives it away is the name, which a browser sends as Host, and the page's, sent as Origin.
"""

from __future__ import annotations

import ipaddress
import socket
from urllib.parse import urlsplit


def addresses_of(host: str) -> set[str]:
    """Addresses that a name stands for here; none where it stands for nothing."""
    try:
        return {str(info[4][0]) for info in socket.getaddrinfo(host, None)}
    except (OSError, UnicodeError):
        return set()


class Visitors:
    """Decides by the headers of a request.

    Args:
        host: name or address that is listened on.
    """

    def __init__(self, host: str) -> None:
        addresses = addresses_of(host)
        # On all addresses no list of them is complete; one that is no name cannot be made to stand for another.
        self._any_address = any(_is_unspecified(address) for address in addresses)
        self._names = {"localhost", host.lower(), *addresses}
        if self._any_address:
            self._names |= {socket.gethostname().lower(), socket.getfqdn().lower()}

    def admit(self, host: str | None, origin: str | None) -> bool:
        """Whether to answer.

        Args:
            host: the header of this name, with or without a port.
            origin: likewise; browsers always send it with a web socket, other programs need not.
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
        _ = parts.port  # raises where there is no number
    except ValueError:
        return None
    return None if parts.path or parts.query or parts.username is not None else parts.hostname


def _scheme_is_web(origin: str) -> bool:
    return _name_in(origin) is not None and urlsplit(origin).scheme in ("http", "https")


def _is_unspecified(address: str) -> bool:
    return ipaddress.ip_address(address.partition("%")[0]).is_unspecified
